"""A merger fitted to a task: weights from demonstrations of it, judged by whole motions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from skillctl import metrics
from skillctl.adapt.follow import follow, slowed
from skillctl.adapt.options import FitLevel
from skillctl.adapt.weights import adapt as adapt_weights
from skillctl.arrays import FloatArray
from skillctl.compose.merge import merge as merge_skills
from skillctl.errors import FitError
from skillctl.geometry import phases
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.merged import MergedSkill
from skillctl.model.rollout import rollout
from skillctl.model.skill import ActingSkill, Skill, contraction_period
from skillctl.model.space import Space

PER_PART = "weights per part"
NEIGHBOURHOOD = 0.1  # of the way to its end, that starts next to a demonstrated one are away from it
PAIRED = 4  # single parts, the nearest, of which pairs are tried
PATIENCE = 5  # durations of the longest demonstration that a motion is followed
STEPS = (200, 2000)  # per demonstration duration: at least as fine, and at most as fine, as this


@dataclass(frozen=True)
class TaskErrors:
    """Mean DTW distance to demonstrations, in the unit of the space; None where a motion diverged.

    Attributes:
        best_single: Of the part that alone, moved to the target, comes nearest.
        best_part: That part, counted from 1.
        equal: Of all parts with equal weights.
        fitted: Of the fitted weights.
    """

    best_single: float | None
    best_part: int
    equal: float | None
    fitted: float | None


@dataclass(frozen=True, eq=False)
class FittedMerger:
    """A merged skill fitted to a task.

    Attributes:
        skill: Superposition of the parts used; its speed is the sum of the weights.
        used: Indices of the parts with a weight.
        choice: The best way: ``one part``, ``equal weights``, ``equal weights of two``, ``weights per part``
            or ``per component``.
        errors: On the demonstrations given.
        held_out: The same on each demonstration with weights fitted to the others; None for a single one.
    """

    skill: MergedSkill
    used: tuple[int, ...]
    choice: str
    errors: TaskErrors
    held_out: TaskErrors | None


@dataclass(frozen=True, eq=False)
class _Candidate:
    """One way to merge, its weights (number of given parts,), and its error on demonstrations and neighbours.

    Distances have shape (n, 1 + 2d): each demonstration comes first, then its neighbours.
    """

    skill: MergedSkill
    weights: FloatArray
    choice: str
    distances: FloatArray

    @property
    def used(self) -> tuple[int, ...]:
        return tuple(np.flatnonzero(self.weights).tolist())


def fit_to_task(
    parts: Sequence[Skill],
    task: DemonstrationSet,
    lyapunov: FloatArray,
    *,
    level: FitLevel = "part",
    target: Sequence[float] | None = None,
) -> FittedMerger:
    """Return the merger of parts whose motions come nearest to demonstrations of a new task.

    Least squares on velocities (``compose.adapt``) say little about where a motion goes; so the best of
    those weights, equal ones and one part alone is where ``follow`` starts to fit whole motions, and of
    everything tried that is on these demonstrations no worse than one part alone or equal weights, the mean
    DTW distance to them and to their neighbours decides. What it does not show: how near motions from other
    starts come, for which see ``held_out``.

    Args:
        parts: Two or more SEDS or merged skills.
        task: Demonstrations of the new task.
        lyapunov: Common P of the parts, (d, d).
        level: One weight per part, or ``component``: also one factor per component.
        target: Attractor of the result; by default the mean of the demonstrations' end points.

    Raises:
        UsageError, FitError: As ``compose.adapt``.
    """
    if target is None:
        target = tuple(np.mean([motion.positions[-1] for motion in task], axis=0).tolist())
    parts = merge_skills(parts, target=target, lyapunov=lyapunov).parts
    families = [_family(motion, task.space) for motion in task]
    plain = _unfitted(parts, families)
    pairs = _pairs(plain, families)
    best = _best(plain, _fitted(plain, pairs, parts, families, level))
    if not np.isfinite(best.distances).all():
        raise FitError(
            "merge: no mixture of these skills follows the demonstrations without diverging.",
            hint="Learn the task from the demonstrations, or choose other skills.",
        )
    held_out = None
    if len(task) > 1:
        folds = [_best(plain, _fitted(plain, pairs, parts, families, level, i), i) for i in range(len(task))]
        held_out = _errors(plain, np.array([fold.distances[i, 0] for i, fold in enumerate(folds)]))
    errors = _errors(plain, best.distances[:, 0])
    return FittedMerger(best.skill, best.used, best.choice, errors, held_out)


def task_distances(skill: Skill, task: DemonstrationSet, attractor: FloatArray) -> FloatArray:
    """Return the DTW distance of the motion from each demonstrated start to the demonstration. Shape (n,).

    Args:
        skill: What moves.
        task: Demonstrations; each counts relative to its own end.
        attractor: Where they end, (d,).
    """
    shown = [motion.positions - motion.positions[-1] + attractor for motion in task]
    longest = max(motion.duration for motion in task)
    stable = 0.5 * contraction_period(skill)
    period = float(np.clip(stable, longest / STEPS[1], longest / STEPS[0]))
    with np.errstate(over="ignore", invalid="ignore"):  # a step longer than proved may diverge
        moved = rollout(skill, np.stack([p[0] for p in shown]), duration=PATIENCE * longest, period=period)
        return np.array([metrics.dtw(moved.trajectory(i)[1], p) for i, p in enumerate(shown)])


def _family(motion: Demonstration, space: Space) -> DemonstrationSet:
    """Return a demonstration and its neighbours: moved at its start to either side, fading along the way.

    A single demonstration says nothing of where motions from other starts should go; that they should
    differ ever less from it is the least that can be said.
    """
    x = motion.positions
    fading = (1 - phases(x))[:, None]
    reach = NEIGHBOURHOOD * float(np.linalg.norm(x[0] - x[-1]))
    offsets = reach * np.vstack([np.eye(x.shape[1]), -np.eye(x.shape[1])])
    neighbours = [
        Demonstration.from_positions(motion.times, x + fading * offset, motion.source) for offset in offsets
    ]
    return DemonstrationSet((motion, *neighbours), space)


def _distances(skill: Skill, families: Sequence[DemonstrationSet], attractor: FloatArray) -> FloatArray:
    motions = [motion for family in families for motion in family]
    distances = task_distances(skill, DemonstrationSet(tuple(motions), families[0].space), attractor)
    return distances.reshape(len(families), -1)


def _unfitted(parts: Sequence[ActingSkill], families: Sequence[DemonstrationSet]) -> list[_Candidate]:
    """Return equal weights, and then each part alone."""
    merged = merge_skills(parts)
    ways = [(merged, np.ones(len(parts)), "equal weights")]
    ways += [
        (MergedSkill((part,), np.ones(1)), weights, "one part")
        for part, weights in zip(merged.parts, np.eye(len(parts)), strict=True)
    ]
    return [_Candidate(*way, _distances(way[0], families, merged.attractor)) for way in ways]


def _pairs(plain: Sequence[_Candidate], families: Sequence[DemonstrationSet]) -> list[_Candidate]:
    """Return two parts with equal weights, for all pairs of the few that alone come nearest.

    A local search from the best single part stays with it where a pair would be better.
    """
    alone = sorted(plain[1:], key=lambda candidate: float(candidate.distances.mean()))[:PAIRED]
    if len(plain) == 3:  # two parts: that pair is equal weights
        return []
    found = []
    for first, second in combinations(alone, 2):
        skill = MergedSkill((*first.skill.parts, *second.skill.parts), np.full(2, 0.5))
        distances = _distances(skill, families, skill.attractor)
        found.append(_Candidate(skill, first.weights + second.weights, "equal weights of two", distances))
    return found


def _fitted(
    plain: Sequence[_Candidate],
    pairs: Sequence[_Candidate],
    parts: Sequence[ActingSkill],
    families: Sequence[DemonstrationSet],
    level: FitLevel,
    omitted: int | None = None,
) -> list[_Candidate]:
    """Return weights fitted to demonstrations and their neighbours, one of them not looked at."""
    looked_at = [motion for i, family in enumerate(families) if i != omitted for motion in family]
    shown = DemonstrationSet(tuple(looked_at), families[0].space)
    goal = parts[0].attractor
    try:
        adapted = adapt_weights(parts, shown, target=goal)
    except FitError:  # nothing moves along; equal weights remain
        return []
    skill = slowed(adapted.skill)
    nearest = _Candidate(skill, adapted.weights, PER_PART, _distances(skill, families, goal))
    found = [nearest, *pairs]
    ways: dict[FitLevel, str] = {"part": PER_PART}
    if level == "component":
        ways["component"] = "per component"
    for kind, choice in ways.items():
        start = _best(plain, found, omitted).weights
        followed = follow(parts, shown, start, level=kind)
        distances = _distances(followed.skill, families, goal)
        found.append(_Candidate(followed.skill, followed.weights, choice, distances))
    return found


def _best(
    plain: Sequence[_Candidate], fitted: Sequence[_Candidate], omitted: int | None = None
) -> _Candidate:
    """Return who comes nearest to demonstrations and neighbours, one demonstration not looked at.

    Nobody who is worse on the demonstrations alone than one part, or equal weights, comes into question.
    """

    def error(candidate: _Candidate, members: slice = slice(None)) -> float:
        seen = candidate.distances if omitted is None else np.delete(candidate.distances, omitted, axis=0)
        return float(seen[:, members].mean())

    shown = slice(0, 1)
    least = min(error(candidate, shown) for candidate in plain)
    return min((c for c in (*plain, *fitted) if error(c, shown) <= least), key=error)


def _errors(plain: Sequence[_Candidate], fitted: FloatArray) -> TaskErrors:
    equal, *singles = (_mean(candidate.distances[:, 0]) for candidate in plain)
    values = [np.inf if single is None else single for single in singles]
    best = int(np.argmin(values))
    return TaskErrors(singles[best], best + 1, equal, _mean(fitted))


def _mean(distances: FloatArray) -> float | None:
    return float(distances.mean()) if np.isfinite(distances).all() else None
