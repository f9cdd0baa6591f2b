"""Choose among named vectors, such as observations of a robot: which of their numbers are the position.

Importers of data sets describe what a file holds as ``Features``: the names of vectors, and of the numbers in
each. What a name means is decided as in the header of a table, see ``columns``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import TypeAlias

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.demonstrations.columns import Column, positions
from skillctl.demonstrations.files import File
from skillctl.demonstrations.orientation_columns import Turn, orientation_of
from skillctl.demonstrations.recording import Orientation, column_indices, listed
from skillctl.errors import InputDataError, printable
from skillctl.model.space import AXIS_NAMES

Features: TypeAlias = dict[str, tuple[str, ...]]  # vectors by name, and the names of their numbers
Place: TypeAlias = tuple[str, int]  # a vector, and which of its numbers

PATTERN = frozenset("*?[")


@dataclass(frozen=True, slots=True)
class Choice:
    """Numbers that make up a position.

    Attributes:
        places: Vector and index of each, in order.
        names: Their names in the state space: x, y, z for one point.
        point: Whether they are one point.
        taken: Their own names.
        left: Names of the vectors, and of numbers beside those chosen, that are no position.
        turn: Vector and index of each number of the orientation, if it is read.
        convention: Of it.
        turned: Names among ``left`` that are it.
        notes: About an orientation that is not.
    """

    places: tuple[Place, ...]
    names: tuple[str, ...]
    point: bool
    taken: tuple[str, ...]
    left: tuple[str, ...]
    turn: tuple[Place, ...] = ()
    convention: str = ""
    turned: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def keys(self) -> list[str]:
        """The vectors that are needed."""
        return list(dict.fromkeys(feature for feature, _ in (*self.places, *self.turn)))

    def split(self, stack: FloatArray, features: Features) -> tuple[FloatArray, Orientation | None]:
        """Return the position and the orientation among the vectors ``keys``, side by side in (T, d)."""
        stacked = [(key, index) for key in self.keys for index in range(len(features[key]))]
        position, turn = (
            np.ascontiguousarray(stack[:, [stacked.index(place) for place in places]])
            for places in (self.places, self.turn)
        )
        return position, Orientation(turn, self.convention, self.turned) if self.turn else None


def numbered(feature: str, width: int) -> tuple[str, ...]:
    """Return names for the numbers of a vector of which only the name is known."""
    stem = feature.rpartition("/")[2]
    return tuple(f"{stem}_{i}" for i in range(width))


def points(labels: Sequence[str]) -> list[tuple[int, ...]]:
    """Return the indices of x, y (and z) of each point among the names of a vector's numbers."""
    return list(positions([Column(label) for label in labels]).values())


def choose(wanted: Sequence[str], features: Features, file: File, *, what: str) -> Choice:
    """Return the numbers that the wanted words name; messages call a vector ``what``.

    A word is a vector, one of its numbers (``x``, or ``state/x`` where several vectors have one), or a
    pattern of such names (``left_*``). Of a whole vector that holds one point, this is taken; of others, all
    but those of a gripper.

    Raises:
        UsageError: A word is given twice.
        InputDataError: A word names nothing or several things, or more numbers than a motion has dimensions.
    """
    column_indices(wanted, wanted, file.path)  # refuses words that are given twice
    found = [(word, _named(word, features, file, what)) for word in wanted]
    places = list(dict.fromkeys(place for _, some in found for place in some))
    whole = any(len(some) > 1 for _, some in found)
    turn = None if file.position_only else _turn(places, features, whole, file)
    if turn is not None:
        places = [place for place in places if place not in turn[0]]
    labels = [features[feature][index] for feature, index in places]
    if len(places) > file.max_dimension:
        raise InputDataError(
            f"{file.path}: {len(places)} numbers could be the position; which are?",
            hint=f"Choose with --columns, which takes patterns such as 'left_*', too. They are: "
            f"{listed(labels, 40)}.",
        )
    point = points(labels) == [tuple(range(len(places)))]
    names = AXIS_NAMES[: len(places)] if point else _names(places, features)
    new = {some[0]: file.renamed[word] for word, some in found if len(some) == 1 and word in file.renamed}
    names = tuple(new.get(place, name) for place, name in zip(places, names, strict=True))
    choice = Choice(tuple(places), names, point, tuple(labels), _left(places, features))
    return choice if turn is None else _turning(choice, *turn, features)


def _turn(
    places: Sequence[Place], features: Features, whole: bool, file: File
) -> tuple[tuple[Place, ...], Turn, str] | None:
    """Return the numbers of the orientation of a point, among its vector, else others; and its convention.

    Raises:
        InputDataError: There is none in the convention that the user says.
    """
    point = [place for place in places if Column(features[place[0]][place[1]]).role.has_axes]
    every = [(feature, index) for feature, labels in features.items() for index in range(len(labels))]
    for within in (True, False) if points([features[f][i] for f, i in point]) == [(0, 1, 2)] else ():
        columns = [Column(features[f][i] if within else f"{f} {features[f][i]}") for f, i in every]
        free = [
            index
            for index, place in enumerate(every)
            if (place[0] == point[0][0]) == within and (whole or place in places)
        ]
        turn = orientation_of([every.index(place) for place in point], columns, free, file.orientation)
        if turn is not None:
            convention = turn.convention(file.orientation, columns)
            return tuple(every[index] for index in turn.columns), turn, convention
    if file.orientation is not None:
        raise InputDataError(
            f"{file.path}: no orientation {file.orientation} is found beside the position.",
            hint=f"Choose both with --columns. There are: {listed(list(features), 40)}.",
        )
    return None


def _turning(
    choice: Choice, places: tuple[Place, ...], turn: Turn, convention: str, features: Features
) -> Choice:
    """Return a choice with an orientation; one of unknown convention is left aside."""
    if not convention:
        return replace(choice, notes=(turn.unknown([features[f][i] for f, i in places]),))
    left = _left((*choice.places, *places), features)
    turned = tuple(name for name in choice.left if name not in left)
    return replace(choice, turn=places, convention=convention, turned=turned)


def offered(features: Features) -> str:
    """Return the beginning of a hint: a vector that holds the position of a point, if there is one."""
    likely = [name for name, labels in features.items() if points(labels)]
    return f"Choose with --columns, as in --columns {printable(likely[0])}." if likely else ""


def _named(word: str, features: Features, file: File, what: str) -> list[Place]:
    whole = [name for name in features if word == name or name.endswith((f"/{word}", f".{word}"))]
    if word in features or len(whole) == 1:
        return _whole(word if word in features else whole[0], features)
    every = [(name, i) for name, labels in features.items() for i in range(len(labels))]
    found, most = [place for place in every if word in _spellings(place, features)], 1
    if not found and PATTERN & set(word):
        matching = [
            each for each in every if any(fnmatchcase(name, word) for name in _spellings(each, features))
        ]
        found = [each for each in matching if not _grips(each, features)]
        most = len(found) if len({feature for feature, _ in found}) == 1 else 1
    if len(found) > most:
        spelled = [_spellings(place, features)[-1] for place in found]
        raise InputDataError(
            f"{file.path}: '{printable(word)}' is one of several numbers.", hint=f"Write {listed(spelled)}."
        )
    if not found:
        column_indices([word], list(features), file.path, what=what)  # refuses, and says what there is
    return found


def _spellings(place: Place, features: Features) -> tuple[str, str, str]:
    """Return what a number may be called, the longest last."""
    feature, index = place
    label = features[feature][index]
    return label, f"{feature}.{label}", f"{feature}/{label}"


def _grips(place: Place, features: Features) -> bool:
    return Column(features[place[0]][place[1]]).role.name == "gripper"


def _whole(feature: str, features: Features) -> list[Place]:
    """Return the numbers of a vector that are its position."""
    found, every = points(features[feature]), [(feature, i) for i in range(len(features[feature]))]
    if len(found) == 1:
        return [(feature, index) for index in found[0]]
    return [place for place in every if not _grips(place, features)] or every


def _names(places: Sequence[Place], features: Features) -> tuple[str, ...]:
    """Return the names of numbers, with their vector where a name occurs twice."""
    labels = [features[feature][index] for feature, index in places]
    often = Counter(labels)
    return tuple(
        label if often[label] == 1 else f"{feature.rpartition('/')[2]}_{index}"
        for label, (feature, index) in zip(labels, places, strict=True)
    )


def _left(places: Sequence[Place], features: Features) -> tuple[str, ...]:
    used = {feature for feature, _ in places}
    numbers = [(name, i) for name in features if name in used for i in range(len(features[name]))]
    beside = [features[feature][index] for feature, index in numbers if (feature, index) not in places]
    return (*(name for name in features if name not in used), *beside)
