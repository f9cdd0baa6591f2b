"""Where the files of a store are: the few things a store asks of the place that keeps it.

A store is folders, one a skill, of files. A place for them is one class with these methods; `local` has the
one for a directory on this machine. What is in the files, and what they are called, is for `registry` to say.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol

from skillctl.store.files import MAX_FILE_BYTES


class Backend(Protocol):
    """A place that keeps the folders of a store; every method may raise OSError for what the place refuses.

    Attributes:
        place: What people call it: the path of a directory.
    """

    place: str

    def folders(self) -> tuple[str, ...]:
        """Return the names of all folders."""

    def files(self, folder: str) -> tuple[str, ...]:
        """Return the names of all files in a folder; none if there is no such folder."""

    def read(self, folder: str, file: str, limit: int = MAX_FILE_BYTES) -> bytes:
        """Return all bytes of a file.

        Raises:
            NotFoundError: There is no such file.
            NotAnArtifactError: It is no regular file, or larger than ``limit`` bytes.
        """

    def beginning(self, folder: str, file: str, length: int) -> tuple[bytes, int]:
        """Return the first bytes of a file and the size of the whole, as ``read`` does."""

    def create(self, folder: str, data: bytes) -> AbstractContextManager[Callable[[str], None]]:
        """Keep ``data`` without a name, and give the function that names it; the folder is made if need be.

        The file is whole from the moment it has its name, and nothing is left of one that was given none. The
        function raises FileExistsError, and changes nothing, if the name is taken, and may be called again.
        At the end of the context the name is safe: whatever fails afterwards, the file is there.
        """

    def replace(self, folder: str, file: str, data: bytes) -> None:
        """Make a file, or one that is there, hold ``data``: afterwards it is old or new, whole."""

    def delete(self, folder: str, files: Iterable[str]) -> None:
        """Remove files, in this order, as far as they are there; at the end they are gone for good."""

    def locked(self, folder: str, *, shared: bool = False) -> AbstractContextManager[None]:
        """Keep all others, or with ``shared`` those who want a folder that exists alone, from the lock.

        Whoever dies gives it back. What killed writers have left half done in the folder may be removed now.
        """

    def path(self, folder: str, file: str) -> Path:
        """Return where this machine has a file, or would have it; a place elsewhere keeps a copy there."""
