"""Files read once, and files written whole or not at all."""

from __future__ import annotations

import errno
import os
import re
import secrets
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from skillctl.errors import InputDataError, NotFoundError, StoreError, did_you_mean, printable
from skillctl.opening import is_regular, open_regular
from skillctl.store.errors import NotAnArtifactError, RefusedFileError
from skillctl.store.locating import is_version_file, require_outside_store

MAX_FILE_BYTES = 64 << 20  # no artifact is larger
STALE_SECONDS = 3600.0  # a temporary file this old belongs to a process that died


def read_once(path: Path, limit: int = MAX_FILE_BYTES) -> bytes:
    """Return all bytes of a regular file, opened and read once, so that it cannot change between two looks.

    Raises:
        NotFoundError: There is no such file.
        NotAnArtifactError: A link, directory, pipe, device, or larger than ``limit`` bytes.
        StoreError: The system does not let us read it.
    """
    with _opened(path, limit) as (descriptor, _), os.fdopen(descriptor, "rb", closefd=False) as file:
        return file.read(limit + 1)


@contextmanager
def refused_as(error: type[RefusedFileError], name: str) -> Iterator[None]:
    """Turn what is wrong with the bytes of one of the store's own text files into an error of its own class.

    Args:
        error: The class.
        name: What the file is called in messages.
    """
    try:
        yield
    except NotAnArtifactError as refused:
        raise error(name, refused.reason) from None
    except ValueError as fault:
        raise error(name, str(fault)) from None


def read_beginning(path: Path, length: int, limit: int = MAX_FILE_BYTES) -> tuple[bytes, int]:
    """Return the first bytes of a regular file, and the size of the whole.

    Raises:
        See ``read_once``.
    """
    with _opened(path, limit) as (descriptor, size):
        return os.read(descriptor, length), size


@contextmanager
def _opened(path: Path, limit: int) -> Iterator[tuple[int, int]]:
    """Open a regular file to read it; yield its descriptor and its size."""
    # A link may point anywhere, and opening a pipe would wait for its writer.
    flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        descriptor = os.open(path, flags)
    except OSError as error:
        raise _cannot_open(path, error) from error
    try:
        with system_errors(f"read {path}"):
            status = os.fstat(descriptor)
            if not is_regular(descriptor):
                raise _not_a_file(path, status.st_mode)
            if status.st_size > limit:
                raise NotAnArtifactError(str(path), f"larger than {limit / (1 << 20):g} MiB")
            yield descriptor, status.st_size
    finally:
        os.close(descriptor)


def _cannot_open(path: Path, error: OSError) -> Exception:
    if error.errno in (errno.ENOENT, errno.ENOTDIR):
        return missing_file(path)
    if error.errno == errno.ELOOP:
        return NotAnArtifactError(
            str(path), "a symbolic link", hint="Name the file itself; `realpath` prints where the link leads."
        )
    if error.errno in (errno.ENXIO, errno.ENODEV):
        return NotAnArtifactError(str(path), "not a regular file")
    return _store_error(f"read {path}", error)


def _not_a_file(path: Path, mode: int) -> NotAnArtifactError:
    if stat.S_ISDIR(mode):
        return NotAnArtifactError(
            str(path), "a directory", hint=f"Name a file in it. Of a store: `skillctl ls --store {path}`."
        )
    return NotAnArtifactError(str(path), "not a regular file")


def missing_file(path: Path) -> NotFoundError:
    """Return the error for a file that does not exist, with files of similar names as hint."""
    siblings: list[str] = []
    with suppress(OSError):
        siblings = [entry.name for entry in os.scandir(path.parent)]
    hint = did_you_mean(path.name, {name: str(path.parent / name) for name in siblings}, most=2)
    return NotFoundError(
        f"{printable(str(path))}: there is no such file.", hint=printable(hint) or "Check the path."
    )


def write_file(path: Path, data: bytes) -> None:
    """Make ``path`` a file with these bytes: afterwards it is old or new, whole, with nothing beside it.

    Raises:
        UsageError: A version of a store.
        StoreError: Not a place for a file, no permission, no space.
    """
    path = Path(path)
    if is_version_file(path.name):
        require_outside_store(path)
    with system_errors(f"write {path}"):
        if path.exists() and not path.is_file():  # replacing /dev/null would break the machine
            raise StoreError(
                f"{printable(str(path))} exists and is not a regular file.",
                hint="Name a file that can be replaced.",
            )
        _sweep_beside(path)
        temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
        file = temporary.open("xb")  # an existing file of this name is not ours to remove
        try:
            with file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(path)
        except BaseException:  # Ctrl-C must leave nothing behind either
            with suppress(OSError):
                temporary.unlink()
            raise


def write_changed(path: Path, data: bytes) -> bool:
    """Write a file unless it has these bytes already; return whether it was written.

    Raises:
        StoreError: See ``write_file``.
    """
    with suppress(OSError, InputDataError), open_regular(path) as file:  # the writer says what is wrong
        if file.read(len(data) + 1) == data:
            return False
    write_file(path, data)
    return True


def _sweep_beside(path: Path) -> None:
    left_over = re.compile(rf"\.{re.escape(path.name)}\.[0-9a-f]{{8}}\.tmp")
    with suppress(OSError):  # a directory that one may write to, but not list
        directory = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            sweep(directory, lambda name: left_over.fullmatch(name) is not None)
        finally:
            os.close(directory)


def sweep(directory: int, is_temporary: Callable[[str], bool]) -> None:
    """Remove the temporary files that killed writers have left in a directory, given as a descriptor."""
    for name in filter(is_temporary, os.listdir(directory)):
        with suppress(OSError):  # of another user, or not a file: it may stay
            age = time.time() - os.stat(name, dir_fd=directory, follow_symlinks=False).st_mtime
            if age > STALE_SECONDS:
                os.unlink(name, dir_fd=directory)


@contextmanager
def system_errors(action: str) -> Iterator[None]:
    """Turn an OSError into a StoreError that says what could not be done, and why."""
    try:
        yield
    except OSError as error:
        raise _store_error(action, error) from error


_HINTS = {
    errno.ENOENT: "Make the directory first, with mkdir -p.",
    errno.ENOTDIR: "A file stands where a directory is needed.",
    errno.EACCES: "Check the permissions of the file and its directory.",
    errno.EPERM: "Check the permissions of the file and its directory.",
    errno.EROFS: "Choose a place that can be written to.",
    errno.ENOSPC: "Free some space.",
    errno.EDQUOT: "Your disk quota is used up.",
    errno.EFBIG: "The limit on file sizes (`ulimit -f`) is too small.",
    errno.ENAMETOOLONG: "Choose a shorter name.",
}


def _store_error(action: str, error: OSError) -> StoreError:
    cause = error.strerror or str(error)
    return StoreError(
        f"cannot {printable(action)}: {printable(cause)}.",
        hint=_HINTS.get(error.errno or 0, "Check the path and the disk."),
    )
