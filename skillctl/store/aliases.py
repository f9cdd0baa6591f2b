"""``<store>/<name>/refs.toml``: words that name a version, as text, so that a review shows a promotion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from skillctl.errors import NotFoundError, UsageError, printable
from skillctl.store.backend import Backend
from skillctl.store.errors import InvalidRefsError
from skillctl.store.files import document_lines, read_document
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


def read_aliases(backend: Backend, name: str) -> dict[str, int]:
    """Return the version of each alias of a skill, by alias; none without the file.

    Raises:
        InvalidRefsError: The file is not TOML, or says something else than versions of aliases.
        StoreError: The system does not let us read it.
    """
    shown = f"{backend.place}/{name}/{REFS_FILE}"
    try:
        document = read_document(
            lambda: backend.read(name, REFS_FILE, MAX_REFS_BYTES), shown, InvalidRefsError
        )
    except NotFoundError:
        return {}
    return dict(sorted(_checked(document, shown).items()))


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


def write_aliases(backend: Backend, name: str, aliases: Mapping[str, int]) -> None:
    """Replace the aliases of a skill: afterwards the file is old or new, whole.

    Raises:
        StoreError: No permission, no space.
    """
    text = _HEADING + document_lines(dict(sorted(aliases.items())))
    backend.replace(name, REFS_FILE, text.encode("ascii"))


def by_version(aliases: Mapping[str, int]) -> dict[int, tuple[str, ...]]:
    """Return the aliases of each version that has any."""
    versions = sorted(set(aliases.values()))
    return {number: tuple(a for a, version in aliases.items() if version == number) for number in versions}
