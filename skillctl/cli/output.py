"""The streams of a run: results on standard output, everything else on standard error."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any, TextIO

from skillctl.cli import render
from skillctl.cli.errors import Failure, describe, published
from skillctl.cli.exit_codes import ExitCode
from skillctl.errors import StoreError, printable


@dataclass
class Output:
    """The streams of one run, and how much is printed on them.

    Attributes:
        as_json: The result is one JSON document; so is an error.
        quiet: Nothing but the result, warnings and errors.
        verbose: Also what is being done.
        debug: Tracebacks.
        command: What is being run, as it is typed.
    """

    as_json: bool = False
    quiet: bool = False
    verbose: bool = False
    debug: bool = False
    command: str = "skillctl"

    @classmethod
    def for_arguments(cls, arguments: Sequence[str]) -> Output:
        """Return the output for a command line that may not even parse: errors need its form too."""
        words = list(arguments[: arguments.index("--")] if "--" in arguments else arguments)
        return cls(as_json="--json" in words, debug="--debug" in words)

    def result(self, report: Any, blocks: Callable[[], Sequence[render.Block]]) -> None:
        """Print a report: as a JSON document, or as the blocks that describe it to people."""
        if self.as_json:
            self._write(render.to_json(report) + "\n")
        elif is_terminal(sys.stdout):
            coloured = not os.environ.get("NO_COLOR")  # https://no-color.org
            self._write(render.to_terminal(blocks(), coloured=coloured))
        else:
            self._write(render.to_text(blocks()))

    def verbatim(self, text: str) -> None:
        """Print a result whose form another program prescribes, as it is."""
        self._write(text)

    def note(self, text: str) -> None:
        """Print what is not the result."""
        if not (self.quiet or self.as_json):
            _to_stderr(_wrapped(printable(text)))

    def announce(self, command: str) -> None:
        """Print a command that is run; where its line is broken it ends so that it can be pasted."""
        if not (self.quiet or self.as_json):
            _to_stderr(_wrapped(f"$ {printable(command)}", ending=" \\"))

    def warning(self, text: str) -> None:
        """Print what must not be missed, even with --quiet; the document of --json holds it."""
        if not self.as_json:
            _to_stderr(_wrapped(printable(f"warning: {text}")))

    def detail(self, text: str) -> None:
        """Print what is only of interest with --verbose."""
        if self.verbose:
            self.note(text)

    @contextmanager
    def progress(self, label: str) -> Iterator[Callable[[str, int, int], None] | None]:
        """Yield a function (stage, done, total) that moves a progress bar; None where none can be shown.

        With --verbose each stage is a line instead.
        """
        if self.quiet or self.as_json or not (self.verbose or is_terminal(sys.stderr)):
            yield None
            return
        if self.verbose:
            yield self._stages(label)
            return
        from rich.console import Console
        from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(label, total=None)
            yield lambda stage, done, total: bar.update(
                task, description=f"{label}: {stage}", completed=done, total=total
            )

    def _stages(self, label: str) -> Callable[[str, int, int], None]:
        """Return a function that says when a new stage begins."""
        began, last = time.monotonic(), ""

        def say_new_stage(stage: str, done: int, total: int) -> None:
            nonlocal last
            if stage != last:
                last = stage
                self.note(f"{label}: {stage}, after {time.monotonic() - began:.2f} s")

        return say_new_stage

    def fail(self, error: BaseException) -> int:
        """Tell about an error, and what was published before it, and return the exit code."""
        failure = describe(error)
        if (done := published()) and done not in failure.message:
            failure = replace(failure, message=f"{failure.message} All the same, {done}.")
        if failure.code == ExitCode.USAGE and not failure.hint:
            failure = replace(failure, hint=f"'{self.command} --help' shows how it is used.")
        if self.debug:
            traceback.print_exception(error, file=sys.stderr)
        if failure.code != ExitCode.CLOSED_PIPE:
            self._tell(failure)
        _settle_stdout()
        return int(failure.code)

    def failures(self, failures: Sequence[Failure], attempts: int, done: str = "read") -> None:
        """Tell about the failures among many attempts: each in words, or all of them in one document."""
        if not self.as_json:
            for failure in failures:
                self._tell(failure)
        elif failures:
            worst = max(failure.code for failure in failures)
            summary = f"{len(failures)} of {attempts} skills could not be {done}."
            self._tell(Failure(worst, summary, "The document on standard output says which, and why."))

    def _tell(self, failure: Failure) -> None:
        if self.as_json:
            _to_stderr(render.to_json(failure))
            return
        hint = f"\nhint: {failure.hint}" if failure.hint else ""
        _to_stderr(_wrapped(f"error: {failure.message}{hint}"))

    def flush(self) -> None:
        """Make sure that what was printed has arrived: a full disk must not look like success."""
        self._write("")

    def _write(self, text: str) -> None:
        if sys.stdout is None:
            raise StoreError("standard output is closed.", hint="Redirect it to a file or to /dev/null.")
        try:
            sys.stdout.write(text)
            sys.stdout.flush()
        except BrokenPipeError:
            raise
        except OSError as error:
            problem = f"standard output cannot be written: {error.strerror}."
            raise StoreError(problem, hint="Free some space, or write elsewhere.") from error


def is_terminal(stream: TextIO | None) -> bool:
    """Return whether a stream is a terminal that can show more than plain lines (not dumb, not CI)."""
    if stream is None or os.environ.get("TERM") == "dumb" or os.environ.get("CI"):
        return False
    return stream.isatty()


def _wrapped(text: str, ending: str = "") -> str:
    """Return text broken between words where standard error is a terminal, which breaks within them.

    ``ending`` closes each line that is broken.
    """
    if not is_terminal(sys.stderr):
        return text
    whole: dict[str, Any] = {"break_long_words": False, "break_on_hyphens": False, "subsequent_indent": "  "}
    wrapper = textwrap.TextWrapper(shutil.get_terminal_size().columns - len(ending), **whole)
    return "\n".join(f"{ending}\n".join(wrapper.wrap(line)) for line in text.split("\n"))


def _to_stderr(text: str) -> None:
    with suppress(OSError, ValueError):  # nowhere left to complain to
        print(text, file=sys.stderr, flush=True)


def _settle_stdout() -> None:
    """Flush standard output, or point it nowhere: the flush at exit would fail once more, and say so."""
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
