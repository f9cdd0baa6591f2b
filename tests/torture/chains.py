"""Random chains from random starts: does each stage end within its bound, and all motions at the last target?

python tests/torture/chains.py [chains] [starts] [seed]
"""

from __future__ import annotations

import sys
import time
from contextlib import suppress

import numpy as np

from skillctl.compose.chain import chained
from skillctl.model.combined import CombinedSkill
from skillctl.model.coordinates.chain import Chain, OnPosition
from skillctl.model.coordinates.shears import Shears
from skillctl.model.merged import MergedSkill
from skillctl.model.mixture import GaussianMixture
from skillctl.model.pose import Pose
from skillctl.model.seds import SedsSkill
from skillctl.model.space import Euclidean
from skillctl.stability.certificate import certify
from skillctl.stability.stages import level_within

SPREAD = 0.1  # [m] of what a skill was taught


def spd(rng, k, d, size):
    factors = rng.normal(0, size, (k, d, d))
    squares = factors @ factors.swapaxes(1, 2)
    return 0.5 * (squares + squares.swapaxes(1, 2)) + 0.5 * size**2 * np.eye(d)


def contracting(rng, k, lyapunov):
    """Matrices (k, d, d) with a decay rate of at least 0.5 1/s under P, by construction."""
    d = len(lyapunov)
    loss, turn = rng.normal(0, 1, (2, k, d, d))
    right = -(loss @ loss.swapaxes(1, 2)) - 0.51 * lyapunov + turn - turn.swapaxes(1, 2)
    return np.linalg.solve(lyapunov, right)


def side_by_side(one, other):
    stacked = np.zeros((len(one), 6, 6))
    stacked[:, :3, :3], stacked[:, 3:, 3:] = one, other
    return stacked


def shears(rng, d):
    linear = np.triu(rng.normal(0, 0.2, (d, d)), 1) + np.diag(np.exp(rng.normal(0, 0.2, d)))
    spacings = rng.uniform(0.4, 0.6, 3) * SPREAD
    return Shears(
        linear, rng.normal(size=(3, d)), -5 * spacings, spacings, 0.2 * SPREAD * rng.normal(size=(3, 11, d))
    )


def learned(rng, space, target, lyapunov, coordinates):
    k, d, c = int(rng.integers(1, 5)), space.dimension, space.positions
    matrices = contracting(rng, k, lyapunov[:c, :c])
    covariances = spd(rng, k, d, SPREAD)
    if c < d:
        matrices = side_by_side(matrices, contracting(rng, k, np.eye(3)))
    anchor = space.anchor(target)
    means, priors = anchor + rng.normal(0, SPREAD, (k, d)), rng.dirichlet(np.full(k, 5.0))
    return SedsSkill(
        priors=priors, means=means, covariances=covariances, system_matrices=matrices,
        residual_covariances=covariances, attractor=target, lyapunov=lyapunov,
        density=GaussianMixture(priors, means, covariances), space=space, coordinates=coordinates,
        speed=float(np.exp(rng.normal(0, 0.3))),
    )  # fmt: skip


def random_target(rng, space):
    return np.concatenate(
        [rng.uniform(-0.5, 0.5, space.positions), rng.normal(0, 0.4, space.dimension - space.positions)]
    )


def random_stage(rng, space, bent):
    """A learned skill, a merger of two, or two combined, with one target or two."""
    c, d = space.positions, space.dimension
    target, kind = random_target(rng, space), rng.choice(["learned", "merged", "combined"])

    def metric():
        lyapunov = np.eye(d)
        lyapunov[:c, :c] = spd(rng, 1, c, 1.0)[0] * np.exp(rng.normal())
        link = shears(rng, c) if bent and rng.random() < 0.5 else None
        links = () if link is None else (link,) if c == d else (OnPosition(link),)
        return lyapunov, Chain(links)

    if kind == "learned":
        return learned(rng, space, target, *metric())
    weights = rng.dirichlet([5.0, 5.0])
    if kind == "merged":
        common = metric()
        return MergedSkill(tuple(learned(rng, space, target, *common) for _ in weights), weights)
    ends = [target, target if rng.random() < 0.5 else random_target(rng, space)]
    return CombinedSkill(tuple(learned(rng, space, end, *metric()) for end in ends), weights)


def random_chain(rng):
    space = Pose(length=0.2) if rng.random() < 0.2 else Euclidean.cartesian(int(rng.integers(2, 7)))
    bent = space.positions <= 3 and rng.random() < 0.3
    stages = [random_stage(rng, space, bent) for _ in range(rng.integers(2, 6))]
    within = rng.uniform(0.003, 0.05, len(stages))
    levels = [level_within(stage, distance) for stage, distance in zip(stages, within, strict=True)]
    events = [(int(rng.integers(1, len(stages) + 1)), event) for event in ("close", "wait 0.3")]
    return chained(stages, levels, events=events, on_jump=rng.choice(["stay", "back"])), within


def stage_steps(chain, starts, period, most):
    """Follow motions until the chain is done: the steps of each stage, (stages, n), and where they end."""
    x, parts = starts.copy(), chain.part_at(starts)
    begun = np.full((len(chain.parts) + 1, len(x)), -1)
    stage_of = np.array([chain.stage_of(part) for part in range(len(chain.acting_parts))])
    for step in range(most + 1):
        parts = chain.onward(x, parts)
        stage, done = stage_of[parts], np.zeros(len(x), dtype=bool)
        for index in chain.stages[-1]:
            if (here := parts == index).any():
                done[here] = chain.acting_parts[index].v_distance(x[here]) ** 2 <= chain.levels[-1]
        reached = np.arange(len(begun))[:, None] <= stage + done
        begun[reached & (begun < 0)] = step
        if done.all():
            break
        for index in np.unique(parts):
            here = (parts == index) & ~done
            x[here] = chain.acting_parts[index].advanced(x[here], period)
    return np.where(begun[1:] < 0, most + 1, np.diff(begun, axis=0)), x


def check(rng, count):
    """Return the faults of one random chain, and bounds over measured times of its stages and as a whole."""
    chain, within = random_chain(rng)
    certificate = certify(chain)
    course = certificate.course
    if certificate.verdict != "stable" or course is None:
        return [f"not proved: {certificate.failures}"], [], [0.0]
    faults = []
    c = chain.space.positions
    starts = np.hstack([
        rng.uniform(course.low, course.high, (count, c)),
        rng.normal(0, 1.0, (count, chain.dimension - c)),
    ])  # fmt: skip
    steps, ends = stage_steps(chain, starts, course.period, course.steps)
    bounds = np.array([stage.steps for stage in course.stages])
    if (steps > bounds[:, None]).any():
        faults.append(f"steps {steps.max(axis=1).tolist()} are more than {bounds.tolist()}")
    away = chain.space.distance(ends[:, None], chain.attractors).min(axis=1)
    if away.max() > course.stages[-1].within:
        faults.append(f"{away.max():.3g} from the last target; proved is {course.stages[-1].within:.3g}")
    if any(stage.within > distance for stage, distance in zip(course.stages, within, strict=True)):
        faults.append(f"over within {[stage.within for stage in course.stages]}; asked for {within.tolist()}")
    slowest = steps.max(axis=1)
    return (
        faults,
        (bounds / np.maximum(slowest, 1))[slowest > 0].tolist(),
        [bounds.sum() / steps.sum(axis=0).max()],
    )


def main() -> int:
    count, starts, seed = (int(word) for word in [*sys.argv[1:], *["100", "20", "0"][len(sys.argv) - 1 :]])
    stages: list[float] = []
    wholes: list[float] = []
    began, bad = time.perf_counter(), 0
    with suppress(KeyboardInterrupt):  # what was seen until then is told
        for number in range(count):
            faults, of_stages, of_whole = check(np.random.default_rng([seed, number]), starts)
            stages, wholes, bad = stages + of_stages, wholes + of_whole, bad + bool(faults)
            for fault in faults:
                print(f"chain {number}: {fault}", flush=True)
    for name, ratios in (("stages", stages), ("whole chains", wholes)):
        low, middle, high = np.percentile(ratios, [0, 50, 95])
        figures = f"at least {low:.2f}, median {middle:.2f}, 95 % below {high:.1f}"
        print(f"bound over the slowest motion, {name}: {figures}")
    print(f"{len(wholes)} chains x {starts} starts, {bad} at fault, {time.perf_counter() - began:.0f} s")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
