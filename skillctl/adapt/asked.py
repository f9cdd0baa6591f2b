"""A task with all that its file names: demonstrations, and skills to be like."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from skillctl.adapt.clauses import Demonstrations, Like
from skillctl.adapt.report import TaskVerdict
from skillctl.adapt.task_file import Task, read_task
from skillctl.adapt.verdict import judge_task
from skillctl.demonstrations.options import Reading
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.skill import Skill
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
