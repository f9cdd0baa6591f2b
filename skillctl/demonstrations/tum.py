"""TUM trajectories: rows ``timestamp tx ty tz qx qy qz qw``, separated by spaces, without a header."""

from __future__ import annotations

import math

from skillctl.demonstrations import table
from skillctl.demonstrations.files import File
from skillctl.demonstrations.recording import Recording

COLUMNS = ("timestamp", "x", "y", "z", "qx", "qy", "qz", "qw")
HEADERS = (["timestamp", "tx", "ty", "tz", *COLUMNS[4:]], list(COLUMNS))
HEAD = 2**16  # bytes: comments longer than this hide what follows
UNIT = 0.01  # a unit quaternion, written with two decimals or more, is this close to length one


def recognises(file: File) -> bool:
    """Return whether a text has the header of a TUM trajectory or a first row that ends in a unit quaternion.

    A table of seven joints may have as many numbers, but then it has a header of its own.
    """
    if not table.recognises(file):
        return False
    above: list[str] = []
    for line in file.content[:HEAD].decode("utf-8-sig", "replace").splitlines():
        words = line.lower().strip("# ").split()
        if words in HEADERS:
            return True
        if words and not line.lstrip().startswith("#"):
            return len(above) != len(COLUMNS) and _is_pose(words)
        above = words
    return False


def read(file: File) -> list[Recording]:
    """Return the one demonstration in a TUM trajectory.

    Raises:
        InputDataError: A row is not eight numbers; the message gives the line.

    References:
        Sturm et al. 2012, the RGB-D benchmark; its page on file formats.
    """
    return table.read(file, header=COLUMNS)


def _is_pose(words: list[str]) -> bool:
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return False
    return len(numbers) == len(COLUMNS) and abs(math.hypot(*numbers[4:]) - 1) < UNIT
