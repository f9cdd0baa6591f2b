"""Random starts, skills and bodies, in the plane and in space: does any motion enter, does any not arrive?

python tests/torture/keep_out.py [starts] [skills]
"""

from __future__ import annotations

import sys
import time

import numpy as np

from skillctl.errors import UsageError
from skillctl.model.coordinates.bodies import Ball, Box, Cylinder, Ellipsoid
from skillctl.model.kept_out import kept_out
from skillctl.model.mixture import GaussianMixture
from skillctl.model.seds import SedsSkill
from skillctl.model.space import Euclidean
from skillctl.model.stepper import Stepper

PERIOD, DURATION, ARRIVED = 0.02, 60.0, 1e-3  # [s], [s], [m]
MARGIN = 0.01  # [m]


def random_skill(rng, d, k=4):
    """A mixture over about 0.4 m whose components all contract under I, at 0.5 1/s or more."""
    loss, turn = rng.normal(0, 0.7, (2, k, d, d))
    matrices = -(loss @ loss.swapaxes(1, 2)) - 0.5 * np.eye(d) + turn - turn.swapaxes(1, 2)
    factors = rng.normal(0, 0.08, (k, d, d))
    covariances = factors @ factors.swapaxes(1, 2) + 0.003 * np.eye(d)
    covariances = 0.5 * (covariances + covariances.swapaxes(1, 2))
    means, priors = rng.normal(0, 0.2, (k, d)), rng.dirichlet(np.full(k, 5.0))
    return SedsSkill(
        priors=priors, means=means, covariances=covariances, system_matrices=matrices,
        residual_covariances=covariances, attractor=rng.normal(0, 0.2, d), lyapunov=np.eye(d),
        density=GaussianMixture(priors, means, covariances), space=Euclidean.cartesian(d),
    )  # fmt: skip


def random_body(rng, d, target, number):
    """A body of a few centimetres, 10 to 40 cm from the target, turned at random."""
    away = rng.normal(size=d)
    centre = tuple((target + rng.uniform(0.1, 0.4) * away / np.linalg.norm(away)).tolist())
    sizes = tuple(rng.uniform(0.02, 0.12, d).tolist())
    turn = tuple(rng.normal(0, 1, d * (d - 1) // 2).tolist())
    kinds = [
        lambda: Ball(f"ball {number}", centre, sizes[0]),
        lambda: Ellipsoid(f"ellipsoid {number}", centre, sizes, turn=turn),
        lambda: Box(f"box {number}", centre, sizes, turn=turn),
        lambda: Cylinder(f"cylinder {number}", centre, 0.5 * sizes[0], 2 * sizes[1], turn=turn),
    ]
    return kinds[rng.integers(4 if d == 3 else 3)]()


def random_scene(rng, skill):
    """A skill among one to five bodies that it can keep out of together."""
    while True:
        count = rng.integers(1, 6)
        bodies = [random_body(rng, skill.dimension, skill.attractor, i) for i in range(count)]
        try:
            return bodies, kept_out(skill, bodies, margin=MARGIN)
        except UsageError:
            continue


def main(starts=10_000, skills=30):
    """Print how many motions there were, entered, arrived, and were nudged, and what a step costs."""
    totals = np.zeros(5, dtype=int)  # motions, entered, not arrived, nudged, would have entered
    risen, seconds, steps = 0, [], 0
    for number in range(skills):
        d = 2 + number % 2
        rng = np.random.default_rng(number)
        skill = random_skill(rng, d)
        bodies, kept = random_scene(rng, skill)
        link = kept.coordinates.links[0]
        x = skill.attractor + rng.uniform(-0.5, 0.5, (starts, d))
        x = x[~link.inside(x - skill.attractor)]
        totals[0] += len(x)
        plain, crossed = x, np.zeros(len(x), dtype=bool)
        entered, nudged = crossed.copy(), crossed.copy()
        stepper, unaware, v = Stepper(kept, PERIOD), Stepper(skill, PERIOD), kept.v_distance(x)
        for _ in range(round(DURATION / PERIOD)):
            x = stepper.step_many(x).states
            offsets = x - skill.attractor
            entered |= link.inside(offsets)
            nudged |= link.nudged(link.forward(offsets))
            fallen = kept.v_distance(x)
            risen += int(((fallen >= v) & (v > 1e-9)).sum())
            v, steps = fallen, steps + len(x)
            plain = unaware.step_many(plain).states
            crossed |= link.inside(plain - skill.attractor)
            going = np.linalg.norm(offsets, axis=1) >= ARRIVED
            totals += [0, (entered & ~going).sum(), 0, (nudged & ~going).sum(), (crossed & ~going).sum()]
            x, plain, v = x[going], plain[going], v[going]
            entered, nudged, crossed = entered[going], nudged[going], crossed[going]
            if not len(x):
                break
        totals += [0, entered.sum(), (~nudged).sum(), nudged.sum(), crossed.sum()]
        near = [link.back_at(gauge.pole + 0.5 * np.eye(d)[0] * gauge.rounding) for gauge in link.gauges]
        began = time.process_time()
        for state in near * 500:
            link.back_at(link.forward_at(state))
        seconds.append((time.process_time() - began) / (500 * len(near) * len(bodies)))
    motions, inside, missing, aside, before = totals
    print(f"{skills} skills, {motions} motions, {steps} steps")
    print(f"entered a body: {inside} (without keep-out: {before}); V rose at {risen} steps")
    print(f"did not arrive in {DURATION:g} s: {missing}; nudged aside from a pole: {aside}")
    costs = 1e6 * np.array(seconds)
    print(f"there and back near a body: {np.median(costs):.1f} µs a body, {costs.max():.1f} at most")
    return int(inside or missing or risen)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
