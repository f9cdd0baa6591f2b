"""Which part of a combined skill acts at starts that were not taught, and priors that help the right one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray, IntArray
from skillctl.compose.regions import regions
from skillctl.errors import UsageError
from skillctl.evaluate.left_out import MOST_FOLDS
from skillctl.learning.em import POSITION_FLOOR, expectation, position_moments
from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.mixture import GaussianMixture
from skillctl.model.rollout import rollout
from skillctl.model.skill import ActingSkill, Skill, contraction_period, extent

DURATIONS = 10.0  # of the longest demonstration: enough for a motion to arrive
STEPS = (200, 2000)  # per demonstration duration: at least as fine, and at most as fine, as this
SWEEPS = 50  # over all parts; a handful is enough
SMALLEST_LOG = -600.0  # of a prior relative to the largest: much smaller ones underflow to zero
BEYOND = 1.0  # how far a log prior lies beyond the first or last border, where the interval is open
SAME_TARGET = 0.02  # of the smallest part's extent: targets that are nearer to each other are not told apart


@dataclass(frozen=True, slots=True)
class PartCoverage:
    """How many demonstrations of one of its parts a combined skill keeps, each left out of the part's region.

    Attributes:
        part: Counted from 1.
        demonstrations: Number of embedded demonstrations.
        selected: Share whose start selects this part; None of a part of one demonstration: without it nothing
            is known of the region.
        kept: Share whose start selects it and whose motion ends at its target; None likewise.
        instead: The part that takes most of the others; None if there are none.
    """

    part: int
    demonstrations: int
    selected: float | None
    kept: float | None
    instead: int | None

    @property
    def lost(self) -> int:
        """How many of the demonstrations other parts take."""
        return 0 if self.selected is None else round((1 - self.selected) * self.demonstrations)


def with_regions(skill: CombinedSkill, demonstrations: Sequence[DemonstrationSet | None]) -> CombinedSkill:
    """Return the skill with regions that are learned from its parts and what they were taught.

    Without any demonstrations the position densities of the parts remain its regions.

    Args:
        skill: A combined skill.
        demonstrations: One set per leaf of the skill, None where none is embedded.
    """
    taught = _taught(skill, demonstrations)
    if not any(taught):
        return skill
    return replace(skill, regions=_regions([part.density for part in skill.parts], taught))


def coverage(
    skill: CombinedSkill, demonstrations: Sequence[DemonstrationSet | None]
) -> tuple[PartCoverage, ...]:
    """Return, for each part with demonstrations, how many of them would start and end in it if left out.

    A demonstration is a motion relative to its own end point, so it is laid out from where the part's
    attractor is now. Of more than ``MOST_FOLDS`` demonstrations, a ``MOST_FOLDS``-th is left out at a time.
    Regions are learned again without it, motions are not: those follow the skill as it is, with its own gate.

    Args:
        skill: What ``combine`` returned.
        demonstrations: One set per leaf of the skill, None where none is embedded.

    Raises:
        UsageError: Another number of sets than leaves.
    """
    taught = _taught(skill, demonstrations)
    report = []
    for index, own in enumerate(taught):
        if own is None:
            continue
        scores = _left_out_scores(skill, taught, index)
        if scores is None:
            report.append(PartCoverage(index + 1, len(own.paths), None, None, None))
            continue
        chosen = scores.argmax(axis=1)
        selected = chosen == index
        kept = selected & _ends_at(skill, index, own.starts, own.longest)
        shares = float(np.mean(selected)), float(np.mean(kept))
        report.append(PartCoverage(index + 1, len(own.paths), *shares, _most_frequent(chosen[~selected])))
    return tuple(report)


def selected_shares(
    skill: CombinedSkill, demonstrations: Sequence[DemonstrationSet | None]
) -> tuple[tuple[int, float | None], ...]:
    """Return, for each part, how many demonstrations it has and which share selects it when left out.

    As ``coverage``, without following motions. The share is None for fewer than two demonstrations.
    """
    taught = _taught(skill, demonstrations)
    shares: list[tuple[int, float | None]] = []
    for index, own in enumerate(taught):
        scores = _left_out_scores(skill, taught, index)
        share = None if scores is None else float(np.mean(scores.argmax(axis=1) == index))
        shares.append((0 if own is None else len(own.paths), share))
    return tuple(shares)


def same_targets(skill: CombinedSkill) -> tuple[tuple[int, int, float], ...]:
    """Return the pairs of parts whose attractors differ by less than ``SAME_TARGET``, and how far these are.

    Parts are counted from 1; parts that end in exactly one place, however they are turned, are not named.
    """
    ends, tolerance = skill.part_attractors, _tolerance(skill)
    near = []
    for i, j in combinations(range(len(ends)), 2):
        gap, _ = skill.space.apart(ends[i], ends[j])
        if gap > 0 and skill.space.distance(ends[i], ends[j]) <= tolerance:
            near.append((i + 1, j + 1, float(gap)))
    return tuple(near)


def calibrated_priors(skill: CombinedSkill, demonstrations: Sequence[DemonstrationSet | None]) -> FloatArray:
    """Return priors β with which more starts of each part select it, each left out of the part's region.

    The start of a part's only demonstration counts as it is.

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
    taught = _taught(skill, demonstrations)
    groups = []
    for index, own in enumerate(taught):
        if own is not None:
            scores = _left_out_scores(skill, taught, index)
            scores = skill.part_scores(own.starts) if scores is None else scores
            groups.append((index, scores - np.log(skill.part_priors)))
    if not groups:
        raise UsageError(
            "calibrate: the skills carry no demonstrations.", hint="Give --priors, or learn the skills again."
        )
    return best_priors(groups, skill.part_priors)


def best_priors(groups: Sequence[tuple[int, FloatArray]], priors: FloatArray) -> FloatArray:
    """Return the priors that maximise the sum over the parts of the share of their starts that select them.

    The search moves one log β after the other to the middle of the interval in which the sum is largest,
    until no move increases it: a global maximum for two parts, a local one for more.

    Args:
        groups: The index of a part, and log rⱼ of every part j at each of its starts, shape (n, parts).
        priors: Where the search begins, shape (parts,).
    """
    logs = np.log(priors)
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
        skill: Any skill; of a chain, the first stage counts.
        demonstrations: One set per leaf, None where none is embedded.
    """
    leaves = skill.parts[0].leaves if isinstance(skill, ChainedSkill) else skill.leaves
    return np.array(
        [
            skill.space.carried(motion.positions[0], motion.positions[-1], leaf.attractor)
            for leaf, motions in zip(leaves, demonstrations, strict=False)  # later stages are left out
            for motion in motions or ()
        ]
    )


@dataclass(frozen=True, eq=False, slots=True)
class _Taught:
    """The demonstrations of one part, laid out from where the part's attractor is now.

    Attributes:
        part: The part.
        paths: Charted states, shape (samples, d) each.
        longest: Duration of the longest, [s].
    """

    part: ActingSkill
    paths: tuple[FloatArray, ...]
    longest: float

    @property
    def places(self) -> FloatArray:
        """Charted states at which they begin. Shape (n, d)."""
        return np.stack([path[0] for path in self.paths])

    @property
    def starts(self) -> FloatArray:
        """States in which they begin. Shape (n, d)."""
        return self.part.uncharted(self.places)


def _taught(skill: CombinedSkill, demonstrations: Sequence[DemonstrationSet | None]) -> list[_Taught | None]:
    """Return the demonstrations of each part; None for a part without any."""
    if len(demonstrations) != len(skill.leaves):
        raise UsageError(f"demonstrations: expected {len(skill.leaves)} sets, got {len(demonstrations)}.")
    remaining = iter(demonstrations)
    found: list[_Taught | None] = []
    for part in skill.parts:
        motions = [motion for _ in part.leaves for motion in next(remaining) or ()]
        paths = tuple(
            part.anchor + part.space.offsets(motion.positions, motion.positions[-1]) for motion in motions
        )
        found.append(_Taught(part, paths, max(motion.duration for motion in motions)) if motions else None)
    return found


def _regions(
    densities: Sequence[GaussianMixture], taught: Sequence[_Taught | None]
) -> tuple[GaussianMixture, ...]:
    return regions(densities, [None if motions is None else motions.places for motions in taught])


def _left_out_scores(skill: CombinedSkill, taught: Sequence[_Taught | None], index: int) -> FloatArray | None:
    """Return log βⱼ + log rⱼ at the starts of a part's demonstrations, its own r learned without each.

    Returns:
        Shape (n, parts); None if the part has fewer than two demonstrations.
    """
    own, part = taught[index], skill.parts[index]
    if own is None or len(own.paths) < 2:
        return None
    scores, numbers = skill.part_scores(own.starts), np.arange(len(own.paths))
    densities, others = [other.density for other in skill.parts], list(taught)
    folds = min(len(numbers), MOST_FOLDS)
    for fold in range(folds):
        left = numbers % folds == fold
        rest = replace(own, paths=tuple(own.paths[i] for i in numbers[~left]))
        densities[index], others[index] = _relearned(part, np.vstack(rest.paths)), rest
        region = _regions(densities, others)[index] if skill.regions else densities[index]
        scores[left, index] = np.log(skill.part_priors[index]) + region.log_density(own.places[left])
    return scores


def _relearned(part: ActingSkill, positions: FloatArray) -> GaussianMixture:
    """Return the position density of a part after one step of EM on other charted states (n, d)."""
    floor = POSITION_FLOOR * float(((positions - part.anchor) ** 2).sum(axis=1).mean())
    shares = expectation(part.density.log_joint(positions).T)
    return GaussianMixture(*position_moments(shares, positions, floor))


def _most_frequent(parts: IntArray) -> int | None:
    """Return the part, counted from 1, whose index occurs most often; None if there is none."""
    return int(np.bincount(parts).argmax()) + 1 if parts.size else None


def _tolerance(skill: CombinedSkill) -> float:
    """Return how far apart targets have to be to be told apart, in the unit of the space."""
    return SAME_TARGET * min(extent(part.density) for part in skill.parts)


def _ends_at(skill: CombinedSkill, index: int, starts: FloatArray, longest: float) -> npt.NDArray[np.bool_]:
    """Return which motions arrive at the attractor of part ``index``, or at one that is not told from it."""
    period = float(np.clip(0.5 * contraction_period(skill), longest / STEPS[1], longest / STEPS[0]))
    result = rollout(skill, starts, duration=DURATIONS * longest, period=period)
    distances = skill.space.distance(result.positions[:, -1, None], skill.part_attractors)
    near = distances[:, index] <= distances.min(axis=1) + _tolerance(skill)
    return np.asarray(result.arrived & near)
