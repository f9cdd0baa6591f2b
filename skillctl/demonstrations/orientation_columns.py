"""Which columns are an orientation, by their names, and whether these tell its convention."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from skillctl.demonstrations.columns import MATRIX, POSES, Column
from skillctl.demonstrations.recording import listed

LETTERS = ("x", "y", "z", "w")
ANGLES = ("roll", "pitch", "yaw")
TURNS = {"q", "o", "r", "m", "quat", "quaternion", "orientation", "orient", "ori", "rotation", "rot", "euler"}
TURNS |= {"rpy", "rotvec", "axis", "aa"}
SHIFTS = {"p", "t", "pos", "position", "translation", "trans", "loc", "location"}
LETTER_IN_WORD = re.compile(f"({'|'.join(sorted(TURNS))})([xyzw])")
QUATERNIONS, TRIPLES = ("xyzw", "wxyz"), ("rotvec", "rpy")
KINDS = ("xyzw", "wxyz", "matrix", "rotvec", "rpy")  # of several, the first is read
TELLING = {"rotvec", "axis", "aa", "r"}  # words of rotation vectors with three letters: rx, rotvec_x
BY_COLUMN = (0, 4, 8, 1, 5, 9, 2, 6, 10)  # numbers of a 4 × 4 matrix, column by column, that are its rotation
MEASURED = {"actual", "target"}  # poses that robots of Universal Robots report, with a rotation vector


@dataclass(frozen=True, slots=True)
class Turn:
    """Columns that are an orientation.

    Attributes:
        columns: Their indices.
        conventions: Those that they may be in, without a unit.
        certain: Whether the names tell that they are in the first of these.
        thing: Words for what turns.
    """

    columns: tuple[int, ...]
    conventions: tuple[str, ...]
    certain: bool
    thing: frozenset[str]

    def convention(self, asked: str | None, columns: Sequence[Column]) -> str:
        """Return the convention; empty if neither the names nor the user, who ``asked``, tell it."""
        plain, _, unit = (asked or "").partition("-")
        name = self.conventions[0] if self.certain and plain not in self.conventions else plain
        units = {said.name for index in self.columns if (said := columns[index].unit) is not None}
        degrees = name in TRIPLES and ("deg" in units or (unit == "deg" and not units))
        return f"{name}-deg" if degrees else name

    def unknown(self, names: Sequence[str]) -> str:
        """Return a note on an orientation whose convention is unknown; ``names`` are those of its numbers."""
        known = " or ".join(self.conventions)
        return (
            f"the orientation {listed(names)} is left aside, because its name does not tell its convention; "
            f"--orientation {known} reads it."
        )

    def fits(self, asked: str | None) -> bool:
        """Return whether they may be in the convention that the user asks for; letters tell the order."""
        plain = (asked or self.conventions[0]).partition("-")[0]
        return plain in self.conventions or {plain, *self.conventions} == set(QUATERNIONS)


def orientation_of(
    position: Sequence[int], columns: Sequence[Column], free: Iterable[int], asked: str | None
) -> Turn | None:
    """Return the orientation of the thing whose x, y and z are known, or None.

    Args:
        position: Indices of x, y and z.
        columns: All columns.
        free: Indices of those that may be an orientation.
        asked: Convention that the user says; other orientations are passed over.
    """
    first = columns[position[0]]
    words = Column(first.axis[0]).words if first.axis else first.words[:-1]
    thing = frozenset(words) - TURNS - SHIFTS
    others = set(free) - set(position)
    behind = _behind(position, columns, thing)
    found = [*([behind] if behind and others.issuperset(behind.columns) else []), *_named(columns, others)]
    fitting = [turn for turn in found if turn.fits(asked) and _is_one(turn.thing, thing)]

    def rank(turn: Turn) -> tuple[bool, int, int]:
        return not turn.certain, len(turn.thing ^ thing), KINDS.index(turn.conventions[0])

    best = sorted(fitting, key=rank)[:2]
    return None if not best or len({*map(rank, best)}) < len(best) else best[0]  # of two things, neither


def _is_one(a: frozenset[str], b: frozenset[str]) -> bool:
    return a <= b or b <= a


def _behind(position: Sequence[int], columns: Sequence[Column], thing: frozenset[str]) -> Turn | None:
    """Return the orientation in the numbered columns whose first ones, or last ones, are a position."""
    words = columns[position[0]].words
    family = [
        index
        for index, column in enumerate(columns)
        if column.words[:-1] == words[:-1] and column.words[-1:] and column.words[-1].isdigit()
    ]
    if tuple(position) == tuple(family[i] for i in MATRIX[1] if i < len(family)):
        return Turn(tuple(family[i] for i in BY_COLUMN), ("matrix",), True, thing)
    rest = tuple(family[3:])
    if tuple(position) != tuple(family[:3]) or len(rest) not in (3, 4) or not POSES & set(words):
        return None
    certain = len(rest) == 3 and not MEASURED.isdisjoint(words) and "tcp" in words
    return Turn(rest, TRIPLES if len(rest) == 3 else QUATERNIONS, certain, thing)


def _named(columns: Sequence[Column], free: Iterable[int]) -> Iterator[Turn]:
    """Yield the orientations that columns form by their names."""
    groups: dict[tuple[str, ...], dict[str, int]] = {}
    for index in sorted(free):
        words, part = _part(columns[index])
        if part:
            groups.setdefault(words, {}).setdefault(part, index)
    for words, found in groups.items():
        for parts, conventions, certain in _forms(words, found, columns):
            if set(parts) == set(found):
                thing = frozenset(words) - TURNS - SHIFTS
                yield Turn(tuple(found[part] for part in parts), conventions, certain, thing)
                break


def _forms(
    words: Sequence[str], found: dict[str, int], columns: Sequence[Column]
) -> Iterator[tuple[Sequence[str], tuple[str, ...], bool]]:
    """Yield the parts of each form of an orientation, its conventions, and whether names tell the first."""
    degrees = any((unit := columns[i].unit) is not None and unit.name == "deg" for i in found.values())
    yield LETTERS, ("xyzw",), True
    yield LETTERS[:3], TRIPLES, not (degrees or TELLING.isdisjoint(words))
    yield ANGLES, ("rpy",), True
    for first in (1, 0):
        yield [f"{first + i}{first + k}" for i in range(3) for k in range(3)], ("matrix",), True
    for count, conventions in ((9, ("matrix",)), (4, QUATERNIONS), (3, TRIPLES)):
        for first in (0, 1):
            yield [str(first + i) for i in range(count)], conventions, False


def _part(column: Column) -> tuple[tuple[str, ...], str]:
    """Return the words of an orientation, and which of its numbers a column is; empty if it is none."""
    words, role = column.words, column.role.name
    digits = next((i for i, word in enumerate(words[::-1]) if not word.isdigit()), len(words))
    if digits and words[:-digits] and (role == "orientation" or words[-digits - 1] in TURNS):
        return words[:-digits], "".join(words[-digits:])
    if role != "orientation":
        return (), ""
    parts = [word for word in words if word in (*LETTERS, *ANGLES)]
    if len(parts) == 1:
        return tuple(word for word in words if word not in parts), parts[0]
    if match := LETTER_IN_WORD.fullmatch(words[-1]):
        return (*words[:-1], match[1]), match[2]
    return (), ""
