"""A task with all that its file names: demonstrations, and skills to be like."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from skillctl.adapt.clauses import Demonstrations, Like
from skillctl.adapt.judge import Judge
from skillctl.adapt.report import ClauseVerdict, TaskVerdict
from skillctl.adapt.task_file import Task, read_task
from skillctl.adapt.verdict import judge_task
from skillctl.arrays import FloatArray
from skillctl.demonstrations.options import Reading
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.skill import Skill, contraction_period
from skillctl.simulation.tally import wilson_interval
from skillctl.stability.report import Certificate
from skillctl.store import InputRecord, Lock, input_record
from skillctl.store.source import open_skill


@dataclass(frozen=True, eq=False)
class AskedTask:
    """A task with all that its file names.

    Attributes:
        task: The clauses.
        shown: Demonstrations of each clause that compares with some.
        like: Skill of each clause that compares with one.
        inputs: Files that were read, besides the task and skills.
        digests: Of the skills in ``like``.
    """

    task: Task
    shown: Mapping[str, DemonstrationSet] = field(default_factory=dict)
    like: Mapping[str, Skill] = field(default_factory=dict)
    inputs: tuple[tuple[Path, InputRecord], ...] = ()
    digests: tuple[str, ...] = ()

    @classmethod
    def read(cls, given: Task | Path, store: str | Path | None = None, lock: Lock | None = None) -> AskedTask:
        """Return a task, and the demonstrations and skills that its file names relative to itself.

        Raises:
            NotFoundError, InputDataError, ArtifactError: One of these files cannot be used.
        """
        task = read_task(given) if isinstance(given, Path) else given
        folder = given.parent if isinstance(given, Path) else Path()
        shown, like, inputs, digests = {}, {}, [], []
        for name, clause in task.clauses.items():
            if isinstance(clause, Demonstrations):
                read = Reading().read([folder / file for file in clause.files])
                shown[name] = read.demonstrations
                inputs += [
                    (file.path, input_record(file.path, file.sha256, file.importer)) for file in read.sources
                ]
            elif isinstance(clause, Like):
                path = folder / clause.skill
                source = open_skill(path if path.is_file() else clause.skill, store, lock)
                like[name] = source.skill
                digests.append(source.artifact.digest)
        return cls(task, shown, like, tuple(inputs), tuple(digests))

    def judged(self, skill: Skill, certificate: Certificate) -> TaskVerdict:
        """Return whether a skill does the task."""
        return judge_task(self.task, skill, certificate, shown=self.shown, like=self.like)

    def judged_path(self, skill: Skill, states: FloatArray, step: float) -> TaskVerdict:
        """Return whether one motion that was measured does the task, whatever is proved of the skill.

        Clauses about demonstrations are left out: those are about motions from other starts.

        Args:
            skill: What moved.
            states: Shape (T, d).
            step: Time between two states, [s].
        """
        task = self.task.model_copy(update={"demonstrations": ()})
        judge = Judge.of(task, skill, states[:1], like=self.like)
        steps, periods = np.array([[step]]), np.array([contraction_period(skill)])
        margins = judge.margins(states[None, None], steps, periods)
        start = tuple(states[0].tolist())
        verdicts = tuple(
            ClauseVerdict(name, clause.unit, float(margins[name][0, 0]), start, proved=False, bound=None)
            for name, clause in task.clauses.items()
        )
        held = int(all(each.holds for each in verdicts))
        return TaskVerdict(verdicts, 1, held, wilson_interval(held, 1))
