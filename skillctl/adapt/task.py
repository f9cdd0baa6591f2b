"""A merger fitted to demonstrations of a task, judged by whole motions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from skillctl import metrics
from skillctl.adapt.charted import charted, uncharted
from skillctl.adapt.follow import follow
from skillctl.adapt.options import FitLevel
from skillctl.adapt.pace import motions_from, paced, paths_to
from skillctl.adapt.weights import fit_velocities
from skillctl.arrays import FloatArray
from skillctl.compose.merge import merge as merge_skills
from skillctl.errors import FitError
from skillctl.geometry import phases
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.merged import MergedSkill
from skillctl.model.retarget import goal_of
from skillctl.model.skill import ActingSkill, Skill
from skillctl.model.space import Space

PER_PART = "weights per part"
NEIGHBOURHOOD = 0.1  # distance of a neighbour's start, as a share of the demonstration's way to its end
LATE = 1.25  # of the demonstrated duration: later than that is another motion
PAIRED = 4  # pairs are tried of this many parts, those that alone come nearest


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
        skill: Superposition of the parts used, as fast as the demonstrations.
        used: Indices of the parts with a weight.
        choice: How the weights were found: ``one part``, ``equal weights``, ``equal weights of two``,
            ``weights per part`` or ``per component``.
        errors: On the demonstrations given.
        held_out: The same on each demonstration with weights fitted to the others; None for a single one.
        late: How many times as long as the demonstrations its motions take: 1 unless the controller period
            that its parts are proved for limits its speed.
    """

    skill: MergedSkill
    used: tuple[int, ...]
    choice: str
    errors: TaskErrors
    held_out: TaskErrors | None
    late: float


@dataclass(frozen=True, eq=False)
class _Candidate:
    """One way to merge.

    Attributes:
        skill: The merger, as fast as the demonstrations.
        weights: Of each given part. Shape (number of given parts,).
        choice: What it is called in reports.
        distances: DTW distance to each demonstration, in the first column, and to its neighbours.
            Shape (n, 1 + 2d).
        late: How many times as long as the demonstrations its motions take, because of the period.
    """

    skill: MergedSkill
    weights: FloatArray
    choice: str
    distances: FloatArray
    late: float

    @classmethod
    def of(
        cls, skill: MergedSkill, weights: FloatArray, choice: str, families: Sequence[DemonstrationSet]
    ) -> _Candidate:
        shown = tuple(family.demonstrations[0] for family in families)
        found = paced(skill, [DemonstrationSet(shown, skill.space)])
        skill = found.skill
        motions = tuple(motion for family in families for motion in family)
        distances = task_distances(skill, DemonstrationSet(motions, skill.space), skill.attractor, found.late)
        return cls(skill, weights, choice, distances.reshape(len(families), -1), found.late)


def fit_to_task(
    parts: Sequence[Skill],
    task: DemonstrationSet,
    lyapunov: FloatArray,
    *,
    level: FitLevel = "part",
    target: Sequence[float] | None = None,
) -> FittedMerger:
    """Return the merger of parts whose motions come nearest to demonstrations of a new task.

    Least squares on velocities (``fit_velocities``) say little about where a motion goes. So ``follow`` fits
    whole motions, from the best of those weights, equal weights and one part alone. Of everything tried, the
    result has the smallest mean DTW distance to the demonstrations and their neighbours, provided that on
    the demonstrations alone it does at least as well as one part alone and equal weights. What it does not
    show: how near motions from other starts come, for which see ``held_out``. Of poses, distances are those
    of charted states, in which an angle counts as the characteristic length says.

    Args:
        parts: Two or more SEDS or merged skills.
        task: Demonstrations of the new task.
        lyapunov: Common P of the parts, (d, d).
        level: One weight per part, or ``component``: also one factor per component.
        target: Attractor of the result, as of ``retargeted``; what is not given of it is the mean of the
            demonstrations' ends.

    Raises:
        UsageError, NoCommonLyapunovError: As ``compose.merge``.
        FitError: Every mixture that was tried diverges.
    """
    goal = task.space.mean(np.array([motion.positions[-1] for motion in task]))
    if target is not None:
        goal = goal_of(task.space, target, goal)
    members = merge_skills(parts, target=goal, lyapunov=lyapunov).parts
    space, attractor = members[0].space, members[0].attractor
    parts, task = charted(members, task)
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
    used = tuple(np.flatnonzero(best.weights).tolist())
    found = uncharted(best.skill, space, attractor)
    return FittedMerger(found, used, best.choice, errors, held_out, best.late)


def task_distances(
    skill: Skill, task: DemonstrationSet, attractor: FloatArray, late: float = 1.0
) -> FloatArray:
    """Return the DTW distance of the motion from each demonstrated start to the demonstration. Shape (n,).

    Args:
        skill: What moves.
        task: Demonstrations; each counts relative to its own end.
        attractor: Where they end, (d,).
        late: How many times as long as the demonstrations the motions take: they are followed so long.
    """
    paths = paths_to(task, attractor)
    found = motions_from(skill, paths, late * max(motion.duration for motion in task))
    with np.errstate(over="ignore", invalid="ignore"):
        return np.array([metrics.dtw(found.trajectory(i)[1], path) for i, path in enumerate(paths)])


def _family(motion: Demonstration, space: Space) -> DemonstrationSet:
    """Return a demonstration and its neighbours: moved at its start to either side, fading along the way.

    A single demonstration does not show where motions from other starts should go. The neighbours stand for
    the least that may be expected: such motions come ever nearer to it.
    """
    x = motion.positions
    fading = (1 - phases(x))[:, None]
    reach = NEIGHBOURHOOD * float(np.linalg.norm(x[0] - x[-1]))
    offsets = reach * np.vstack([np.eye(x.shape[1]), -np.eye(x.shape[1])])
    neighbours = [
        Demonstration.from_positions(motion.times, x + fading * offset, motion.source) for offset in offsets
    ]
    return DemonstrationSet((motion, *neighbours), space)


def _unfitted(parts: Sequence[ActingSkill], families: Sequence[DemonstrationSet]) -> list[_Candidate]:
    """Return equal weights, and then each part alone."""
    merged = merge_skills(parts)
    equal = _Candidate.of(merged, np.ones(len(parts)), "equal weights", families)
    alone = [
        _Candidate.of(MergedSkill((part,), np.ones(1)), weights, "one part", families)
        for part, weights in zip(merged.parts, np.eye(len(parts)), strict=True)
    ]
    return [equal, *alone]


def _pairs(plain: Sequence[_Candidate], families: Sequence[DemonstrationSet]) -> list[_Candidate]:
    """Return two parts with equal weights, for all pairs of the few that alone come nearest.

    A local search from the best single part stays with it where a pair would be better.
    """
    if len(plain) == 3:  # there are two parts, and equal weights are their pair
        return []
    alone = sorted(plain[1:], key=lambda candidate: float(candidate.distances.mean()))[:PAIRED]
    return [
        _Candidate.of(
            MergedSkill((*first.skill.parts, *second.skill.parts), np.full(2, 0.5)),
            first.weights + second.weights,
            "equal weights of two",
            families,
        )
        for first, second in combinations(alone, 2)
    ]


def _fitted(
    plain: Sequence[_Candidate],
    pairs: Sequence[_Candidate],
    parts: Sequence[ActingSkill],
    families: Sequence[DemonstrationSet],
    level: FitLevel,
    omitted: int | None = None,
) -> list[_Candidate]:
    """Return the pairs, and weights fitted to demonstrations and their neighbours, without one of them.

    None where no mixture moves along with the demonstrations: then the unfitted candidates remain.
    """
    kept = tuple(motion for i, family in enumerate(families) if i != omitted for motion in family)
    demonstrations = DemonstrationSet(kept, families[0].space)
    nearest = fit_velocities(parts, demonstrations)
    if nearest is None:
        return []
    found = [_Candidate.of(nearest.skill, nearest.weights, PER_PART, families), *pairs]
    ways: dict[FitLevel, str] = {"part": PER_PART}
    if level == "component":
        ways["component"] = "per component"
    for kind, choice in ways.items():
        start = _best(plain, found, omitted).weights
        followed = follow(parts, demonstrations, start, level=kind)
        found.append(_Candidate.of(followed.skill, followed.weights, choice, families))
    return found


def _best(
    plain: Sequence[_Candidate], fitted: Sequence[_Candidate], omitted: int | None = None
) -> _Candidate:
    """Return the candidate with the least distance to demonstrations and neighbours, without one of them.

    A candidate must do at least as well on the demonstrations alone as the best unfitted one. Those that
    would be late count only if all are: they are near to the way, but not proved at the speed of the motion.
    """

    def error(candidate: _Candidate, members: slice = slice(None)) -> float:
        kept = candidate.distances if omitted is None else np.delete(candidate.distances, omitted, axis=0)
        return float(kept[:, members].mean())

    alone = slice(0, 1)
    candidates = [*plain, *fitted]
    timely = [candidate for candidate in candidates if candidate.late <= LATE] or candidates
    least = min((error(candidate, alone) for candidate in plain if candidate in timely), default=np.inf)
    return min((candidate for candidate in timely if error(candidate, alone) <= least), key=error)


def _errors(plain: Sequence[_Candidate], fitted: FloatArray) -> TaskErrors:
    """Return the errors of the unfitted candidates beside the ``fitted`` distances (n,)."""
    equal, *singles = (_mean(candidate.distances[:, 0]) for candidate in plain)
    best = int(np.argmin([np.inf if single is None else single for single in singles]))
    return TaskErrors(singles[best], best + 1, equal, _mean(fitted))


def _mean(distances: FloatArray) -> float | None:
    return float(distances.mean()) if np.isfinite(distances).all() else None
