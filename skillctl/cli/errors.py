"""From an exception to its exit code and one sentence."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass

import typer

from skillctl import errors
from skillctl.cli.exit_codes import ExitCode
from skillctl.errors import did_you_mean, printable

# What the parser says in a programmer's words, and how it is said here.
REWORDED = (
    (re.compile(r"('.*') is not a valid int(eger)?( range)?\."), r"\1 is not a whole number."),
    (re.compile(r"('.*') is not a valid float( range)?\."), r"\1 is not a number."),
    (re.compile(r"(\S+) is not in the range x>=(\S+)\."), r"\1 is less than \2."),
    (
        re.compile(r"Got unexpected extra argument\(s\) \((.*)\)"),
        r"Nothing more was expected, but there is: \1.",
    ),
)
CHOICES = re.compile(r"'(?P<word>[^']*)' is not one of (?P<known>'.*')")

# Typer keeps its parser's usage error private; its public BadParameter is a direct child of it.
ParserError: type[Exception] = typer.BadParameter.__bases__[0]


@dataclass(frozen=True)
class Failure:
    """What is told about an error: exit code, one sentence, and the next action (may be empty)."""

    code: ExitCode
    message: str
    hint: str = ""


def describe(error: BaseException) -> Failure:
    """Return what to tell about an error."""
    if isinstance(error, ParserError):
        return _usage_failure(error)
    code = ExitCode.of(error)
    if isinstance(error, errors.SkillctlError):
        return Failure(code, printable(str(error)), printable(error.hint))
    if isinstance(error, KeyboardInterrupt):
        stopped = "terminated" if isinstance(error, errors.Terminated) else "interrupted"
        said = printable(str(error)) or _published()  # by whoever knows what was done already
        return Failure(code, f"{stopped}: {said}." if said else f"{stopped}.")
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return Failure(code, printable(f"{where}{error.strerror or error}."), "Check the path and the disk.")
    kind = type(error).__name__
    return Failure(
        code,
        printable(f"internal error ({kind}: {error})."),
        "This is a bug in skillctl. Repeat the command with --debug and report what it prints.",
    )


def forget_published() -> None:
    """Forget what commands before this one published: a test, or a notebook, runs many in one process."""
    _publications().clear()


def _publications() -> list[str]:
    registry = sys.modules.get("skillctl.store.registry")  # what was not imported has not published
    published: list[str] = registry.PUBLISHED if registry else []
    return published


def _published() -> str:
    """Return what this command has published before it was interrupted, in words; nothing if nothing."""
    versions = _publications()
    verb = "was" if len(versions) == 1 else "were"
    return f"{', '.join(versions)} {verb} published" if versions else ""


def nearest_word(word: str, known: Iterable[str]) -> str:
    """Return ``Did you mean …?`` for the nearest known word, or nothing. Dashes in front do not count."""
    return did_you_mean(word.lstrip("-"), {name.lstrip("-"): name for name in known}, cutoff=0.55)


def _usage_failure(error: Exception) -> Failure:
    message = getattr(error, "message", "") or ""
    option = getattr(error, "option_name", None)
    hint = ""
    if option is not None and hasattr(error, "possibilities"):
        message = f"No such option: {option}"
        hint = nearest_word(option, _options_of(error))
    elif callable(render := getattr(error, "format_message", None)):
        message = render()
    for pattern, words in REWORDED:
        message = pattern.sub(words, message)
    if choice := CHOICES.search(message):
        hint = nearest_word(choice["word"], re.findall("'([^']*)'", choice["known"]))
    return Failure(ExitCode.USAGE, printable(_sentence(message)), printable(hint))


def _options_of(error: Exception) -> list[str]:
    context = getattr(error, "ctx", None)
    if context is None:
        return list(getattr(error, "possibilities", None) or ())
    return [name for parameter in context.command.get_params(context) for name in parameter.opts]


def _sentence(text: str) -> str:
    text = " ".join(text.split())
    return text if text.endswith((".", "?", "!")) else f"{text}."
