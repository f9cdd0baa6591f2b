"""How a table is written: its separator, what its commas mean, and what stands above its numbers."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice, pairwise, zip_longest
from pathlib import Path
from typing import TypeAlias

from skillctl.demonstrations.units import SPELLED
from skillctl.errors import InputDataError

Row: TypeAlias = tuple[int, list[str]]  # line in the file, cells

HEAD = 1000  # lines among which the first numbers are
SAMPLE = 20  # of them by which the separator is judged
COMMENT = ("#", "%")
SEPARATORS = ("\t", ";", "|", ",", " ")  # in doubt the first
SEPARATOR_LINE = re.compile(r'"?sep=(.)"?\s*', re.IGNORECASE)  # Excel's own first line
NUMBER = re.compile(r"[-+]?[\d.,]*\d[\d.,]*([eE][-+]?\d+)?|[-+]?(nan|inf|infinity)", re.IGNORECASE)
LABELS = ("type", "name", "id", "parent")  # first cells of the rows above the axes, in motion capture
SKIPPED = ("type", "id", "parent")
RATE = re.compile(r"((capture|data|camera|frame|sampl\w*)*(rate|frequency|fps))(hz)?")
PERIOD = re.compile(r"dt|(sampl\w*)?period")
LENGTH = re.compile(r"(length|position)?units?")
MARKERS = "MARKER_NAMES"  # of a table without a header, three columns each
SWAPPED = str.maketrans(",.", ".,")
COMMAS = {  # what a cell shows about the commas of its column
    "decimal": re.compile(r"[-+]?(\d*,(?!\d{3}$)\d+|0*,\d+|\d{1,3}(\.\d{3})+,\d+)([eE][-+]?\d+)?"),
    "thousands": re.compile(r"[-+]?\d{1,3}((,\d{3}){2,}|(,\d{3})+\.\d*)"),
    "either": re.compile(r"[-+]?\d{1,3},\d{3}"),
    "hundreds": re.compile(r"[-+]?[1-9]\d\d"),
    "larger": re.compile(r"[-+]?(\d{4,}|\d*\.\d*)"),
}


@dataclass(frozen=True, slots=True)
class Opened:
    """A table whose header was read.

    Attributes:
        names: Of the columns.
        separator: Between cells.
        lines: Of the rows, with those that were looked at.
        above: Number of lines above them.
        first: The first row.
        units: Unit of each column in a row of units; empty if there is none.
        rate: Samples per second that the lines above the header say, else None.
        length: Spelled unit of lengths that they say, else None.
    """

    names: tuple[str, ...]
    separator: str
    lines: Iterator[str]
    above: int
    first: list[str]
    units: tuple[str, ...] = ()
    rate: float | None = None
    length: str | None = None


def opened(text: Iterator[str], path: Path, header: Sequence[str] | None = None) -> Opened:
    """Return a table with its header read: one row of names, or several, as motion capture writes them.

    ``header`` names the columns of a format that has no header and separates by spaces.

    Raises:
        InputDataError: There is no header, or no row.
    """
    head = list(islice(text, HEAD))
    separator = _separator(head)
    if head and SEPARATOR_LINE.fullmatch(head[0].strip("\n")):
        head[0] = "\n"
    rows = [(at, row) for at, line in enumerate(head) if any(row := _uncommented(line, separator))]
    for index, (at, first) in enumerate(rows):
        block = [] if header else _header(rows[:index], head, first)
        if not _starts(rows[index:], head) or not (header or block):
            continue
        names, units = (tuple(header), ()) if header else _named(block, len(first))
        facts = _facts([found for _, found in rows[:index]])
        lines = chain(head[at:], text)
        return Opened(names, separator, lines, at, first, units, _rate(facts), _fact(facts, LENGTH))
    numeric = [at for at, found in rows if not _is_comment(head[at]) and any(map(is_number, found))]
    if numeric:
        raise InputDataError(
            f"{path}, line {numeric[0] + 1}: numbers where the names of the columns should be.",
            hint="Add a header as first line, such as t,x,y,z.",
        )
    words = sum(not _is_comment(head[at]) for at, _ in rows)
    what = ("a table without rows", "a header but no rows")[words] if words < 2 else "no row holds numbers"
    raise InputDataError(f"{path}: {what}.", hint="Record or export it again.")


def cells(line: str, separator: str) -> list[str]:
    """Return the cells of one line."""
    return next((found for _, found in parsed([line], separator, 0)), [])


def parsed(text: Iterable[str], separator: str, consumed: int) -> Iterator[Row]:
    """Yield the rows of lines, after ``consumed`` lines; neither comments nor empty ones."""
    lines = (line.strip("\n ") for line in text)  # not tabs: a tab at the end is an empty cell
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    for row in reader:
        if any(row) and not row[0].startswith(COMMENT):
            yield consumed + reader.line_num, row


def _uncommented(line: str, separator: str) -> list[str]:
    """Return the cells of a line that may be a header, also in a comment; units in brackets are no cells."""
    line = line.strip().lstrip("#% ") if _is_comment(line) else line
    return cells(re.sub(r" +(?=[\[(])", "", line) if separator == " " else line, separator)


def is_number(cell: str) -> bool:
    """Return whether a cell holds a number, in any dialect."""
    return NUMBER.fullmatch(cell.strip()) is not None


def meaning_of_commas(rows: Iterable[Row], columns: Sequence[int], where: str) -> str:
    """Return what a comma in a number is: ``decimal``, ``thousands``, or nothing if there is none.

    ``0,35`` and ``1.234,5`` have decimal commas, ``1,234.5`` and ``1,234,567`` separate thousands. ``1,650``
    may be either: it separates thousands if its column also holds whole numbers below a thousand.

    Raises:
        InputDataError: It may be either, and nothing tells.
    """
    kind, line, cell = _evidence(rows, columns)
    if kind != "either":
        return kind
    raise InputDataError(
        f"{where}, line {line}: {cell} is {cell.replace(',', '.')} with a decimal comma, and "
        f"{cell.replace(',', '')} with a comma between thousands; nothing in the table tells which.",
        hint="Export it with decimal points and without separators between thousands.",
    )


def points_separate_thousands(rows: Iterable[Row], columns: Sequence[int]) -> bool:
    """Return whether points are no decimal points: ``1.650`` in a column with whole numbers below 1000."""
    swapped = ((line, [cell.translate(SWAPPED) for cell in row]) for line, row in rows)
    return _evidence(swapped, columns)[0] == "thousands"


def _evidence(rows: Iterable[Row], columns: Sequence[int]) -> tuple[str, int, str]:
    """Return what commas are: decimal, thousands, either or nothing; and line and text of the first cell."""
    shown: dict[int, set[str]] = {column: set() for column in columns}
    doubtful = (0, "")
    for line, row in rows:
        for column in columns:
            cell = row[column].strip() if column < len(row) else ""
            kind = next((kind for kind, pattern in COMMAS.items() if pattern.fullmatch(cell)), "")
            if kind in ("decimal", "thousands"):
                return kind, line, cell
            shown[column].add(kind)
            doubtful = (line, cell) if kind == "either" and not doubtful[0] else doubtful
    if any({"either", "hundreds"} <= kinds and "larger" not in kinds for kinds in shown.values()):
        return "thousands", *doubtful
    return "either" if doubtful[0] else "", *doubtful


def _separator(head: Sequence[str]) -> str:
    """Return the separator under which most cells of the lines are numbers, in rows of one width."""
    if head and (said := SEPARATOR_LINE.fullmatch(head[0].strip("\n"))):
        return said[1]
    lines = [line for line in head if line.strip() and not _is_comment(line)][-SAMPLE:]
    tried = {separator: [cells(line, separator) for line in lines] for separator in SEPARATORS}

    def score(separator: str) -> tuple[int, int]:
        rows = [row for row in tried[separator] if len(row) > 1]
        numbers = sum(all(is_number(cell) or not cell for cell in row) for row in rows)
        return numbers, sum(any(map(is_number, row)) for row in rows)

    best = max(SEPARATORS, key=score)
    if score(best) > (0, 0):
        return best
    return next((each for each in SEPARATORS if any(each in line for line in head)), ",")


def _is_comment(line: str) -> bool:
    return line.strip().startswith(COMMENT)


def _starts(rows: Sequence[Row], head: Sequence[str]) -> bool:
    """Return whether the first of these rows begins the numbers: it has some, and so has the one below."""
    numbers = [any(map(is_number, row)) for at, row in rows[:50] if not _is_comment(head[at])][:2]
    return not _is_comment(head[rows[0][0]]) and bool(numbers) and all(numbers)


def _header(above: Sequence[Row], head: Sequence[str], first: Sequence[str]) -> list[list[str]]:
    """Return the rows of names above the first row of numbers; none if there are only other lines."""
    block: list[list[str]] = []
    for at, row in reversed(above):
        label = next(filter(None, row), "").strip().lower()
        if any(map(is_number, row)) and label not in LABELS:
            break
        fits = len(first) - 2 <= len(row) or (row[0] == MARKERS and 3 * (len(row) - 1) == len(first))
        if not block and _is_comment(head[at]):
            return [row] if len(row) == len(first) else []
        if not block and not (len(row) > 1 or len(first) == 1):
            return []
        if _is_comment(head[at]) or (block and not (fits and len(row) <= len(block[0]))):
            break
        block.insert(0, row)
    return block


def _named(block: Sequence[Sequence[str]], width: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names and the units of columns that a header of one row or several gives."""
    if block[-1][0] == MARKERS and width == 3 * (len(block[-1]) - 1):
        return tuple(f"{marker} {axis}" for marker in block[-1][1:] for axis in "XYZ"), ()
    rows = [[cell.strip() for cell in row] for row in block]
    units: tuple[str, ...] = ()
    if len(rows) > 1 and all(cell.lower().strip("[]()") in SPELLED for cell in rows[-1] if cell):
        units = tuple(cell.lower().strip("[]()") for cell in rows.pop())
    columns = zip_longest(*[_filled(row) for row in rows[:-1]], rows[-1], fillvalue="")
    return tuple(map(_joined, columns)) if len(rows) > 1 else tuple(rows[0]), units


def _filled(row: list[str]) -> list[str]:
    """Return a row above the axes in which a name stands over all of its columns."""
    label = next(filter(None, row), "").lower()
    if label in SKIPPED:
        return []
    if label in LABELS:
        row = ["" if cell.lower() == label else cell for cell in row]
    filled: list[str] = []
    for cell in row:
        filled.append(cell or (filled[-1] if filled else ""))
    return filled


def _joined(parts: Sequence[str]) -> str:
    *above, last = parts
    if above and re.fullmatch(r"[XYZ]\d+", last):
        last = last[0]  # X1 is x of the first marker, which has a name
    words = [part for part in (*above, last) if part and part.lower() not in ("position", "positions")]
    return " ".join(dict.fromkeys(words))


def _facts(above: Sequence[Sequence[str]]) -> dict[str, str]:
    """Return what the lines above the header say: a key beside, before or above each value."""
    facts: dict[str, str] = {}
    for row, below in zip_longest(above, above[1:], fillvalue=()):
        split = [part.strip() for cell in row for part in re.split("[:=]", cell)]
        for key, value in chain(pairwise(split), zip(row, below, strict=False)):
            if value[:1].isdigit() or value.lower() in SPELLED:
                facts.setdefault(re.sub(r"[\W_]", "", key.lower()), value)
        if len(row) == 1 and is_number(row[0]) and len(above) > 1:
            facts.setdefault("rate", row[0])  # Vicon's second line
    return facts


def _fact(facts: dict[str, str], key: re.Pattern[str]) -> str | None:
    return next((value for name, value in facts.items() if key.fullmatch(name)), None)


def _rate(facts: dict[str, str]) -> float | None:
    """Return the samples per second that the lines above a header say, or None."""
    said = facts.get("exportframerate") or _fact(facts, RATE)
    period = _fact(facts, PERIOD)
    for text, inverse in ((said, False), (period, True)):
        number = re.match(r"\d*\.?\d+", text or "")
        if number and float(number[0]) > 0:
            return 1 / float(number[0]) if inverse else float(number[0])
    return None
