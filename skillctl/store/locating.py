"""Which store is meant, and what a reference leads to in it."""

from __future__ import annotations

import os
from pathlib import Path

from skillctl.store.references import parse_reference
from skillctl.store.registry import Located, Registry, existing_file

STORE_VARIABLE = "SKILLCTL_STORE"
STORE_NAME = "skills"


def locate_store(explicit: str | Path | None = None) -> Path:
    """Return the directory of the store.

    The one given; else ``SKILLCTL_STORE``; else the nearest directory ``skills`` from the working directory
    upwards; else the one in the user's data folder. A link is followed where the user names it.
    """
    named = explicit or os.environ.get(STORE_VARIABLE)
    if named:
        return Path(named).resolve()
    for place in upwards(STORE_NAME):
        if place.is_dir():
            return place
    data = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(data) / "skillctl" / STORE_NAME


def upwards(name: str) -> list[Path]:
    """Return where a file of that name may lie, from the working directory upwards."""
    here = Path.cwd()
    return [directory / name for directory in (here, *here.parents)]


def locate(reference: str | Path, store: str | Path | None = None) -> Located:
    """Return what a reference leads to, in the store that ``locate_store`` finds; see ``Registry.locate``.

    A ``Path`` is always a file.
    """
    parsed = parse_reference(reference)
    if isinstance(parsed, Path):
        return existing_file(parsed)
    return Registry(locate_store(store)).located(parsed)
