"""The interface of a place that keeps the files of a store.

A store is folders of files, one folder a skill. `local` has the backend for a directory on this machine.
What the files hold and what they are called is decided in `folder`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol

from skillctl.store.files import MAX_FILE_BYTES


class Backend(Protocol):
    """A place that keeps the folders of a store; every method may raise OSError if the place refuses.

    Attributes:
        place: Its name for people: the path of a directory.
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
            NotAnArtifactError: It is not a regular file, or it has more than ``limit`` bytes.
        """

    def beginning(self, folder: str, file: str, length: int) -> tuple[bytes, int]:
        """Return the first bytes of a file and the size of the whole, as ``read`` does."""

    def create(self, folder: str, data: bytes) -> AbstractContextManager[Callable[[str], None]]:
        """Keep ``data`` without a name, and yield the function that names it; make the folder if need be.

        The file is whole from the moment it has its name, and a file without a name leaves nothing behind.
        The function raises FileExistsError, and changes nothing, if the name is taken; it may be called
        again. At the end of the context the name is safe: whatever fails afterwards, the file is there.
        """

    def replace(self, folder: str, file: str, data: bytes) -> None:
        """Make a file hold ``data``, whether it exists or not: afterwards it is old or new, whole."""

    def delete(self, folder: str, files: Iterable[str]) -> None:
        """Remove those of the files that exist, in this order; at the end they do not come back."""

    def locked(self, folder: str, *, shared: bool = False) -> AbstractContextManager[None]:
        """Hold the lock of a folder that exists, alone or ``shared`` with others who share it.

        The lock ends with its process. Files that killed writers left unfinished may be removed now.
        """

    def path(self, folder: str, file: str) -> Path:
        """Return where this machine has a file, or would have it; a place elsewhere keeps a copy there."""
