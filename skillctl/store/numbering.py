"""Numbers of versions: given once, and remembered when what had them is removed."""

from __future__ import annotations

import fcntl
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from skillctl.store.files import sweep

SIGNATURE_SUFFIX = ".sig"  # beside a version; it goes with it
# An empty file `7.removed` remembers that numbers up to 7 were given. Only the highest matters, so only it
# is kept; where a higher version exists, none.
_ENTRY = re.compile(r"([1-9][0-9]{0,5})\.(h5|removed)")
_SIGNATURES = re.compile(rf"([1-9][0-9]{{0,5}}\.h5){re.escape(SIGNATURE_SUFFIX)}")
_SIGNING = re.compile(rf"\.{_SIGNATURES.pattern}\.[0-9a-f]{{8}}\.tmp")  # as `write_file` calls it


def existing_versions(directory: int | Path) -> tuple[int, ...]:
    """Return the numbers of the versions in a skill's directory (path or descriptor), rising."""
    return _numbers(directory, "h5")


def highest_given(directory: int) -> int:
    """Return the highest number that a version has or had; 0 if there never was one."""
    return max((*_numbers(directory, "h5"), *_numbers(directory, "removed")), default=0)


def remove_versions(directory: int, versions: Iterable[int]) -> None:
    """Remove versions; killed at any moment, no number is free that was taken.

    The caller holds the directory's exclusive lock.
    """
    highest = highest_given(directory)
    doomed = set(versions)
    if not set(existing_versions(directory)) - doomed or highest in doomed:
        flags = os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
        os.close(os.open(f"{highest}.removed", flags, 0o444, dir_fd=directory))
        os.fsync(directory)
    for version in sorted(doomed):
        os.unlink(f"{version}.h5", dir_fd=directory)
    sweep_signatures(directory)
    for number in _numbers(directory, "removed"):
        if number < highest:
            with suppress(FileNotFoundError):
                os.unlink(f"{number}.removed", dir_fd=directory)
    os.fsync(directory)


def sweep_signatures(directory: int) -> None:
    """Remove what whoever was killed has left: signatures of versions that are gone, and halves of new ones.

    A version goes before its signatures, so that one that is there never loses them. The caller holds the
    directory's lock, shared or not: nobody signs or removes meanwhile.
    """
    entries = set(os.listdir(directory))  # of a descriptor, which pathlib does not take
    for match in filter(None, map(_SIGNATURES.fullmatch, entries)):
        if match[1] not in entries:
            with suppress(OSError):  # somebody else's, or no file at all: it may stay
                os.unlink(match[0], dir_fd=directory)
    sweep(directory, lambda name: _SIGNING.fullmatch(name) is not None)


@contextmanager
def locked(directory: int, *, shared: bool = False) -> Iterator[None]:
    """Hold the lock of a skill's directory, which the system releases when a process dies.

    Writers of new versions share it; it only keeps them from taking a number while that is being removed.
    """
    try:
        fcntl.flock(directory, fcntl.LOCK_SH if shared else fcntl.LOCK_EX)
    except OSError:  # a file system without locks: publishing needs none but against removal
        if not shared:
            raise
    yield  # closing the descriptor releases it
    with suppress(OSError):
        fcntl.flock(directory, fcntl.LOCK_UN)


def _numbers(directory: int | Path, suffix: str) -> tuple[int, ...]:
    matches = (_ENTRY.fullmatch(entry) for entry in os.listdir(directory))  # noqa: PTH208 - may be a descriptor
    return tuple(sorted(int(match[1]) for match in matches if match and match[2] == suffix))
