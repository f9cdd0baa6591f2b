"""A store in a directory of this machine, in which no symbolic link is followed."""

from __future__ import annotations

import errno
import fcntl
import os
import re
import secrets
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from skillctl.store.errors import UnsafeStoreError
from skillctl.store.files import MAX_FILE_BYTES, read_beginning, read_once, sweep, write_file
from skillctl.store.locating import FILE_MODE

TEMPORARY_PREFIX = ".publishing-"

_OPEN_DIRECTORY = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
# The temporary files of aliases and signatures, as `write_file` names them; other files may lie beside them.
_TEMPORARY = re.compile(r"\.(refs\.toml|[1-9][0-9]{0,5}\.h5\.sig)\.[0-9a-f]{8}\.tmp")
# The answers of a file system, or a kernel, that has no files without names.
_UNSUPPORTED = {errno.EOPNOTSUPP, errno.EISDIR, errno.EINVAL, errno.ENOENT}


class LocalBackend:
    """The folders of a store as directories; see ``skillctl.store.backend.Backend``.

    The directory need not exist before the first file is made.
    """

    def __init__(self, root: Path) -> None:
        self.root = Path(root)
        self.place = str(root)

    def folders(self) -> tuple[str, ...]:
        """Return the names of all directories; a link does not count."""
        if not _is_directory(self.root):
            return ()
        return tuple(entry.name for entry in os.scandir(self.root) if entry.is_dir(follow_symlinks=False))

    def files(self, folder: str) -> tuple[str, ...]:
        """Return the names of all entries; none where there is no directory."""
        if not (_is_directory(self.root) and _is_directory(self.root / folder)):
            return ()
        return tuple(entry.name for entry in os.scandir(self.root / folder))

    def read(self, folder: str, file: str, limit: int = MAX_FILE_BYTES) -> bytes:
        """Return all bytes of a regular file, read once."""
        return read_once(self.path(folder, file), limit)

    def beginning(self, folder: str, file: str, length: int) -> tuple[bytes, int]:
        """Return the first bytes of a regular file and its size."""
        return read_beginning(self.path(folder, file), length)

    @contextmanager
    def create(self, folder: str, data: bytes) -> Iterator[Callable[[str], None]]:
        """Write ``data`` to a file without a name, synced, and give the function that links it to one."""
        self._make(folder)
        with self._opened(folder) as directory:
            with _staged(directory, data) as link:
                yield link
            os.fsync(directory)

    def replace(self, folder: str, file: str, data: bytes) -> None:
        """Replace a file by one that was written beside it, and synced."""
        write_file(self.path(folder, file), data)

    def delete(self, folder: str, files: Iterable[str]) -> None:
        """Unlink files, and sync the directory."""
        with self._opened(folder) as directory:
            for file in files:
                with suppress(FileNotFoundError):
                    os.unlink(file, dir_fd=directory)
            os.fsync(directory)

    @contextmanager
    def locked(self, folder: str, *, shared: bool = False) -> Iterator[None]:
        """Hold the lock of the directory, and remove what killed writers have left there."""
        with self._opened(folder) as directory, flocked(directory, shared=shared):
            sweep(directory, lambda name: _TEMPORARY.fullmatch(name) is not None)
            yield

    def path(self, folder: str, file: str) -> Path:
        """Return the path of a file."""
        return self.root / folder / file

    def _make(self, folder: str) -> None:
        if not _is_directory(self.root):
            self.root.mkdir(parents=True, exist_ok=True)
        if not _is_directory(self.root / folder):
            with _descriptor(self.root) as root:
                with suppress(FileExistsError):
                    os.mkdir(folder, dir_fd=root)
                os.fsync(root)

    @contextmanager
    def _opened(self, folder: str) -> Iterator[int]:
        """Open the directory of a folder, through no symbolic link."""
        if _is_directory(self.root):
            _is_directory(self.root / folder)  # for its message; opening follows no link either
        with _descriptor(self.root) as root, _descriptor(folder, root) as directory:
            yield directory


@contextmanager
def _staged(directory: int, data: bytes) -> Iterator[Callable[[str], None]]:
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


@contextmanager
def flocked(directory: int, *, shared: bool = False) -> Iterator[None]:
    """Hold the lock of a directory, given as a descriptor; the system releases it when a process dies.

    Writers of new versions share it: it only keeps them from taking a number that is being removed.
    """
    try:
        fcntl.flock(directory, fcntl.LOCK_SH if shared else fcntl.LOCK_EX)
    except OSError:  # a file system without locks; only removal needs them
        if not shared:
            raise
    yield  # closing the descriptor releases it
    with suppress(OSError):
        fcntl.flock(directory, fcntl.LOCK_UN)


@contextmanager
def locked_directory(path: Path) -> Iterator[None]:
    """Hold the exclusive lock of any directory, which may be behind a link."""
    directory = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        with flocked(directory):
            yield
    finally:
        os.close(directory)


@contextmanager
def _descriptor(path: str | Path, within: int | None = None) -> Iterator[int]:
    descriptor = os.open(path, _OPEN_DIRECTORY, dir_fd=within)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def _is_directory(path: Path) -> bool:
    """Tell whether a directory stands at ``path``; a link to one is an error."""
    if path.is_symlink():
        raise UnsafeStoreError(str(path), "a symbolic link")
    return path.is_dir()
