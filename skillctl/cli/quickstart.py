"""``skillctl quickstart``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from skillctl.cli import render, words
from skillctl.cli.exit_codes import ExitCode
from skillctl.cli.output import Output

if TYPE_CHECKING:
    from skillctl.usecases.quickstart import QuickstartReport

EXAMPLES = """\b
Example:
  skillctl quickstart
  skillctl quickstart path/to/new-directory --json"""


def quickstart(
    context: typer.Context,
    directory: Annotated[
        Path, typer.Argument(metavar="[DIR]", help="Where to do it: new, empty, or an earlier quickstart.")
    ] = Path("quickstart"),
) -> None:
    """See it all on an example: reach for a cup on a shelf.

    Writes demonstrations of three reaches, learns a skill from each, merges two pairs into reaches nobody
    demonstrated, combines the upper three into one, proves all six stable and runs them on a simulated arm.
    Every command is printed as it is run, so that you can repeat it by hand.
    """
    from skillctl.usecases.quickstart import quickstart as run_quickstart

    output: Output = context.obj
    with output.progress("working") as progress:
        report = run_quickstart(
            directory, announce=lambda command: output.note(f"$ {command}"), progress=progress
        )
    words.explain(output, report.notes)
    output.result(report, lambda: blocks(report))
    raise typer.Exit(ExitCode.DONE if report.success else ExitCode.NEGATIVE)


def blocks(report: QuickstartReport) -> list[render.Block]:
    """Return the report for people."""
    rows = tuple(
        (
            skill.skill,
            skill.made_by,
            words.length(skill.dtw, "m"),
            skill.verdict,
            *words.rate_and_period(skill.rate, skill.period)[::2],
            skill.outcome or words.NONE,
            words.length(skill.final_error, "m"),
            words.number(skill.time_to_target, "s"),
        )
        for skill in report.skills
    )
    headings = ("skill", "made by", "DTW", "verdict", "rate", "controller ≥", "simulated", "error", "time")
    where = f"Everything is in {report.directory}: demonstrations/, skills/"
    seen = "." if report.picture is None else f", and the picture {report.picture}."
    following = "skillctl ls, skillctl inspect shelf, skillctl simulate --help"
    following = f"Look around: cd {report.directory}, then {following}."
    return [render.Table(headings, rows), f"{where}{seen}", following]
