"""CSV, TSV and the like: a header row, then one row per sample."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import TypeAlias

import numpy as np

from skillctl.arrays import FloatArray, IntArray
from skillctl.demonstrations import joints
from skillctl.demonstrations.files import File
from skillctl.demonstrations.recording import GAPS, Recording, listed
from skillctl.errors import InputDataError, printable
from skillctl.model.space import AXIS_NAMES

Row: TypeAlias = tuple[int, list[str]]  # line in the file, cells
Block: TypeAlias = tuple[IntArray, FloatArray, list[str]]  # lines, numbers, values of the demo column

ROWS = 8192  # lines that are parsed together: the text is never in memory as a whole
COMMENT = ("#", "%")
TICKS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}  # in a second
UNIT = f"({'|'.join(TICKS)})"
TIME = re.compile(rf"(?:t|time|stamp|timestamp)(?:_{UNIT}| ?[\[(]{UNIT}[\])])?", re.IGNORECASE)
DEMO = "demo"


def recognises(file: File) -> bool:
    """Return whether the content is text: tables have nothing else in common."""
    return b"\0" not in file.content


def read(file: File, *, header: Sequence[str] | None = None) -> list[Recording]:
    """Return the demonstrations of a table.

    The first row names the columns: a time (``t``, ``time``, ``stamp`` or ``timestamp``, in seconds unless
    its name goes on like ``t_ms`` or ``time [us]``), positions, and optionally ``demo``, which separates
    demonstrations. If there are columns x and y (and z), only these are positions; otherwise all columns are,
    up to seven. ``file.columns`` overrides this; it may also name joints of a skeleton.
    Comma, semicolon, tab and spaces separate; with any but the comma, numbers may have decimal commas.
    Lines that start with # or % are comments; the last one before the numbers may be the header.
    ``header`` names the columns of a format that has no header and separates by spaces.

    Raises:
        InputDataError: There is no text, header or row, a row is ragged, or a cell is not a number; the
            message gives the line.
    """
    path = file.path
    text = io.TextIOWrapper(io.BytesIO(file.content), encoding="utf-8-sig")
    try:
        names, delimiter, lines, above = _opened(text, header, path)
        layout = _layout(names, delimiter, file)
        blocks = list(_blocks(lines, above, layout))
    except UnicodeDecodeError as error:
        raise InputDataError(f"{path}: not UTF-8 text.", hint="Save the table as UTF-8.") from error
    except csv.Error as error:
        raise InputDataError(f"{path}: not a table ({error}).", hint="Export it as CSV again.") from error
    if not blocks:
        raise InputDataError(f"{path}: a header but no rows.", hint="Record or export it again.")
    numbers, values, demos = zip(*blocks, strict=True)
    return _split(layout, np.concatenate(numbers), np.concatenate(values), list(chain(*demos)))


@dataclass(frozen=True, slots=True)
class _Layout:
    """The columns of a table.

    Attributes:
        path: The file, for messages.
        delimiter: Separates the cells of a line.
        names: All columns of the header.
        time, demo: Their columns, None if absent.
        ticks: Units of the time column in a second.
        positions: Columns of the positions.
        labels: Their names in the state space.
        unused: Names of columns that are not used, although the user did not choose columns.
    """

    path: Path
    delimiter: str
    names: tuple[str, ...]
    time: int | None
    demo: int | None
    ticks: float
    positions: tuple[int, ...]
    labels: tuple[str, ...]
    unused: tuple[str, ...]

    @property
    def numeric(self) -> tuple[int, ...]:
        """Columns read as numbers: the time, if there is one, and the positions."""
        return self.positions if self.time is None else (self.time, *self.positions)


def _opened(
    text: Iterator[str], header: Sequence[str] | None, path: Path
) -> tuple[Sequence[str], str, Iterator[str], int]:
    """Return the column names, the delimiter, the lines of rows, and the number of lines above them."""
    comment = ""
    for number, line in enumerate(text, start=1):
        if line.strip().startswith(COMMENT):
            comment = line.strip().lstrip("#% ")
        elif line.strip():
            delimiter = _delimiter(line)
            cells, above = _cells(line, delimiter), _cells(comment, delimiter)
            if not any(map(_is_number, cells)):
                return header or cells, delimiter, text, number
            if header or (len(above) == len(cells) and not any(map(_is_number, above))):
                return header or above, delimiter, chain([line], text), number - 1
            raise InputDataError(
                f"{path}, line {number}: numbers where the names of the columns should be.",
                hint="Add a header as first line, such as t,x,y,z.",
            )
    raise InputDataError(f"{path}: a table without rows.", hint="Record or export it again.")


def _delimiter(line: str) -> str:
    most = max(",;\t", key=line.count)
    return most if most in line else " "


def _cells(line: str, delimiter: str) -> list[str]:
    return next((cells for _, cells in _rows([line], delimiter, 0)), [])


def _rows(text: Iterable[str], delimiter: str, consumed: int) -> Iterator[Row]:
    lines = (line.strip("\n ") for line in text)  # not tabs: a tab at the end is an empty cell
    reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    for cells in reader:
        if any(cells) and not cells[0].startswith(COMMENT):
            yield consumed + reader.line_num, cells


def _is_number(cell: str) -> bool:
    try:
        np.array(cell, dtype=np.float64)
    except ValueError:
        return False
    return True


def _layout(header: Sequence[str], delimiter: str, file: File) -> _Layout:
    path, columns = file.path, file.columns
    names = tuple(name.strip() for name in header)
    asked = set(columns or ())
    time = next((i for i, name in enumerate(names) if TIME.fullmatch(name) and name not in asked), None)
    demo = next((i for i, name in enumerate(names) if name.lower() == DEMO and name not in asked), None)
    free = [i for i, name in enumerate(names) if name and i not in (time, demo)]
    axes = [i for i in free if names[i].lower() in AXIS_NAMES]
    if columns is not None:
        positions = joints.chosen(columns, names, path)
    elif {"x", "y"} <= {names[i].lower() for i in axes}:
        positions = tuple(sorted(axes, key=lambda i: names[i].lower()))
    else:
        joints.require_few([names[i] for i in free], path)
        positions = tuple(free)
    chosen = [names[i].lower() for i in positions]
    if not positions or len(set(chosen)) < len(chosen):
        raise InputDataError(
            f"{path}: {'two position columns of one name' if positions else 'no position columns'}.",
            hint=f"Name each column once, as in t,x,y,z. The columns are: {listed(names)}.",
        )
    unused = () if columns is not None else tuple(names[i] for i in free if i not in positions)
    ticks = 1.0 if time is None else _ticks(names[time])
    labels = _labels([names[i] for i in positions], columns)
    return _Layout(path, delimiter, names, time, demo, ticks, positions, labels, unused)


def _labels(chosen: Sequence[str], columns: Sequence[str] | None) -> tuple[str, ...]:
    """Return names for the chosen columns: x, y, z if they are one joint, else their own."""
    if columns is not None and len(columns) < len(chosen) <= len(AXIS_NAMES):
        return AXIS_NAMES[: len(chosen)]
    return tuple(name.lower() if name.lower() in AXIS_NAMES else name for name in chosen)


def _ticks(name: str) -> float:
    match = TIME.fullmatch(name)
    return TICKS[(match[1] or match[2] or "s").lower()] if match else 1.0


def _blocks(text: Iterator[str], consumed: int, layout: _Layout) -> Iterator[Block]:
    while lines := list(islice(text, ROWS)):
        plain = _plain(lines, layout)
        if plain is not None:
            yield np.arange(consumed, consumed + len(lines)) + 1, *plain
        elif rows := list(_rows(lines, layout.delimiter, consumed)):
            yield _block(rows, layout)
        consumed += len(lines)


def _plain(lines: list[str], layout: _Layout) -> tuple[FloatArray, list[str]] | None:
    """Return a block's numbers and demo column, parsed in one go; None if a line needs ``_block``."""
    text = "".join(lines)
    if text.isspace() or any(mark in text for mark in (*COMMENT, '"')):
        return None
    separator = None if layout.delimiter == " " else layout.delimiter
    width = len(layout.names)
    # NumPy counts the cells of a row if it reads all of them.
    some = layout.numeric if len(layout.numeric) < width else None
    if some and any(len(line.split(separator)) != width for line in lines):
        return None
    numbers = [line.replace(",", ".") for line in lines] if separator != "," and "," in text else lines
    try:
        values = np.loadtxt(numbers, delimiter=separator, comments=None, usecols=some, ndmin=2)
    except ValueError:
        return None
    if values.shape != (len(lines), len(layout.numeric)):  # blank lines are left out
        return None
    values = values if some else values[:, layout.numeric]
    if layout.demo is None:
        return values, []
    return values, [line.split(separator)[layout.demo].strip() for line in lines]


def _block(rows: list[Row], layout: _Layout) -> Block:
    """Return a block, parsed cell by cell, so that a message can name the cell that is wrong."""
    width = len(layout.names)
    for line, cells in rows:
        if len(cells) != width:
            raise InputDataError(
                f"{layout.path}, line {line}: {len(cells)} cells, but there are {width} columns.",
                hint="A recording that was cut off? Remove the incomplete line.",
            )
    texts = [[cells[i] for i in layout.numeric] for _, cells in rows]
    if layout.delimiter != ",":
        texts = [[cell.replace(",", ".") for cell in row] for row in texts]
    try:
        values = np.array(texts, dtype=np.float64)
    except ValueError as error:
        at, column = next(
            (at, column)
            for at, row in enumerate(texts)
            for column, cell in zip(layout.numeric, row, strict=True)
            if not _is_number(cell)
        )
        raise _not_a_number(rows[at], column, layout) from error
    demos = [] if layout.demo is None else [cells[layout.demo].strip() for _, cells in rows]
    return np.array([line for line, _ in rows]), values, demos


def _not_a_number(row: Row, column: int, layout: _Layout) -> InputDataError:
    line, cell = row[0], row[1][column]
    where = f"{layout.path}, line {line}, column '{printable(layout.names[column])}'"
    if not cell:
        return InputDataError(f"{where}: an empty cell.", hint=GAPS)
    return InputDataError(
        f"{where}: '{printable(cell)[:40]}' is not a number.",
        hint=f"Correct the cell, or choose columns with --columns. They are: {listed(layout.names)}.",
    )


def _split(layout: _Layout, lines: IntArray, values: FloatArray, demos: list[str]) -> list[Recording]:
    """Return one recording per value of the demo column, in the order of their first rows."""
    times, positions = (None, values) if layout.time is None else (values[:, 0] / layout.ticks, values[:, 1:])
    number = {value: i for i, value in enumerate(dict.fromkeys(demos))}
    codes = np.array([number[value] for value in demos]) if demos else np.zeros(len(lines), dtype=np.int64)
    order = np.argsort(codes, kind="stable")
    members = np.split(order, np.flatnonzero(np.diff(codes[order])) + 1)
    return [
        Recording(
            layout.path,
            positions[rows],
            times=None if times is None else times[rows],
            names=layout.labels,
            lines=lines[rows],
            part=f"demo {printable(demos[rows[0]])[:40]}" if demos else "",
            unused=layout.unused,
        )
        for rows in members
    ]
