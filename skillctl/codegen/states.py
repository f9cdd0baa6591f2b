"""States at which a skill in another language is compared with the skill itself."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.codegen.tables import inner_of
from skillctl.model.chained import ChainedSkill
from skillctl.model.controller import Controller
from skillctl.model.coordinates.keep_out import KeepOut
from skillctl.model.limits import Limits
from skillctl.model.skill import Skill, extent
from skillctl.model.space import Space

FAR = (1.0, 10.0, 1e3)  # extents away
NEAR = (1e-6, 1e-3, 0.1)
SEAM = 0.05  # [rad] beside half a turn from a target
SLOW = 1e-6  # commands that are no faster get no limit: a share of rounding is none
OUTSIDE = 1.1  # times √V at the end of a stage
AROUND = (0.5, 2.5)  # radii of a body away from its pole: in it, near it, and at the end of its influence


def stepped(controller: Controller, state: FloatArray, limits: Limits, busy: bool = False) -> FloatArray:
    """Return the command (d,) of a controller for a state (d,) within limits of its speed."""
    speed, turn = (None if limit == math.inf else limit for limit in (limits.speed, limits.turn))
    return controller.step(state, max_speed=speed, max_turn=turn, busy=busy)


def capped(speeds: tuple[float, float], shares: tuple[float, float]) -> Limits:
    """Return limits that are shares of speeds; none where nothing moves."""
    speed, turn = (share * v if v > SLOW else math.inf for v, share in zip(speeds, shares, strict=True))
    return Limits(speed=speed, turn=turn)


def states_around(skill: Skill, count: int, taught: Sequence[FloatArray], seed: int = 0) -> FloatArray:
    """Return states (count, d): taught, beside those, at targets, half a turn away, far, between, at bodies.

    Args:
        skill: The skill.
        count: How many.
        taught: Its demonstrations, (n, d) each; without any, states are drawn from its densities.
        seed: Of the draws.
    """
    rng, space, d = np.random.default_rng(seed), skill.space, skill.dimension
    size = extent(skill.density)
    known = np.concatenate(taught) if taught else _drawn(skill, count, rng)

    def picked(of: FloatArray, n: int) -> FloatArray:
        return of[rng.integers(len(of), size=n)]

    def moved(states: FloatArray, sizes: tuple[float, ...]) -> FloatArray:
        scale = size * rng.choice(sizes, size=(len(states), 1))
        return space.displace(states, scale * rng.standard_normal((len(states), d)))

    ends = np.stack([part.attractor for part in skill.acting_parts])
    each = -(-count // 7)
    first, second = picked(known, each), picked(known, each)
    between = space.displace(first, rng.uniform(size=(each, 1)) * space.difference(second, first))
    kinds = [
        picked(known, each),
        moved(picked(known, each), NEAR),
        moved(picked(ends, each), NEAR),
        moved(picked(known, each), FAR),
        between,
        _turned_half(space, picked(ends, each), rng),
        _beside_bodies(skill, picked(known, each), rng),
    ]
    return np.stack(kinds, axis=1).reshape(-1, d)[:count]


def stage_ends(chain: ChainedSkill, count: int, rng: np.random.Generator) -> list[tuple[int, FloatArray]]:
    """Return stages, each with a state (d,) at which it is nearly over: √V is a little above its level."""
    ends = []
    for index in range(count):
        part = chain.acting_parts[index % len(chain.acting_parts)]
        stage = chain.stage_of(index % len(chain.acting_parts))
        y = rng.standard_normal(chain.dimension)
        y *= OUTSIDE * np.sqrt(chain.levels[stage] / (y @ part.lyapunov @ y))
        ends.append((stage, chain.space.placed_at(part.coordinates.back_at(y), part.attractor)))
    return ends


def _turned_half(space: Space, states: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return states (n, d) turned by about half a turn about any axis, if they can turn."""
    differences = np.zeros_like(states)
    axes = rng.standard_normal((len(states), states.shape[1] - space.positions))
    angles = np.pi + SEAM * rng.standard_normal((len(states), 1))
    differences[:, space.positions :] = angles * axes / np.linalg.norm(axes, axis=1, keepdims=True)
    return space.displace(states, differences)


def _drawn(skill: Skill, count: int, rng: np.random.Generator) -> FloatArray:
    """Return states (at least count, d) from the densities of the leaves."""
    drawn = []
    for leaf in skill.leaves:
        density = leaf.density
        which = rng.choice(len(density.priors), size=count, p=density.priors)
        roots = np.linalg.cholesky(density.covariances)[which]
        charted = density.means[which] + np.einsum(
            "nij,nj->ni", roots, rng.standard_normal((count, skill.dimension))
        )
        drawn.append(leaf.uncharted(charted))
    return np.concatenate(drawn)


def _beside_bodies(skill: Skill, states: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return states (n, d) with positions around the bodies that are kept out, if there are any."""
    bodies = [
        (part.attractor[: len(gauge.pole)] + gauge.pole, gauge.radius)
        for part in skill.acting_parts
        for link in part.coordinates.links
        if isinstance(keep_out := inner_of(link)[0], KeepOut)
        for gauge in keep_out.gauges
    ]
    for state in states if bodies else ():
        pole, radius = bodies[rng.integers(len(bodies))]
        direction = rng.standard_normal(len(pole))
        away = radius * rng.uniform(*AROUND)
        state[: len(pole)] = pole + away / np.linalg.norm(direction) * direction
    return states
