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

COLOURS = {
    "stable": "green",
    "proved": "green",
    "not proved": "red",
    "not signed": "red",
    "inconclusive": "yellow",
    "unreadable": "red",
    "failed": "red",
    "reached": "green",
    "timeout": "red",
    "unreachable": "red",
    "diverged": "red",
    "yes": "green",
    "no": "red",
}


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
    """Return a value as JSON knows it: dataclasses as objects, arrays as lists, NaN and infinity as null."""
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
        return f"{printable(block)}\n"
    if isinstance(block, Lines):
        sentences = (f"  {printable(sentence)}\n" for sentence in block.sentences)
        return "".join([f"{printable(block.title)}\n", *sentences])
    if isinstance(block, Facts):
        width = max((len(printable(name)) for name, _ in block.items), default=0)
        lines = [f"{printable(name):<{width}}  {printable(value)}" for name, value in block.items]
    else:
        lines = _aligned((block.headings, *block.rows), _right_aligned(block))
    return "".join(f"{line.rstrip()}\n" for line in lines)


def _aligned(rows: Sequence[Sequence[str]], right: Sequence[bool]) -> list[str]:
    cells = [[printable(cell) for cell in row] for row in rows]
    widths = [max(len(row[i]) for row in cells) for i in range(len(right))]
    return [
        "  ".join(
            cell.rjust(width) if to_right else cell.ljust(width)
            for cell, width, to_right in zip(row, widths, right, strict=True)
        )
        for row in cells
    ]


def _right_aligned(table: Table) -> list[bool]:
    """Return for each column whether it holds numbers."""
    return [
        bool(table.rows) and all(_is_numeric(row[i]) for row in table.rows)
        for i in range(len(table.headings))
    ]


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
        lines = captured.get().split("\n")
        shown.append(
            "".join(f"{line.rstrip()}\n" for line in lines if line.strip())
        )  # tables bring empty lines
    return "\n".join(shown)


def _renderable(block: Block) -> Any:
    """Return what Rich prints for a block."""
    from rich.console import Group
    from rich.padding import Padding
    from rich.text import Text

    if isinstance(block, str):
        return Text(printable(block))
    if isinstance(block, Lines):
        sentences = (Padding(Text(printable(sentence)), (0, 0, 0, 2)) for sentence in block.sentences)
        return Group(Text(printable(block.title)), *sentences)
    return _rich_table(block)


def _rich_table(block: Table | Facts) -> Any:
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    def cell(text: str) -> Text:
        return Text(printable(text), style=COLOURS.get(text, ""))

    if isinstance(block, Facts):
        grid = RichTable.grid(padding=(0, 2))
        for name, value in block.items:
            grid.add_row(Text(printable(name), style="dim"), cell(value))
        return grid
    table = RichTable(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for heading, right in zip(block.headings, _right_aligned(block), strict=True):
        table.add_column(Text(printable(heading)), justify="right" if right else "left", overflow="fold")
    for row in block.rows:
        table.add_row(*map(cell, row))
    return table
