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


def to_terminal(blocks: Sequence[Block], *, coloured: bool) -> str:
    """Return blocks for a terminal: tables with rules, verdicts in colour."""
    from rich.console import Console

    console = Console(no_color=not coloured, highlight=False)
    shown = []
    for block in blocks:
        with console.capture() as captured:
            console.print(_renderable(block))
        lines = filter(str.strip, captured.get().split("\n"))  # tables bring empty lines
        shown.append("".join(f"{line.rstrip()}\n" for line in lines))
    return "\n".join(shown)


def _renderable(block: Block) -> Any:
    """Return what Rich prints for a block."""
    from rich import box
    from rich.console import Group
    from rich.padding import Padding
    from rich.table import Table as RichTable
    from rich.text import Text

    def text(words: str, style: str = "") -> Text:
        return Text(printable(words), style=style)

    if isinstance(block, str):
        return text(block)
    if isinstance(block, Lines):
        return Group(text(block.title), *(Padding(text(each), (0, 0, 0, 2)) for each in block.sentences))
    if isinstance(block, Facts):
        grid = RichTable.grid(padding=(0, 2))
        for name, value in block.items:
            grid.add_row(text(name, "dim"), text(value, COLOURS.get(value, "")))
        return grid
    table = RichTable(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for heading, to_right in zip(block.headings, _numeric(block), strict=True):
        table.add_column(text(heading), justify="right" if to_right else "left", overflow="fold")
    for row in block.rows:
        table.add_row(*(text(cell, COLOURS.get(cell, "")) for cell in row))
    return table
