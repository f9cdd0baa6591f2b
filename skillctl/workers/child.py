"""A child process that calls functions for its parent, which nothing they do there can harm.

Libraries written in C may crash on a damaged file, never return, or take all memory. In a child that costs
the one call: ``Child.call`` raises, and the next call starts a new child.

- ``Limits`` bound the time, the memory and the answer of a call, and forbid writing files. A child with
  limits is not trusted: it answers with numbers, text, lists, dictionaries and arrays only (``messages``).
- Without limits, results are whatever can be pickled, and exceptions are raised as they are.
- Arguments are pickled, and functions are found by name: they stand at the top level of a module.
- What functions print on standard output is lost; on standard error, it is if there are limits.
- A child ends with its parent, however the parent ends. Ctrl-C reaches the parent only.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import IO, Any, TypeAlias, cast

from skillctl.workers import messages
from skillctl.workers.limits import Limits
from skillctl.workers.threads import THREAD_VARIABLES

START = "import sys; sys.path[:] = sys.argv[1:]; from skillctl.workers.serving import serve; serve()"
NO_MORE: Mapping[str, str] = MappingProxyType({})
Process: TypeAlias = "subprocess.Popen[bytes]"


class ChildDiedError(Exception):
    """A child ended instead of answering, or answered nonsense; the text says how: ``ends with SIGSEGV``."""


class Child:
    """A process for calling functions, started when first needed, and again after a call has ended it.

    Its user closes it, best by a ``with`` statement. Another thread may do so, too; a call that is under way
    then raises ChildDiedError.

    Args:
        limits: Of each call; None trusts the functions and their data.
        environment: Environment variables that the child has besides those of this process.
    """

    def __init__(self, limits: Limits | None = None, environment: Mapping[str, str] = NO_MORE) -> None:
        self.limits = limits
        # One thread for linear algebra: others would reserve address space, and results would depend on them.
        self._environment = {**dict.fromkeys(THREAD_VARIABLES, "1"), **environment}
        self._process: Process | None = None
        self._closed = False
        self._lock = threading.Lock()  # of the two above

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def call(self, function: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        """Return ``function(*arguments, **options)``, computed in the child.

        Raises:
            TimeoutError: There was no answer in time.
            MemoryError: The function took more memory than it may.
            ChildDiedError: The child ended instead.
            OSError: It does not start.
            Whatever the function raises; with limits InputDataError as it is, and ValueError with the text of
                any other exception.
        """
        process = self._started()
        try:
            with _killed_after(self.limits.seconds, process) if self.limits else contextlib.nullcontext():
                self.ask(function, *arguments, **options)
                received = self._received()
        except TimeoutError:
            self._end(process)
            raise
        return messages.result(*received, self.limits)

    def ask(self, function: Callable[..., Any], *arguments: Any, **options: Any) -> None:
        """Let the child begin a call; its ``answer`` has to be fetched before the next.

        Raises:
            ChildDiedError, OSError: See ``call``.
        """
        request = pickle.dumps((function, arguments, options))
        process = self._started()
        with self._ended_by_errors(process):
            messages.send(_pipes(process)[0], pickle.dumps(self.limits), [request])

    def answer(self) -> Any:
        """Return, or raise, what the call leads to that was begun; see ``call``."""
        return messages.result(*self._received(), self.limits)

    def _received(self) -> tuple[bytearray, bytearray]:
        process = self._started()
        with self._ended_by_errors(process):
            return messages.receive(_pipes(process)[1], self.limits)

    def fileno(self) -> int:
        """Return a descriptor that can be read when there is an answer."""
        return _pipes(self._started())[1].fileno()

    @contextlib.contextmanager
    def _ended_by_errors(self, process: Process) -> Iterator[None]:
        """End the child after any error: half an exchange would spoil the next."""
        try:
            yield
        except (EOFError, ValueError, BrokenPipeError):
            how = _ending(process)
            self._end(process)
            raise ChildDiedError(how) from None
        except BaseException:  # Ctrl-C, or no memory
            self._end(process)
            raise

    def close(self) -> None:
        """End the process, if there is one, and start no other."""
        with self._lock:
            self._closed, process = True, self._process
        if process is not None:
            self._end(process)

    def _started(self) -> Process:
        with self._lock:
            if self._closed:
                raise ChildDiedError("was closed")
            if self._process is None:
                self._process = subprocess.Popen(
                    [sys.executable, "-I", "-B", "-c", START, *sys.path],  # -I: nothing from the cwd
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=None if self.limits is None else subprocess.DEVNULL,
                    env={**os.environ, **self._environment},
                    start_new_session=True,  # a terminal sends it no Ctrl-C
                )
            return self._process

    def _end(self, process: Process) -> None:
        with self._lock:
            if self._process is process:
                self._process = None
        process.kill()
        process.wait()
        for pipe in _pipes(process):
            with contextlib.suppress(OSError):  # what it did not read of a request
                pipe.close()


def _pipes(process: Process) -> tuple[IO[bytes], IO[bytes]]:
    return cast(IO[bytes], process.stdin), cast(IO[bytes], process.stdout)  # it is started with both


@contextlib.contextmanager
def _killed_after(seconds: float, process: Process) -> Iterator[None]:
    """Kill a process if the block takes longer; then raise TimeoutError, whatever else happens."""
    late = threading.Event()

    def stop() -> None:
        late.set()
        process.kill()

    watchdog = threading.Timer(seconds, stop)
    watchdog.start()
    try:
        yield
    finally:
        watchdog.cancel()
        if late.is_set():  # perhaps just after the answer: the child is gone all the same
            raise TimeoutError


def _ending(process: Process) -> str:
    """Return how a process ended that has closed its pipes."""
    try:
        code = process.wait(timeout=1)
    except subprocess.TimeoutExpired:
        return "answers nonsense"
    try:
        return f"ends with {signal.Signals(-code).name}"
    except ValueError:
        return f"ends with status {code}"
