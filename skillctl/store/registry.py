"""The store: ``<root>/<name>/<version>.h5``; where it is, and what a reference leads to in it."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple

from skillctl.errors import NotFoundError, SkillctlError, StoreError, UsageError, did_you_mean, printable
from skillctl.store.backend import Backend
from skillctl.store.files import missing_file, system_errors
from skillctl.store.folder import Folder, require_alias, what_there_is
from skillctl.store.local import LocalBackend
from skillctl.store.locating import existing_store
from skillctl.store.references import Reference, is_name, parse_reference, require_name
from skillctl.store.seal import Header

PUBLISHED: list[str] = []  # by this process, so that a later interrupt can say so


@dataclass(frozen=True, slots=True)
class StoredVersion:
    """One version of a skill in the store.

    Attributes:
        name, version: ``name@version`` names it.
        path: Its file.
        digest: Content digest, ``sha256:…``.
        created: False if the newest version already had this content.
    """

    name: str
    version: int
    path: Path
    digest: str
    created: bool


@dataclass(frozen=True, slots=True)
class Located:
    """Where a reference leads.

    Attributes:
        path: A file.
        name, version: If it is one of a store.
        backend: What keeps that store; None for a file in no store.
    """

    path: Path
    name: str | None = None
    version: int | None = None
    backend: Backend | None = field(default=None, repr=False, compare=False)

    @property
    def shown(self) -> str:
        """``name@3`` for a skill of a store, else the path."""
        return str(self.path) if self.name is None else f"{self.name}@{self.version}"


class Removed(NamedTuple):
    """What was removed of a skill: versions, rising, and the version that each lost alias named."""

    versions: tuple[int, ...]
    aliases: dict[str, int]


class Registry:
    """A store of skills.

    Attributes:
        backend: The place that keeps its files. A path stands for a directory of this machine, which need not
            exist before the first publish.
    """

    def __init__(self, place: Path | Backend) -> None:
        self.backend: Backend = LocalBackend(place) if isinstance(place, Path) else place

    @property
    def root(self) -> Path:
        """The place of the store, for people."""
        return Path(self.backend.place)

    def names(self) -> tuple[str, ...]:
        """Return the names of all skills that have a version, sorted."""
        with system_errors(f"list {self.root}"):
            names = filter(is_name, self.backend.folders())
            return tuple(sorted(name for name in names if self._folder(name).versions()))

    def versions(self, name: str) -> tuple[int, ...]:
        """Return the version numbers of a skill, rising; none if there is no such skill.

        Raises:
            UsageError: No skill can have this name.
            UnsafeStoreError: A symbolic link stands where a directory belongs.
        """
        with system_errors(f"list {self.root / name}"):
            return self._folder(name).versions()

    def path_of(self, name: str, version: int) -> Path:
        """Return where a version is, or would be, stored."""
        return self._folder(name).path(version)

    def header(self, name: str, version: int) -> Header:
        """Return what a version states in its first bytes; see ``seal.read_header``."""
        return self._folder(name).header(version)

    def locate(self, reference: str | Path | Reference) -> Located:
        """Return the file, name and version that a reference names.

        Raises:
            UsageError: Not a reference, or the beginning of more than one digest.
            NotFoundError: No such file, skill or version.
        """
        parsed = parse_reference(reference)
        if isinstance(parsed, Path):
            return existing_file(parsed)
        version = self.version_of(parsed)
        return Located(self.path_of(parsed.name, version), parsed.name, version, self.backend)

    def version_of(self, reference: Reference) -> int:
        """Return the version that a reference means.

        Raises:
            UsageError: The beginning of more than one digest.
            NotFoundError: No such skill or version.
        """
        numbers = self.versions(reference.name)
        if not numbers:
            raise self._unknown_name(reference.name)
        return self._folder(reference.name).select(reference.selector, numbers)

    def publish(self, name: str, data: bytes) -> StoredVersion:
        """Store an artifact as the next version of a skill, unless the newest version has its content.

        Any number of processes may publish at once: each new version appears whole, under a number of its
        own, without gaps. When this returns, the version is on disk.

        Args:
            name: Name of the skill.
            data: An artifact, as ``encode`` returns it.

        Raises:
            UsageError: No skill can have this name.
            ArtifactError: Not an artifact, or a symbolic link stands where a directory belongs.
            StoreError: No permission, no space.
            KeyboardInterrupt: Interrupted or terminated.

        The text of the last two says whether the version was published.
        """
        folder = self._folder(name)
        with _telling_publication(folder, data):
            from skillctl.store.reader import digest_of

            digest = digest_of(data, f"the new version of {name}")
            with system_errors(f"publish {name} in {self.root}"):
                version, created = folder.add(data, digest)
            if created:
                PUBLISHED.append(f"{name}@{version}")
        return StoredVersion(name, version, folder.path(version), digest, created)

    def aliases(self, name: str) -> dict[str, int]:
        """Return the version of each alias of a skill, by alias.

        Raises:
            InvalidRefsError: The file that holds them cannot be understood.
        """
        return self._folder(name).aliases()

    def tag(self, name: str, version: int, alias: str) -> int | None:
        """Let an alias name a version, and return the one that it named before, if any.

        Raises:
            UsageError: No version can have this name.
            NotFoundError: There is no such version.
            InvalidRefsError: The file that holds the aliases cannot be understood; it is left as it is.
        """
        require_alias(alias)
        with self._existing(name).changing() as folder:
            if version not in folder.versions():
                raise NotFoundError(f"{name} has no version {version}.", hint="`skillctl ls` lists them.")
            aliases = folder.aliases()
            before = aliases.get(alias)
            if before != version:
                folder.write_aliases({**aliases, alias: version})
        return before

    def untag(self, name: str, alias: str) -> int:
        """Remove an alias and return the version that it named.

        Raises:
            NotFoundError: There is no such skill or alias.
            InvalidRefsError: The file that holds the aliases cannot be understood; it is left as it is.
        """
        with self._existing(name).changing() as folder:
            aliases = folder.aliases()
            if alias not in aliases:
                raise folder.unknown_alias(printable(alias)[:80], list(aliases))
            version = aliases.pop(alias)
            folder.write_aliases(aliases)
        return version

    def remove(
        self, name: str, versions: Iterable[int], *, tagged: Literal["remove", "keep", "refuse"] = "remove"
    ) -> Removed:
        """Remove versions of a skill, with their aliases; their numbers stay taken.

        Args:
            name: Of the skill.
            versions: Which.
            tagged: What becomes of those that have an alias at the moment nobody else can change that.

        Raises:
            NotFoundError: There is no such skill.
            UsageError: One has an alias, and that is refused; nothing is removed.
            InvalidRefsError: The file that holds the aliases cannot be understood; nothing is removed.
            StoreError: The disk refused; its text says what is gone.
        """
        existing = self._existing(name)
        with _telling_removal(existing), existing.changing() as folder:
            doomed = set(versions) & set(folder.versions())
            aliases = folder.aliases()
            if tagged == "keep":
                doomed -= set(aliases.values())
            lost = {alias: version for alias, version in aliases.items() if version in doomed}
            if lost and tagged == "refuse":
                raise has_alias(name, *next(iter(lost.items())))
            if lost:
                folder.write_aliases({a: v for a, v in aliases.items() if a not in lost})
            folder.remove(doomed)
        return Removed(tuple(sorted(doomed)), lost)

    def _folder(self, name: str) -> Folder:
        return Folder(self.backend, require_name(name))

    def _existing(self, name: str) -> Folder:
        """Return the folder of a skill that has a version, or raise NotFoundError."""
        if not self.versions(name):
            raise self._unknown_name(name)
        return self._folder(name)

    def _unknown_name(self, name: str) -> NotFoundError:
        known = self.names()
        hint = (
            (f"For the file of that name, write ./{name}." if Path(name).is_file() else "")
            or did_you_mean(name, known, most=3, cutoff=0.5)
            or what_there_is(known)
            or "It holds no skills yet; `skillctl learn DATA --name NAME` stores one."
        )
        return NotFoundError(
            f"the store {printable(str(self.root))} has no skill {name}.", hint=printable(hint)
        )


def has_alias(name: str, alias: str, version: int) -> UsageError:
    """Return the error for a version that is not removed, because it has an alias."""
    return UsageError(
        f"{name}@{version} is {name}@{alias}; nothing was removed.",
        hint=f"`skillctl untag {name} {alias}` first, or --force.",
    )


@contextmanager
def _telling_publication(folder: Folder, data: bytes) -> Iterator[None]:
    """Let an interrupt, or the disk's refusal, say whether it came before or after the version had its name.

    It may come between the link and the next line of Python, so only the directory knows.
    """
    before = _known(folder)[0]

    def outcome() -> str:
        mine = [n for n in _known(folder)[0] if n not in before and folder.holds(n, data)]
        name = folder.name
        return f"{name}@{mine[0]} was published" if mine else f"nothing was published as {name}"

    try:
        yield
    except KeyboardInterrupt as stop:
        stop.args = (outcome(),)
        raise
    except StoreError as error:
        said = outcome()
        error.add(f"{said[0].upper()}{said[1:]}." if said.startswith("nothing") else f"{said}, all the same.")
        raise


@contextmanager
def _telling_removal(folder: Folder) -> Iterator[None]:
    """Let the disk's refusal say what is gone: versions go one after the other, and aliases before them."""
    versions, aliases = _known(folder)
    try:
        yield
    except StoreError as error:
        left, words = _known(folder)
        gone = [f"{folder.name}@{version}" for version in versions if version not in left]
        gone += [f"{folder.name}@{alias}" for alias in aliases if alias not in words]
        error.add(f"Removed before that: {', '.join(gone)}." if gone else "Nothing was removed.")
        raise


def _known(folder: Folder) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Return the versions and the aliases of a skill; none if they cannot be read: another error says why."""
    try:
        return folder.versions(), tuple(folder.aliases())
    except (OSError, SkillctlError):
        return (), ()


def existing_file(path: Path) -> Located:
    """Return where a file is, or raise NotFoundError with files of similar names."""
    if not os.path.lexists(path):
        raise missing_file(path)
    return Located(path)


def locate(reference: str | Path, store: str | Path | None = None) -> Located:
    """Return what a reference leads to, in the store that ``locate_store`` finds; see ``Registry.locate``.

    A ``Path`` is always a file.
    """
    parsed = parse_reference(reference)
    if isinstance(parsed, Path):
        return existing_file(parsed)
    return Registry(existing_store(store)).locate(parsed)
