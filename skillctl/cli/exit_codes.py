"""The exit codes of the program, their meanings, and the errors that lead to each."""

from __future__ import annotations

from enum import IntEnum

from skillctl import errors


class ExitCode(IntEnum):
    """What the shell sees.

    Attributes:
        meaning: In the words of the help.
        causes: Errors that lead to it; the nearest class of an error decides.
    """

    meaning: str
    causes: tuple[type[BaseException], ...]

    def __new__(cls, code: int, meaning: str, *causes: type[BaseException]) -> ExitCode:
        """Return a code with its meaning and causes."""
        member = int.__new__(cls, code)
        member._value_, member.meaning, member.causes = code, meaning, causes
        return member

    DONE = 0, "done or proved"
    NEGATIVE = 1, "not proved or goal not reached", errors.GoalNotReachedError  # an answer, not an error
    USAGE = 2, "usage", errors.UsageError
    INCONCLUSIVE = 3, "inconclusive"
    NOT_FOUND = 4, "not found", errors.NotFoundError
    BAD_INPUT = 5, "bad input data", errors.InputDataError, errors.InvalidModelError
    FIT_FAILED = 6, "no acceptable skill", errors.FitError
    REFUSED = 7, "artifact refused", errors.ArtifactError  # corrupt, hostile, of an unsupported version
    STORE = 8, "store, disk or memory", errors.StoreError, errors.ResourceError, OSError, MemoryError
    INTERNAL = 70, "internal error", Exception
    INTERRUPTED = 130, "interrupted", KeyboardInterrupt
    CLOSED_PIPE = 141, "closed pipe", BrokenPipeError
    TERMINATED = 143, "terminated", errors.Terminated

    @classmethod
    def of(cls, error: BaseException) -> ExitCode:
        """Return the code that an error leads to."""
        codes = {cause: code for code in cls for cause in code.causes}
        return next((codes[kind] for kind in type(error).__mro__ if kind in codes), cls.INTERNAL)


def described() -> str:
    """Return the codes with their meanings, in words."""
    return ", ".join(f"{code:d} {code.meaning}" for code in ExitCode if code <= ExitCode.INTERNAL)
