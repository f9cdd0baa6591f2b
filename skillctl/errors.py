"""Every deliberate failure of skillctl: one sentence, and a hint that names the next action."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

UNPRINTABLE = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})  # control, format (bidi), surrogates, line breaks


def printable(text: str) -> str:
    r"""Return ``text`` with control and invisible format characters written as ``\x1b``.

    Names in other people's files end up in messages; a terminal must not obey them.
    """
    return "".join(
        char.encode("unicode_escape").decode("ascii") if unicodedata.category(char) in UNPRINTABLE else char
        for char in text
    )


def did_you_mean(
    word: str, known: Iterable[str] | Mapping[str, str], *, most: int = 1, cutoff: float = 0.6
) -> str:
    """Return ``Did you mean …?`` with the known words nearest to one that is not, or nothing.

    Args:
        word: What was given.
        known: What it may have been meant to be; a mapping says how each is shown.
        most: How many are named.
        cutoff: How near they have to be, from 0 to 1 for the word itself.
    """
    import difflib  # late: only mistakes need it

    shown = dict(known) if isinstance(known, Mapping) else {name: name for name in known}
    near = difflib.get_close_matches(word, list(shown), n=most, cutoff=cutoff)
    return f"Did you mean {' or '.join(shown[name] for name in near)}?" if near else ""


class SkillctlError(Exception):
    """Base of all deliberate failures. ``hint`` says what the user can do next."""

    def __init__(self, message: str, *, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint

    def add(self, sentence: str) -> None:
        """Say one sentence more, about what had happened by then."""
        self.args = (f"{self} {sentence}",)

    def __reduce__(self) -> tuple[Any, ...]:  # the default loses keyword-only arguments between processes
        return Exception.__new__, (type(self), *self.args), self.__dict__


class Terminated(KeyboardInterrupt):
    """SIGTERM: unwinds as Ctrl-C does, so that nothing half is left."""


class UsageError(SkillctlError):
    """The request itself makes no sense: options that contradict each other, a weight below zero."""


class NotFoundError(SkillctlError):
    """Something named does not exist: a file, a skill, a version, or an optional package."""


class InputDataError(SkillctlError):
    """Demonstrations that cannot be used: unreadable, not finite, too short, of different dimensions."""


class StateError(InputDataError):
    """A state that a skill cannot be asked about: of another shape, or not finite."""


class InvalidModelError(SkillctlError):
    """Arrays that do not form a skill: wrong shape, not finite, not positive definite."""


class FitError(SkillctlError):
    """No skill with the required guarantee could be computed from acceptable input."""


class GoalNotReachedError(SkillctlError):
    """The arm cannot do what was asked: the target or the start lies outside its workspace."""


class ArtifactError(SkillctlError):
    """A file that is not an intact skill artifact of a format this build reads."""


class ResourceError(SkillctlError):
    """Memory or time that a computation needs, and that is not there."""


class StoreError(SkillctlError):
    """The disk refused: no permission, no space, not a directory."""


def require_directory(file: Path | None) -> None:
    """Raise StoreError unless ``file`` can be written where it is to be, asked before any work is done."""
    if file is not None and not file.parent.is_dir():
        parent = printable(str(file.parent))
        raise StoreError(f"{parent}: there is no such directory.", hint=f"Make it: mkdir -p {parent}")
