"""One new file in a directory, whole from the moment it has a name, without locks."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from skillctl.store.files import sweep

FILE_MODE = 0o444  # a version never changes
TEMPORARY_PREFIX = ".publishing-"

# What a file system, or a kernel, without unnamed files answers.
_UNSUPPORTED = {errno.EOPNOTSUPP, errno.EISDIR, errno.EINVAL, errno.ENOENT}

Link = Callable[[str], None]


@contextmanager
def staged(directory: int, data: bytes) -> Iterator[Link]:
    """Write ``data`` to a file without a final name, and give the function that names it.

    The function links the file to a name in the directory; it raises FileExistsError, and changes nothing,
    if that name is taken. An unlinked file leaves nothing behind.

    Args:
        directory: Open descriptor of the directory.
        data: Contents.
    """
    sweep(directory, lambda name: name.startswith(TEMPORARY_PREFIX))
    unnamed = _open_unnamed(directory)
    if unnamed is not None:
        source, descriptor = f"/proc/self/fd/{unnamed}", unnamed
    else:
        source = f"{TEMPORARY_PREFIX}{secrets.token_hex(8)}"
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        descriptor = os.open(source, flags, 0o600, dir_fd=directory)
    try:
        _fill(descriptor, data)
        yield lambda name: os.link(source, name, src_dir_fd=directory, dst_dir_fd=directory)
    finally:
        os.close(descriptor)
        if unnamed is None:
            with suppress(FileNotFoundError):
                os.unlink(source, dir_fd=directory)


def _open_unnamed(directory: int) -> int | None:
    """Return a descriptor of a file that vanishes with its process, or None where there are no such files."""
    if not hasattr(os, "O_TMPFILE") or not os.path.isdir("/proc/self/fd"):  # noqa: PTH112
        return None
    try:
        return os.open(".", os.O_TMPFILE | os.O_WRONLY | os.O_CLOEXEC, 0o600, dir_fd=directory)
    except OSError as error:
        if error.errno in _UNSUPPORTED:
            return None
        raise


def _fill(descriptor: int, data: bytes) -> None:
    remaining = memoryview(data)
    while remaining:
        remaining = remaining[os.write(descriptor, remaining) :]
    os.fchmod(descriptor, FILE_MODE)
    os.fsync(descriptor)
