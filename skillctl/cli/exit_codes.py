"""The exit codes of the program."""

from __future__ import annotations

from enum import IntEnum


class ExitCode(IntEnum):
    """What the shell sees."""

    DONE = 0  # or a positive verdict
    NEGATIVE = 1  # not proved stable, goal not reached: an answer, not an error
    USAGE = 2
    INCONCLUSIVE = 3
    NOT_FOUND = 4
    BAD_INPUT = 5
    FIT_FAILED = 6
    REFUSED = 7  # an artifact that is corrupt, hostile or of an unsupported version
    STORE = 8  # or any other I/O
    INTERNAL = 70
    INTERRUPTED = 130
    CLOSED_PIPE = 141
    TERMINATED = 143
