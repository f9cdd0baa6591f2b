"""Parse other people's binary files in a process of its own, which a damaged one may crash, hang or exhaust.

The libraries that know these formats are written in C: a file can end the process that reads it, or never let
it go on. So its bytes go to a child with limits, and nothing but plain numbers and text comes back.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from skillctl.demonstrations.files import MAX_BYTES, damaged
from skillctl.demonstrations.serving import FRAME, MAX_TEXT, MEMORY_LIMIT, TIME_LIMIT, Parser, unpacked
from skillctl.errors import InputDataError

START = "import sys; sys.path[:] = sys.argv[1:]; from skillctl.demonstrations.serving import serve; serve()"
SURROUNDINGS = {
    "HDF5_PLUGIN_PRELOAD": "::",  # no filter plugins: code that a file can ask for by number
    "OPENBLAS_NUM_THREADS": "1",  # every thread would reserve some of the address space
    "OMP_NUM_THREADS": "1",
}
HINT = "Save or copy it again, or export the trajectories as CSV or NPZ."


class Child:
    """A process for parsing, started when first needed, and again after a file has ended it.

    Its user closes it, best by a ``with`` statement.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Child:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def parse(self, parser: Parser, content: bytes, path: Path, kind: str, **options: Any) -> Any:
        """Return what ``parser(content, **options)`` returns, computed in the child.

        Args:
            parser: See ``serving.Parser``.
            content: The bytes of a file.
            path: The file, for messages.
            kind: What the file should be, for messages.
            options: Whatever JSON can express.

        Raises:
            InputDataError: The parser refused the file, failed on it, was killed by it, or took more time or
                memory than it may.
        """
        request = {"module": parser.__module__, "parser": parser.__name__, "options": options}
        try:
            answer, numbers = self._asked(json.dumps(request).encode(), content)
        except TimeoutError:
            raise InputDataError(
                f"{path}: reading this {kind} takes longer than {TIME_LIMIT:g} s.", hint=HINT
            ) from None
        except OSError as error:
            raise InputDataError(
                f"{path}: reading this {kind} needs a process of its own, which does not start "
                f"({error.strerror}).",
                hint="Close other programs, or export the trajectories as CSV or NPZ.",
            ) from error
        except EOFError as error:
            raise damaged(path, kind, error) from error
        if answer.get("exhausted"):
            limit = f"{MEMORY_LIMIT / 2**20:.0f} MiB of memory"
            raise InputDataError(f"{path}: reading this {kind} takes more than {limit}.", hint=HINT)
        if "refused" in answer:
            raise InputDataError(f"{path}: {answer['refused']}", hint=answer["hint"])
        if "failed" in answer:
            raise damaged(path, kind, ValueError(answer["failed"]))
        return unpacked(answer["value"], numbers)

    def close(self) -> None:
        """End the process, if there is one."""
        process, self._process = self._process, None
        if process is None:
            return
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            with contextlib.suppress(OSError):  # what it did not read of a request
                assert pipe is not None
                pipe.close()

    def _asked(self, request: bytes, content: bytes) -> tuple[dict[str, Any], bytearray]:
        """Return the answer to a request: its text, and its numbers.

        Raises:
            TimeoutError: There was none in time.
            EOFError: The child ended instead; says how.
            OSError: It does not start.
        """
        process = self._process = self._process or _started()
        late = threading.Event()
        watchdog = threading.Timer(TIME_LIMIT, _stop, (process, late))
        watchdog.start()
        try:
            return _exchange(process, request, content)
        except (ValueError, OSError, EOFError):
            ending = _ending(process)
            self.close()
            raise EOFError(f"the process that reads it {ending}") from None
        finally:
            watchdog.cancel()
            if late.is_set():  # perhaps just after the answer: the child is gone all the same
                self.close()
                raise TimeoutError


def _started() -> subprocess.Popen[bytes]:
    command = [sys.executable, "-I", "-B", "-c", START, *sys.path]  # -I: nothing from the working directory
    return subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **SURROUNDINGS},
    )


def _stop(process: subprocess.Popen[bytes], late: threading.Event) -> None:
    late.set()
    process.kill()


def _exchange(
    process: subprocess.Popen[bytes], request: bytes, content: bytes
) -> tuple[dict[str, Any], bytearray]:
    assert process.stdin is not None
    assert process.stdout is not None
    for part in (FRAME.pack(len(request), len(content)), request, content):
        process.stdin.write(part)
    process.stdin.flush()
    size, count = FRAME.unpack(_exactly(process.stdout, FRAME.size))
    if size > MAX_TEXT or count > MAX_BYTES:
        raise ValueError("no answer is that long")
    return json.loads(_exactly(process.stdout, size)), _exactly(process.stdout, count)


def _exactly(pipe: IO[bytes], size: int) -> bytearray:
    """Return the next ``size`` bytes, in memory that arrays can share."""
    buffer = bytearray(size)
    view, filled = memoryview(buffer), 0
    while filled < size:
        got = pipe.readinto(view[filled:])  # type: ignore[attr-defined]
        if not got:
            raise EOFError
        filled += got
    return buffer


def _ending(process: subprocess.Popen[bytes]) -> str:
    """Return how a process ended that has closed its pipes."""
    try:
        code = process.wait(timeout=1)
    except subprocess.TimeoutExpired:
        return "answers nonsense"
    try:
        return f"ends with {signal.Signals(-code).name}"
    except ValueError:
        return f"ends with status {code}"
