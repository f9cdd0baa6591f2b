"""Whole motions judged by every clause of a task, for many candidates at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from skillctl.adapt.clauses import Demonstrations, Like, NearTo, Paths, PeriodLimit, StayIn, compared
from skillctl.adapt.keep_out import KeepOutClause
from skillctl.adapt.task_file import Task
from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.learning.options import LearnOptions
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.retarget import retargeted
from skillctl.model.rollout import rollout
from skillctl.model.skill import Skill, contraction_period
from skillctl.model.space import Space

PERIOD = LearnOptions().period  # [s] of a controller, unless the task has another
RESOLVED = 0.5  # of the longest contracting step: steps that motions are followed with
HALF = 0.5  # of the margin that a motion which rests at the target would have
MOST_STEPS = 4000  # of a motion that is followed
ARRIVED = 0.5  # of the tolerance of the target: motions are followed until they are nearer than that
MEAN_SHARE = 0.1  # what the mean margin counts beside the worst, so that better ones are told apart
AMPLE = 1.0  # a margin that is larger than its scale counts no more
SPARE = 0.9  # of a limit, that is used up where another limit allows it


@dataclass(frozen=True, eq=False)
class Judge:
    """A task with its starts, and what its clauses compare motions with.

    Attributes:
        task: The clauses.
        target: Where motions end, (d,).
        space: Of the states.
        starts: Of the start box, and after them those of demonstrations. Shape (m, d).
        rows: Which starts each clause is about, by its name.
        references: Points (rows, COMPARED, k) that a clause compares motions with, by its name.
    """

    task: Task
    target: FloatArray
    space: Space
    starts: FloatArray
    rows: Mapping[str, slice]
    references: Mapping[str, FloatArray]

    @classmethod
    def of(
        cls,
        task: Task,
        skill: Skill,
        starts: FloatArray,
        shown: Mapping[str, DemonstrationSet] | None = None,
        like: Mapping[str, Skill] | None = None,
    ) -> Judge:
        """Return the judge of motions from starts (n, d).

        Args:
            task: The clauses.
            skill: One of those to be judged; where the target's orientation is not given, it keeps its own.
            starts: Where motions begin; of poses positions will do, with the target's orientation.
            shown: Demonstrations of each clause that compares with some, by its name.
            like: Skill of each clause that compares with one, by its name.

        Raises:
            UsageError: The task has another dimension than the space.
        """
        space = skill.space
        allowed = {
            "target": (len(task.target.position), {space.positions, *space.sizes}),
            "start": (starts.shape[1], {space.positions, space.dimension}),
        }
        for what, (size, sizes) in allowed.items():
            if size not in sizes:
                raise UsageError(
                    f"{what}: the task has {size} numbers, the skills have {space.dimension} "
                    f"({', '.join(space.names)}).",
                    hint="Write the task in the coordinates of the skills.",
                )
        target = retargeted(skill, task.target.position).attractors[0]
        turned = np.tile(target[starts.shape[1] :], (len(starts), 1))
        starts = np.concatenate([starts, turned], axis=1)
        rows, references, every = {}, {}, [starts]
        for name, clause in task.clauses.items():
            rows[name] = slice(0, len(starts))
            if isinstance(clause, Demonstrations):
                paths = [space.carried(m.positions, m.positions[-1], target) for m in (shown or {})[name]]
                first = sum(map(len, every))
                every.append(np.stack([path[0] for path in paths]))
                rows[name] = slice(first, first + len(paths))
                own = [compared(path[None, :, : space.positions]) for path in paths]
                references[name] = np.concatenate(own)
            elif isinstance(clause, Like):
                model = retargeted((like or {})[name], target)
                references[name] = compared(follow(model, starts, task)[0][..., : space.positions])
        return cls(task, target, space, np.concatenate(every), rows, references)

    @cached_property
    def at_target(self) -> dict[str, float]:
        """Margins of the clauses about places at the target itself; no motion that arrives has more."""
        resting = self.paths(np.tile(self.target, (1, 2, 1)), np.ones(1))
        return {
            name: float(clause.margins(resting)[0])
            for name, clause in self.task.clauses.items()
            if isinstance(clause, KeepOutClause | StayIn)
        }

    @cached_property
    def scales(self) -> dict[str, float]:
        """The margin of each clause that is ample, in its unit: at the target there may be no more."""
        found = {name: clause.scale(self.task.way) for name, clause in self.task.clauses.items()}
        there = {name: HALF * most for name, most in self.at_target.items() if most > 0}
        return {name: min(scale, there.get(name, scale)) for name, scale in found.items()}

    def paths(self, states: FloatArray, steps: FloatArray) -> Paths:
        """Return motions (n, T, d), with the time between two states of each, (n,), as clauses take them."""
        task = self.task
        return Paths(states, steps, self.target, self.space, task.target.tolerance, task.hand_radius)

    def margins(self, states: FloatArray, steps: FloatArray, periods: FloatArray) -> dict[str, FloatArray]:
        """Return the margin of every clause, for C candidates at once.

        Args:
            states: Of each from all ``starts``. Shape (C, m, T, d).
            steps: Time between two states of each motion, (C, m), [s].
            periods: Longest contracting period of each candidate, (C,), [s].

        Returns:
            By the name of the clause, shape (C, number of its starts).
        """
        found, known, count = {}, {}, len(states)
        for name, clause in self.task.clauses.items():
            rows = self.rows[name]
            if rows.start not in known:  # clauses about the same starts share what is computed of the motions
                own = states[:, rows]
                known[rows.start] = self.paths(own.reshape(-1, *own.shape[2:]), steps[:, rows].ravel())
            paths = known[rows.start]
            if isinstance(clause, PeriodLimit):
                margins = np.repeat(periods - clause.most, rows.stop - rows.start)
            elif isinstance(clause, NearTo):
                margins = clause.against(np.tile(self.references[name], (count, 1, 1)), paths)
            else:
                margins = clause.margins(paths)
            found[name] = np.asarray(margins).reshape(count, -1)
        return found

    def scores(self, margins: Mapping[str, FloatArray]) -> FloatArray:
        """Return one number a candidate, (C,): its worst margin over clauses and starts, each in its scale.

        A margin that is ample counts as one. The mean of all has a small share, to tell good ones apart.
        """
        scaled = [np.minimum(values / self.scales[name], AMPLE) for name, values in margins.items()]
        worst = np.min([values.min(axis=1) for values in scaled], axis=0)
        mean = np.mean([np.maximum(values, -AMPLE).mean(axis=1) for values in scaled], axis=0)
        return np.asarray(worst + MEAN_SHARE * mean)

    def trial(self, skill: Skill) -> dict[str, FloatArray]:
        """Return the margins of one skill as it is, from each start of each clause."""
        states, step = follow(skill, self.starts, self.task)
        steps = np.full((1, len(states)), step)
        margins = self.margins(states[None], steps, np.array([contraction_period(skill)]))
        return {name: values[0] for name, values in margins.items()}

    def speeds(self, states: FloatArray, steps: FloatArray, periods: FloatArray) -> FloatArray:
        """Return a factor on the speed of each candidate, (C,), that suits the limits of the task.

        A path does not depend on it. It is one if that suits; else the limit that is broken gets a tenth of
        room; if speed and time cannot both be had, both are missed by the same share. The arguments are those
        of ``margins``.
        """
        limits, count = self.task.limits, len(states)
        if limits.time is None and limits.speed is None:
            return np.ones(count)
        paths = self.paths(states.reshape(-1, *states.shape[2:]), steps.ravel())
        low, high = np.zeros(count), np.full(count, np.inf)
        if limits.time is not None:
            low = paths.times.reshape(count, -1).max(axis=1) / limits.time
        if limits.speed is not None:
            fastest = paths.lengths.max(axis=1) / paths.steps
            high = limits.speed / fastest.reshape(count, -1).max(axis=1)
        with np.errstate(invalid="ignore"):  # zero times infinity, where neither limit is missed
            factors = np.where(low > high, np.sqrt(low * high), np.clip(1.0, low, high))
        roomy = low / SPARE <= SPARE * high
        factors = np.where(roomy, np.clip(1.0, low / SPARE, SPARE * high), factors)
        allowed = periods / (limits.period or PERIOD)  # where it is below one, a task's period clause says so
        return np.asarray(np.minimum(factors, np.maximum(allowed, 1.0)))


def follow(skill: Skill, starts: FloatArray, task: Task) -> tuple[FloatArray, float]:
    """Return the motions of a skill from starts (n, d), shape (n, T, d), and the time of one step [s].

    Each is followed until all are nearer to an attractor than ``ARRIVED`` of the task's tolerance.
    """
    step = min(task.limits.period or PERIOD, RESOLVED * contraction_period(skill))
    near = ARRIVED * task.target.tolerance
    found = rollout(skill, starts, duration=MOST_STEPS * step, period=step, arrival_distance=near)
    return found.positions, step


def padded(motions: Sequence[FloatArray]) -> FloatArray:
    """Return motions of different lengths, (n, T, d) each, as one array (C, n, T, d): the shorter rest."""
    longest = max(motion.shape[1] for motion in motions)
    return np.stack(
        [np.concatenate([m, np.repeat(m[:, -1:], longest - m.shape[1], axis=1)], axis=1) for m in motions]
    )
