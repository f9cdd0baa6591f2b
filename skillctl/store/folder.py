"""The folder of one skill in a store: its versions, the numbers that were given, and its aliases.

Versions are whole, immutable and never overwritten. A number is given once: an empty file remembers it when
its version is removed. Aliases are text, in ``refs.toml``, so that a review shows when one is moved.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillctl.errors import NotFoundError, SkillctlError, StoreError, UsageError, did_you_mean, printable
from skillctl.store.backend import Backend
from skillctl.store.errors import InvalidRefsError
from skillctl.store.files import refused_as, system_errors
from skillctl.store.references import MAX_VERSION, is_version, is_word
from skillctl.store.seal import SEAL_BYTES, Header, parse_header

SIGNATURE_SUFFIX = ".sig"  # beside a version; it goes with it
REFS_FILE = "refs.toml"
MAX_REFS_BYTES = 1 << 20
RESERVED = ("latest",)

# An empty file `7.removed` remembers that numbers up to 7 were given. Only the highest matters, so only it
# is kept; where a higher version exists, none.
_ENTRY = re.compile(r"([1-9][0-9]{0,5})\.(h5|removed)")
_SIGNATURES = re.compile(rf"([1-9][0-9]{{0,5}}\.h5){re.escape(SIGNATURE_SUFFIX)}")
_HEADING = "# Aliases of this skill's versions, written by `skillctl tag` and `skillctl untag`.\n[aliases]\n"


@dataclass(frozen=True, slots=True)
class Folder:
    """The folder of a skill, which need not exist.

    Attributes:
        backend: The place that keeps the store.
        name: Of the skill.
    """

    backend: Backend
    name: str

    def versions(self) -> tuple[int, ...]:
        """Return the numbers of the versions, rising."""
        return tuple(sorted(self._numbers("h5")))

    def path(self, version: int) -> Path:
        """Return where a version is, or would be, stored."""
        return self.backend.path(self.name, _file(version))

    def header(self, version: int) -> Header:
        """Return what a version states in its first bytes; see ``seal.read_header``."""
        file = _file(version)
        return parse_header(*self.backend.beginning(self.name, file, SEAL_BYTES), self._shown(file))

    def stated_digest(self, version: int) -> str | None:
        """Return the content digest that a version states; a reader of the version checks it."""
        with suppress(SkillctlError):
            return self.header(version).digest
        return None

    def holds(self, version: int, data: bytes) -> bool:
        """Tell whether a version has exactly these bytes."""
        with suppress(SkillctlError):
            return self.backend.read(self.name, _file(version)) == data
        return False

    def select(self, selector: int | str, numbers: Sequence[int]) -> int:
        """Return the version that the selector of a reference means.

        Args:
            selector: See ``Reference``.
            numbers: The versions, rising, at least one.

        Raises:
            NotFoundError: No such version or alias.
            UsageError: The beginning of more than one digest.
        """
        if selector == "latest":
            return numbers[-1]
        if isinstance(selector, str):
            by = self._with_digest if selector.startswith("sha256:") else self._with_alias
            return by(selector, numbers)
        if selector in numbers:
            return selector
        # Numbers are given without gaps, so one that is missing below another was there once.
        removed = ": it was removed" if selector < numbers[-1] else ""
        raise NotFoundError(
            f"{self.name} has no version {selector}{removed}.",
            hint=f"It has {ranges(numbers)}; `{self.name}` alone names the newest.",
        )

    def _with_alias(self, alias: str, numbers: Sequence[int]) -> int:
        aliases = self.aliases()
        if alias not in aliases:
            raise self.unknown_alias(alias, list(aliases))
        if aliases[alias] not in numbers:
            raise NotFoundError(
                f"{self.name}@{alias} is version {aliases[alias]}, which does not exist.",
                hint=f"It has {ranges(numbers)}; `skillctl tag {self.name}@N {alias}` moves the alias.",
            )
        return aliases[alias]

    def unknown_alias(self, alias: str, known: Sequence[str]) -> NotFoundError:
        """Return the error for an alias that the skill does not have."""
        hint = (
            did_you_mean(alias, {word: f"{self.name}@{word}" for word in known}, cutoff=0.5)
            or what_there_is(known)
            or f"It has no aliases yet; `skillctl tag {self.name}@N {alias}` makes one."
        )
        return NotFoundError(f"{self.name} has no alias {alias}.", hint=hint)

    def _with_digest(self, beginning: str, numbers: Sequence[int]) -> int:
        found: dict[int, str] = {}
        for number in reversed(numbers):
            digest = self.stated_digest(number) or ""
            if digest == beginning:
                return number
            if digest.startswith(beginning):
                found[number] = digest
        if not found:
            raise NotFoundError(
                f"no version of {self.name} has a content digest beginning {beginning}.",
                hint=f"It has {ranges(numbers)}; `skillctl ls {self.name}` shows their digests.",
            )
        if len(set(found.values())) > 1:
            raise UsageError(
                f"{len(found)} versions of {self.name} have a content digest beginning {beginning}.",
                hint=f"Give more digits: {', '.join(found.values())}.",
            )
        return next(iter(found))

    def newest_with(self, digest: str) -> int | None:
        """Return the newest version if it has this content, whatever its seal states; else None."""
        from skillctl.store.reader import digest_of

        for version in self.versions()[-1:]:
            file = _file(version)
            with suppress(SkillctlError):
                if digest_of(self.backend.read(self.name, file), self._shown(file)) == digest:
                    return version
        return None

    def add(self, data: bytes, digest: str) -> tuple[int, bool]:
        """Store an artifact under the next number; return it, and False if the newest has this content."""
        version = self.newest_with(digest)
        if version is not None:
            return version, False
        with self.backend.create(self.name, data) as call, self.backend.locked(self.name, shared=True):
            self._remove_orphans()
            return self._call_next(call, digest)

    def _call_next(self, call: Callable[[str], None], digest: str) -> tuple[int, bool]:
        """Give the new file the next free number; return it, and whether that was needed."""
        while True:
            version = self._highest_given() + 1
            if version > MAX_VERSION:
                raise StoreError(f"{self.name} has {MAX_VERSION} versions; no more fit.")
            try:
                call(_file(version))
            except FileExistsError:  # another process was faster: perhaps with the same content
                existing = self.newest_with(digest)
                if existing is not None:
                    return existing, False
            else:
                return version, True

    @contextmanager
    def changing(self) -> Iterator[Folder]:
        """Keep all others from changing the folder, which exists, and yield it."""
        with system_errors(f"change {self.name} in {self.backend.place}"), self.backend.locked(self.name):
            self._remove_orphans()
            yield self

    def remove(self, versions: Iterable[int]) -> None:
        """Remove versions; killed at any moment, no number is free that was taken.

        The caller holds the exclusive lock.
        """
        highest, doomed = self._highest_given(), set(versions)
        if not set(self.versions()) - doomed or highest in doomed:
            with self.backend.create(self.name, b"") as call, suppress(FileExistsError):
                call(f"{highest}.removed")
        self.backend.delete(self.name, [_file(version) for version in sorted(doomed)])
        self._remove_orphans()
        lower = sorted(number for number in self._numbers("removed") if number < highest)
        self.backend.delete(self.name, [f"{number}.removed" for number in lower])

    def _remove_orphans(self) -> None:
        """Remove signatures of versions that are gone, left by a process that was killed while removing.

        A version goes before its signatures, so a version that exists never loses them. The caller holds the
        lock, shared or not, so no process signs or removes meanwhile.
        """
        files = set(self.backend.files(self.name))
        for match in filter(None, map(_SIGNATURES.fullmatch, files)):
            if match[1] not in files:
                with suppress(OSError):  # of another user, or not a file: it may stay
                    self.backend.delete(self.name, [match[0]])

    def _highest_given(self) -> int:
        """Return the highest number that a version has or had; 0 if there never was one."""
        return max(self._numbers("h5", "removed"), default=0)

    def _numbers(self, *suffixes: str) -> list[int]:
        matches = filter(None, map(_ENTRY.fullmatch, self.backend.files(self.name)))
        return [int(match[1]) for match in matches if match[2] in suffixes]

    def aliases(self) -> dict[str, int]:
        """Return the version of each alias, by alias; none without the file.

        Raises:
            InvalidRefsError: The file is not TOML, or holds something other than versions by alias.
            StoreError: The system does not let us read it.
        """
        from skillctl.toml_files import parse_toml  # late: few commands meet such a file

        shown = self._shown(REFS_FILE)
        try:
            with refused_as(InvalidRefsError, shown):
                document = parse_toml(self.backend.read(self.name, REFS_FILE, MAX_REFS_BYTES))
        except NotFoundError:
            return {}
        return dict(sorted(_checked(document, shown).items()))

    def write_aliases(self, aliases: Mapping[str, int]) -> None:
        """Replace the aliases: afterwards the file is old or new, whole.

        Raises:
            StoreError: No permission, no space.
        """
        from skillctl.toml_files import toml_lines

        text = _HEADING + toml_lines(dict(sorted(aliases.items())))
        self.backend.replace(self.name, REFS_FILE, text.encode("ascii"))

    def _shown(self, file: str) -> str:
        return f"{self.backend.place}/{self.name}/{file}"


def _file(version: int) -> str:
    return f"{version}.h5"


def is_alias(text: str) -> bool:
    """Tell whether a version can have this name."""
    return is_word(text) and text not in RESERVED


def require_alias(text: str) -> None:
    """Raise UsageError unless a version can have this name."""
    if not is_alias(text):
        raise UsageError(
            f"{printable(text)[:80]!r} cannot be an alias.",
            hint="Use up to 64 of a-z, 0-9, '.', '_' and '-', first a letter; not latest, which is always "
            "the newest version.",
        )


def _checked(document: Mapping[str, Any], path: str) -> dict[str, int]:
    aliases = document.get("aliases", {})
    if set(document) - {"aliases"} or not isinstance(aliases, dict):
        raise InvalidRefsError(path, "expected one table, [aliases]")
    for alias, version in aliases.items():
        if not is_alias(alias):
            raise InvalidRefsError(path, f"{alias[:80]!r} cannot be an alias")
        if type(version) is not int or not is_version(str(version)):
            raise InvalidRefsError(path, f"{alias} = {str(version)[:40]} is not a version number")
    return aliases


def what_there_is(known: Sequence[str]) -> str:
    """Return ``It has …`` with the first few of the known words, or nothing."""
    return f"It has {', '.join(known[:8])}{' …' if len(known) > 8 else ''}." if known else ""


def ranges(numbers: Sequence[int]) -> str:
    """Return ``version 1``, ``versions 1 to 7`` or ``versions 1 to 7 (5 of them)``."""
    if len(numbers) == 1:
        return f"version {numbers[0]}"
    gaps = f" ({len(numbers)} of them)" if numbers[-1] - numbers[0] >= len(numbers) else ""
    return f"versions {numbers[0]} to {numbers[-1]}{gaps}"


def by_version(aliases: Mapping[str, int]) -> dict[int, tuple[str, ...]]:
    """Return the aliases of each version that has any."""
    versions = sorted(set(aliases.values()))
    return {number: tuple(a for a, version in aliases.items() if version == number) for number in versions}
