"""How skills are named, and which version of a skill a reference means."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from skillctl.errors import NotFoundError, UsageError, did_you_mean, printable

MAX_VERSION = 999_999

_NAME = re.compile(r"[a-z0-9][a-z0-9._-]{0,63}")
_VERSION = re.compile(r"[1-9][0-9]{0,5}")
_DIGEST = re.compile(r"sha256:[0-9a-f]{8,64}")
_WORD = re.compile(r"[a-z][a-z0-9._-]{0,63}")

EXAMPLES = "A skill is named path/to/file.h5, name, name@3, name@latest, name@alias or name@sha256:0123abcd."


@dataclass(frozen=True, slots=True)
class Reference:
    """A skill of the store: its name, and which version.

    Attributes:
        name: Directory of the skill in the store.
        selector: A version number, the beginning of a content digest (``sha256:…``), ``latest`` or an alias.
    """

    name: str
    selector: int | str = "latest"


def is_name(text: str) -> bool:
    """Tell whether a skill can be called so."""
    return _NAME.fullmatch(text) is not None and not text.endswith(".h5")


def is_version(text: str) -> bool:
    """Tell whether a version can have this number."""
    return _VERSION.fullmatch(text) is not None


def is_word(text: str) -> bool:
    """Tell whether ``text`` can stand behind the @ as ``latest`` or an alias."""
    return _WORD.fullmatch(text) is not None


def require_name(name: str) -> str:
    """Return ``name`` if a skill can be called so, or raise UsageError."""
    if not is_name(name):
        raise UsageError(
            f"{printable(name)[:80]!r} cannot name a skill.",
            hint="Use up to 64 of a-z, 0-9, '.', '_' and '-', first a letter or digit, not ending in .h5.",
        )
    return name


def parse_reference(text: str | Path | Reference) -> Path | Reference:
    """Return the file or the skill of the store that ``text`` names.

    A path, or a text with a slash or ending in ``.h5``, names a file.

    Raises:
        UsageError: It can be neither.
    """
    if isinstance(text, Path | Reference):
        return text
    if "\0" in text:
        raise UsageError("a reference to a skill must not contain NUL.", hint=EXAMPLES)
    if "/" in text or text.endswith(".h5"):
        return Path(text)
    name, at, selector = text.partition("@")
    if not is_name(name):
        raise UsageError(f"{printable(text)[:80]!r} cannot name a skill.", hint=EXAMPLES)
    if not at:
        return Reference(name)
    if is_version(selector):
        return Reference(name, int(selector))
    if _DIGEST.fullmatch(selector) or is_word(selector):
        return Reference(name, selector)
    raise UsageError(f"{printable(text)[:80]!r}: no version can be named like that.", hint=EXAMPLES)


def require_file_name(path: str | Path) -> Path:
    """Return the path of a skill to be written, or raise UsageError if no text would name it afterwards."""
    try:
        file = parse_reference(str(path))
    except UsageError:
        file = None
    if not isinstance(file, Path):
        raise UsageError(
            f"{printable(str(path))[:80]!r}: by this name the file could not be loaded again.",
            hint="End it in .h5, or name a directory before it (./): any other word is a name in the store.",
        )
    return file


DigestOf = Callable[[int], str | None]


def select(
    reference: Reference, numbers: tuple[int, ...], aliases: Callable[[], Mapping[str, int]], digest: DigestOf
) -> int:
    """Return the version that a reference means.

    Args:
        reference: Name and selector.
        numbers: Versions that exist, rising, at least one.
        aliases: Reads the aliases; called only if the selector is one.
        digest: Returns the content digest of a version, None if it cannot be read.

    Raises:
        NotFoundError: No such version or alias.
        UsageError: The beginning of more than one digest.
    """
    selector = reference.selector
    if selector == "latest":
        return numbers[-1]
    if isinstance(selector, int):
        return _numbered(reference.name, selector, numbers)
    if selector.startswith("sha256:"):
        return _with_digest(reference.name, selector, numbers, digest)
    return _with_alias(reference.name, selector, numbers, aliases())


def _numbered(name: str, version: int, numbers: tuple[int, ...]) -> int:
    if version in numbers:
        return version
    # Numbers are given without gaps, so one that is missing below another was there once.
    removed = ": it was removed" if version < numbers[-1] else ""
    raise NotFoundError(
        f"{name} has no version {version}{removed}.",
        hint=f"It has {ranges(numbers)}; `{name}` alone names the newest.",
    )


def _with_alias(name: str, alias: str, numbers: tuple[int, ...], aliases: Mapping[str, int]) -> int:
    if alias not in aliases:
        raise unknown_alias(name, alias, aliases)
    if aliases[alias] not in numbers:
        raise NotFoundError(
            f"{name}@{alias} is version {aliases[alias]}, which does not exist.",
            hint=f"It has {ranges(numbers)}; `skillctl tag {name}@N {alias}` moves the alias.",
        )
    return aliases[alias]


def unknown_alias(name: str, alias: str, aliases: Iterable[str]) -> NotFoundError:
    """Return the error for an alias that a skill does not have."""
    known = list(aliases)
    hint = (
        did_you_mean(alias, {word: f"{name}@{word}" for word in known}, cutoff=0.5)
        or what_there_is(known)
        or f"It has no aliases yet; `skillctl tag {name}@N {alias}` makes one."
    )
    return NotFoundError(f"{name} has no alias {alias}.", hint=hint)


def what_there_is(known: Sequence[str]) -> str:
    """Return ``It has …`` with the first few of the known words, or nothing."""
    return f"It has {', '.join(known[:8])}{' …' if len(known) > 8 else ''}." if known else ""


def _with_digest(name: str, beginning: str, numbers: tuple[int, ...], digest_of: DigestOf) -> int:
    found: dict[int, str] = {}
    for number in reversed(numbers):
        digest = digest_of(number) or ""
        if digest == beginning:
            return number
        if digest.startswith(beginning):
            found[number] = digest
    if not found:
        raise NotFoundError(
            f"no version of {name} has a content digest beginning {beginning}.",
            hint=f"It has {ranges(numbers)}; `skillctl ls {name}` shows their digests.",
        )
    if len(set(found.values())) > 1:
        raise UsageError(
            f"{len(found)} versions of {name} have a content digest beginning {beginning}.",
            hint=f"Give more digits: {', '.join(found.values())}.",
        )
    return next(iter(found))


def ranges(numbers: tuple[int, ...]) -> str:
    """Return ``version 1``, ``versions 1 to 7`` or ``versions 1 to 7 (5 of them)``."""
    if len(numbers) == 1:
        return f"version {numbers[0]}"
    gaps = f" ({len(numbers)} of them)" if numbers[-1] - numbers[0] >= len(numbers) else ""
    return f"versions {numbers[0]} to {numbers[-1]}{gaps}"
