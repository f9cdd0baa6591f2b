"""A skill that was read: its place, and what its file holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from skillctl.store.reader import read_skill
from skillctl.store.registry import Located, locate
from skillctl.store.schema import DemonstrationReport, ParentRecord, label

if TYPE_CHECKING:
    from skillctl.model.demonstration import DemonstrationSet
    from skillctl.model.seds import SedsSkill
    from skillctl.model.skill import Skill
    from skillctl.store.artifact import Artifact
    from skillctl.store.lockfile import Lock


@dataclass(frozen=True, eq=False)
class Source:
    """A skill that was read.

    Attributes:
        located: Its file, and its name and version if it is in a store.
        artifact: What the file holds.
    """

    located: Located
    artifact: Artifact

    @property
    def skill(self) -> Skill:
        """The skill itself."""
        return self.artifact.skill

    @property
    def name(self) -> str:
        """A short name for tables and sentences."""
        return self.located.shown

    def as_parent(self, role: str) -> ParentRecord:
        """Return what a skill made from this one records about it."""
        name = self.located.name or label(self.located.path.name)
        return ParentRecord(name=name, version=self.located.version, digest=self.artifact.digest, role=role)


def open_skill(reference: str | Path, store: str | Path | None = None, lock: Lock | None = None) -> Source:
    """Return the skill that a reference (file, NAME, NAME@3, NAME@latest) names.

    Args:
        reference: The skill; a ``Path`` is always a file.
        store: Where names live; default as on the command line.
        lock: If given, the skills that are allowed; a reference that is locked leads to its locked version.

    Raises:
        UsageError: The reference is malformed.
        NotFoundError: There is nothing of that name.
        ArtifactError: The file is not an intact skill artifact, or not one that the lock names.
    """
    located = lock.locate(reference, store) if lock else locate(reference, store)
    source = Source(located, read_skill(located.path))
    if lock:
        lock.require(located, source.artifact.digest)
    return source


def carried_demonstrations(
    sources: Sequence[Source], leaves: Sequence[SedsSkill], *, turn: bool = False
) -> tuple[DemonstrationSet | None, ...]:
    """Return the demonstrations of the parents, moved with their leaves, and in the space of those.

    Args:
        sources: The parents.
        leaves: Those of all parents, from left to right, as they are now.
        turn: Whether motions of poses turned with their targets.
    """
    before = [leaf for source in sources for leaf in source.skill.leaves]
    taught = [motions for source in sources for motions in source.artifact.demonstrations]
    return tuple(
        None
        if motions is None
        else replace(motions.carried(old.attractor, new.attractor, turn=turn), space=new.space)
        for old, motions, new in zip(before, taught, leaves, strict=True)
    )


def carried_reports(sources: Sequence[Source]) -> list[DemonstrationReport]:
    """Return the reports of the parents, with the leaf numbers of the child.

    They stay true: a leaf that is moved repeats a moved demonstration as well as before.
    """
    carried: list[DemonstrationReport] = []
    first_leaf = 0
    for source in sources:
        reports = source.artifact.reports
        carried += [report.model_copy(update={"leaf": first_leaf + report.leaf}) for report in reports]
        first_leaf += len(source.skill.leaves)
    return carried
