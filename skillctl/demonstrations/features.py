"""Choose among named vectors, such as observations of a robot: which of their numbers are the position.

Importers of data sets describe what a file holds as ``Features``: the names of vectors, and of the numbers in
each. Nothing else is known about them, so that a choice that is not certain is left to the user.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TypeAlias

from skillctl.demonstrations.joints import MOST, joints
from skillctl.demonstrations.recording import column_indices, listed
from skillctl.errors import InputDataError, printable
from skillctl.model.space import AXIS_NAMES

Features: TypeAlias = dict[str, tuple[str, ...]]  # vectors by name, and the names of their numbers
Column: TypeAlias = tuple[str, int]  # a vector, and which of its numbers

GRIPPER = re.compile(r"grip|finger|jaw", re.IGNORECASE)  # never a coordinate, unless by its own name
TURNING = re.compile(r"rot|ori|quat|euler|ang|vel|force|torque|axis|^[qrw][._ ]?$", re.IGNORECASE)
POSITION = re.compile(r"(pos|position|xyz)$", re.IGNORECASE)
POSE, POSE_WIDTHS = re.compile("pose", re.IGNORECASE), (6, 7)  # a position, then an orientation
PATTERN = frozenset("*?[")


@dataclass(frozen=True, slots=True)
class Choice:
    """Numbers that make up a position.

    Attributes:
        columns: Vector and index of each, in order.
        names: Their names in the state space: x, y, z for one point.
        left: Names of the vectors, and of numbers beside those chosen, that are not used.
    """

    columns: tuple[Column, ...]
    names: tuple[str, ...]
    left: tuple[str, ...]


def numbered(feature: str, width: int) -> tuple[str, ...]:
    """Return names for the numbers of a vector of which only the name is known."""
    stem = feature.rpartition("/")[2]
    names = tuple(f"{stem}_{i}" for i in range(width))
    if POSITION.search(stem) and width == len(AXIS_NAMES):
        return AXIS_NAMES
    return AXIS_NAMES + names[3:] if POSE.search(stem) and width in POSE_WIDTHS else names


def points(labels: Sequence[str]) -> list[tuple[int, ...]]:
    """Return the indices of x, y (and z) of each point among the names of a vector's numbers."""
    lower = [label.lower() for label in labels]
    axes = [axis for axis in AXIS_NAMES if axis in lower]
    found = [tuple(map(lower.index, axes))] if len(axes) > 1 else []
    for stem, columns in joints(labels).items():
        if not TURNING.search(stem):
            found.append(tuple(labels.index(column) for column in columns))
    return found


def choose(wanted: Sequence[str], features: Features, path: Path, *, what: str) -> Choice:
    """Return the numbers that the wanted words name; messages call a vector ``what``.

    A word is a vector, one of its numbers (``x``, or ``state/x`` where several vectors have one), or a
    pattern of such names (``left_*``). Of a whole vector with the numbers x, y, z, these are taken; of
    others, all but those of a gripper.

    Raises:
        UsageError: A word is given twice.
        InputDataError: A word names nothing, or several things.
    """
    column_indices(wanted, wanted, path)  # refuses words that are given twice
    columns = [column for word in wanted for column in _named(word, features, path, what)]
    columns = list(dict.fromkeys(columns))
    if len(columns) > MOST:
        names = [features[feature][index] for feature, index in columns]
        raise InputDataError(
            f"{path}: {len(columns)} numbers could be the position; which are?",
            hint=f"Choose with --columns, which takes patterns such as 'left_*', too. They are: "
            f"{listed(names, 40)}.",
        )
    return Choice(tuple(columns), _names(columns, features), _left(columns, features))


def offered(features: Features) -> str:
    """Return the vectors for a hint, those first that hold the position of a point."""
    likely = [name for name, labels in features.items() if points(labels)]
    return f"Choose with --columns {printable(likely[0])}. " if likely else ""


def _named(word: str, features: Features, path: Path, what: str) -> list[Column]:
    whole = [name for name in features if word == name or name.endswith((f"/{word}", f".{word}"))]
    if word in features or len(whole) == 1:
        return _whole(word if word in features else whole[0], features)
    every = [(name, i) for name, labels in features.items() for i in range(len(labels))]
    found = [column for column in every if word in _spellings(column, features)]
    most = 1
    if not found and PATTERN & set(word):
        matching = [c for c in every if any(fnmatchcase(name, word) for name in _spellings(c, features))]
        found = [c for c in matching if not GRIPPER.search(features[c[0]][c[1]])]
        most = len(found) if len({feature for feature, _ in found}) == 1 else 1
    if len(found) > most:
        spelled = [_spellings(column, features)[-1] for column in found]
        raise InputDataError(
            f"{path}: '{printable(word)}' is one of several numbers.", hint=f"Write {listed(spelled)}."
        )
    if not found:
        column_indices([word], list(features), path, what=what)  # refuses, and says what there is
    return found


def _spellings(column: Column, features: Features) -> tuple[str, str, str]:
    """Return what a number may be called, the longest last."""
    feature, index = column
    label = features[feature][index]
    return label, f"{feature}.{label}", f"{feature}/{label}"


def _whole(feature: str, features: Features) -> list[Column]:
    """Return the numbers of a vector that are its position."""
    labels = features[feature]
    found = points(labels)
    if len(found) == 1:
        return [(feature, index) for index in found[0]]
    columns = [(feature, i) for i, label in enumerate(labels) if not GRIPPER.search(label)]
    return columns or [(feature, i) for i in range(len(labels))]


def _names(columns: Sequence[Column], features: Features) -> tuple[str, ...]:
    """Return names for the state space, each of which occurs once."""
    names = [features[feature][index] for feature, index in columns]
    axes = tuple(name[-1:].lower() for name in names)
    if len(axes) > 1 and axes == AXIS_NAMES[: len(axes)]:
        return axes
    often = Counter(names)
    return tuple(
        name if often[name] == 1 else f"{feature.rpartition('/')[2]}_{index}"
        for name, (feature, index) in zip(names, columns, strict=True)
    )


def _left(columns: Sequence[Column], features: Features) -> tuple[str, ...]:
    used = {feature for feature, _ in columns}
    beside = [
        label
        for feature in used
        for index, label in enumerate(features[feature])
        if (feature, index) not in columns
    ]
    return (*(name for name in features if name not in used), *beside)
