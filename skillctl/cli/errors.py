"""From an exception to its exit code and one sentence."""

from __future__ import annotations

import errno
import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import typer

from skillctl import errors
from skillctl.cli.exit_codes import ExitCode
from skillctl.errors import did_you_mean, printable

# Phrases of the parser, which speaks to programmers, and ours for them.
REWORDED = (
    (re.compile(r"('.*') is not a valid int(eger)?( range)?\."), r"\1 is not a whole number."),
    (re.compile(r"('.*') is not a valid float( range)?\."), r"\1 is not a number."),
    (re.compile(r"(\S+) is not in the range x>=(\S+)\."), r"\1 is less than \2."),
    (
        re.compile(r"Got unexpected extra argument\(s\) \((.*)\)"),
        r"Nothing more was expected, but there is: \1.",
    ),
)
LESS = "Raise the limit (`ulimit -v`), or do less at once: fewer --jobs, --components or demonstrations."
NO_MEMORY = re.compile("failed to map segment|cannot allocate|can't start new thread|std::bad_alloc", re.I)
CHOICES = re.compile(r"'(?P<word>[^']*)' is not one of (?P<known>'.*')")

# Typer keeps its parser's usage error private; its public BadParameter is a direct child of it.
ParserError: type[Exception] = typer.BadParameter.__bases__[0]


@dataclass(frozen=True)
class Failure:
    """An error in words: exit code, one sentence, and the next action (may be empty)."""

    code: ExitCode
    message: str
    hint: str = ""


def describe(error: BaseException) -> Failure:
    """Return an error in words."""
    if isinstance(error, ParserError):
        return _usage_failure(error)
    code = ExitCode.of(error)
    if isinstance(error, errors.SkillctlError):
        return Failure(code, printable(str(error)), printable(error.hint))
    if isinstance(error, KeyboardInterrupt):
        stopped = "terminated" if isinstance(error, errors.Terminated) else "interrupted"
        done = printable(str(error)) or published()
        return Failure(code, f"{stopped}: {done}." if done else f"{stopped}.")
    if _for_want_of_memory(error):
        return Failure(ExitCode.STORE, "there is not enough memory.", LESS)
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return Failure(code, printable(f"{where}{error.strerror or error}."), "Check the path and the disk.")
    return Failure(
        code,
        printable(f"internal error ({type(error).__name__}: {error})."),
        "This is a bug in skillctl. Repeat the command with --debug and report what it prints.",
    )


def _for_want_of_memory(error: BaseException | None) -> bool:
    """Tell whether an error comes of a lack of memory, which libraries also say in other ways."""
    while error is not None:
        if isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.ENOMEM:
            return True
        if isinstance(error, ImportError | RuntimeError) and NO_MEMORY.search(str(error)):
            return True
        error = error.__cause__ or error.__context__
    return False


def publications() -> list[str]:
    """Return what was published in this process; a new command clears it, for a notebook runs many in one."""
    registry = sys.modules.get("skillctl.store.registry")  # what was not imported has not published
    published: list[str] = registry.PUBLISHED if registry else []
    return published


def published() -> str:
    """Return what this command has published before it failed, in words; nothing if nothing."""
    versions = publications()
    verb = "was" if len(versions) == 1 else "were"
    return f"{', '.join(versions)} {verb} published" if versions else ""


def nearest_word(word: str, known: Iterable[str]) -> str:
    """Return ``Did you mean …?`` for the nearest known word, or nothing. Dashes in front do not count."""
    return did_you_mean(word.lstrip("-"), {name.lstrip("-"): name for name in known}, cutoff=0.55)


def _usage_failure(error: Any) -> Failure:
    """Return an error of the parser in our words."""
    option, hint = getattr(error, "option_name", None), ""
    if option is not None and hasattr(error, "possibilities"):
        message = f"No such option: {option}"
        known = error.ctx.command.get_params(error.ctx) if error.ctx else ()
        hint = nearest_word(option, [name for parameter in known for name in parameter.opts])
    else:
        message = error.format_message()
    for pattern, words in REWORDED:
        message = pattern.sub(words, message)
    if choice := CHOICES.search(message):
        hint = nearest_word(choice["word"], re.findall("'([^']*)'", choice["known"]))
    message = " ".join(message.split())
    ended = message if message.endswith((".", "?", "!")) else f"{message}."
    return Failure(ExitCode.USAGE, printable(ended), printable(hint))
