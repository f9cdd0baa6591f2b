"""The lock file: which skills a pipeline may use, by their content."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from skillctl.errors import ArtifactError, NotFoundError, UsageError, printable
from skillctl.store import (
    Located,
    LockedSkill,
    Registry,
    existing_store,
    is_lock,
    locate,
    locate_again,
    locate_lock,
    lock_text,
    locked_skill,
    read_lock,
    read_skill,
    write_changed,
)


@dataclass(frozen=True)
class LockChange:
    """What a reference is locked to, before and after.

    Attributes:
        reference: As it was given.
        before, after: The skill and its content; None where it is not in the lock.
    """

    reference: str
    before: LockedSkill | None
    after: LockedSkill | None


@dataclass(frozen=True)
class LockReport:
    """A lock file.

    Attributes:
        path: Its file.
        skills: What it names, or would name.
        changes: What differs from what it named before.
        written: Whether the file was written; never when it was only checked.
    """

    path: Path
    skills: tuple[LockedSkill, ...]
    changes: tuple[LockChange, ...]
    written: bool


def lock(
    references: Sequence[str] = (),
    *,
    path: Path | None = None,
    check: bool = False,
    store: Path | None = None,
) -> LockReport:
    """Write a lock file that names skills: version, and content digest.

    Args:
        references: The skills. None: those that the lock was made of, at what their references mean now; if
            there is no lock yet, the newest version of each skill of the store.
        path: The lock file; default as for every command.
        check: Write nothing.
        store: Where names live; default as on the command line.

    Raises:
        UsageError: There is nothing to lock, or the file is something else than a lock.
        NotFoundError: There is no such skill; when only checked, no lock.
        ArtifactError: A skill is not intact, or the lock cannot be read.
        StoreError: The file cannot be written.
    """
    path = path or locate_lock()
    before = _current(path, wanted=check, needed=check or not references)
    if references or not before:
        skills = tuple(_locked(text, locate(text, store), path) for text in references or _all(store))
    else:
        skills = tuple(_locked(skill.reference, locate_again(skill, path, store), path) for skill in before)
    skills = tuple(sorted(set(skills), key=lambda skill: skill.key))
    written = not check and write_changed(path, lock_text(skills).encode())
    return LockReport(path, skills, _changes(before, skills), written)


def _current(path: Path, *, wanted: bool, needed: bool) -> tuple[LockedSkill, ...]:
    """Return what the lock names; none if there is none and it is not wanted, or a broken one not needed."""
    try:
        return read_lock(path).skills
    except NotFoundError:
        if wanted:
            raise
        return ()
    except ArtifactError as error:
        if needed:
            raise
        if not is_lock(path):
            raise UsageError(
                f"{printable(str(path))} exists and is not a lock; it will not be overwritten.",
                hint="Give another name after --file.",
            ) from error
        return ()


def _all(store: Path | None) -> tuple[str, ...]:
    registry = Registry(existing_store(store))
    names = registry.names()
    if not names:
        raise UsageError(
            f"there is nothing to lock: the store {printable(str(registry.root))} holds no skills.",
            hint="Name skills, or another store with --store.",
        )
    return names


def _locked(reference: str, located: Located, lock: Path) -> LockedSkill:
    return locked_skill(reference, located, read_skill(located.path).digest, lock)


def _changes(before: Sequence[LockedSkill], after: Sequence[LockedSkill]) -> tuple[LockChange, ...]:
    old, new = ({skill.key: skill for skill in skills} for skills in (before, after))
    return tuple(
        LockChange(key[1], old.get(key), new.get(key))
        for key in sorted(old.keys() | new.keys())
        if old.get(key) != new.get(key)
    )
