"""Reports as text: JSON for programs, aligned columns for files, coloured tables for terminals."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any, TypeAlias

from skillctl.cli.errors import describe
from skillctl.errors import SkillctlError, printable

SCHEMA_VERSION = 2  # keys are only ever added under one version

RED = ("not proved", "not signed", "unreadable", "failed", "timeout", "unreachable", "diverged", "no")
GREEN = ("stable", "proved", "reached", "yes")
GAP = 2  # between columns, and between a name and its value
UNBROKEN = 24  # a cell up to this width stays on one line
COLOURS = {**dict.fromkeys(RED, "red"), **dict.fromkeys(GREEN, "green"), "inconclusive": "yellow"}


@dataclasses.dataclass(frozen=True)
class Table:
    """Rows under headings; cells are text already."""

    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclasses.dataclass(frozen=True)
class Facts:
    """Names and values, one a line."""

    items: tuple[tuple[str, str], ...]


@dataclasses.dataclass(frozen=True)
class Lines:
    """Sentences under a title."""

    title: str
    sentences: tuple[str, ...]


Block: TypeAlias = Table | Facts | Lines | str


def table(things: Iterable[Any], columns: Mapping[str, Callable[[Any], object]]) -> Table:
    """Return a table with a row a thing; a column is a heading and a function from a thing to its cell."""
    rows = tuple(tuple(str(cell(thing)) for cell in columns.values()) for thing in things)
    return Table(tuple(columns), rows)


def to_json(report: Any) -> str:
    """Return one JSON document: the report's fields and ``schema_version``; NaN becomes null."""
    document = {"schema_version": SCHEMA_VERSION, **plain(report)}
    return json.dumps(document, ensure_ascii=False, allow_nan=False, indent=2)


def plain(value: Any) -> Any:
    """Return a value in the types of JSON: dataclasses as objects, arrays as lists, NaN as null."""
    if isinstance(value, SkillctlError):
        return plain(describe(value))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if hasattr(value, "model_dump"):  # what an artifact's metadata is made of
        return plain(value.model_dump())
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, str | int | bool | None):
        return value
    if hasattr(value, "tolist"):  # arrays and NumPy's numbers
        return plain(value.tolist())
    return [plain(item) for item in value]


def to_text(blocks: Sequence[Block]) -> str:
    """Return blocks as plain lines, columns aligned by spaces; the same in a pipe, a file and a log."""
    return "\n".join(_lines_of(block) for block in blocks)


def _lines_of(block: Block) -> str:
    if isinstance(block, str):
        lines = [printable(block)]
    elif isinstance(block, Lines):
        lines = [printable(block.title), *(f"  {printable(sentence)}" for sentence in block.sentences)]
    elif isinstance(block, Facts):
        width = max((len(printable(name)) for name, _ in block.items), default=0)
        lines = [f"{printable(name):<{width}}  {printable(value)}" for name, value in block.items]
    else:
        lines = _aligned(block)
    return "".join(f"{line.rstrip()}\n" for line in lines)


def _aligned(table: Table) -> list[str]:
    """Return the lines of a table, numbers to the right."""
    columns = []
    for column, to_right in zip(zip(table.headings, *table.rows, strict=True), _numeric(table), strict=True):
        cells = list(map(printable, column))
        width = max(map(len, cells))
        columns.append([cell.rjust(width) if to_right else cell.ljust(width) for cell in cells])
    return ["  ".join(row) for row in zip(*columns, strict=True)]


def _numeric(table: Table) -> list[bool]:
    """Return for each column whether it holds numbers."""
    count = len(table.headings)
    return [bool(table.rows) and all(_is_numeric(row[i]) for row in table.rows) for i in range(count)]


def _is_numeric(cell: str) -> bool:
    try:
        float(cell.split(" ")[0].removesuffix("%"))
    except ValueError:
        return cell in ("", "–")
    return True


def to_terminal(blocks: Sequence[Block], *, coloured: bool, width: int | None = None) -> str:
    """Return blocks for a terminal: tables with rules, verdicts in colour.

    Args:
        blocks: What is shown.
        coloured: Whether colours are used.
        width: Columns of the terminal, by default of the one in use. No word is broken that fits in them.
    """
    from rich.console import Console

    console = Console(no_color=not coloured, highlight=False, width=width)
    shown = []
    for piece in (piece for block in blocks for piece in _pieces(block, console.width)):
        with console.capture() as captured:
            for line in piece:
                console.print(line)
        lines = filter(str.strip, captured.get().split("\n"))  # tables bring empty lines
        shown.append("".join(f"{line.rstrip()}\n" for line in lines))
    return "\n".join(shown)


def _pieces(block: Block, width: int) -> list[list[Any]]:
    """Return what Rich prints for a block on so many columns; an empty line separates pieces."""
    from rich.padding import Padding
    from rich.text import Text

    if isinstance(block, str):
        return [[Text(printable(block))]]
    if isinstance(block, Lines):
        sentences = (Padding(Text(printable(each)), (0, 0, 0, 2)) for each in block.sentences)
        return [[Text(printable(block.title)), *sentences]]
    if isinstance(block, Facts):
        return [_facts(block, width)]
    return [[_ruled(block, columns)] for columns in _fitting(block, width)]


def _facts(facts: Facts, width: int) -> list[Any]:
    """Return names and values; a value with a word that does not fit beside its name stands below it."""
    from rich.cells import cell_len
    from rich.padding import Padding
    from rich.table import Table as RichTable
    from rich.text import Text

    longest = max((cell_len(printable(name)) for name, _ in facts.items), default=0)
    lines: list[Any] = []
    for name, value in facts.items:
        term = Text(printable(name), style="dim")
        words = Text(printable(value), style=COLOURS.get(value, ""))
        if _longest_word(words.plain) > width - longest - GAP:
            lines += [term, Padding(words, (0, 0, 0, GAP))]
        else:
            grid = RichTable.grid(padding=(0, GAP, 0, 0))
            grid.add_column(width=longest)
            grid.add_row(term, words)
            lines.append(grid)
    return lines


def _fitting(table: Table, width: int) -> list[list[int]]:
    """Return which columns stand side by side: as many as fit, after the first, which is repeated.

    Long texts may take several lines.
    """
    cells = zip(table.headings, *table.rows, strict=True)
    first, *others = (max(_least_width(printable(cell)) for cell in column) for column in cells)
    groups, used = [[0]], first
    for index, needed in enumerate(others, start=1):
        if used + GAP + needed > width and len(groups[-1]) > 1:
            groups.append([0])
            used = first
        groups[-1].append(index)
        used += GAP + needed
    return groups


def _least_width(cell: str) -> int:
    from rich.cells import cell_len

    return min(cell_len(cell), max(_longest_word(cell), UNBROKEN))


def _longest_word(text: str) -> int:
    from rich.cells import cell_len

    return max(map(cell_len, text.split()), default=0)


def _ruled(table: Table, columns: Sequence[int]) -> Any:
    """Return some columns of a table for Rich."""
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    ruled = RichTable(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    numeric = _numeric(table)
    for i in columns:
        ruled.add_column(
            Text(printable(table.headings[i])), justify="right" if numeric[i] else "left", overflow="fold"
        )
    for row in table.rows:
        ruled.add_row(*(Text(printable(row[i]), style=COLOURS.get(row[i], "")) for i in columns))
    return ruled
