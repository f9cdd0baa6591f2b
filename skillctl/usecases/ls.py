"""What is in the store."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from skillctl.errors import ArtifactError, NotFoundError, StoreError
from skillctl.store import Registry, existing_store
from skillctl.store.folder import by_version


@dataclass(frozen=True, slots=True)
class VersionEntry:
    """One version, as its file states it in its first bytes.

    Attributes:
        version: Its number.
        aliases: Words that name it.
        kind: ``seds``, ``merged`` or ``combined``; like digest and bytes None if the file cannot be read.
        digest: Content digest.
        bytes: Size of the file.
        verified: Whether the whole file passes every check that commands make before they use it; None
            if only its first bytes were read, so the other values are what the file says of itself.
        problem: What is wrong with it.
    """

    version: int
    aliases: tuple[str, ...]
    kind: str | None = None
    digest: str | None = None
    bytes: int | None = None
    verified: bool | None = None
    problem: str | None = None


@dataclass(frozen=True)
class StoredSkill:
    """One name of the store.

    Attributes:
        name: Of the skill.
        versions: Its version numbers, rising.
        path: File of the newest one.
        entries: Each version, in that order.
        problem: Why its aliases cannot be read.
    """

    name: str
    versions: tuple[int, ...]
    path: Path
    entries: tuple[VersionEntry, ...]
    problem: str | None = None


@dataclass(frozen=True)
class StoreReport:
    """Which skills a store holds.

    Attributes:
        store: Its directory, which need not exist.
        skills: By name.
    """

    store: Path
    skills: tuple[StoredSkill, ...]


def list_skills(store: Path | None = None, *, names: Sequence[str] = (), check: bool = False) -> StoreReport:
    """Return names, versions and aliases of the store, and what each file states in its first bytes.

    Args:
        store: Its directory; default as on the command line.
        names: Only these skills.
        check: Read every file as a whole, as commands do before they use it.

    Raises:
        NotFoundError: There is no skill of a name.
        StoreError: The directory cannot be read.
    """
    registry = Registry(existing_store(store))
    for name in names:
        registry.locate(name)
    found = (_skill(registry, name, check) for name in names or registry.names())
    return StoreReport(registry.root, tuple(skill for skill in found if skill is not None))


def _skill(registry: Registry, name: str, check: bool) -> StoredSkill | None:
    """Return what the store has of a name; None if its last version was removed meanwhile."""
    numbers = registry.versions(name)
    words: dict[int, tuple[str, ...]] = {}
    problem = None
    try:
        words = by_version(registry.aliases(name))
    except (ArtifactError, StoreError) as error:
        problem = str(error)
    found = (_entry(registry, name, number, words.get(number, ()), check) for number in numbers)
    entries = tuple(entry for entry in found if entry is not None)
    if not entries:
        return None
    versions = tuple(entry.version for entry in entries)
    return StoredSkill(name, versions, registry.path_of(name, versions[-1]), entries, problem)


def _entry(
    registry: Registry, name: str, version: int, words: tuple[str, ...], check: bool
) -> VersionEntry | None:
    """Return what is known of a version; None if it was removed meanwhile."""
    try:
        header = registry.header(name, version)
        if check:
            from skillctl.store import read_skill  # late: a list reads first bytes only, without HDF5

            read_skill(registry.path_of(name, version))
    except NotFoundError:
        return None
    except (ArtifactError, StoreError) as error:
        return VersionEntry(version, words, verified=False if check else None, problem=str(error))
    verified = True if check else None
    return VersionEntry(version, words, header.kind, header.digest, header.file_bytes, verified)
