"""The history of a skill: what made each version, and the skills it was made from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from skillctl.errors import ArtifactError, NotFoundError, SkillctlError, StoreError
from skillctl.store import (
    Located,
    Lock,
    ParentRecord,
    Registry,
    existing_store,
    locate_store,
    read_header,
    read_skill,
)
from skillctl.store.folder import by_version
from skillctl.store.source import Source, open_skill

Presence: TypeAlias = Literal["present", "changed", "missing"]


@dataclass(frozen=True)
class LogEntry:
    """One version of a skill.

    Attributes:
        version, aliases: How it is named.
        digest, command, note, date, tool: Its identity, and what made it; None if it cannot be read.
        parents: Skills it was made from.
        inputs: How many files it was made from.
        problem: Why it cannot be read.
    """

    version: int
    aliases: tuple[str, ...]
    digest: str | None = None
    command: str | None = None
    note: str | None = None
    date: str | None = None
    tool: str | None = None
    parents: tuple[ParentRecord, ...] = ()
    inputs: int = 0
    problem: str | None = None


@dataclass(frozen=True)
class LogReport:
    """The versions of a skill, newest first."""

    name: str
    entries: tuple[LogEntry, ...]


def log(name: str, *, limit: int | None = None, store: Path | None = None) -> LogReport:
    """Return what made each version of a skill of the store, newest first.

    Args:
        name: Of the skill.
        limit: Only so many versions.
        store: Where names live; default as on the command line.

    Raises:
        UsageError: No skill can have this name.
        NotFoundError: There is no such skill.
        InvalidRefsError: Its aliases cannot be read.
    """
    registry = Registry(existing_store(store))
    versions = registry.versions(name)
    if not versions:
        registry.locate(name)  # raises, and says what there is instead
    words = by_version(registry.aliases(name))
    newest = versions[::-1][:limit]
    entries = (_entry(registry.path_of(name, number), number, words.get(number, ())) for number in newest)
    return LogReport(name, tuple(entries))


def _entry(path: Path, version: int, aliases: tuple[str, ...]) -> LogEntry:
    try:
        artifact = read_skill(path)
    except (ArtifactError, NotFoundError, StoreError) as error:
        return LogEntry(version, aliases, problem=str(error))
    operation, provenance = artifact.operation, artifact.provenance
    return LogEntry(
        version,
        aliases,
        digest=artifact.digest,
        command=operation.command,
        note=operation.note,
        date=provenance.date,
        tool=provenance.tool,
        parents=provenance.parents,
        inputs=len(provenance.inputs),
    )


@dataclass(frozen=True)
class Ancestor:
    """A skill in the tree of what a skill was made from.

    Attributes:
        skill: As it was named when it was used, or as it is found now.
        role: Its role in the skill that was made from it; empty for the skill itself.
        digest: Its content digest, as its child recorded it.
        presence: ``present`` (this content is there), ``changed`` (other content is there), or ``missing``.
        path: Where it is, if present.
        command, note: What made it, if present.
        parents: What it was made from, if present.
    """

    skill: str
    role: str
    digest: str
    presence: Presence
    path: Path | None
    command: str | None
    note: str | None
    parents: tuple[Ancestor, ...]

    def all(self) -> Iterator[Ancestor]:
        """Yield this skill and all it was made from."""
        yield self
        for parent in self.parents:
            yield from parent.all()


@dataclass(frozen=True)
class LineageReport:
    """The tree of what a skill was made from.

    Attributes:
        lineage: The skill, with its parents, and theirs.
        complete: Whether every parent is present.
    """

    lineage: Ancestor
    complete: bool


def lineage(reference: str | Path, *, store: Path | None = None, lock: Lock | None = None) -> LineageReport:
    """Return the tree of parents of a skill, and which of them are still there.

    A parent is looked for in the store, under its name and version, then among the other versions of the
    name; a parent that was a file is looked for beside its child. Only a skill with the recorded digest is
    the parent.

    Raises:
        NotFoundError, ArtifactError: The reference leads to no intact skill.
    """
    registry = Registry(locate_store(store))
    source = open_skill(reference, store, lock)
    tree = _found(source, "", registry)
    return LineageReport(tree, all(ancestor.presence == "present" for ancestor in tree.all()))


def _found(source: Source, role: str, registry: Registry) -> Ancestor:
    artifact, path = source.artifact, source.located.path
    parents = tuple(_ancestor(record, path.parent, registry) for record in artifact.provenance.parents)
    operation = artifact.operation
    return Ancestor(
        source.name, role, artifact.digest, "present", path, operation.command, operation.note, parents
    )


def _ancestor(record: ParentRecord, folder: Path, registry: Registry) -> Ancestor:
    presence: Presence = "missing"
    for located in _candidates(record, folder, registry):
        if not located.path.exists():
            continue
        try:
            if read_header(located.path).digest == record.digest:
                return _found(Source(located, read_skill(located.path)), record.role, registry)
        except SkillctlError:
            pass  # damaged, so it is not the parent
        # Another version may be another skill; only other content in the recorded place is a change.
        if located.version in (None, record.version):
            presence = "changed"
    return Ancestor(record.shown, record.role, record.digest, presence, None, None, None, ())


def _candidates(record: ParentRecord, folder: Path, registry: Registry) -> Iterator[Located]:
    """Yield where a parent may be found, the likeliest place first."""
    if record.version is None:
        yield Located(folder / Path(record.name).name)  # a name in a file must not lead to another directory
        return
    try:
        versions = registry.versions(record.name)
    except SkillctlError:  # a name that no skill of the store can have
        return
    for version in sorted(versions, key=lambda number: number != record.version):
        yield Located(registry.path_of(record.name, version), record.name, version)
