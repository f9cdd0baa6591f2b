"""``<store>/<name>/refs.toml``: words that name a version, as text, so that a review shows a promotion."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from skillctl.errors import NotFoundError, UsageError, printable
from skillctl.store.errors import InvalidRefsError
from skillctl.store.files import read_document, write_file
from skillctl.store.references import is_version, is_word

REFS_FILE = "refs.toml"
MAX_REFS_BYTES = 1 << 20
RESERVED = ("latest",)

_HEADING = "# Aliases of this skill's versions, written by `skillctl tag` and `skillctl untag`.\n[aliases]\n"


def is_alias(text: str) -> bool:
    """Tell whether a version can be called so."""
    return is_word(text) and text not in RESERVED


def require_alias(text: str) -> str:
    """Return ``text`` if a version can be called so, or raise UsageError."""
    if not is_alias(text):
        raise UsageError(
            f"{printable(text)[:80]!r} cannot be an alias.",
            hint="Use up to 64 of a-z, 0-9, '.', '_' and '-', first a letter; not latest, which is always "
            "the newest version.",
        )
    return text


def read_aliases(directory: Path) -> dict[str, int]:
    """Return the version of each alias of the skill in ``directory``, by alias; none without the file.

    Raises:
        InvalidRefsError: The file is not TOML, or says something else than versions of aliases.
        StoreError: The system does not let us read it.
    """
    path = directory / REFS_FILE
    try:
        document = read_document(path, MAX_REFS_BYTES, InvalidRefsError)
    except NotFoundError:
        return {}
    return dict(sorted(_checked(document, str(path)).items()))


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


def write_aliases(directory: Path, aliases: Mapping[str, int]) -> None:
    """Replace the aliases of the skill in ``directory``: afterwards the file is old or new, whole.

    Raises:
        StoreError: No permission, no space.
    """
    lines = (f"{_key(alias)} = {version}\n" for alias, version in sorted(aliases.items()))
    write_file(directory / REFS_FILE, (_HEADING + "".join(lines)).encode("ascii"))


def _key(alias: str) -> str:
    return f'"{alias}"' if "." in alias else alias  # a bare dot would nest tables
