"""Skills by reference, read and written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from skillctl.model import CombinedSkill, MergedSkill, SedsSkill, Skill
from skillctl.store import (
    Artifact,
    Located,
    Lock,
    Operation,
    ParentRecord,
    label,
    locate,
    read_skill,
)


@dataclass(frozen=True, eq=False)
class Source:
    """A skill that was read.

    Attributes:
        located: Its file, and its name and version if it lies in a store.
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
        return display_name(self.located)

    def as_parent(self, role: str) -> ParentRecord:
        """Return what a skill made from this one records about it."""
        name = self.located.name or label(self.located.path.name)
        return ParentRecord(name=name, version=self.located.version, digest=self.artifact.digest, role=role)


def open_skill(reference: str | Path, store: str | Path | None = None, lock: Lock | None = None) -> Source:
    """Return the skill that a reference (file, NAME, NAME@3, NAME@latest) names.

    Args:
        reference: The skill.
        store: Where names live; default as on the command line.
        lock: If given, the skills that are allowed; a name it was made with leads to the version it names.

    Raises:
        UsageError: The reference is malformed.
        NotFoundError: There is nothing of that name.
        ArtifactError: The file is not an intact skill artifact, or not one that the lock names.
    """
    if lock is None:
        located = locate(str(reference), store)
        return Source(located, read_skill(located.path))
    located = lock.locate(str(reference), store)
    source = Source(located, read_skill(located.path))
    lock.require(located, source.artifact.digest)
    return source


def load(reference: str | Path, *, store: str | Path | None = None) -> Skill:
    """Return the skill that a reference names, ready to be asked for velocities.

    Args:
        reference: ``path/to/file.h5``, ``name`` (its newest version), ``name@3`` or ``name@latest``.
        store: Where names live; default as on the command line.

    Raises:
        See ``open_skill``.
    """
    return open_skill(reference, store).skill


def save(skill: Skill, path: str | Path) -> Path:
    """Write a skill made or changed in Python to a file, without demonstrations or parents.

    Nothing is proved about it here: see ``verify``.

    Args:
        skill: What to write.
        path: The file; replaced if it exists.

    Returns:
        The path.

    Raises:
        StoreError: The file cannot be written.
    """
    from skillctl.store import current_provenance, encode, write_file  # late: reading needs none of them

    commands: dict[type, Literal["learn", "merge", "combine"]] = {
        SedsSkill: "learn",
        MergedSkill: "merge",
        CombinedSkill: "combine",
    }
    operation = Operation(command=commands[type(skill)], options={"from_python": True})
    artifact = Artifact(skill, (None,) * len(skill.leaves), operation, current_provenance())
    write_file(Path(path), encode(artifact))
    return Path(path)


def display_name(located: Located) -> str:
    """Return ``name@3`` for a skill of the store, else its path."""
    return str(located.path) if located.name is None else f"{located.name}@{located.version}"
