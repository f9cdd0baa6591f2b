"""``skillctl merge``."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from skillctl.adapt.options import TASK, TaskOptions
from skillctl.cli import options, render, words
from skillctl.cli.making import files_of, make
from skillctl.cli.parameters import was_typed
from skillctl.compose.options import MergeOptions
from skillctl.demonstrations.options import Reading
from skillctl.errors import UsageError
from skillctl.options import options_of

if TYPE_CHECKING:
    from skillctl.usecases.merge import MergeReport, TaskReport

EXAMPLES = """\b
Example:
  skillctl merge bottom-left top-centre --target 0.63,0.28,0.76 --name left
  skillctl merge a.h5 b.h5 --weights 2,1 --gate experts --sharpness 4 -o c.h5
  skillctl merge a b c --fit new-task.csv --fit-level component -o fitted.h5
  skillctl merge --from-store --fit once.csv --fit again.csv --name new-task"""

ORIGINS = {
    "shared": "all parts were learned under one already",
    "found": "one was found for all parts",
    "refitted": "none exists for the parts as they were: they were learned again under one",
}


def merge(
    context: typer.Context,
    skills: Annotated[
        list[str] | None, typer.Argument(metavar="SKILL...", help=f"Two or more: {options.SKILL}.")
    ] = None,
    *,
    making: options.Making,
    merging: MergeOptions,
    no_refit: options.NoRefit = False,
    task: TaskOptions,
    reading: Annotated[Reading, TASK],
    place: options.LockedPlace,
) -> None:
    """Merge skills: all of them act together on one target, and the result is proved stable.

    The target is --target, else the mean end of the demonstrations of --fit, else the weighted mean of the
    skills' targets. Combined skills and chains cannot be merged.
    """
    from skillctl.store import parse_reference
    from skillctl.usecases.merge import merge as merge_skills

    _require_task(context, skills, task)
    call = partial(
        merge_skills,
        skills or [],
        store=place.store,
        lock=place.lock,
        options=merging,
        task=replace(task, reading=reading) if task.demonstrations else None,
        refit=not no_refit,
    )
    named = [Path(skill) for skill in skills or () if isinstance(parse_reference(skill), Path)]

    def made_from(report: MergeReport) -> list[Path]:
        return [*named, *files_of(report.parts, place), *task.demonstrations]

    make(context.obj, "merging", making, call, blocks, made_from)


def _require_task(context: typer.Context, skills: list[str] | None, task: TaskOptions) -> None:
    """Raise UsageError for options that only mean something with --fit, or for no skill at all."""
    for option in (*options_of(TaskOptions), *options_of(Reading)):
        if not task.demonstrations and was_typed(context, option.field):
            hint = "Add --fit DEMO, a file with the new task."
            raise UsageError(f"--{option.key} is only used with --fit.", hint=hint)
    if not (skills or task.from_store):
        raise UsageError(
            "merge: no skill is named.", hint="Name two or more skills, or give --from-store and --fit DEMO."
        )


def blocks(report: MergeReport) -> list[render.Block]:
    """Return the report for people."""
    again = words.refits(report.refits, report.unit)
    task = report.task
    errors = [] if task is None else [_errors(task, report.unit)]
    fitted = [] if task is None else [("fitted", f"{task.choice}; chosen from {task.candidates} skills")]
    facts = (
        *words.written(report.written),
        ("gate", words.gate(report.gate, report.parameters)),
        ("speed", f"{report.speed:.4g}"),
        *fitted,
        ("attractor", words.point(report.target, report.unit)),
        ("Lyapunov matrix", ORIGINS[report.lyapunov]),
        *words.proof(report.certificate),
    )
    return [words.parts(report.parts, "weight"), *again, *errors, render.Facts(facts)]


def _errors(task: TaskReport, unit: str) -> render.Table:
    """Return the errors on the demonstrations of the task, and on those left out in turn."""
    rows = [(f"{task.demonstrations} given", task.errors)]
    if task.held_out is not None:
        rows.append(("each left out in turn", task.held_out))
    columns = {
        "DTW to demonstrations": lambda row: row[0],
        "best part alone": lambda row: f"{words.length(row[1].best_single, unit)} (part {row[1].best_part})",
        "equal weights": lambda row: words.length(row[1].equal, unit),
        "fitted": lambda row: words.length(row[1].fitted, unit),
    }
    return render.table(rows, columns)
