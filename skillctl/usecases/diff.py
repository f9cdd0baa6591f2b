"""What tells two skills apart: identity, metadata, parameters, behaviour, and what is proved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.geometry import box
from skillctl.model.rollout import rollout
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import Skill
from skillctl.stability.certificate import certify
from skillctl.stability.report import Certificate
from skillctl.store import Lock, metadata_of
from skillctl.store.source import Source, open_skill

DEFAULT_TOLERANCE = 1e-9  # far above what rounding does to a velocity, far below what an arm can follow
GRID_POINTS = 1000  # at most
STEPS = 400  # of a rollout, for the longest demonstration
PATIENCE = 3  # rollouts may take so many times the longest demonstration
MARGIN = 0.1  # the grid reaches beyond all demonstrations by this share of their extent


@dataclass(frozen=True)
class Side:
    """One of the two skills."""

    skill: str
    path: Path
    digest: str


@dataclass(frozen=True)
class Change:
    """A metadata field with two values; None where a side does not have it."""

    field: str
    a: Any
    b: Any


@dataclass(frozen=True, eq=False)
class LeafDifference:
    """How far the numbers of two leaves are apart, components matched by means and covariances.

    Attributes:
        leaf: Counted from 1, from left to right.
        matched: Component of b for each component of a, counted from 1; None for one without a partner.
        unmatched: Components of either side without a partner.
        attractor: Distance, [unit].
        priors: Largest difference over matched components.
        means: Largest distance over matched components, [unit].
        covariances, system_matrices, lyapunov: Largest relative difference ‖a − b‖ / ‖a‖ (Frobenius).
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


@dataclass(frozen=True)
class FieldDifference:
    """How far velocities are apart over some points.

    Attributes:
        points: How many.
        greatest, rms: Of ‖f_a − f_b‖, [unit/s].
        speed: Greatest ‖f_a‖ there, for comparison, [unit/s].
        within: Whether ‖f_a − f_b‖ ≤ atol + rtol ‖f_a‖ at every point.
    """

    points: int
    greatest: float
    rms: float
    speed: float
    within: bool


@dataclass(frozen=True)
class Behaviour:
    """How differently two skills move. None where there are no demonstrations, or no common space.

    Attributes:
        demonstrations: Velocities on the embedded demonstrations of both.
        grid: Velocities on a grid around them.
        rollouts: Greatest distance of motions from the same starts, at the same time, [unit].
        attractors: Greatest distance of attractors, [unit]; None if their numbers differ.
        same: Whether all of it lies within the tolerances.
    """

    demonstrations: FieldDifference | None
    grid: FieldDifference | None
    rollouts: float | None
    attractors: float | None
    same: bool


@dataclass(frozen=True, eq=False)
class DiffReport:
    """What tells two skills apart.

    Attributes:
        a, b: The skills.
        identical: Equal content digests: nothing differs.
        differs: Behaviour or certificate differ by more than the tolerances.
        atol, rtol: These tolerances.
        unit: Of positions.
        metadata: Fields that differ.
        leaves: Numbers of the leaves; None if the skills are not made of equally many, in one space.
        behaviour: How differently they move.
        certificates: What is proved of a and b, derived now.
        proofs_agree: Same verdict and scope, rates and periods within the tolerances.
    """

    a: Side
    b: Side
    identical: bool
    differs: bool
    atol: float
    rtol: float
    unit: str
    metadata: tuple[Change, ...]
    leaves: tuple[LeafDifference, ...] | None
    behaviour: Behaviour
    certificates: tuple[Certificate, Certificate]
    proofs_agree: bool


def diff(
    first: str | Path,
    second: str | Path,
    *,
    atol: float = DEFAULT_TOLERANCE,
    rtol: float = DEFAULT_TOLERANCE,
    store: Path | None = None,
    lock: Lock | None = None,
) -> DiffReport:
    """Compare two skills.

    Args:
        first: Reference of a.
        second: Reference of b.
        atol: Velocities, positions and rates may differ by so much, in their units, and
        rtol: by this share of what a has.
        store: Where names live; default as on the command line.
        lock: Allow only skills that it names.

    Raises:
        UsageError: A negative tolerance.
        NotFoundError, ArtifactError: A reference leads to no intact skill.
    """
    if not (atol >= 0 and rtol >= 0):
        raise UsageError("--atol and --rtol: must not be negative.")
    sources = source_a, source_b = open_skill(first, store, lock), open_skill(second, store, lock)
    a, b = source_a.skill, source_b.skill
    certificates = (certify(a), certify(b))
    proofs_agree = _agree(*certificates, atol, rtol)
    with np.errstate(all="ignore"):  # an unstable skill's motions may leave float64: then they differ
        behaviour = _behaviour(sources, atol, rtol)
    sides = [Side(s.name, s.located.path, s.artifact.digest) for s in sources]
    metadata = _changes(metadata_of(source_a.artifact), metadata_of(source_b.artifact))
    return DiffReport(
        sides[0],
        sides[1],
        identical=sides[0].digest == sides[1].digest,
        differs=not (behaviour.same and proofs_agree),
        atol=atol,
        rtol=rtol,
        unit=a.space.unit,
        metadata=metadata,
        leaves=_leaf_differences(a, b),
        behaviour=behaviour,
        certificates=certificates,
        proofs_agree=proofs_agree,
    )


# Metadata


def _changes(a: Any, b: Any, path: str = "") -> tuple[Change, ...]:
    """Return every leaf of two JSON values that differs, by its dotted path."""
    if isinstance(a, dict) and isinstance(b, dict):
        keys = sorted(a.keys() | b.keys())
        found = (_changes(a.get(key), b.get(key), f"{path}.{key}".lstrip(".")) for key in keys)
        return tuple(change for changes in found for change in changes)
    nested = all(isinstance(value, list) and any(isinstance(v, dict) for v in value) for value in (a, b))
    if nested and len(a) == len(b):
        found = (_changes(x, y, f"{path}.{index}") for index, (x, y) in enumerate(zip(a, b, strict=True)))
        return tuple(change for changes in found for change in changes)
    return () if a == b else (Change(path, a, b),)


# Parameters


def _leaf_differences(a: Skill, b: Skill) -> tuple[LeafDifference, ...] | None:
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
    return LeafDifference(
        leaf=number,
        matched=tuple(partner[i] + 1 if i in partner else None for i in range(a.n_components)),
        unmatched=a.n_components + b.n_components - 2 * len(pairs),
        attractor=float(np.linalg.norm(a.attractor - b.attractor)),
        priors=float(np.abs(a.priors[rows_a] - b.priors[rows_b]).max()),
        means=float(np.linalg.norm(a.means[rows_a] - b.means[rows_b], axis=1).max()),
        covariances=_relative(a.covariances[rows_a], b.covariances[rows_b]),
        system_matrices=_relative(a.component_matrices[rows_a], b.component_matrices[rows_b]),
        lyapunov=_relative(a.lyapunov[None], b.lyapunov[None]),
    )


def matched_components(a: SedsSkill, b: SedsSkill) -> list[tuple[int, int]]:
    """Return pairs of components that lie nearest, each in one pair, nearest pairs first served.

    The distance is ‖μ_a − μ_b‖² + ‖Σ_a − Σ_b‖ (Frobenius); ours.
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


# Behaviour


def _behaviour(sources: Sequence[Source], atol: float, rtol: float) -> Behaviour:
    a, b = (source.skill for source in sources)
    if a.space != b.space:
        return Behaviour(None, None, None, None, same=False)
    taught = [
        motion for source in sources for motions in source.artifact.demonstrations for motion in motions or ()
    ]
    goals = (a.attractors, b.attractors)
    points = np.concatenate([motion.positions for motion in taught] if taught else [*goals, _means_of(a)])
    grid = _field(a, b, _grid(points), atol, rtol)
    shown, distance = None, None
    scale = float(np.ptp(points, axis=0).max())
    if taught:
        shown = _field(a, b, points, atol, rtol)
        starts = np.stack([motion.positions[0] for motion in taught])
        distance = _rollout_distance(a, b, starts, max(motion.duration for motion in taught))
    apart = (
        float(np.linalg.norm(goals[0] - goals[1], axis=1).max()) if len(goals[0]) == len(goals[1]) else None
    )
    lengths = [length for length in (distance, np.inf if apart is None else apart) if length is not None]
    same = (
        grid.within
        and (shown is None or shown.within)
        and all(length <= atol + rtol * scale for length in lengths)
    )
    return Behaviour(shown, grid, distance, apart, same=bool(same))


def _means_of(skill: Skill) -> FloatArray:
    """Return the means of all components, shape (K, d)."""
    return np.concatenate([leaf.means for leaf in skill.leaves])


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


def _field(a: Skill, b: Skill, points: FloatArray, atol: float, rtol: float) -> FieldDifference:
    velocities = a.velocity(points)
    apart = np.linalg.norm(velocities - b.velocity(points), axis=1)
    speeds = np.linalg.norm(velocities, axis=1)
    return FieldDifference(
        points=len(points),
        greatest=float(apart.max()),
        rms=float(np.sqrt(np.mean(apart**2))),
        speed=float(speeds.max()),
        within=bool((apart <= atol + rtol * speeds).all()),
    )


def _rollout_distance(a: Skill, b: Skill, starts: FloatArray, longest: float) -> float:
    paths = [
        rollout(skill, starts, duration=PATIENCE * longest, period=longest / STEPS).positions
        for skill in (a, b)
    ]
    length = max(path.shape[1] for path in paths)
    # One that has arrived rests while the other goes on.
    first, second = (
        np.concatenate([path, np.repeat(path[:, -1:], length - path.shape[1], axis=1)], axis=1)
        for path in paths
    )
    return float(np.linalg.norm(first - second, axis=2).max())


# Proofs


def _agree(a: Certificate, b: Certificate, atol: float, rtol: float) -> bool:
    def close(x: float | None, y: float | None) -> bool:
        return x == y or (x is not None and y is not None and abs(x - y) <= atol + rtol * abs(x))

    same = (a.verdict, a.scope) == (b.verdict, b.scope)
    return same and close(a.rate, b.rate) and close(a.period, b.period)
