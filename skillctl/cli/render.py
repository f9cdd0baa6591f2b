"""Reports as text: JSON for programs, aligned columns for files, coloured tables for terminals."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from typing import Any, TypeAlias

from skillctl.errors import printable

SCHEMA_VERSION = 1  # keys are only ever added under one version

COLOURS = {
    "stable": "green",
    "not proved": "red",
    "inconclusive": "yellow",
    "refused": "red",
    "yes": "green",
    "no": "red",
}


@dataclasses.dataclass(frozen=True)
class Table:
    """Rows under headings; cells are text already."""

    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    title: str = ""


@dataclasses.dataclass(frozen=True)
class Facts:
    """Names and values, one a line."""

    items: tuple[tuple[str, str], ...]
    title: str = ""


Block: TypeAlias = Table | Facts | str


def to_json(report: Any) -> str:
    """Return one JSON document: the report's fields and ``schema_version``; NaN becomes null."""
    document = {"schema_version": SCHEMA_VERSION, **plain(report)}
    return json.dumps(document, ensure_ascii=False, allow_nan=False, indent=2)


def plain(value: Any) -> Any:
    """Return a value as JSON knows it: dataclasses as objects, arrays as lists, NaN and infinity as null."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
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
    title = [printable(block.title)] if block.title else []
    if isinstance(block, Facts):
        width = max((len(name) for name, _ in block.items), default=0)
        lines = [f"{name:<{width}}  {printable(value)}" for name, value in block.items]
    else:
        lines = _aligned((block.headings, *block.rows), _right_aligned(block))
    return "".join(f"{line.rstrip()}\n" for line in [*title, *lines])


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
    with console.capture() as captured:
        for index, block in enumerate(blocks):
            if index:
                console.print()
            console.print(printable(block) if isinstance(block, str) else _rich_table(block), markup=False)
    return captured.get()


def _rich_table(block: Table | Facts) -> Any:
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    def cell(text: str) -> Text:
        return Text(printable(text), style=COLOURS.get(text, ""))

    if isinstance(block, Facts):
        grid = RichTable.grid(padding=(0, 2))
        grid.title, grid.title_justify = block.title or None, "left"
        for name, value in block.items:
            grid.add_row(Text(name, style="dim"), cell(value))
        return grid
    table = RichTable(box=box.SIMPLE_HEAD, title=block.title or None, title_justify="left", pad_edge=False)
    for heading, right in zip(block.headings, _right_aligned(block), strict=True):
        table.add_column(heading, justify="right" if right else "left", overflow="fold")
    for row in block.rows:
        table.add_row(*map(cell, row))
    return table


def length(value: float | None, unit: str) -> str:
    """Return a distance for people: metres as millimetres, radians as they are; a dash if there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    return f"{1e3 * value:.2f} mm" if unit == "m" else f"{value:.4f} {unit}"


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with a few significant digits; a dash if there is none."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"


def point(values: Sequence[float]) -> str:
    """Return coordinates as they are typed on the command line."""
    return ",".join(f"{value:.4g}" for value in values)


def yes_no(value: bool) -> str:
    """Return ``yes`` or ``no``."""
    return "yes" if value else "no"
