"""``skillctl.lock``: which skills a pipeline may use, by content; a text, so that a review shows changes."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillctl.errors import NotFoundError, UsageError, printable
from skillctl.store.errors import InvalidLockError, NotAnArtifactError, NotLockedError
from skillctl.store.files import read_once, refused_as
from skillctl.store.locating import locate_store, upwards
from skillctl.store.references import is_name, is_version, parse_reference
from skillctl.store.registry import Located, Registry, existing_file, locate
from skillctl.toml_files import parse_toml, toml_lines

LOCK_VARIABLE = "SKILLCTL_LOCK"
LOCK_NAME = "skillctl.lock"
LOCK_FORMAT = 1
MAX_LOCK_BYTES = 16 << 20

_DIGEST = re.compile(r"sha256:[0-9a-f]{64}")
_STORED, _FILE = {"reference", "name", "version", "digest"}, {"file", "digest"}
_HEADING = "# The skills that --locked allows, written by `skillctl lock`. Keep it under version control.\n"


@dataclass(frozen=True, slots=True)
class LockedSkill:
    """One skill that a lock names.

    Attributes:
        reference: The reference that was given: ``reach``, ``reach@release``; of a file, its path relative to
            the directory of the lock.
        digest: Content digest, ``sha256:…``.
        name, version: What the reference meant; None for a file.
    """

    reference: str
    digest: str
    name: str | None = None
    version: int | None = None

    @property
    def key(self) -> tuple[bool, str]:
        """Unique in a lock, and the order of its skills; files come last."""
        return (self.name is None, self.reference)

    @property
    def skill(self) -> str:
        """``name@3``, or the path of a file."""
        return self.reference if self.name is None else f"{self.name}@{self.version}"


@dataclass(frozen=True, slots=True)
class Lock:
    """The skills that may be used, and the file that says so."""

    path: Path
    skills: tuple[LockedSkill, ...]

    def locate(self, reference: str | Path, store: str | Path | None = None) -> Located:
        """Return what a reference leads to; a locked reference leads to the version that was locked.

        Any other may name a version itself. ``require`` decides whether the content is allowed.

        Raises:
            UsageError: Not a reference, or a name alone that is locked at more than one version.
            NotFoundError: No such file, skill or version.
            NotLockedError: The lock does not name this version.
        """
        parsed = parse_reference(reference)
        if isinstance(parsed, Path):
            return existing_file(parsed)
        reference = str(reference)
        registry = Registry(locate_store(store))
        same = [skill for skill in self.skills if skill.name == parsed.name]
        meant = {skill.version for skill in same if skill.reference == _without_latest(reference)}
        if not meant and parsed.selector == "latest":
            meant = {skill.version for skill in same}
        if len(meant) > 1:
            raise UsageError(
                f"{reference} is locked at {len(meant)} versions: {_listed(same)}.",
                hint="Say which one is meant.",
            )
        if meant:
            return registry.locate(f"{parsed.name}@{meant.pop()}")
        if not same:
            raise self._unnamed(reference)
        located = registry.locate(reference)
        if located.version not in {skill.version for skill in same}:
            other = "" if reference == located.shown else f"{reference} is {located.shown}, and "
            raise NotLockedError(
                f"{other}{self.path} names {_listed(same)}{'' if other else f', not {located.shown}'}.",
                hint=f"`skillctl lock {reference} …`, with all others that are used, locks that version.",
            )
        return located

    def names(self, name: str) -> bool:
        """Tell whether a version of this skill of the store is allowed."""
        return any(skill.name == name for skill in self.skills)

    def require(self, located: Located, digest: str) -> None:
        """Raise NotLockedError unless the lock allows this content at this place.

        A file may lie anywhere: its content is what the lock names.
        """
        if located.name is None:
            if digest not in {skill.digest for skill in self.skills}:
                raise self._unnamed(f"{located.path} ({digest})")
            return
        for skill in self.skills:
            if (skill.name, skill.version) == (located.name, located.version) and skill.digest != digest:
                raise NotLockedError(
                    f"{skill.skill} holds {digest}, but {self.path} names {skill.digest}.",
                    hint="Another skill is in the place of the locked one: restore that one, or lock this "
                    f"one with `skillctl lock`, if it is meant. Its file: {located.path}",
                )

    def _unnamed(self, what: str) -> NotLockedError:
        return NotLockedError(
            f"{self.path} does not name {what}.",
            hint="`skillctl lock SKILL…`, with all skills that are to be used, writes one that does.",
        )


def _without_latest(reference: str) -> str:
    return reference.removesuffix("@latest")


def _listed(skills: Iterable[LockedSkill]) -> str:
    return ", ".join(sorted({skill.skill for skill in skills}))


def locate_lock() -> Path:
    """Return the lock file: ``SKILLCTL_LOCK``, else the nearest one from the working directory upwards.

    Where there is none, the one that would be made here.
    """
    named = os.environ.get(LOCK_VARIABLE)
    if named:
        return Path(named).resolve()
    return next((place for place in upwards(LOCK_NAME) if place.is_file()), Path.cwd() / LOCK_NAME)


def read_lock(path: Path) -> Lock:
    """Return what a lock file names.

    Raises:
        NotFoundError: There is no such file.
        InvalidLockError: It is not TOML, or not of the form of a lock.
        StoreError: The system does not let us read it.
    """
    try:
        with refused_as(InvalidLockError, str(path)):
            document = parse_toml(read_once(path, MAX_LOCK_BYTES))
    except NotFoundError:
        raise NotFoundError(
            f"{printable(str(path))}: there is no lock file.", hint="`skillctl lock SKILL…` writes one."
        ) from None
    return Lock(path, _skills_of(document, str(path)))


def _skills_of(document: Mapping[str, Any], path: str) -> tuple[LockedSkill, ...]:
    if document.get("format") != LOCK_FORMAT or type(document["format"]) is not int:
        raise InvalidLockError(path, f"it states format {document.get('format')!r:.40}, not {LOCK_FORMAT}")
    tables = document.get("skill", [])
    if set(document) - {"format", "skill"} or not isinstance(tables, list):
        raise InvalidLockError(path, "expected a format, and tables [[skill]]")
    return tuple(_skill_of(table, number, path) for number, table in enumerate(tables, start=1))


def _skill_of(table: Any, number: int, path: str) -> LockedSkill:
    keys = set(table) if isinstance(table, dict) else set()
    if keys not in (_STORED, _FILE):
        raise InvalidLockError(
            path, f"skill {number}: expected {', '.join(sorted(_STORED))}, or digest, file"
        )
    texts = {key: value for key, value in table.items() if key != "version"}
    if not all(isinstance(value, str) for value in texts.values()):
        raise InvalidLockError(path, f"skill {number}: {', '.join(sorted(texts))} are texts")
    if not _DIGEST.fullmatch(table["digest"]):
        raise InvalidLockError(path, f"skill {number}: {table['digest'][:80]!r} is not a content digest")
    if keys == _FILE:
        return LockedSkill(table["file"], table["digest"])
    name, version = table["name"], table["version"]
    if not is_name(name) or type(version) is not int or not is_version(str(version)):
        raise InvalidLockError(path, f"skill {number}: {name[:80]!r}, {version!r:.40} name no version")
    if table["reference"].partition("@")[0] != name:
        raise InvalidLockError(path, f"skill {number}: its reference is not one to {name}")
    return LockedSkill(table["reference"], table["digest"], name, version)


def is_lock(path: Path) -> bool:
    """Tell whether a file was written as a lock, even if it can no longer be read as one."""
    with suppress(NotFoundError, NotAnArtifactError):
        return read_once(path, MAX_LOCK_BYTES).startswith(_HEADING.encode())
    return False


def lock_text(skills: Iterable[LockedSkill]) -> str:
    """Return the text of a lock file: sorted, the same for the same skills."""
    ordered = sorted(skills, key=lambda skill: skill.key)
    return "".join([_HEADING, f"format = {LOCK_FORMAT}\n", *map(_table, ordered)])


def _table(skill: LockedSkill) -> str:
    values: dict[str, str | int] = {"file": skill.reference}
    if skill.name is not None and skill.version is not None:
        values = {"reference": skill.reference, "name": skill.name, "version": skill.version}
    values["digest"] = skill.digest
    return f"\n[[skill]]\n{toml_lines(values)}"


def locked_skill(reference: str, located: Located, digest: str, lock: Path) -> LockedSkill:
    """Return the entry of a skill in the lock at ``lock``.

    Raises:
        UsageError: A file whose path a text cannot hold.
    """
    if located.name is not None:
        return LockedSkill(_without_latest(reference), digest, located.name, located.version)
    path = Path(os.path.relpath(located.path.absolute(), lock.absolute().parent)).as_posix()
    if printable(path) != path:
        raise UsageError(
            f"{printable(path)}: a lock cannot name a path with control characters.",
            hint="Rename the file.",
        )
    return LockedSkill(path, digest)


def locate_again(skill: LockedSkill, lock: Path, store: Path | None = None) -> Located:
    """Return what the reference of a locked skill leads to now.

    Raises:
        NotFoundError: Nothing any more.
    """
    if skill.name is None:
        return existing_file(lock.parent / skill.reference)
    return locate(skill.reference, store)
