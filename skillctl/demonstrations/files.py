"""Read a file once, parse it in a child process, and describe what is wrong with it."""

from __future__ import annotations

import hashlib
import stat
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from skillctl.errors import InputDataError, NotFoundError, printable
from skillctl.opening import open_regular
from skillctl.workers.child import Child, ChildDiedError
from skillctl.workers.limits import Limits

MAX_BYTES = 2**28  # of a file, packed or unpacked: millions of samples; more is no demonstration
LIMITS = Limits(
    seconds=8.0,
    memory=2**31,  # a file and numbers of MAX_BYTES each, twice, and the libraries
    numbers=MAX_BYTES,
)
# For the child. Filters of HDF5 are code that a file can ask for by number. Arrow's own allocators reserve
# more address space than LIMITS allow.
NO_PLUGINS = {"HDF5_PLUGIN_PRELOAD": "::", "ARROW_DEFAULT_MEMORY_POOL": "system"}
HEAD = 2**16  # bytes by which such files are recognised:
OPENED = (b"\x89HDF", b"#ROSBAG V", b"\x89MCAP", b"SQLite format 3\0")  # large, for they may hold films
HINT = "Save or copy it again, or export the trajectories as CSV or NPZ."


@dataclass(frozen=True, slots=True)
class File:
    """A file that is being read.

    Attributes:
        path: As the user named it, for messages.
        content: Its bytes; of a format that its parser opens itself, the first ones; of a folder, none.
        columns: Names of the position columns that the user asked for; in formats without names the caller
            selects them.
        child: Process for parsers that use large C libraries, which a damaged file may crash or exhaust.
        renamed: New names for columns, by their names in the file.
        axes: What the axes of an array are, if the user says it: demo, time and dim.
        max_dimension: Largest number of dimensions of a motion.
        topic: Of a bag, the topic that the user asked for.
        orientation: Convention of the orientation, if the user says it.
        position_only: Whether orientations are left aside.
    """

    path: Path
    content: bytes
    columns: Sequence[str] | None
    child: Child
    renamed: Mapping[str, str] = field(default_factory=dict)
    axes: Sequence[str] | None = None
    max_dimension: int = 7
    topic: str | None = None
    orientation: str | None = None
    position_only: bool = False
    _parsed: dict[Any, Any] = field(default_factory=dict)

    def opened(self, parser: Callable[..., Any], kind: str, **options: Any) -> Any:
        """Return ``parser(path, **options)``, computed once, in the child; see ``parsed``."""
        return self._once(parser, str(self.path.absolute()), kind, options)

    def parsed(self, parser: Callable[..., Any], kind: str, **options: Any) -> Any:
        """Return ``parser(content, **options)``, computed once, in the child.

        Args:
            parser: A function at the top level of a module, which returns arrays, text and numbers in lists
                and dictionaries, or raises InputDataError without the name of the file.
            kind: What the file should be, for messages.
            options: Further arguments of the parser; the same at every call.

        Raises:
            InputDataError: The parser refused the file, failed, crashed, or took too much time or memory.
        """
        return self._once(parser, self.content, kind, options)

    def _once(
        self, parser: Callable[..., Any], given: bytes | str, kind: str, options: dict[str, Any]
    ) -> Any:
        if parser not in self._parsed:
            self._parsed[parser] = self._called(parser, given, kind, options)
        return self._parsed[parser]

    def _called(
        self, parser: Callable[..., Any], given: bytes | str, kind: str, options: dict[str, Any]
    ) -> Any:
        path, limits = self.path, self.child.limits or LIMITS
        try:
            return self.child.call(parser, given, **options)
        except TimeoutError:
            reason = f"takes longer than {limits.seconds:g} s"
        except MemoryError:
            reason = f"takes more than {(limits.memory or 0) / 2**20:.0f} MiB of memory"
        except OSError as error:
            reason = f"needs a process of its own, which does not start ({error.strerror})"
        except InputDataError as refusal:
            raise InputDataError(f"{path}: {refusal}", hint=refusal.hint) from None
        except ChildDiedError as error:
            raise damaged(path, kind, f"the process that reads it {error}") from error
        except ValueError as error:
            raise damaged(path, kind, str(error)) from error
        raise InputDataError(f"{path}: reading this {kind} {reason}.", hint=HINT)


def read_bytes(path: Path) -> bytes:
    """Return the content of a file; its first HEAD bytes if its parser opens it, and none of a folder.

    Raises:
        NotFoundError: There is no such file.
        InputDataError: The file is not regular, not readable, empty, or larger than MAX_BYTES.
    """
    try:
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            return b""
        with open_regular(path) as file:
            content = file.read(HEAD)
            if content.startswith(OPENED):
                return content
            if status.st_size <= MAX_BYTES:
                content += file.read(MAX_BYTES + 1 - len(content))  # the size may have grown since
    except (FileNotFoundError, NotADirectoryError) as error:
        raise NotFoundError(f"{path}: there is no such file.", hint="Check the path.") from error
    except (OSError, ValueError) as error:  # ValueError: a path with a NUL byte
        reason = getattr(error, "strerror", None) or error
        raise InputDataError(f"{path}: cannot be read ({reason}).", hint="Check its permissions.") from error
    if not content:
        raise InputDataError(f"{path}: the file is empty.", hint="Record or export it again.")
    if (size := max(len(content), status.st_size)) > MAX_BYTES:
        raise InputDataError(
            f"{path}: {size / 2**20:.0f} MiB; at most {MAX_BYTES / 2**20:.0f} MiB are read.",
            hint="Record at a lower rate, or split the file.",
        )
    return content


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal; the file may be larger than the memory."""
    digest = hashlib.sha256()
    with open_regular(path) as file:
        while piece := file.read(2**20):
            digest.update(piece)
    return digest.hexdigest()


def damaged(path: Path, kind: str, reason: str) -> InputDataError:
    """Return the refusal of a file that the reader of its format cannot parse."""
    return InputDataError(
        f"{path}: not an intact {kind} ({printable(reason)[:80]}).",
        hint="Save or copy it again; if it is of another format, leave out --input-format.",
    )
