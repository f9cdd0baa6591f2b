"""How many demonstrations of its parts a combined skill keeps, and priors with which it keeps more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.model.combined import CombinedSkill
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.rollout import rollout
from skillctl.model.skill import Skill, contraction_period

DURATIONS = 10.0  # of the longest demonstration: enough for a motion to arrive
STEPS = (200, 2000)  # per demonstration duration: at least as fine, and at most as fine, as this
SWEEPS = 50  # over all parts; a handful is enough
SMALLEST_LOG = -600.0  # of a prior relative to the largest: much smaller ones underflow to zero
BEYOND = 1.0  # how far a log prior lies beyond the first or last border, where the interval is open


@dataclass(frozen=True, slots=True)
class PartCoverage:
    """How many demonstrations of one of its parts a combined skill keeps.

    Attributes:
        part: Counted from 1.
        demonstrations: Number of embedded demonstrations.
        selected: Share whose start selects this part.
        kept: Share whose start selects it and whose motion ends at its attractor.
    """

    part: int
    demonstrations: int
    selected: float
    kept: float


def coverage(
    skill: CombinedSkill, demonstrations: Sequence[DemonstrationSet | None]
) -> tuple[PartCoverage, ...]:
    """Return, for each part with demonstrations, how many of them still start and end in it.

    A demonstration is a motion relative to its own end point, so it is laid out from where the part's
    attractor is now. Rollouts follow the skill's own gate.

    Args:
        skill: What ``combine`` returned.
        demonstrations: One set per leaf of the skill, None where none is embedded.

    Raises:
        UsageError: Another number of sets than leaves.
    """
    report = []
    for index, taught in enumerate(_taught(skill, demonstrations)):
        if taught is None:
            continue
        selected = skill.part_at(taught.starts) == index
        kept = selected & _ends_at(skill, index, taught.starts, taught.longest)
        report.append(
            PartCoverage(index + 1, len(taught.starts), float(np.mean(selected)), float(np.mean(kept)))
        )
    return tuple(report)


def selected_shares(
    skill: CombinedSkill, demonstrations: Sequence[DemonstrationSet | None]
) -> tuple[tuple[int, float | None], ...]:
    """Return, for each part, how many demonstrations it has and which share of their starts select it.

    As ``coverage``, without following motions. The share is None for a part without demonstrations.
    """
    return tuple(
        (0, None)
        if taught is None
        else (len(taught.starts), float(np.mean(skill.part_at(taught.starts) == index)))
        for index, taught in enumerate(_taught(skill, demonstrations))
    )


def calibrated_priors(skill: CombinedSkill, demonstrations: Sequence[DemonstrationSet | None]) -> FloatArray:
    """Return priors β with which more demonstrated starts of each part select that part.

    The search maximises the sum over the parts of the share of their starts that select them. It moves one
    log β after the other to the middle of the interval in which the sum is largest, until no move increases
    the sum: a global maximum for two parts, a local one for more.

    Args:
        skill: A combined skill; the search begins at its priors.
        demonstrations: As for ``coverage``.

    Returns:
        Positive, summing to one, shape (number of parts,).

    Raises:
        UsageError: Another number of sets than leaves, or no demonstrations at all.

    References:
        Theory page, combine; the search is ours.
    """
    groups = [
        (index, skill.part_scores(taught.starts) - np.log(skill.part_priors))
        for index, taught in enumerate(_taught(skill, demonstrations))
        if taught is not None
    ]
    if not groups:
        raise UsageError(
            "calibrate: the skills carry no demonstrations.", hint="Give --priors, or learn the skills again."
        )
    logs = np.log(skill.part_priors)
    for _ in range(SWEEPS):
        before = logs.copy()
        for part in range(len(logs)):
            logs[part] = _best_log_prior(groups, logs, part)
        if (logs == before).all():
            break
    priors = np.exp(np.maximum(logs - logs.max(), SMALLEST_LOG))
    return np.asarray(priors / priors.sum())


def _best_log_prior(groups: Sequence[tuple[int, FloatArray]], logs: FloatArray, part: int) -> float:
    """Return the value of log β of one part with which the sum of the parts' shares is largest.

    Each start has one border: the value above which it selects this part. Between borders no share changes.
    """
    others = np.delete(np.arange(len(logs)), part)
    borders = np.concatenate(
        [(scores[:, others] + logs[others]).max(axis=1) - scores[:, part] for _, scores in groups]
    )
    edges = np.unique(borders)
    values = [edges[0] - BEYOND, *(0.5 * (edges[1:] + edges[:-1])), edges[-1] + BEYOND]

    def gain(value: float) -> float:
        trial = logs.copy()
        trial[part] = value
        return sum(float(np.mean(np.argmax(scores + trial, axis=1) == index)) for index, scores in groups)

    best = max(values, key=gain)
    return float(best if gain(best) > gain(logs[part]) else logs[part])


def demonstrated_starts(skill: Skill, demonstrations: Sequence[DemonstrationSet | None]) -> FloatArray:
    """Return where demonstrations begin, seen from the attractors where they are now. Shape (n, d).

    Args:
        skill: Any skill.
        demonstrations: One set per leaf, None where none is embedded.
    """
    return np.array(
        [
            leaf.attractor + (motion.positions[0] - motion.positions[-1])
            for leaf, motions in zip(skill.leaves, demonstrations, strict=True)
            for motion in motions or ()
        ]
    )


@dataclass(frozen=True, eq=False, slots=True)
class _Taught:
    """The demonstrations of one part.

    Attributes:
        starts: Where they begin, laid out from where the part's attractor is now. Shape (n, d).
        longest: Duration of the longest, [s].
    """

    starts: FloatArray
    longest: float


def _taught(skill: CombinedSkill, demonstrations: Sequence[DemonstrationSet | None]) -> list[_Taught | None]:
    """Return the demonstrations of each part; None for a part without any."""
    if len(demonstrations) != len(skill.leaves):
        raise UsageError(f"demonstrations: expected {len(skill.leaves)} sets, got {len(demonstrations)}.")
    remaining = iter(demonstrations)
    found: list[_Taught | None] = []
    for part in skill.parts:
        sets = [next(remaining) for _ in part.leaves]
        starts = demonstrated_starts(part, sets)
        durations = [motion.duration for motions in sets for motion in motions or ()]
        found.append(_Taught(starts, max(durations)) if durations else None)
    return found


def _ends_at(skill: CombinedSkill, index: int, starts: FloatArray, longest: float) -> npt.NDArray[np.bool_]:
    """Return which motions are at the attractor of part ``index`` after ``DURATIONS`` demonstrations."""
    period = float(np.clip(0.5 * contraction_period(skill), longest / STEPS[1], longest / STEPS[0]))
    result = rollout(skill, starts, duration=DURATIONS * longest, period=period)
    distances = np.linalg.norm(result.positions[:, -1, None] - skill.part_attractors, axis=2)
    return np.asarray(result.arrived & (distances[:, index] == distances.min(axis=1)))
