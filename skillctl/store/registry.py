"""The store: ``<root>/<name>/<version>.h5``. Versions are whole, immutable and never overwritten."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from skillctl.errors import NotFoundError, SkillctlError, StoreError, did_you_mean, printable
from skillctl.store.aliases import by_version, read_aliases, require_alias, write_aliases
from skillctl.store.backend import Backend
from skillctl.store.files import missing_file, system_errors
from skillctl.store.local import LocalBackend
from skillctl.store.numbering import (
    existing_versions,
    highest_given,
    remove_orphans,
    remove_versions,
    version_file,
)
from skillctl.store.references import MAX_VERSION, Reference, is_name, parse_reference, require_name
from skillctl.store.seal import SEAL_BYTES, Header, parse_header
from skillctl.store.selection import select, unknown_alias, what_there_is

PUBLISHED: list[str] = []  # by this process, for what it is told when it is interrupted later on


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
        backend: What keeps that store; None for a file that lies anywhere.
    """

    path: Path
    name: str | None = None
    version: int | None = None
    backend: Backend | None = field(default=None, repr=False, compare=False)


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
            named = filter(is_name, self.backend.folders())
            return tuple(sorted(name for name in named if existing_versions(self.backend.files(name))))

    def versions(self, name: str) -> tuple[int, ...]:
        """Return the version numbers of a skill, rising; none if there is no such skill.

        Raises:
            UsageError: No skill can be called so.
            UnsafeStoreError: A symbolic link stands where a directory belongs.
        """
        require_name(name)
        with system_errors(f"list {self.root / name}"):
            return existing_versions(self.backend.files(name))

    def path_of(self, name: str, version: int) -> Path:
        """Return where a version is, or would be, stored."""
        return self.backend.path(name, version_file(version))

    def header(self, name: str, version: int) -> Header:
        """Return what a version states in its first bytes; see ``seal.read_header``."""
        file = version_file(version)
        return parse_header(*self.backend.beginning(name, file, SEAL_BYTES), self._shown(name, file))

    def locate(self, reference: str | Path) -> Located:
        """Return the file, name and version that a reference names.

        Raises:
            UsageError: Not a reference, or the beginning of more than one digest.
            NotFoundError: No such file, skill or version.
        """
        parsed = parse_reference(reference)
        return existing_file(parsed) if isinstance(parsed, Path) else self.located(parsed)

    def located(self, reference: Reference) -> Located:
        """Return the file, name and version that a reference to a skill of this store names."""
        version = self.version_of(reference)
        return Located(self.path_of(reference.name, version), reference.name, version, self.backend)

    def version_of(self, reference: Reference) -> int:
        """Return the version that a reference means.

        Raises:
            UsageError: The beginning of more than one digest.
            NotFoundError: No such skill or version.
        """
        name = reference.name
        numbers = self.versions(name)
        if not numbers:
            raise self._unknown_name(name)
        digest_of = partial(self._stated_digest, name)
        return select(reference, numbers, partial(self.aliases, name), digest_of)

    def publish(self, name: str, data: bytes) -> StoredVersion:
        """Store an artifact as the next version of a skill, unless the newest version has its content.

        Any number of processes may publish at once: each new version appears whole, under a number of its
        own, without gaps. When this returns, the version is on disk.

        Args:
            name: Name of the skill.
            data: An artifact, as ``encode`` returns it.

        Raises:
            UsageError: No skill can be called so.
            ArtifactError: Not an artifact, or a symbolic link stands where a directory belongs.
            StoreError: No permission, no space.
            KeyboardInterrupt: Interrupted or terminated; its text says whether the version was published.
        """
        require_name(name)
        with self._telling(name, data):
            stored = self._publish(name, data)
            if stored.created:
                PUBLISHED.append(f"{name}@{stored.version}")
        return stored

    def _publish(self, name: str, data: bytes) -> StoredVersion:
        from skillctl.store.reader import digest_of

        digest = digest_of(data, f"the new version of {name}")
        with system_errors(f"publish {name} in {self.root}"):
            version, created = self._newest_with(digest, name), False
            if version is None:
                with self.backend.create(name, data) as call, self.backend.locked(name, shared=True):
                    remove_orphans(self.backend, name)
                    version, created = self._call_next(call, digest, name)
        return StoredVersion(name, version, self.path_of(name, version), digest, created)

    @contextmanager
    def _telling(self, name: str, data: bytes) -> Iterator[None]:
        """Let an interrupt say whether it came before or after the version had its name.

        It may come between the link and the next line of Python, so only the directory knows.
        """
        before = self._numbers_there(name)
        try:
            yield
        except KeyboardInterrupt as stop:
            mine = [n for n in self._numbers_there(name) if n not in before and self._holds(name, n, data)]
            stop.args = (f"{name}@{mine[0]} was published" if mine else f"nothing was published as {name}",)
            raise

    def _numbers_there(self, name: str) -> tuple[int, ...]:
        try:
            return existing_versions(self.backend.files(name))
        except (OSError, SkillctlError):  # whoever publishes will be told why not
            return ()

    def _holds(self, name: str, version: int, data: bytes) -> bool:
        try:
            return self.backend.read(name, version_file(version)) == data
        except SkillctlError:
            return False

    def aliases(self, name: str) -> dict[str, int]:
        """Return the version of each alias of a skill, by alias.

        Raises:
            InvalidRefsError: The file that holds them cannot be understood.
        """
        return read_aliases(self.backend, require_name(name))

    def words(self, name: str) -> dict[int, tuple[str, ...]]:
        """Return the aliases of each version of a skill that has any; see ``aliases``."""
        return by_version(self.aliases(name))

    def tag(self, name: str, version: int, alias: str) -> int | None:
        """Let an alias name a version, and return the one that it named before, if any.

        Raises:
            UsageError: No version can be called so.
            NotFoundError: There is no such version.
            InvalidRefsError: The file that holds the aliases cannot be understood; it is left as it is.
        """
        require_alias(alias)
        with self._changing(name):
            if version not in self.versions(name):
                raise NotFoundError(f"{name} has no version {version}.", hint="`skillctl ls` lists them.")
            aliases = self.aliases(name)
            before = aliases.get(alias)
            if before != version:
                write_aliases(self.backend, name, {**aliases, alias: version})
        return before

    def untag(self, name: str, alias: str) -> int:
        """Remove an alias and return the version that it named.

        Raises:
            NotFoundError: There is no such skill or alias.
            InvalidRefsError: The file that holds the aliases cannot be understood; it is left as it is.
        """
        with self._changing(name):
            aliases = self.aliases(name)
            if alias not in aliases:
                raise unknown_alias(name, printable(alias)[:80], aliases)
            version = aliases.pop(alias)
            write_aliases(self.backend, name, aliases)
        return version

    def remove(self, name: str, versions: Iterable[int]) -> dict[str, int]:
        """Remove versions of a skill with their aliases, and return those; their numbers stay taken.

        Raises:
            NotFoundError: There is no such skill.
            InvalidRefsError: The file that holds the aliases cannot be understood; nothing is removed.
        """
        with self._changing(name):
            doomed = set(versions) & set(self.versions(name))
            aliases = self.aliases(name)
            lost = {alias: version for alias, version in aliases.items() if version in doomed}
            if lost:
                write_aliases(self.backend, name, {a: v for a, v in aliases.items() if a not in lost})
            remove_versions(self.backend, name, doomed)
        return lost

    @contextmanager
    def _changing(self, name: str) -> Iterator[None]:
        """Keep all others from changing a skill that exists."""
        if not self.versions(name):
            raise self._unknown_name(name)
        with system_errors(f"change {name} in {self.root}"), self.backend.locked(name):
            remove_orphans(self.backend, name)
            yield

    def _call_next(self, call: Callable[[str], None], digest: str, name: str) -> tuple[int, bool]:
        """Give the new file the next free number; return it, and whether that was needed."""
        while True:
            version = highest_given(self.backend.files(name)) + 1
            if version > MAX_VERSION:
                raise StoreError(f"{name} has {MAX_VERSION} versions; no more fit.")
            try:
                call(version_file(version))
            except FileExistsError:  # another process was faster: perhaps with the same content
                existing = self._newest_with(digest, name)
                if existing is not None:
                    return existing, False
            else:
                return version, True

    def _newest_with(self, digest: str, name: str) -> int | None:
        """Return the newest version if it has this content."""
        version = max(self.versions(name), default=0)
        return version if version and self._digest(name, version) == digest else None

    def _stated_digest(self, name: str, version: int) -> str | None:
        """Return the content digest that a version states; whoever reads the version checks it."""
        try:
            return self.header(name, version).digest
        except SkillctlError:
            return None

    def _digest(self, name: str, version: int) -> str | None:
        """Return the content digest of a version, None if it cannot be read."""
        from skillctl.store.reader import digest_of

        file = version_file(version)
        try:
            return digest_of(self.backend.read(name, file), self._shown(name, file))
        except SkillctlError:
            return None

    def _shown(self, name: str, file: str) -> str:
        return f"{self.backend.place}/{name}/{file}"

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


def existing_file(path: Path) -> Located:
    """Return where a file is, or raise NotFoundError with files of similar names."""
    if not os.path.lexists(path):
        raise missing_file(path)
    return Located(path)
