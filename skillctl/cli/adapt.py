"""``skillctl adapt``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from skillctl.cli import options, render, words
from skillctl.cli.exit_codes import ExitCode
from skillctl.cli.making import files_of, make
from skillctl.errors import UsageError
from skillctl.options import RESULT

if TYPE_CHECKING:
    from skillctl.usecases.adapt import AdaptReport

EXAMPLES = """\b
Example:
  skillctl adapt --print-task demonstration.csv > task.toml
  skillctl adapt task.toml bottom-left top-centre --name left
  skillctl adapt task.toml --from-store -o t.h5 --explain --plot t.png

Exit codes: 0 every clause of the task holds; 1 one fails: it is named with its margin, and nothing is written
without --anyway; 6 there is no candidate, or no proof."""

TASK = "The task"


def adapt(
    context: typer.Context,
    task: Annotated[
        Path | None, typer.Argument(metavar="[TASK.toml]", help="What the motion is to do: its clauses.")
    ] = None,
    skills: Annotated[
        list[str] | None, typer.Argument(metavar="SKILL...", help=f"To choose from: {options.SKILL}.")
    ] = None,
    from_store: Annotated[
        bool,
        typer.Option("--from-store", help="Choose from the skills of the store.", rich_help_panel=TASK),
    ] = False,
    print_task: Annotated[
        Path | None,
        typer.Option(
            metavar="DEMO|SCENARIO.toml",
            help="Only print a task file: start box and target of demonstrations, or those of a scenario "
            "with the bodies of its scene.",
            rich_help_panel=TASK,
        ),
    ] = None,
    anyway: Annotated[
        bool,
        typer.Option(
            "--anyway", help="Write the best candidate even if a clause fails.", rich_help_panel=RESULT
        ),
    ] = False,
    *,
    making: options.Making,
    no_refit: options.NoRefit = False,
    place: options.LockedPlace,
) -> None:
    """Find a skill that does a task: one alone, merged or combined; the result is proved, and written.

    Every candidate is judged by whole motions from the start box against every clause of the task; the
    margin of a clause says by how much it holds. --explain lists candidates. --plot draws the task.
    """
    from skillctl.usecases.adapt import adapt as adapt_skills
    from skillctl.usecases.adapt import print_task as task_text

    if print_task is not None:
        others = [path for path in (task, *(skills or ())) if path is not None]
        context.obj.verbatim(task_text([print_task, *map(Path, others)]))
        return
    if task is None:
        hint = "`skillctl adapt --print-task DEMO` writes one."
        raise UsageError("adapt: no task file is named.", hint=hint)
    call = partial(
        adapt_skills,
        task,
        skills or [],
        from_store=from_store,
        store=place.store,
        lock=place.lock,
        refit=not no_refit,
        anyway=anyway,
    )

    def made_from(report: AdaptReport) -> list[Path]:
        return [task, *files_of(report.parts, place)]

    report = make(context.obj, "adapting", making, call, partial(blocks, explain=making.explain), made_from)
    raise typer.Exit(ExitCode.DONE if report.holds else ExitCode.NEGATIVE)


def blocks(report: AdaptReport, *, explain: bool = False) -> list[render.Block]:
    """Return the report for people."""
    share = f"{report.held} of {report.starts} drawn starts"
    low, high = report.interval
    interval = f" ({low:.1%} to {high:.1%} with 95 % confidence)" if report.starts > 1 else ""
    written = words.written(report.written) if report.written else (("skill", "nothing was written"),)
    facts = (
        *written,
        ("choice", f"{report.choice}, the best of {report.tried} candidates"),
        *([("gate", report.gate)] if report.gate else []),
        *([("speed", f"{report.speed:.3g}")] if report.speed != 1 else []),
        ("every clause holds", f"from {share}{interval}"),
        *words.proof(report.certificate),
    )
    listed = [_candidates(report)] if explain else []
    failures = [render.Lines("the task is not done:", report.failures)] if report.failures else []
    return [
        words.parts(report.parts, "weight"),
        *words.refits(report.refits, report.unit),
        *listed,
        clauses(report),
        render.Facts(facts),
        *failures,
    ]


def clauses(report: AdaptReport) -> render.Table:
    """Return a table of the clauses and their margins; what fails has a negative one."""
    columns = {
        "clause": lambda row: row.clause,
        "margin": lambda row: words.margin(row.margin, row.unit),
        "proved": lambda row: words.proved_margin(row.bound, row.unit),
        "best single skill": lambda row: words.margin(row.single, row.unit),
        "equal weights": lambda row: words.margin(row.equal, row.unit),
    }
    return render.table(report.clauses, columns)


def _candidates(report: AdaptReport) -> render.Table:
    columns = {
        "candidate": lambda row: f"{row.kind}, {row.gate}" if row.gate else row.kind,
        "weights": lambda row: " ".join(f"{weight:.2f}" for weight in row.weights),
        "score": lambda row: f"{row.score:.2f}",
        "worst clause": lambda row: row.worst,
        "its margin": lambda row: words.margin(row.margin, _unit(report, row.worst)),
    }
    return render.table(report.candidates, columns)


def _unit(report: AdaptReport, clause: str) -> str:
    return next(row.unit for row in report.clauses if row.clause == clause)
