"""``skillctl merge``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skillctl.cli import options, render, words
from skillctl.cli.output import Output
from skillctl.errors import UsageError

if TYPE_CHECKING:
    from skillctl.adapt.task import TaskErrors
    from skillctl.usecases.merge import MergeReport, TaskReport

EXAMPLES = """\b
Example:
  skillctl merge bottom-left top-centre --target 0.63,0.28,0.76 --name top-left
  skillctl merge a.h5 b.h5 --weights 2,1 --gate experts --sharpness 4 -o c.h5
  skillctl merge a b c --fit new-task.csv --fit-level component -o fitted.h5
  skillctl merge --from-store --fit once.csv --fit again.csv --name new-task"""

TASK = "Fitting to a task"

ORIGINS = {
    "shared": "all parts were learned under one already",
    "found": "one was found for all parts",
    "refitted": "none exists for the parts as they were: they were learned again under one",
}


def merge(
    context: typer.Context,
    skills: Annotated[
        list[str] | None,
        typer.Argument(metavar="SKILL...", help=f"Two or more: {options.SKILL}."),
    ] = None,
    output_file: options.OutputFile = None,
    name: options.Name = None,
    message: options.Message = None,
    depfile: options.Depfile = None,
    if_changed: options.IfChanged = False,
    explain: options.Explain = False,
    force: options.Force = False,
    plot: options.Plot = None,
    weights: Annotated[
        options.Numbers | None,
        typer.Option(
            parser=options.read_numbers,
            metavar="W,W,...",
            help="Influence of each skill, all positive. Default: equal.",
            rich_help_panel=options.MOTION,
        ),
    ] = None,
    gate: Annotated[
        options.MergeGate,
        typer.Option(
            help="superposition: all act everywhere; density: each mostly where it was taught; "
            "experts: the strongest Gaussian of a place counts most.",
            rich_help_panel=options.MOTION,
        ),
    ] = "superposition",
    sharpness: Annotated[
        float,
        typer.Option(metavar="G", help="Of the experts gate, at least 1.", rich_help_panel=options.MOTION),
    ] = 1.0,
    speed: Annotated[
        float, typer.Option(metavar="F", help="Factor on the velocity.", rich_help_panel=options.MOTION)
    ] = 1.0,
    target: options.Target = None,
    no_refit: options.NoRefit = False,
    fit: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="DEMO",
            help="Choose the weights so that the motion is near to the demonstrations in this file; give it "
            "again for more files.",
            rich_help_panel=TASK,
        ),
    ] = None,
    fit_level: Annotated[
        options.FitLevel,
        typer.Option(
            help="part: one weight a skill; component: also one factor a Gaussian component.",
            rich_help_panel=TASK,
        ),
    ] = "part",
    from_store: Annotated[
        bool,
        typer.Option(
            "--from-store",
            help="Merge the few skills of the store that help with the task.",
            rich_help_panel=TASK,
        ),
    ] = False,
    input_format: Annotated[
        options.InputFormat | None,
        typer.Option(help="Of DEMO. Default: told from the content.", rich_help_panel=TASK),
    ] = None,
    columns: Annotated[
        options.Words | None,
        typer.Option(
            parser=options.read_words,
            metavar="X,Y,Z",
            help="Columns that hold the position, as for learn.",
            rich_help_panel=TASK,
        ),
    ] = None,
    dt: Annotated[
        float | None,
        typer.Option(
            metavar="S", help="Seconds between samples, if the file has no time.", rich_help_panel=TASK
        ),
    ] = None,
    units: Annotated[
        options.Units | None, typer.Option(help="Unit of the positions.", rich_help_panel=TASK)
    ] = None,
    scale: Annotated[
        float | None, typer.Option(metavar="F", help="Multiply all positions.", rich_help_panel=TASK)
    ] = None,
    demos: Annotated[
        options.Indices | None,
        typer.Option(
            parser=options.read_indices,
            metavar="0,2,5-9",
            help="Use these demonstrations only, counted from 0 over all files.",
            rich_help_panel=TASK,
        ),
    ] = None,
    frame: Annotated[
        str | None,
        typer.Option(
            metavar="FRAME",
            help="Frame in which the positions are given. Default: base.",
            rich_help_panel=TASK,
        ),
    ] = None,
    store: options.Store = None,
    locked: options.Locked = False,
) -> None:
    """Merge skills: all of them act together on one target, and the result is proved stable.

    The target is --target, else the mean end of the demonstrations of --fit, else the weighted mean of the
    skills' targets. Combined skills cannot be merged.
    """
    from skillctl.adapt.options import TaskOptions
    from skillctl.compose.options import MergeOptions
    from skillctl.demonstrations.options import Reading
    from skillctl.store import locate, parse_reference
    from skillctl.usecases.merge import merge as merge_skills
    from skillctl.usecases.target import finish_target, require_target

    reading: dict[str, Any] = {
        "input_format": input_format,
        "columns": columns,
        "dt": dt,
        "units": units,
        "scale": scale,
        "demos": demos,
        "frame": frame,
    }
    given = {key: value for key, value in reading.items() if value is not None}
    _require_task(skills, fit, fit_level, from_store, given)

    output: Output = context.obj
    lock = options.chosen_lock(locked)
    require_target(output_file, depfile, if_changed)
    with output.progress("merging") as progress:
        report = merge_skills(
            skills or [],
            output=output_file,
            name=name,
            store=store,
            lock=lock,
            note=message,
            options=MergeOptions(
                weights, gate, {"sharpness": sharpness} if sharpness != 1 else {}, speed, target
            ),
            task=TaskOptions(tuple(fit), fit_level, from_store, Reading(**given)) if fit else None,
            refit=not no_refit,
            force=force,
            plot=plot,
            progress=progress,
        )
    files = [Path(skill) for skill in skills or () if isinstance(parse_reference(skill), Path)]
    parts = [*files, *(locate(part.skill, store).path for part in report.parts)]
    parts += [lock.path] if lock is not None else []
    finish_target(
        output_file,
        [*parts, *(fit or ())],
        created=report.written.created,
        depfile=depfile,
        if_changed=if_changed,
    )
    words.explain(output, report.notes, report.reasons if explain else ())
    output.result(report, lambda: blocks(report))


def _require_task(
    skills: list[str] | None,
    fit: list[Path] | None,
    fit_level: str,
    from_store: bool,
    reading: dict[str, Any],
) -> None:
    """Raise UsageError for options that only mean something with --fit, or for no skill at all."""
    if not fit:
        without = {
            "--fit-level": fit_level != "part",
            "--from-store": from_store,
            **{f"--{key.replace('_', '-')}": True for key in reading},
        }
        for option, given in without.items():
            if given:
                raise UsageError(
                    f"{option}: only with --fit.", hint="Add --fit DEMO, a file with the new task."
                )
    if not (skills or from_store):
        raise UsageError(
            "merge: no skill is named.", hint="Name two or more skills, or give --from-store and --fit DEMO."
        )


def blocks(report: MergeReport) -> list[render.Block]:
    """Return the report for people."""
    if report.status == "up to date":
        return [words.up_to_date(report.written.skill, "inputs")]
    blocks: list[render.Block] = [words.parts(report.parts, "weight")]
    if report.refits:
        blocks.append(words.refits(report.refits, report.unit))
    if report.task is not None:
        blocks.append(_errors(report.task, report.unit))
    gate = report.gate if report.gate != "experts" else words.gate(report.gate, report.parameters)
    facts = (
        *words.written(report.written),
        ("gate", gate),
        ("speed", f"{report.speed:.4g}"),
        *_fit(report.task),
        ("attractor", words.point(report.attractor, report.unit)),
        ("Lyapunov matrix", ORIGINS[report.lyapunov]),
        *words.proof(report.certificate),
    )
    return [*blocks, render.Facts(facts)]


def _errors(task: TaskReport, unit: str) -> render.Table:
    """Return the errors on the demonstrations of the task, and on those left out in turn."""

    def row(name: str, errors: TaskErrors) -> tuple[str, ...]:
        single = f"{words.length(errors.best_single, unit)} (part {errors.best_part})"
        return (name, single, words.length(errors.equal, unit), words.length(errors.fitted, unit))

    rows = [row(f"{task.demonstrations} given", task.errors)]
    if task.held_out is not None:
        rows.append(row("each left out in turn", task.held_out))
    return render.Table(("DTW to demonstrations", "best part alone", "equal weights", "fitted"), tuple(rows))


def _fit(task: TaskReport | None) -> tuple[tuple[str, str], ...]:
    if task is None:
        return ()
    return (("fitted", f"{task.choice}; chosen from {task.candidates} skills"),)
