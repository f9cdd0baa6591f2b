"""Numbers of versions: given once, and remembered when what had them is removed."""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import suppress

from skillctl.store.backend import Backend

SIGNATURE_SUFFIX = ".sig"  # beside a version; it goes with it
# An empty file `7.removed` remembers that numbers up to 7 were given. Only the highest matters, so only it
# is kept; where a higher version exists, none.
_ENTRY = re.compile(r"([1-9][0-9]{0,5})\.(h5|removed)")
_SIGNATURES = re.compile(rf"([1-9][0-9]{{0,5}}\.h5){re.escape(SIGNATURE_SUFFIX)}")


def version_file(version: int) -> str:
    """Return the name of the file of a version."""
    return f"{version}.h5"


def existing_versions(files: Iterable[str]) -> tuple[int, ...]:
    """Return the numbers of the versions among the files of a skill, rising."""
    return _numbers(files, "h5")


def highest_given(files: Iterable[str]) -> int:
    """Return the highest number that a version has or had; 0 if there never was one."""
    matches = filter(None, map(_ENTRY.fullmatch, files))
    return max((int(match[1]) for match in matches), default=0)


def remove_versions(backend: Backend, name: str, versions: Iterable[int]) -> None:
    """Remove versions of a skill; killed at any moment, no number is free that was taken.

    The caller holds the exclusive lock of its folder.
    """
    files = backend.files(name)
    highest, doomed = highest_given(files), set(versions)
    if not set(existing_versions(files)) - doomed or highest in doomed:
        with backend.create(name, b"") as call, suppress(FileExistsError):
            call(f"{highest}.removed")
    backend.delete(name, [version_file(version) for version in sorted(doomed)])
    remove_orphans(backend, name)
    backend.delete(name, [f"{n}.removed" for n in _numbers(backend.files(name), "removed") if n < highest])


def remove_orphans(backend: Backend, name: str) -> None:
    """Remove signatures of versions that are gone, as whoever was killed while removing has left them.

    A version goes before its signatures, so that one that is there never loses them. The caller holds the
    lock of the folder, shared or not: nobody signs or removes meanwhile.
    """
    files = set(backend.files(name))
    for match in filter(None, map(_SIGNATURES.fullmatch, files)):
        if match[1] not in files:
            with suppress(OSError):  # somebody else's, or no file at all: it may stay
                backend.delete(name, [match[0]])


def _numbers(files: Iterable[str], suffix: str) -> tuple[int, ...]:
    matches = filter(None, map(_ENTRY.fullmatch, files))
    return tuple(sorted(int(match[1]) for match in matches if match[2] == suffix))
