"""The search for a skill that does a task: single ones, mergers, combinations, judged by whole motions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, product

import numpy as np

from skillctl.adapt.blends import Blend, Blends
from skillctl.adapt.clauses import compared, lengths
from skillctl.adapt.judge import ARRIVED, RESOLVED, Judge, follow, padded
from skillctl.adapt.task_file import Task
from skillctl.arrays import FloatArray
from skillctl.compose.combine import combine
from skillctl.compose.merge import common_members
from skillctl.compose.parts import in_one_space
from skillctl.errors import FitError, UsageError
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.gates import MERGE_GATES
from skillctl.model.retarget import retargeted
from skillctl.model.skill import ActingSkill, Skill, contraction_period

STARTS = 16  # that every candidate is judged from
GRIDS = {2: 12, 3: 6, 4: 4, 5: 3}  # number of parts → into how many steps a weight is divided
FINER = (1 / 12, 1 / 24, 1 / 48)  # weights that are moved from one part to another, round by round
FACTORS = (0.5, 2.0)  # of a component, that are tried one at a time
ENOUGH = 0.5  # a score from which on no factors are tried: half of what is ample
PAYS = 0.05  # a score that is better by less is not worth more parts, or a factor per component
SLOWER = 2.5  # a merger is followed for this many times the time of the slowest single skill
RESOLUTION = 150  # steps of a merger, at least, in the time of the slowest single skill
LONGEST_STEP = 0.02  # [s]
MOST_PARTS = 3  # of a store that are searched; each more makes a common proof harder
PAIRED = 8  # skills that are tried in pairs, those that alone are best and move differently
ALIKE = 0.05  # of the way: motions that are nearer to each other on average are alike
ROUNDS = 3  # of a search that is repeated with starts from which its result fails
DRAWN = 200  # starts that look for such
ADDED = 8  # of them
FIRST_SEED = 1000  # of starts that are drawn
MOST_COMBINED = 5  # skills of which all subsets are combined


@dataclass(frozen=True, eq=False)
class Candidate:
    """A skill that was tried for a task.

    Attributes:
        kind: ``single``, ``merged`` or ``combined``.
        parts: Indices of the given parts that it is made of.
        weights: Of each given part; equal for a combined one. Shape (N,).
        gate: How the parts act together; empty for a single skill.
        speed: Factor on the velocity.
        build: Makes the skill.
        component_wise: Whether its components have factors of their own.
        score: Worst margin over clauses and starts, each in its scale, and a little of the mean.
        margins: Of each clause from each of its starts, by its name.
    """

    kind: str
    parts: tuple[int, ...]
    weights: FloatArray
    gate: str
    speed: float
    build: Callable[[], Skill] = field(repr=False)
    component_wise: bool = False
    score: float = -np.inf
    margins: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def worst(self) -> dict[str, float]:
        """The smallest margin of each clause, in its unit."""
        return {name: float(values.min()) for name, values in self.margins.items()}

    @property
    def holds(self) -> bool:
        """Whether every clause holds from every start that was tried."""
        return min(self.worst.values()) >= 0


@dataclass(frozen=True, eq=False)
class Search:
    """What was tried for a task.

    Attributes:
        candidates: All by score, but first the simplest of those that are nearly as good as the best.
        single: The best skill that is moved to the target and changed no further.
        equal: All parts with equal weights; None if there is one part, or no common proof.
        judge: What they were judged by.
    """

    candidates: tuple[Candidate, ...]
    single: Candidate
    equal: Candidate | None
    judge: Judge

    @property
    def best(self) -> Candidate:
        """The first candidate."""
        return self.candidates[0]


def search(
    task: Task,
    skills: Sequence[Skill],
    parts: Sequence[ActingSkill] | None = None,
    *,
    starts: FloatArray | None = None,
    shown: Mapping[str, DemonstrationSet] | None = None,
    like: Mapping[str, Skill] | None = None,
) -> Search:
    """Return everything that was tried for a task, the best first; equal arguments give equal results.

    Tried are each skill alone, moved to the target; latched combinations of all subsets of them; mergers of
    the parts, with weights on a grid over the simplex and all gates, then with ever finer weights around the
    best, and, if that is not ample, with factors of single components. Fields of the parts are shared: all
    mergers from all starts are followed at once.

    Args:
        task: What is wanted.
        skills: One or more, each with one attractor.
        parts: The same for merging, under one P and in one chart (``compose.merge.common_members``). Default:
            the skills, if they have that; else nothing is merged.
        starts: Where motions begin, (n, d); by default ``STARTS`` spread over the task's start box.
        shown: Demonstrations of each clause that compares with some, by its name.
        like: Skill of each clause that compares with one, by its name.

    Raises:
        UsageError: No skill can be moved to the target, or the task has another dimension.
        NoCommonLyapunovError: The parts have different P or charts.
    """
    starts = task.start.spread(STARTS) if starts is None else starts
    usable = [i for i, skill in enumerate(skills) if len(skill.attractors) == 1]
    if not usable:
        raise UsageError("adapt: no skill has one target.", hint="Combine skills with --align first.")
    judge = Judge.of(task, skills[usable[0]], starts, shown, like)
    trial = _Trial(judge, len(skills))
    singles = {i: retargeted(skills[i], judge.target) for i in usable}
    alone = {i: _Motions(*follow(s, judge.starts, task), contraction_period(s)) for i, s in singles.items()}
    found = trial.singles(singles, alone)
    combined = trial.combined(singles, alone)
    parts = _common(list(singles.values())) if parts is None else common_members(parts, None)
    merged: list[Candidate] = []
    if parts is not None and len(parts) > 1:
        moved = [retargeted(part, judge.target) for part in in_one_space(parts)]
        slowest = max(motions.step * motions.states.shape[1] for motions in alone.values())
        merged = trial.merged(Blends(moved), slowest)
    equal = next((c for c in merged if c.gate == MERGE_GATES[0].name and np.ptp(c.weights) == 0), None)
    ranked = _ranked([*found, *merged, *combined])
    return Search(tuple(ranked), max(found, key=_score), equal, judge)


def search_robustly(
    task: Task,
    skills: Sequence[Skill],
    parts: Sequence[ActingSkill] | None = None,
    *,
    shown: Mapping[str, DemonstrationSet] | None = None,
    like: Mapping[str, Skill] | None = None,
) -> Search:
    """Return what ``search`` finds, repeated with more starts while drawn ones find a clause that fails.

    Each round draws other starts; those from which the best candidate fails most are added to the search.
    """
    starts = task.start.spread(STARTS)
    for number in range(ROUNDS):
        found = search(task, skills, parts, starts=starts, shown=shown, like=like)
        drawn = task.start.drawn(DRAWN, FIRST_SEED + number)
        if not found.best.holds or len(drawn) < DRAWN:  # there are no others
            break
        skill = found.best.build()
        margins = Judge.of(task, skill, drawn, shown, like).trial(skill)
        worst = np.min([values for values in margins.values() if len(values) == DRAWN], axis=0)
        failing = np.argsort(worst)[:ADDED][np.sort(worst)[:ADDED] < 0]
        if not len(failing):
            break
        starts = np.concatenate([starts, drawn[failing]])
    return found


def shortlist(
    task: Task,
    skills: Sequence[Skill],
    *,
    shown: Mapping[str, DemonstrationSet] | None = None,
    like: Mapping[str, Skill] | None = None,
) -> tuple[int, ...]:
    """Return which skills, at most ``MOST_PARTS`` of them, help most with a task: rising indices.

    Each is judged alone; the best that move differently are judged in pairs that move with the mean of both
    velocities, whatever their P and charts. The parts of the best pairs are taken, and the best single skill.
    """
    starts = task.start.spread(STARTS // 2)
    usable = {i: skill for i, skill in enumerate(skills) if len(skill.attractors) == 1}
    if len(usable) <= MOST_PARTS:
        return tuple(usable)
    judge = Judge.of(task, next(iter(usable.values())), starts, shown, like)
    trial = _Trial(judge, len(skills))
    singles = {i: retargeted(skill, judge.target) for i, skill in usable.items()}
    alone = {i: _Motions(*follow(s, judge.starts, task), contraction_period(s)) for i, s in singles.items()}
    ranked = sorted(trial.singles(singles, alone), key=_score, reverse=True)
    order = [c.parts[0] for c in ranked]
    fresh = _different(order, {i: m.states for i, m in alone.items()}, task.way)[:PAIRED]
    best = [*fresh, *(i for i in order if i not in fresh)][: max(len(fresh), MOST_PARTS)]
    pairs = list(combinations(best, 2))
    slowest = max(alone[i].step * alone[i].states.shape[1] for i in best)
    step = min(LONGEST_STEP, slowest / RESOLUTION, *(RESOLVED * alone[i].period for i in best))
    states = _paired(singles, pairs, judge.starts, step, round(slowest / step))
    steps, periods = np.full(states.shape[:2], step), np.full(len(pairs), step)
    scores = judge.scores(judge.margins(states, steps, periods))
    chosen = [best[0]]
    for number in np.argsort(-scores, kind="stable"):
        chosen += [i for i in pairs[number] if i not in chosen]
        if len(chosen) >= MOST_PARTS:
            break
    return tuple(sorted(chosen[:MOST_PARTS]))


def _different(ranked: Sequence[int], motions: Mapping[int, FloatArray], way: float) -> list[int]:
    """Return indices by rank, without those whose motions (n, T, d) are like those of a better one."""
    ways: list[FloatArray] = []
    fresh: list[int] = []
    for i in ranked:
        path = compared(motions[i])
        if all(float(lengths(path - other).mean()) > ALIKE * way for other in ways):
            ways.append(path)
            fresh.append(i)
    return fresh


def _paired(
    skills: Mapping[int, Skill], pairs: Sequence[tuple[int, int]], starts: FloatArray, step: float, count: int
) -> FloatArray:
    """Return motions (pairs, n, T, d) with the mean velocity of two skills each."""
    space = next(iter(skills.values())).space
    names = sorted({i for pair in pairs for i in pair})
    members = {i: [k for k, pair in enumerate(pairs) if i in pair] for i in names}
    x = np.tile(starts, (len(pairs), 1, 1))
    kept = [x]
    for _ in range(count):
        velocities = np.zeros_like(x)
        for i, rows in members.items():
            own = x[rows].reshape(-1, x.shape[-1])
            velocities[rows] += 0.5 * skills[i].velocity(own).reshape(len(rows), *x.shape[1:])
        x = space.displace(x, step * velocities)
        kept.append(x)
    return np.stack(kept, axis=2)


def _ranked(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return candidates by score, but first the simplest of those that are nearly as good as the best."""
    ranked = sorted(candidates, key=_score, reverse=True)
    near = [c for c in ranked if c.score > ranked[0].score - PAYS and c.holds == ranked[0].holds]
    simplest = min(near, key=lambda c: (c.component_wise, len(c.parts)))
    return [simplest, *(c for c in ranked if c is not simplest)]


def _common(skills: Sequence[Skill]) -> Sequence[ActingSkill] | None:
    """Return the skills for merging if they share P and chart."""
    try:
        return common_members(skills, None)
    except (UsageError, FitError):
        return None


@dataclass(frozen=True, eq=False)
class _Motions:
    """Motions of one skill from all starts, (m, T, d), the time of one step and the longest period, [s]."""

    states: FloatArray
    step: float
    period: float


@dataclass(frozen=True, eq=False)
class _Trial:
    """Makes and judges candidates.

    Attributes:
        judge: The task.
        count: Number of given skills.
    """

    judge: Judge
    count: int

    def judged(
        self,
        states: FloatArray,
        steps: FloatArray,
        periods: FloatArray,
        make: Callable[[int, float], Candidate],
    ) -> list[Candidate]:
        """Return C candidates with scores and margins.

        Args:
            states: Shape (C, m, T, d).
            steps: Time between two states, (C, m), [s].
            periods: Longest contracting period of each, (C,), [s].
            make: Returns a candidate by its number and its speed.
        """
        judge = self.judge
        speeds = judge.speeds(states, steps, periods)
        margins = judge.margins(states, steps / speeds[:, None], periods / speeds)
        scores = judge.scores(margins)
        return [
            replace(
                make(i, float(speed)),
                score=float(scores[i]),
                margins={name: values[i] for name, values in margins.items()},
            )
            for i, speed in enumerate(speeds)
        ]

    def singles(self, skills: Mapping[int, Skill], alone: Mapping[int, _Motions]) -> list[Candidate]:
        """Return each skill alone."""
        indices = list(skills)

        def make(number: int, speed: float) -> Candidate:
            index = indices[number]
            weights = np.eye(self.count)[index]
            return Candidate("single", (index,), weights, "", speed, lambda: _faster(skills[index], speed))

        states = padded([alone[i].states for i in indices])
        steps = np.array([np.full(states.shape[1], alone[i].step) for i in indices])
        return self.judged(states, steps, np.array([alone[i].period for i in indices]), make)

    def combined(self, skills: Mapping[int, Skill], alone: Mapping[int, _Motions]) -> list[Candidate]:
        """Return latched combinations of two or more skills: at each start one of their motions."""
        subsets = [s for size in range(2, len(skills) + 1) for s in combinations(skills, size)]
        if not subsets or len(skills) > MOST_COMBINED:
            return []
        built = {s: combine([skills[i] for i in s], align=True, target=self.judge.target) for s in subsets}
        motions, order = padded([alone[i].states for i in skills]), {i: k for k, i in enumerate(skills)}
        steps, periods = (np.array([getattr(alone[i], key) for i in skills]) for key in ("step", "period"))
        owners = {
            i: np.full(len(skills[i].acting_parts), order[i]) for i in skills
        }  # a combined skill among them has several acting parts
        chosen = np.stack(
            [np.concatenate([owners[i] for i in s])[built[s].part_at(self.judge.starts)] for s in subsets]
        )
        rows = np.arange(motions.shape[1])

        def make(number: int, speed: float) -> Candidate:
            subset = subsets[number]
            weights = np.isin(np.arange(self.count), subset) / len(subset)
            build = lambda: _faster(built[subset], speed)  # noqa: E731
            return Candidate("combined", subset, weights, built[subset].gate, speed, build)

        return self.judged(
            motions[chosen, rows],
            steps[chosen],
            np.array([min(periods[order[i]] for i in s) for s in subsets]),
            make,
        )

    def merged(self, blends: Blends, slowest: float) -> list[Candidate]:
        """Return mergers with weights on a grid, with ever finer ones around the best, and with factors.

        Args:
            blends: The parts.
            slowest: Time of the slowest single skill, [s].
        """
        count = len(blends.parts)
        grid = [blends.plain(weights) for weights in _grid(count)]
        found = [c for gate in MERGE_GATES for c in self._merged(blends, grid, gate.name, slowest)]
        for finer in FINER:
            best = max(found, key=_score)
            near = list(_neighbours(best.weights, finer))
            if near:
                found += self._merged(blends, [blends.plain(w) for w in near], best.gate, slowest)
        best = max(found, key=_score)
        if best.score < ENOUGH:
            k = len(blends.owners)
            used = np.flatnonzero(best.weights[blends.owners])
            scaled = [
                Blend(best.weights, np.where(np.arange(k) == i, factor, 1.0))
                for i in used
                for factor in FACTORS
            ]
            better = self._merged(blends, scaled, best.gate, slowest)
            found += [c for c in better if c.score > best.score + PAYS]
        return found

    def _merged(self, blends: Blends, tried: Sequence[Blend], gate: str, slowest: float) -> list[Candidate]:
        """Return mergers with one gate."""
        judge, tolerance = self.judge, self.judge.task.target.tolerance
        periods = np.array([blends.period(blend) for blend in tried])
        step = min(LONGEST_STEP, slowest / RESOLUTION, RESOLVED * float(periods.min()))
        count = round(SLOWER * slowest / step)
        states = blends.follow(tried, gate, judge.starts, step, count, ARRIVED * tolerance)
        steps = np.full(states.shape[:2], step)

        def make(number: int, speed: float) -> Candidate:
            blend = tried[number]
            build = lambda: blends.skill(blend, gate, speed)  # noqa: E731
            parts = tuple(np.flatnonzero(blend.weights).tolist())
            scaled = bool((blend.factors != 1).any())
            return Candidate("merged", parts, blend.weights, gate, speed, build, component_wise=scaled)

        return self.judged(states, steps, periods, make)


def _score(candidate: Candidate) -> float:
    return candidate.score


def _faster(skill: Skill, factor: float) -> Skill:
    """Return the same motion, faster by a positive factor."""
    return skill if factor == 1 else replace(skill, speed=factor * skill.speed)  # type: ignore[type-var]


def _grid(count: int) -> list[FloatArray]:
    """Return weights of ``count`` parts on a grid over the simplex, without the corners; equal ones first."""
    steps = GRIDS[count]
    found = [
        np.array(split) / steps
        for split in product(range(steps + 1), repeat=count)
        if sum(split) == steps and max(split) < steps
    ]
    return [np.full(count, 1 / count), *(w for w in found if np.ptp(w) > 0)]


def _neighbours(weights: FloatArray, moved: float) -> list[FloatArray]:
    """Return weights with a little moved from one part to another; two parts or more keep some."""
    found = []
    for giver, taker in product(range(len(weights)), repeat=2):
        if giver != taker and weights[giver] > 0:
            other = weights.copy()
            other[giver], other[taker] = max(weights[giver] - moved, 0.0), weights[taker]
            other[taker] += weights[giver] - other[giver]
            if np.count_nonzero(other) > 1:
                found.append(other / other.sum())
    return found
