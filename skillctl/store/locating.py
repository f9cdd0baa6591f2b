"""Where the store is, and which files belong to one."""

from __future__ import annotations

import os
import re
import stat
from contextlib import suppress
from pathlib import Path

from skillctl.errors import NotFoundError, UsageError, did_you_mean, printable
from skillctl.store.references import is_name

STORE_VARIABLE = "SKILLCTL_STORE"
STORE_NAME = "skills"
FILE_MODE = 0o444  # of a version, which never changes

_VERSION = re.compile(r"[1-9][0-9]{0,5}\.h5")


def locate_store(explicit: str | Path | None = None) -> Path:
    """Return the directory of the store.

    The one given; else ``SKILLCTL_STORE``; else the nearest directory ``skills`` from the working directory
    upwards; else the one in the user's data folder. A link is followed where the user names it.
    """
    named = _named(explicit)
    if named:
        return Path(named).resolve()
    for place in upwards(STORE_NAME):
        if place.is_dir():
            return place
    data = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(data) / "skillctl" / STORE_NAME


def existing_store(explicit: str | Path | None = None) -> Path:
    """Return the directory of the store to read from; see ``locate_store``.

    Raises:
        NotFoundError: There is no directory at the path that the user has named. The store of the data folder
            need not exist: nothing was learned yet.
    """
    store = locate_store(explicit)
    if _named(explicit) and not store.is_dir():
        siblings: list[str] = []
        with suppress(OSError):
            siblings = [entry.name for entry in os.scandir(store.parent) if entry.is_dir()]
        near = did_you_mean(store.name, {name: str(store.parent / name) for name in siblings})
        source = "--store" if explicit else STORE_VARIABLE
        raise NotFoundError(
            f"{printable(str(store))}: there is no such store.",
            hint=printable(near)
            or f"Check the path in {source}; `skillctl learn DATA --name NAME` makes a store.",
        )
    return store


def _named(explicit: str | Path | None) -> str | Path | None:
    return explicit or os.environ.get(STORE_VARIABLE)


def upwards(name: str) -> list[Path]:
    """Return where a file of that name may lie, from the working directory upwards."""
    here = Path.cwd()
    return [directory / name for directory in (here, *here.parents)]


def is_version_file(name: str) -> bool:
    """Tell whether a store names its versions like this."""
    return _VERSION.fullmatch(name) is not None


def require_outside_store(file: Path, store: str | Path | None = None) -> None:
    """Raise UsageError if a file would lie in the folder of a skill in a store, where versions never change.

    A folder is one if it holds versions, or would by this file, and lies in a store: the one in force, or a
    directory ``skills``. In any other directory, what a version is is told by its mode.

    Args:
        file: What is to be written.
        store: The store, if the user has named it.
    """
    folder = file.parent.resolve()
    root = folder.parent
    if not is_name(folder.name):
        return
    in_store = root.name == STORE_NAME or root in (locate_store(store), locate_store())
    versions = [path for path in folder.glob("*.h5") if is_version_file(path.name)]
    if any(_is_sealed(path) for path in versions) or (in_store and (versions or is_version_file(file.name))):
        raise UsageError(
            f"{printable(str(file))} lies in a store, where versions never change; it will not be written.",
            hint=printable(
                f"Write it elsewhere, or publish the next version: --name {folder.name} --store {root}."
            ),
        )


def _is_sealed(path: Path) -> bool:
    with suppress(OSError):
        return stat.S_IMODE(path.lstat().st_mode) == FILE_MODE
    return False
