"""How skills are named: a file, or a name in the store with a version."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from skillctl.errors import UsageError, printable

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
    """Tell whether a skill can have this name."""
    return _NAME.fullmatch(text) is not None and not text.endswith(".h5")


def is_version(text: str) -> bool:
    """Tell whether a version can have this number."""
    return _VERSION.fullmatch(text) is not None


def is_word(text: str) -> bool:
    """Tell whether ``text`` can stand behind the @ as ``latest`` or an alias."""
    return _WORD.fullmatch(text) is not None


def require_name(name: str) -> str:
    """Return ``name`` if a skill can have it, or raise UsageError."""
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
    """Return the path of a skill to be written, or raise UsageError if no reference could name it."""
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
