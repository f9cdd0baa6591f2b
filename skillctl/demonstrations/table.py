"""CSV, TSV and the like: a header, then one row per sample."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from itertools import chain, islice
from typing import TypeAlias

import numpy as np

from skillctl.arrays import FloatArray, IntArray
from skillctl.demonstrations import clock
from skillctl.demonstrations.dialect import COMMENT, Row, opened, parsed
from skillctl.demonstrations.files import File
from skillctl.demonstrations.layout import UTF16, Layout, layout_of, text_of
from skillctl.demonstrations.recording import GAPS, Orientation, Recording, is_even, listed, uniform_times
from skillctl.errors import InputDataError, printable

Block: TypeAlias = tuple[IntArray, FloatArray, list[tuple[str, ...]]]  # lines, numbers, texts

ROWS = 8192  # lines that are parsed together: the text is never in memory as a whole

POINTS = re.compile(r"[-+]?[1-9]\d{0,2}(\.\d{3})+(,\d*)?")  # between thousands, where commas are decimal


def recognises(file: File) -> bool:
    """Return whether the content is text: tables have nothing else in common."""
    return file.content.startswith(UTF16) or b"\0" not in file.content


def read(file: File, *, header: Sequence[str] | None = None) -> list[Recording]:
    """Return the demonstrations of a table.

    The header names the columns, in one row or in several, as motion capture writes them. Names say what a
    column is (see ``columns``) and its unit. Columns x, y (and z) of one thing are the position, else joint
    angles, else columns of unknown names; a column such as ``demo`` separates demonstrations.
    ``file.columns`` overrides this; it may also name things that move, such as joints of a skeleton.
    Comma, semicolon, tab and spaces separate, and numbers may have decimal commas. Lines that start with # or
    % are comments; the last one before the numbers may be the header. ``header`` names the columns of a
    format that has no header and separates by spaces.

    Raises:
        InputDataError: There is no text, header or row, a row is ragged, or a cell is not a number; the
            message gives the line.
    """
    path = file.path
    try:
        table = opened(text_of(file), path, header)
        layout = layout_of(table, file)
        blocks = list(_blocks(table.lines, table.above, layout))
    except UnicodeDecodeError as error:
        raise InputDataError(f"{path}: not UTF-8 text.", hint="Save the table as UTF-8.") from error
    except csv.Error as error:
        raise InputDataError(f"{path}: not a table ({error}).", hint="Export it as CSV again.") from error
    if not blocks:
        raise InputDataError(f"{path}: a header but no rows.", hint="Record or export it again.")
    numbers, values, texts = zip(*blocks, strict=True)
    return _split(layout, np.concatenate(numbers), np.concatenate(values), list(chain(*texts)))


def _blocks(text: Iterator[str], consumed: int, layout: Layout) -> Iterator[Block]:
    while lines := list(islice(text, ROWS)):
        plain = _plain(lines, layout)
        if plain is not None:
            yield np.arange(consumed, consumed + len(lines)) + 1, *plain
        elif rows := list(parsed(lines, layout.separator, consumed)):
            yield _block(rows, layout)
        consumed += len(lines)


def _plain(lines: list[str], layout: Layout) -> tuple[FloatArray, list[tuple[str, ...]]] | None:
    """Return a block's numbers and texts, parsed in one go; None if a line needs ``_block``."""
    text = "".join(lines)
    if text.isspace() or any(mark in text for mark in (*COMMENT, '"')):
        return None
    if layout.commas in ("decimal", "points") and "." in text:
        return None
    separator = None if layout.separator == " " else layout.separator
    width = len(layout.names)
    # NumPy counts the cells of a row if it reads all of them.
    some = layout.numeric if len(layout.numeric) < width else None
    if some and any(len(line.split(separator)) != width for line in lines):
        return None
    numbers = [_plainly(line, layout) for line in lines] if layout.commas else lines
    try:
        values = np.loadtxt(numbers, delimiter=separator, comments=None, usecols=some, ndmin=2)
    except ValueError:
        return None
    if values.shape != (len(lines), len(layout.numeric)):  # blank lines are left out
        return None
    values = values if some else values[:, layout.numeric]
    if not layout.texts:
        return values, []
    return values, [_texts(line.split(separator), layout) for line in lines]


def _plainly(text: str, layout: Layout) -> str:
    """Return numbers as Python writes them."""
    if layout.commas in ("decimal", "points"):
        return (text.replace(".", "") if POINTS.fullmatch(text.strip()) else text).replace(",", ".")
    return text.replace(",", "") if layout.commas == "thousands" else text


def _texts(cells: Sequence[str], layout: Layout) -> tuple[str, ...]:
    return tuple(cells[column].strip() for column in layout.texts)


def _block(rows: list[Row], layout: Layout) -> Block:
    """Return a block, parsed cell by cell, so that a message can name the cell that is wrong."""
    width = len(layout.names)
    for line, cells in rows:
        if len(cells) < width or any(cells[width:]):
            raise InputDataError(
                f"{layout.path}, line {line}: {len(cells)} cells, but there are {width} columns.",
                hint="A recording that was cut off? Remove the incomplete line.",
            )
    texts = [[_plainly(cells[i], layout) for i in layout.numeric] for _, cells in rows]
    try:
        values = np.array(texts, dtype=np.float64)
    except ValueError as error:
        at, column = next(
            (at, column)
            for at, row in enumerate(texts)
            for column, cell in zip(layout.numeric, row, strict=True)
            if not _is_plain_number(cell)
        )
        raise _not_a_number(rows[at], column, layout) from error
    return (
        np.array([line for line, _ in rows]),
        values,
        [_texts(cells, layout) for _, cells in rows if layout.texts],
    )


def _is_plain_number(cell: str) -> bool:
    try:
        np.array(cell, dtype=np.float64)
    except ValueError:
        return False
    return True


def _not_a_number(row: Row, column: int, layout: Layout) -> InputDataError:
    line, cell = row[0], row[1][column]
    where = f"{layout.path}, line {line}, column '{printable(layout.names[column])}'"
    if not cell:
        aside = " Or leave the orientation aside with --position-only." if column in layout.turn else ""
        return InputDataError(f"{where}: an empty cell.", hint=f"{GAPS}{aside}")
    if column in layout.clock.columns and clock.LOOKS_LIKE_ONE.fullmatch(cell):
        return InputDataError(f"{where}: '{printable(cell)[:40]}' is no time that is read.", hint=clock.KNOWN)
    return InputDataError(
        f"{where}: '{printable(cell)[:40]}' is not a number.",
        hint=f"Correct the cell, or choose columns with --columns. They are: {listed(layout.names)}.",
    )


def _split(
    layout: Layout, lines: IntArray, values: FloatArray, texts: list[tuple[str, ...]]
) -> list[Recording]:
    """Return one recording per value of the demo column, in the order of their first rows."""
    given = layout.clock
    here = len(given.columns) + np.arange(len(layout.positions))
    found, turned = values[:, here], values[:, len(given.columns) + len(here) :]
    _require_coordinates(layout, found)
    times = _times(layout, lines, values, texts)
    demos = [text[0] for text in texts] if layout.demo is not None else []
    number = {value: i for i, value in enumerate(dict.fromkeys(demos))}
    codes = np.array([number[value] for value in demos]) if demos else np.zeros(len(lines), dtype=np.int64)
    order = np.argsort(codes, kind="stable")
    members = np.split(order, np.flatnonzero(np.diff(codes[order])) + 1)
    return [
        Recording(
            layout.path,
            found[rows],
            times=_own_times(layout, rows) if times is None else times[rows],
            names=layout.labels,
            lines=lines[rows],
            part=f"demo {printable(demos[rows[0]])[:40]}" if demos else "",
            unit=layout.unit,
            unit_said=layout.said,
            taken=tuple(layout.names[i] for i in layout.positions),
            unused=layout.unused,
            orientation=_orientation(layout, turned[rows]),
            notes=_notes(layout, len(members)),
        )
        for rows in members
    ]


def _orientation(layout: Layout, turned: FloatArray) -> Orientation | None:
    names = tuple(layout.names[i] for i in layout.turn)
    return Orientation(turned, layout.convention, names) if layout.turn else None


def _own_times(layout: Layout, rows: IntArray) -> FloatArray | None:
    period = layout.clock.period
    return None if period is None else uniform_times(period, len(rows))


def _times(
    layout: Layout, lines: IntArray, values: FloatArray, texts: list[tuple[str, ...]]
) -> FloatArray | None:
    """Return the time of each row, (T,), [s], or None."""
    given = layout.clock
    if given.stamps is not None:
        cells = [text[-1] for text in texts]
        try:
            return clock.seconds(cells)
        except ValueError as error:
            at = int(error.args[0])
            raise InputDataError(
                f"{layout.path}, line {lines[at]}, column '{printable(layout.names[given.stamps])}': "
                f"'{printable(cells[at])[:40]}' is no time.",
                hint=clock.KNOWN,
            ) from None
    if len(given.columns) > 1:  # the difference first: a sum of 1.7e9 s and nanoseconds is rounded
        parts = values[:, : len(given.columns)]
        return np.asarray((parts - parts[0]) @ (1 / np.array(given.per_second)))
    return values[:, 0] / given.per_second[0] if given.columns else None


def _require_coordinates(layout: Layout, found: FloatArray) -> None:
    """Raise InputDataError if a column of unknown name rises evenly."""
    for index, values in zip(layout.positions, found.T, strict=True):
        if layout.guessed and is_even(values):
            name = printable(layout.names[index])
            raise InputDataError(
                f"{layout.path}: column '{name}' rises evenly, as a clock or a counter does; it is not taken "
                "as a coordinate.",
                hint=f"If it is the time, say --columns t={name}; else name the position with --columns.",
            )


def _notes(layout: Layout, count: int) -> tuple[str, ...]:
    notes = [*layout.clock.notes, *layout.notes]
    if marks := {"thousands": "commas", "points": "points"}.get(layout.commas):
        notes.append(f"{marks} in numbers are read as separators between thousands.")
    if layout.demo is not None and count > 1 and layout.names[layout.demo].lower() != "demo":
        notes.append(f"the column '{printable(layout.names[layout.demo])}' tells demonstrations apart.")
    return tuple(notes)
