"""How differently two skills move, and how far apart their numbers and proofs are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.geometry import box
from skillctl.model.chained import ChainedSkill
from skillctl.model.demonstration import Demonstration
from skillctl.model.rollout import rollout
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import Skill
from skillctl.stability.report import Certificate

GRID_POINTS = 1000  # at most
STEPS = 400  # of a rollout, for the longest demonstration
PATIENCE = 3  # a rollout may take this many times as long as the longest demonstration
MARGIN = 0.1  # the grid reaches beyond all demonstrations by this share of their extent


@dataclass(frozen=True, eq=False)
class LeafDifference:
    """How far apart the numbers of two leaves are, components matched by means and covariances.

    Angles are between orientations, [rad], and None where there are none.

    Attributes:
        leaf: Counted from 1, from left to right.
        matched: Component of b for each component of a, counted from 1; None for one without a partner.
        unmatched: Components of either side without a partner.
        attractor: Distance, [unit].
        priors: Largest difference over matched components.
        means: Largest distance over matched components, [unit].
        covariances, system_matrices, lyapunov: Largest relative difference ‖a − b‖ / ‖a‖ (Frobenius).
        coordinates: Whether both have the same ones.
        attractor_angle: Angle between the attractors.
        means_angle: Largest over matched components.
    """

    leaf: int
    matched: tuple[int | None, ...]
    unmatched: int
    attractor: float
    priors: float
    means: float
    covariances: float
    system_matrices: float
    lyapunov: float
    coordinates: bool
    attractor_angle: float | None
    means_angle: float | None


@dataclass(frozen=True)
class FieldDifference:
    """How far apart velocities are over some points.

    Attributes:
        points: How many.
        greatest, rms: Of ‖f_a − f_b‖, [unit/s].
        speed: Greatest ‖f_a‖ there, for comparison, [unit/s].
        within: Whether ‖f_a − f_b‖ ≤ atol + rtol ‖f_a‖ at every point, and likewise of turning.
        greatest_turn, rms_turn, turn: As ``greatest``, ``rms`` and ``speed``, of turning, [rad/s];
            None if they do not.
    """

    points: int
    greatest: float
    rms: float
    speed: float
    within: bool
    greatest_turn: float | None = None
    rms_turn: float | None = None
    turn: float | None = None


@dataclass(frozen=True)
class Behaviour:
    """How differently two skills move. None where there are no demonstrations, or no common space.

    Attributes:
        demonstrations: Velocities on the embedded demonstrations of both; of chains whichever part acts, and
            None if their stages have other numbers of parts.
        grid: Velocities on a grid around them.
        rollouts: Greatest distance of motions from the same starts, at the same time, [unit].
        attractors: Greatest distance of attractors, [unit]; None if their numbers differ.
        same: Whether all of it lies within the tolerances.
        rollouts_angle, attractors_angle: Greatest angles likewise, [rad]; None without orientation.
        incomparable: Why velocities are not compared; None if they are.
    """

    demonstrations: FieldDifference | None
    grid: FieldDifference | None
    rollouts: float | None
    attractors: float | None
    same: bool
    rollouts_angle: float | None = None
    attractors_angle: float | None = None
    incomparable: Literal["other spaces", "other stages"] | None = None


def leaf_differences(a: Skill, b: Skill) -> tuple[LeafDifference, ...] | None:
    """Return how far apart the leaves of two skills are; None for other numbers of leaves or other spaces."""
    if len(a.leaves) != len(b.leaves) or a.space != b.space:
        return None
    return tuple(
        _leaf_difference(number, x, y)
        for number, (x, y) in enumerate(zip(a.leaves, b.leaves, strict=True), start=1)
    )


def _leaf_difference(number: int, a: SedsSkill, b: SedsSkill) -> LeafDifference:
    pairs = matched_components(a, b)
    rows_a, rows_b = [i for i, _ in pairs], [j for _, j in pairs]
    partner = dict(pairs)
    attractor, attractor_angle = _greatest(*a.space.apart(a.attractor[None], b.attractor[None]))
    states = a.uncharted(a.means[rows_a]), b.uncharted(b.means[rows_b])
    means, means_angle = _greatest(*a.space.apart(*states))
    return LeafDifference(
        leaf=number,
        matched=tuple(partner[i] + 1 if i in partner else None for i in range(a.n_components)),
        unmatched=a.n_components + b.n_components - 2 * len(pairs),
        attractor=attractor,
        priors=float(np.abs(a.priors[rows_a] - b.priors[rows_b]).max()),
        means=means,
        covariances=_relative(a.covariances[rows_a], b.covariances[rows_b]),
        system_matrices=_relative(a.component_matrices[rows_a], b.component_matrices[rows_b]),
        lyapunov=_relative(a.lyapunov[None], b.lyapunov[None]),
        coordinates=a.coordinates == b.coordinates,
        attractor_angle=attractor_angle,
        means_angle=means_angle,
    )


def _greatest(distances: FloatArray, angles: FloatArray | None) -> tuple[float, float | None]:
    """Return the largest distance, and the largest angle if there are angles."""
    return float(distances.max()), None if angles is None else float(angles.max())


def matched_components(a: SedsSkill, b: SedsSkill) -> list[tuple[int, int]]:
    """Return pairs (component of a, component of b), each component in at most one pair, sorted.

    The nearest two components that are still free form the next pair, until one skill has none left. The
    distance is ‖μ_a − μ_b‖² + ‖Σ_a − Σ_b‖ (Frobenius); ours.
    """
    means = ((a.means[:, None] - b.means[None]) ** 2).sum(axis=2)
    spread = np.linalg.norm(a.covariances[:, None] - b.covariances[None], axis=(2, 3))
    order = np.argsort(means + spread, axis=None, kind="stable")
    pairs: dict[int, int] = {}
    taken: set[int] = set()
    for i, j in zip(*np.unravel_index(order, (a.n_components, b.n_components)), strict=True):
        if int(i) not in pairs and int(j) not in taken:
            pairs[int(i)] = int(j)
            taken.add(int(j))
    return sorted(pairs.items())


def _relative(a: FloatArray, b: FloatArray) -> float:
    """Return the largest ‖a − b‖ / ‖a‖ over matrices (n, d, d)."""
    return float((np.linalg.norm(a - b, axis=(1, 2)) / np.linalg.norm(a, axis=(1, 2))).max())


def compare_behaviour(
    a: Skill, b: Skill, taught: Sequence[Demonstration], atol: float, rtol: float
) -> Behaviour:
    """Return how differently two skills move.

    Args:
        a: One skill.
        b: The other.
        taught: Demonstrations that either of them carries.
        atol: Velocities and positions may differ by this much, in their units,
        rtol: plus this share of those of a.
    """
    if a.space != b.space:
        return Behaviour(None, None, None, None, same=False, incomparable="other spaces")
    parts = _compared_parts(a, b)
    goals = (a.attractors, b.attractors)
    means = [leaf.uncharted(leaf.density.means) for leaf in a.leaves]
    points = np.concatenate([motion.positions for motion in taught] if taught else [*goals, *means])
    rollouts: tuple[float | None, float | None] = (None, None)
    with np.errstate(all="ignore"):  # an unstable skill's motions may leave float64: then they differ
        first = a.acting_parts[0]  # a grid over the chart, where no two numbers are one orientation
        places = first.uncharted(_grid(first.charted(points)))
        grid = _field(a, b, places, parts, atol, rtol) if parts else None
        along = _field(a, b, points, parts, atol, rtol) if taught and parts else None
        if taught:
            rollouts = _rollout_distance(a, b, taught)
    apart = _greatest(*a.space.apart(*goals)) if len(goals[0]) == len(goals[1]) else (None, None)
    n = a.space.positions
    near = atol + rtol * float(np.ptp(points[:, :n], axis=0).max()), atol + rtol * np.pi
    same = (
        grid is not None
        and grid.within
        and (along is None or along.within)
        and all(x is None or x <= most for x, most in zip(rollouts, near, strict=True))
        and apart[0] is not None
        and all(x is None or x <= most for x, most in zip(apart, near, strict=True))
    )
    why: Literal["other stages"] | None = None if parts else "other stages"
    return Behaviour(along, grid, rollouts[0], apart[0], same, rollouts[1], apart[1], why)


def _compared_parts(a: Skill, b: Skill) -> Sequence[int | None]:
    """Return the acting parts whose velocities are compared.

    Returns:
        All parts of chains; nothing if a stage of one has more parts than that of the other. Of other skills
        None, for the part that a place selects.
    """
    if "chain" not in (a.kind, b.kind):
        return (None,)
    alike = isinstance(a, ChainedSkill) and isinstance(b, ChainedSkill) and a.stages == b.stages
    return range(len(a.acting_parts)) if alike else ()


def _grid(points: FloatArray) -> FloatArray:
    """Return points that fill the box around ``points`` (n, d), evenly."""
    d = points.shape[1]
    low, high = box(points)
    margin = MARGIN * (high - low).max()
    each = int(GRID_POINTS ** (1 / d) + 1e-9)  # 1000^(1/3) is 9.999…
    if each < 3:  # too many dimensions for a grid: the same random points every time
        return np.random.default_rng(0).uniform(low - margin, high + margin, (GRID_POINTS, d))
    axes = [np.linspace(low[i] - margin, high[i] + margin, each) for i in range(d)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, d)


def _field(
    a: Skill, b: Skill, points: FloatArray, parts: Sequence[int | None], atol: float, rtol: float
) -> FieldDifference:
    velocities = np.concatenate([a.velocity(points, part) for part in parts])
    apart = a.space.magnitudes(velocities - np.concatenate([b.velocity(points, part) for part in parts]))
    speeds = a.space.magnitudes(velocities)
    moves, turns = zip(apart, speeds, strict=True)
    within = [
        bool((x <= atol + rtol * y).all()) for x, y in (moves, turns) if x is not None and y is not None
    ]
    return FieldDifference(len(points), *_figures(*moves), all(within), *_figures(*turns))


def _figures(apart: FloatArray | None, speeds: FloatArray | None) -> tuple[Any, Any, Any]:
    """Return the greatest and root mean square of differences, and the greatest speed; None without them."""
    if apart is None or speeds is None:
        return None, None, None
    return float(apart.max()), float(np.sqrt(np.mean(apart**2))), float(speeds.max())


def _rollout_distance(a: Skill, b: Skill, taught: Sequence[Demonstration]) -> tuple[float, float | None]:
    """Return the greatest distance and angle of motions from the demonstrations' starts, at the same time."""
    starts = np.stack([motion.positions[0] for motion in taught])
    longest = max(motion.duration for motion in taught)
    stages = max(len(skill.parts) if skill.kind == "chain" else 1 for skill in (a, b))
    duration = stages * PATIENCE * longest
    paths = [rollout(skill, starts, duration=duration, period=longest / STEPS).positions for skill in (a, b)]
    length = max(path.shape[1] for path in paths)
    # A motion that has arrived rests while the other goes on.
    first, second = (
        np.concatenate([path, np.repeat(path[:, -1:], length - path.shape[1], axis=1)], axis=1)
        for path in paths
    )
    return _greatest(*a.space.apart(first, second))


def proofs_agree(a: Certificate, b: Certificate, atol: float, rtol: float) -> bool:
    """Return whether two certificates say the same, rates and periods within the tolerances."""

    def close(x: float | None, y: float | None) -> bool:
        return x == y or (x is not None and y is not None and abs(x - y) <= atol + rtol * abs(x))

    same = (a.verdict, a.scope) == (b.verdict, b.scope)
    return same and close(a.rate, b.rate) and close(a.period, b.period)
