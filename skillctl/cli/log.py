"""``skillctl log``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from skillctl.cli import options, render, words
from skillctl.cli.output import Output

if TYPE_CHECKING:
    from skillctl.usecases.history import LogEntry, LogReport

EXAMPLES = """\b
Example:
  skillctl log reach
  skillctl learn reach-*.csv --name reach -m 'slower near the shelf'"""


def log(
    context: typer.Context,
    name: Annotated[str, typer.Argument(metavar="NAME", help="A skill of the store.")],
    limit: Annotated[
        int | None, typer.Option("--limit", "-n", metavar="N", min=1, help="Only the N newest versions.")
    ] = None,
    *,
    place: options.Place,
) -> None:
    """Show the versions of a skill, newest first: what made each, with the notes given with -m."""
    from skillctl.usecases.history import log as log_of

    output: Output = context.obj
    report = log_of(name, limit=limit, store=place.store)
    output.result(report, lambda: blocks(report))


def blocks(report: LogReport) -> list[render.Block]:
    """Return the report for people."""
    headings = ("version", "aliases", "made by", "from", "digest", "note")
    return [render.Table(headings, tuple(_row(report.name, entry) for entry in report.entries))]


def _row(name: str, entry: LogEntry) -> tuple[str, ...]:
    parents = ", ".join(parent.shown for parent in entry.parents)
    origin = parents or (f"{entry.inputs} files" if entry.inputs else words.NONE)
    return (
        f"{name}@{entry.version}",
        ", ".join(entry.aliases) or words.NONE,
        entry.command or "unreadable",
        origin,
        words.short(entry.digest),
        entry.note or entry.problem or words.NONE,
    )
