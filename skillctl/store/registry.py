"""The store: ``<root>/<name>/<version>.h5``. Versions are whole, immutable and never overwritten."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from skillctl.errors import ArtifactError, NotFoundError, StoreError, UsageError, printable
from skillctl.store.errors import UnsafeStoreError
from skillctl.store.files import missing_file, read_once, system_errors
from skillctl.store.publishing import Link, staged
from skillctl.store.references import MAX_VERSION, Reference, is_name, parse_reference, require_name

STORE_VARIABLE = "SKILLCTL_STORE"
STORE_NAME = "skills"

_VERSION_FILE = re.compile(r"([1-9][0-9]{0,5})\.h5")


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
    """Where a reference leads: a file, and its name and version if it is one of the store."""

    path: Path
    name: str | None = None
    version: int | None = None


class Registry:
    """A store of skills in a directory, which need not exist before the first publish."""

    def __init__(self, root: Path) -> None:
        self.root = Path(root)

    def names(self) -> tuple[str, ...]:
        """Return the names of all skills that have a version, sorted."""
        with system_errors(f"list {self.root}"):
            if not _is_directory(self.root):
                return ()
            entries = [entry for entry in os.scandir(self.root) if entry.is_dir(follow_symlinks=False)]
            return tuple(
                sorted(entry.name for entry in entries if is_name(entry.name) and _numbers(Path(entry.path)))
            )

    def versions(self, name: str) -> tuple[int, ...]:
        """Return the version numbers of a skill, rising; none if there is no such skill.

        Raises:
            UsageError: No skill can be called so.
            UnsafeStoreError: A symbolic link stands where a directory belongs.
        """
        require_name(name)
        with system_errors(f"list {self.root / name}"):
            if not (_is_directory(self.root) and _is_directory(self.root / name)):
                return ()
            return _numbers(self.root / name)

    def path_of(self, name: str, version: int) -> Path:
        """Return where a version is, or would be, stored."""
        return self.root / name / f"{version}.h5"

    def resolve(self, reference: str) -> Path:
        """Return the file that a reference names; see ``locate``."""
        return self.locate(reference).path

    def locate(self, reference: str) -> Located:
        """Return the file, name and version that a reference names.

        Raises:
            UsageError: Not a reference, or the beginning of more than one digest.
            NotFoundError: No such file, skill or version.
        """
        parsed = parse_reference(reference)
        if isinstance(parsed, Path):
            return _existing(parsed)
        numbers = self.versions(parsed.name)
        if not numbers:
            raise self._unknown_name(parsed)
        version = self._select(parsed, numbers)
        return Located(self.path_of(parsed.name, version), parsed.name, version)

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
        """
        from skillctl.store.reader import digest_of

        require_name(name)
        digest = digest_of(data, f"the new version of {name}")
        with system_errors(f"publish {name} in {self.root}"), self._opened(name) as directory:
            version = self._newest_with(digest, name, directory)
            if version is not None:
                return StoredVersion(name, version, self.path_of(name, version), digest, created=False)
            with staged(directory, data) as link:
                version, created = self._link_next(link, digest, name, directory)
            os.fsync(directory)
        return StoredVersion(name, version, self.path_of(name, version), digest, created)

    def _link_next(self, link: Link, digest: str, name: str, directory: int) -> tuple[int, bool]:
        """Give the staged file the next free number; return it, and whether that was needed."""
        while True:
            version = max(_numbers(directory), default=0) + 1
            if version > MAX_VERSION:
                raise StoreError(f"{name} has {MAX_VERSION} versions; no more fit.")
            try:
                link(f"{version}.h5")
            except FileExistsError:  # another process was faster: perhaps with the same content
                existing = self._newest_with(digest, name, directory)
                if existing is not None:
                    return existing, False
            else:
                return version, True

    @contextmanager
    def _opened(self, name: str) -> Iterator[int]:
        """Open the directory of a skill, made if need be, through no symbolic link."""
        flags = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
        if not _is_directory(self.root):
            self.root.mkdir(parents=True, exist_ok=True)
        root = os.open(self.root, flags)
        try:
            if not _is_directory(self.root / name):
                with suppress(FileExistsError):
                    os.mkdir(name, dir_fd=root)
                os.fsync(root)
            directory = os.open(name, flags, dir_fd=root)
        finally:
            os.close(root)
        try:
            yield directory
        finally:
            os.close(directory)

    def _newest_with(self, digest: str, name: str, directory: int) -> int | None:
        """Return the newest version if it has this content."""
        version = max(_numbers(directory), default=0)
        return version if version and self._digest(name, version) == digest else None

    def _digest(self, name: str, version: int) -> str | None:
        """Return the content digest of a version, None if it cannot be read."""
        from skillctl.store.reader import digest_of

        path = self.path_of(name, version)
        try:
            return digest_of(read_once(path), str(path))
        except (ArtifactError, NotFoundError, StoreError):
            return None

    def _select(self, reference: Reference, numbers: tuple[int, ...]) -> int:
        selector = reference.selector
        if selector == "latest":
            return numbers[-1]
        if isinstance(selector, str) and selector.startswith("sha256:"):
            return self._with_digest(reference.name, selector, numbers)
        if selector in numbers:
            return int(selector)
        raise NotFoundError(
            f"{reference.name} has no version {selector}.",
            hint=f"It has {_ranges(numbers)}; `{reference.name}` alone names the newest.",
        )

    def _with_digest(self, name: str, beginning: str, numbers: tuple[int, ...]) -> int:
        found: dict[int, str] = {}
        for number in reversed(numbers):
            digest = self._digest(name, number) or ""
            if digest == beginning:
                return number
            if digest.startswith(beginning):
                found[number] = digest
        if not found:
            raise NotFoundError(
                f"no version of {name} has a content digest beginning {beginning}.",
                hint=f"It has {_ranges(numbers)}.",
            )
        if len(set(found.values())) > 1:
            raise UsageError(
                f"{len(found)} versions of {name} have a content digest beginning {beginning}.",
                hint=f"Give more digits: {', '.join(found.values())}.",
            )
        return next(iter(found))

    def _unknown_name(self, reference: Reference) -> NotFoundError:
        known = self.names()
        near = difflib.get_close_matches(reference.name, known, n=3, cutoff=0.5)
        if Path(reference.name).is_file():
            hint = f"For the file of that name, write ./{reference.name}."
        elif near:
            hint = f"Did you mean {' or '.join(near)}?"
        elif known:
            hint = f"It has {', '.join(known[:8])}{' …' if len(known) > 8 else ''}."
        else:
            hint = "It holds no skills yet; `skillctl learn DATA --name NAME` stores one."
        return NotFoundError(
            f"the store {printable(str(self.root))} has no skill {reference.name}.", hint=printable(hint)
        )


def _is_directory(path: Path) -> bool:
    """Tell whether a directory stands at ``path``; a link to one is an error."""
    if path.is_symlink():
        raise UnsafeStoreError(str(path))
    return path.is_dir()


def _numbers(directory: int | Path) -> tuple[int, ...]:
    matches = (_VERSION_FILE.fullmatch(entry) for entry in os.listdir(directory))  # noqa: PTH208 - may be a descriptor
    return tuple(sorted(int(match[1]) for match in matches if match))


def _existing(path: Path) -> Located:
    if not os.path.lexists(path):
        raise missing_file(path)
    return Located(path)


def _ranges(numbers: tuple[int, ...]) -> str:
    """Return ``version 1``, ``versions 1 to 7`` or ``versions 1 to 7 (5 of them)``."""
    if len(numbers) == 1:
        return f"version {numbers[0]}"
    gaps = f" ({len(numbers)} of them)" if numbers[-1] - numbers[0] >= len(numbers) else ""
    return f"versions {numbers[0]} to {numbers[-1]}{gaps}"


def locate_store(explicit: Path | None = None) -> Path:
    """Return the directory of the store.

    The one given; else ``SKILLCTL_STORE``; else the nearest directory ``skills`` from the working directory
    upwards; else the one in the user's data folder. A link is followed where the user names it.
    """
    named = explicit or os.environ.get(STORE_VARIABLE)
    if named:
        return Path(named).resolve()
    here = Path.cwd()
    for directory in (here, *here.parents):
        if (directory / STORE_NAME).is_dir():
            return directory / STORE_NAME
    data = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(data) / "skillctl" / STORE_NAME


def locate(reference: str, store: Path | None = None) -> Located:
    """Return what a reference leads to, in the store that ``locate_store`` finds; see ``Registry.locate``."""
    parsed = parse_reference(reference)
    return _existing(parsed) if isinstance(parsed, Path) else Registry(locate_store(store)).locate(reference)


def resolve(reference: str, store: Path | None = None) -> Path:
    """Return the file that a reference names; see ``Registry.locate``."""
    return locate(reference, store).path
