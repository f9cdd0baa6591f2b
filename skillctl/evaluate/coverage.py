"""What a combined skill keeps of what its parts were taught, and priors that make it keep more."""

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
from skillctl.model.skill import contraction_period

DURATIONS = 10.0  # of the longest demonstration: enough for a motion to arrive
STEPS = (200, 2000)  # per demonstration duration: at least as fine, and at most as fine, as this
SWEEPS = 50  # over all parts; a handful is enough
SMALLEST_LOG = -600.0  # of a prior relative to the largest: smaller ones are no numbers
BEYOND = 1.0  # how far past the last border a log prior goes that has no next one


@dataclass(frozen=True, slots=True)
class PartCoverage:
    """How well a combined skill keeps what one of its parts was taught.

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
    """Return, for each part, how many of its demonstrations still start and end in it.

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
    """Return priors β with which more motions that start where a part was taught select that part.

    Each part's share of starts that select it counts alike. One log β after the other moves to where the sum
    of the shares is largest, to the middle between two borders, and stays where nothing is gained, until no
    move gains anything: for two parts the best there is, for more a local best.

    Args:
        skill: A combined skill; its own priors are where the search begins.
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

    Each start has one border: where this part becomes the one that is selected. Between borders nothing
    changes.
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


@dataclass(frozen=True, eq=False, slots=True)
class _Taught:
    """Where a part was shown to start, as (n, d) positions now, and how long its longest showing took [s]."""

    starts: FloatArray
    longest: float


def _taught(skill: CombinedSkill, demonstrations: Sequence[DemonstrationSet | None]) -> list[_Taught | None]:
    """Return what each part was taught, laid out from where its attractor is now; None for nothing."""
    if len(demonstrations) != len(skill.leaves):
        raise UsageError(f"demonstrations: expected {len(skill.leaves)} sets, got {len(demonstrations)}.")
    remaining = list(demonstrations)
    found: list[_Taught | None] = []
    for part in skill.parts:
        sets = [remaining.pop(0) for _ in part.leaves]
        motions = [motion for chosen in sets if chosen is not None for motion in chosen]
        if not motions:
            found.append(None)
            continue
        starts = np.stack([part.attractor + (m.positions[0] - m.positions[-1]) for m in motions])
        found.append(_Taught(starts, max(motion.duration for motion in motions)))
    return found


def _ends_at(skill: CombinedSkill, index: int, starts: FloatArray, longest: float) -> npt.NDArray[np.bool_]:
    """Return which motions are at the attractor of part ``index`` after ``DURATIONS`` demonstrations."""
    period = float(np.clip(0.5 * contraction_period(skill), longest / STEPS[1], longest / STEPS[0]))
    result = rollout(skill, starts, duration=DURATIONS * longest, period=period)
    distances = np.linalg.norm(result.positions[:, -1, None] - skill.part_attractors, axis=2)
    return np.asarray(result.arrived & (distances[:, index] == distances.min(axis=1)))
