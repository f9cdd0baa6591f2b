"""Read a file's bytes once, and say in words why not."""

from __future__ import annotations

import stat
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skillctl.errors import InputDataError, NotFoundError, printable

if TYPE_CHECKING:
    from skillctl.demonstrations.child import Child

MAX_BYTES = 2**28  # of a file, packed or unpacked: millions of samples; more is no demonstration


@dataclass(frozen=True, slots=True)
class File:
    """A file that is being read.

    Attributes:
        path: As the user named it, for messages.
        content: Its bytes.
        columns: Names of the position columns that the user asked for; formats without names of their own
            leave them to the caller.
        child: Parses what only large libraries in C can.
    """

    path: Path
    content: bytes
    columns: Sequence[str] | None
    child: Child
    _parsed: dict[Any, Any] = field(default_factory=dict)

    def parsed(self, parser: Callable[..., Any], kind: str, **options: Any) -> Any:
        """Return ``parser(content, **options)``, computed once, in the child.

        Args:
            parser: A function at the top level of a module, which returns arrays, text and numbers in lists
                and dictionaries, or raises InputDataError without the name of the file.
            kind: What the file should be, for messages.
            options: Whatever JSON can express.

        Raises:
            InputDataError: The parser refused the file, failed on it, was ended by it, or took more time or
                memory than it may.
        """
        if parser not in self._parsed:
            self._parsed[parser] = self.child.parse(parser, self.content, self.path, kind, **options)
        return self._parsed[parser]


def read_bytes(path: Path) -> bytes:
    """Return what the file holds.

    Raises:
        NotFoundError: No such file.
        InputDataError: Not a regular file, not readable, empty, or larger than MAX_BYTES.
    """
    try:
        status = path.stat()
        _require_usable(path, status.st_mode, status.st_size)
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)  # the size may have grown since
    except (FileNotFoundError, NotADirectoryError) as error:
        raise NotFoundError(f"{path}: there is no such file.", hint="Check the path.") from error
    except (OSError, ValueError) as error:  # ValueError: a path with a NUL byte
        reason = getattr(error, "strerror", None) or error
        raise InputDataError(f"{path}: cannot be read ({reason}).", hint="Check its permissions.") from error
    _require_usable(path, stat.S_IFREG, len(content))
    return content


def damaged(path: Path, kind: str, error: Exception) -> InputDataError:
    """Return what to say about a file that its own format's reader cannot make sense of."""
    reason = printable(str(error) or type(error).__name__)[:80]
    return InputDataError(
        f"{path}: not an intact {kind} ({reason}).",
        hint="Save or copy it again; if it is of another format, leave out --input-format.",
    )


def _require_usable(path: Path, mode: int, size: int) -> None:
    if stat.S_ISDIR(mode):
        raise InputDataError(f"{path}: is a folder, not a file.", hint=f"Name its files: {path}/*.csv")
    if not stat.S_ISREG(mode):
        raise InputDataError(f"{path}: is not a regular file.", hint="Copy the data into a file.")
    if size == 0:
        raise InputDataError(f"{path}: the file is empty.", hint="Record or export it again.")
    if size > MAX_BYTES:
        raise InputDataError(
            f"{path}: {size / 2**20:.0f} MiB; at most {MAX_BYTES / 2**20:.0f} MiB are read.",
            hint="Record at a lower rate, or split the file.",
        )
