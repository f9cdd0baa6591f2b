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


MEANINGS = (
    f"DTW: {words.MEANINGS['DTW']}",
    f"rate: {words.MEANINGS['rate']}",
    "controller: proved, it may give commands this often or more often.",
    "error: how far from its target the simulated hand came to rest.",
    "cups: how many it grasped of the same cups, which stand anywhere on two boards.",
)


def quickstart(
    context: typer.Context,
    directory: Annotated[
        Path, typer.Argument(metavar="[DIR]", help="Where to do it: new, empty, or an earlier quickstart.")
    ] = Path("quickstart"),
) -> None:
    """See every step on an example: reach for a cup on a shelf.

    Writes demonstrations of three reaches, learns a skill from each, merges two pairs into reaches that were
    not demonstrated, combines the upper three into one, learns a retreat from one reach backwards, chains
    skills that carry a cup, proves all eight stable, runs them on a simulated arm, and grasps cups with them.
    Every command is printed as it is run, so that you can repeat it by hand.
    """
    from skillctl.usecases.quickstart import quickstart as run_quickstart

    output: Output = context.obj
    with output.progress("working") as progress:
        report = run_quickstart(directory, announce=output.announce, progress=progress)
    words.explain(output, report.notes)
    output.result(report, lambda: blocks(report))
    raise typer.Exit(ExitCode.DONE if report.success else ExitCode.NEGATIVE)


def blocks(report: QuickstartReport) -> list[render.Block]:
    """Return the report for people."""
    columns = {
        "skill": lambda skill: skill.skill,
        "DTW": lambda skill: words.length(skill.dtw, "m"),
        "verdict": lambda skill: skill.verdict,
        "rate": lambda skill: words.rate_and_period(skill.rate, skill.period)[0],
        "controller ≥": lambda skill: words.rate_and_period(skill.rate, skill.period)[2],
        "error": lambda skill: (
            words.length(skill.final_error, "m") if skill.outcome in (None, "reached") else skill.outcome
        ),
        "cups": lambda skill: words.NONE if skill.grasped is None else f"{skill.grasped} of {report.cups}",
    }
    where = f"Everything is in {report.directory}: demonstrations/, skills/"
    seen = (
        "." if report.picture is None else f", and the picture {report.picture} of the cup that was carried."
    )
    following = "skillctl ls, skillctl inspect shelf, skillctl simulate --help"
    following = f"Look around: cd {report.directory}, then {following}."
    meanings = render.Lines("What the columns say:", MEANINGS)
    return [render.table(report.skills, columns), meanings, f"{where}{seen}", following]
