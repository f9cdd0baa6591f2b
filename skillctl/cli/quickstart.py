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
    """See every step on an example: reach for a cup on a shelf.

    Writes demonstrations of three reaches, learns a skill from each, merges two pairs into reaches that were
    not demonstrated, combines the upper three into one, proves all six stable and runs them on a simulated
    arm. Every command is printed as it is run, so that you can repeat it by hand.
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
    columns = {
        "skill": lambda skill: skill.skill,
        "made by": lambda skill: skill.made_by,
        "DTW": lambda skill: words.length(skill.dtw, "m"),
        "verdict": lambda skill: skill.verdict,
        "rate": lambda skill: words.rate_and_period(skill.rate, skill.period)[0],
        "controller ≥": lambda skill: words.rate_and_period(skill.rate, skill.period)[2],
        "simulated": lambda skill: skill.outcome or words.NONE,
        "error": lambda skill: words.length(skill.final_error, "m"),
        "time": lambda skill: words.number(skill.time_to_target, "s"),
    }
    where = f"Everything is in {report.directory}: demonstrations/, skills/"
    seen = "." if report.picture is None else f", and the picture {report.picture}."
    following = "skillctl ls, skillctl inspect shelf, skillctl simulate --help"
    following = f"Look around: cd {report.directory}, then {following}."
    return [render.table(report.skills, columns), f"{where}{seen}", following]
