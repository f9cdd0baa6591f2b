"""Which columns of a table are times, demonstrations and positions, and how their numbers are written."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

from skillctl.demonstrations import clock
from skillctl.demonstrations.columns import Column, chosen, positions, recognised
from skillctl.demonstrations.dialect import (
    Opened,
    is_number,
    meaning_of_commas,
    parsed,
    points_separate_thousands,
)
from skillctl.demonstrations.files import File
from skillctl.demonstrations.orientation_columns import Turn, orientation_of
from skillctl.demonstrations.recording import listed
from skillctl.demonstrations.units import SPELLED, UNITS
from skillctl.errors import InputDataError, printable
from skillctl.model.space import AXIS_NAMES

UTF16 = (b"\xff\xfe", b"\xfe\xff")  # Excel's "Unicode text"
CLOCKS = ("t", "time", "stamp", "timestamp", "timestamps")  # preferred to other names of times


def text_of(file: File) -> io.TextIOWrapper:
    """Return the lines of a file in UTF-8, or with a byte order mark in UTF-16."""
    encoding = "utf-16" if file.content.startswith(UTF16) else "utf-8-sig"
    return io.TextIOWrapper(io.BytesIO(file.content), encoding=encoding)


@dataclass(frozen=True, slots=True)
class Clock:
    """How the times are written.

    Attributes:
        columns: Numbers that make up the time together, such as seconds and nanoseconds.
        per_second: Units of each in a second.
        stamps: Column of dates or times of day instead, None if there is none.
        period: Seconds between rows that have no time, None if the table does not say it.
        notes: About them.
    """

    columns: tuple[int, ...] = ()
    per_second: tuple[float, ...] = ()
    stamps: int | None = None
    period: float | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Layout:
    """The columns of a table.

    Attributes:
        path: The file, for messages.
        separator: Between the cells of a line.
        names: All columns of the header.
        clock: The times.
        demo: Column that separates demonstrations, None if absent.
        positions: Columns of the positions.
        guessed: Whether the names of these say nothing, so that they may be no positions.
        labels: Their names in the state space.
        unit: Of them.
        said: Whether the table says that unit.
        unused: Names of columns that are no position, although the user did not choose columns.
        turn: Columns of the orientation, empty if it is not read.
        convention: Of the orientation.
        notes: About the columns.
        commas: What a comma in a number is, see ``meaning_of_commas``, or ``points`` if these do.
    """

    path: Path
    separator: str
    names: tuple[str, ...]
    clock: Clock
    demo: int | None
    positions: tuple[int, ...]
    guessed: bool
    labels: tuple[str, ...]
    unit: str
    said: bool
    unused: tuple[str, ...]
    turn: tuple[int, ...] = ()
    convention: str = ""
    notes: tuple[str, ...] = ()
    commas: str = ""

    @property
    def numeric(self) -> tuple[int, ...]:
        """Columns read as numbers: the time, if it is one, the positions, and the orientation."""
        return (*self.clock.columns, *self.positions, *self.turn)

    @property
    def texts(self) -> tuple[int, ...]:
        """Columns read as text: what separates demonstrations, and dates or times of day."""
        return tuple(column for column in (self.demo, self.clock.stamps) if column is not None)


def layout_of(table: Opened, file: File) -> Layout:
    """Return the layout of a table, by its header, its first row, and what the user asks for.

    Raises:
        InputDataError: No columns are positions, several are of one name or one thing, or their units differ;
            or commas in numbers may be read in two ways.
        UsageError: A column is named twice.
    """
    path = file.path
    names = _fitting(table.names, table.first)
    first = [*table.first, *[""] * len(names)]
    columns = [_column(name, file, table.units[i : i + 1]) for i, name in enumerate(names)]
    wanted = _wanted(file, columns)
    asked = set(wanted or ())
    apart = [i for i, column in enumerate(columns) if column.name and column.name not in asked]
    times = _clock(table, first, columns, [i for i in apart if columns[i].role.name == "time"])
    demo = next((i for i in apart if columns[i].role.name == "demonstration"), None)
    used = {*times.columns, times.stamps, demo}
    free = [i for i, column in enumerate(columns) if column.name and i not in used]
    numbers = [i for i in free if not first[i] or is_number(first[i])]
    found = (
        chosen(wanted, columns, path) if wanted else recognised(columns, numbers, file.max_dimension, path)
    )
    turn = None if file.position_only else _turn(found, columns, numbers, wanted, file)
    if turn is not None:
        found = tuple(i for i in found if i not in turn.columns)
    labels = _labels(found, columns, wanted)
    unused = () if wanted else tuple(i for i in free if i not in found)
    axes = {columns[i].axis for i in found} - {None}
    twice = len({label.lower() for label in labels}) < len(labels) or axes & {columns[i].axis for i in unused}
    if not found or twice:
        raise InputDataError(
            f"{path}: {'two position columns of one name' if found else 'no position columns'}.",
            hint=f"Name each column once, as in t,x,y,z. The columns are: {listed(names)}.",
        )
    is_thing = tuple(found) in positions(columns).values()
    unit, said = _unit([columns[i] for i in found], is_thing, table, path)
    layout = Layout(
        path,
        table.separator,
        names,
        times,
        demo,
        found,
        not wanted and all(columns[i].role.name == "" and columns[i].axis is None for i in found),
        labels,
        unit,
        said,
        tuple(names[i] for i in unused),
        **_turning(turn, columns, file),
    )
    return _between_thousands(table, layout, file)


def _turn(
    found: Sequence[int],
    columns: Sequence[Column],
    numbers: Sequence[int],
    wanted: Sequence[str] | None,
    file: File,
) -> Turn | None:
    """Return the orientation of what is found: one that the user names, or of a thing as a whole.

    Raises:
        InputDataError: There is none in the convention that the user says.
    """
    axes = tuple(i for i in found if columns[i].role.has_axes)
    whole = axes in positions(columns).values() and len(axes) == len(AXIS_NAMES)
    named = len(wanted or ()) == len(found) > 0
    turn = orientation_of(axes, columns, found if named else numbers, file.orientation) if whole else None
    if turn is None and file.orientation is not None:
        raise InputDataError(
            f"{file.path}: no orientation {file.orientation} is found beside the position.",
            hint="Name its columns with --columns, as in --columns x,y,z,qx=a,qy=b,qz=c,qw=d. They are: "
            f"{listed([column.name for column in columns], 40)}.",
        )
    return turn


def _turning(turn: Turn | None, columns: Sequence[Column], file: File) -> dict[str, Any]:
    """Return what a layout says of an orientation; one of unknown convention is left aside."""
    if turn is None:
        return {}
    if convention := turn.convention(file.orientation, columns):
        return {"turn": turn.columns, "convention": convention}
    return {"notes": (turn.unknown([columns[i].name for i in turn.columns]),)}


def _fitting(names: Sequence[str], first: Sequence[str]) -> tuple[str, ...]:
    """Return as many names as there are cells: empty ones for a separator at the end, or for row numbers."""
    fitting = [name.strip() for name in names]
    while len(fitting) > len(first) and not fitting[-1]:
        fitting.pop()
    if len(first) == len(fitting) + 1 and first[0] in ("0", "1") and first[-1]:
        fitting.insert(0, "")
    if not any(first[len(fitting) :]):
        fitting += [""] * (len(first) - len(fitting))
    return tuple(fitting)


def _column(name: str, file: File, unit: Sequence[str]) -> Column:
    """Return a column as the user renames it; it keeps the unit of its own name, or of the row of units."""
    own = Column(name)
    said = own.unit or (SPELLED.get(unit[0]) if unit else None)
    new = file.renamed.get(name) or file.renamed.get(own.stem) if name else None
    return Column(new or name, said)


def _wanted(file: File, columns: Sequence[Column]) -> list[str] | None:
    """Return the names of the position columns that the user asks for, None if nothing is chosen."""
    known = {column.name for column in columns}
    wanted = []
    for old in file.columns or ():
        new = file.renamed.get(old, old)
        if new not in known or new == old or Column(new).role.name not in ("time", "demonstration"):
            wanted.append(new if new in known else old)
    return wanted or None


def _clock(table: Opened, first: Sequence[str], columns: Sequence[Column], times: Sequence[int]) -> Clock:
    """Return how the times are written: the column of the plainest name, else frames at a known rate."""
    if not times and not columns[0].name and (clock.is_stamp(first[0]) or "." in first[0]):
        times = [0]  # an index of pandas that is no counter
    if not times:
        frames = [i for i, column in enumerate(columns) if column.words[:1] in (("frame",), ("frames",))]
        if table.rate is None:
            return Clock()
        said = f"the times follow from the rate above the table, {table.rate:g} Hz."
        if frames:
            return Clock((frames[0],), (table.rate,), notes=(said,))
        return Clock(period=1 / table.rate, notes=(said,))
    best = min(times, key=lambda i: (" ".join(columns[i].words) not in CLOCKS, i))
    if clock.is_stamp(first[best]):
        return Clock(stamps=best)
    same = {
        unit.name: i for i in times if columns[i].stem == columns[best].stem and (unit := columns[i].unit)
    }
    finer = next((u for u in ("ns", "us", "ms") if u in same and "sec" in columns[same[u]].name.lower()), "s")
    if "s" in same and finer != "s":
        return Clock((same["s"], same[finer]), (1.0, UNITS[finer].per_base))
    unit = columns[best].unit
    if unit is not None and unit.base == "s":
        return Clock((best,), (unit.per_base,))
    guess = clock.unit_of(_value(first[best]))
    if guess.name == "s":
        return Clock((best,), (guess.per_base,))
    note = f"the times of '{printable(columns[best].name)}' are read as {guess.name}, counted from 1970."
    return Clock((best,), (guess.per_base,), notes=(note,))


def _value(cell: str) -> float:
    """Return the number in a cell, 0 if it is none: that is refused later, with its line."""
    try:
        return float(cell.replace(",", "."))
    except ValueError:
        return 0.0


def _labels(found: Sequence[int], columns: Sequence[Column], wanted: Sequence[str] | None) -> tuple[str, ...]:
    """Return names for the chosen columns: x, y, z if they are one thing that moves, else their own."""
    whole = tuple(found) in positions(columns).values()
    if whole and (wanted is None or len(wanted) < len(found)):
        return AXIS_NAMES[: len(found)]
    stems = [columns[i].stem or columns[i].name for i in found]
    return tuple(stem.lower() if stem.lower() in AXIS_NAMES else stem for stem in stems)


def _unit(found: Sequence[Column], is_thing: bool, table: Opened, path: Path) -> tuple[str, bool]:
    """Return the unit of positions, of one thing or of joints, and whether the table says it.

    Raises:
        InputDataError: It says different ones.
    """
    said = {column.unit.name: column for column in found if column.unit and column.unit.base != "s"}
    if len(said) > 1:
        columns = " and ".join(f"'{printable(column.name)}' is in {unit}" for unit, column in said.items())
        raise InputDataError(
            f"{path}: {columns}.", hint="Convert them to one unit, or choose columns with --columns."
        )
    if said:
        return next(iter(said)), True
    joints = not is_thing and all(column.role.name == "joint" for column in found)
    base = "rad" if joints else "m"
    above = SPELLED.get((table.length or "").lower())
    return (above.name, True) if above is not None and above.base == base else (base, False)


def _between_thousands(table: Opened, layout: Layout, file: File) -> Layout:
    """Return a layout that says what commas and points in numbers are.

    If commas separate cells, others stand in quoted cells only.
    """
    lines = islice(text_of(file), table.above, None)
    rows = parsed(lines, table.separator, table.above)
    if (b'"' if table.separator == "," else b",") in file.content:
        return replace(layout, commas=meaning_of_commas(rows, layout.numeric, str(file.path)))
    if table.separator in (";", "\t") and points_separate_thousands(rows, layout.numeric):
        return replace(layout, commas="points")
    return layout
