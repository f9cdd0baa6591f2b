"""``skillctl learn``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skillctl.cli import learn_batch, options, render, words
from skillctl.cli.output import Output
from skillctl.demonstrations.formats import described
from skillctl.errors import UsageError

if TYPE_CHECKING:
    from skillctl.usecases.learn import LearnReport

EXAMPLES = """\b
Example:
  skillctl learn reach-*.csv --name reach
  skillctl learn recording.csv --columns hand_x,hand_y,hand_z --units mm -o reach.h5
  skillctl learn low_dim.hdf5 --demos 0-19 --name lift
  skillctl learn reach-*.csv --name reach --validate --plot reach.svg
  skillctl learn GShape.mat --name g-shape --objective likelihood --metric euclidean
  skillctl learn --batch manifest.toml --jobs 4"""

LEARNING = "Learning"


def learn(
    context: typer.Context,
    data: Annotated[
        list[str] | None,
        typer.Argument(metavar="DATA...", help=f"Files with demonstrations: {described()}."),
    ] = None,
    output_file: options.OutputFile = None,
    name: options.Name = None,
    message: options.Message = None,
    depfile: options.Depfile = None,
    if_changed: options.IfChanged = False,
    plot: options.Plot = None,
    explain: options.Explain = False,
    force: options.Force = False,
    store: options.Store = None,
    batch: Annotated[
        Path | None,
        typer.Option(
            metavar="F.toml",
            help="Learn many skills: the file lists them, each with its files and options.",
            rich_help_panel=options.WORK,
        ),
    ] = None,
    jobs: options.Jobs = None,
    backend: options.Backend = "processes",
    scheduler: options.Scheduler = None,
    input_format: Annotated[
        options.InputFormat | None,
        typer.Option(help="Default: told from the content.", rich_help_panel=options.INPUT),
    ] = None,
    columns: Annotated[
        options.Words | None,
        typer.Option(
            parser=options.read_words,
            metavar="X,Y,Z",
            help="Columns that hold the position, a joint of a skeleton such as HandRight, or an observation "
            "of a robomimic dataset. Default: x, y, z, or all but the time; robot0_eef_pos.",
            rich_help_panel=options.INPUT,
        ),
    ] = None,
    dt: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="Seconds between samples, if the file has no time.",
            rich_help_panel=options.INPUT,
        ),
    ] = None,
    units: Annotated[
        options.Units | None,
        typer.Option(
            help="Unit of the positions. Default: the format's own, else m.", rich_help_panel=options.INPUT
        ),
    ] = None,
    scale: Annotated[
        float, typer.Option(metavar="F", help="Multiply all positions.", rich_help_panel=options.INPUT)
    ] = 1.0,
    demos: Annotated[
        options.Indices | None,
        typer.Option(
            parser=options.read_indices,
            metavar="0,2,5-9",
            help="Use these demonstrations only, counted from 0 over all files.",
            rich_help_panel=options.INPUT,
        ),
    ] = None,
    frame: Annotated[
        str,
        typer.Option(
            metavar="FRAME", help="Frame in which the positions are given.", rich_help_panel=options.INPUT
        ),
    ] = "base",
    objective: Annotated[
        options.Objective,
        typer.Option(
            help="reproduction: velocities and whole motions; mse: velocities; likelihood: Eq. 6.",
            rich_help_panel=LEARNING,
        ),
    ] = "reproduction",
    metric: Annotated[
        options.Metric,
        typer.Option(
            help="In which distance the motion approaches the target: learned from the data, or plain.",
            rich_help_panel=LEARNING,
        ),
    ] = "learned",
    components: Annotated[
        Any,
        typer.Option(
            parser=options.read_components,
            metavar="N|auto",
            help="Number of Gaussian components; auto: chosen by the error on demonstrations left out. "
            "Default: 7 (9 with --preset quality), or fewer for little data.",
            rich_help_panel=LEARNING,
        ),
    ] = None,
    preset: Annotated[
        options.Preset, typer.Option(help="How much work to spend.", rich_help_panel=LEARNING)
    ] = "default",
    seed: Annotated[
        int, typer.Option(metavar="N", help="Of the random starts.", rich_help_panel=LEARNING)
    ] = 0,
    slowest_rate: Annotated[
        float,
        typer.Option(
            metavar="R",
            help="Decay that every component keeps at least, in the motion's own unit of time.",
            rich_help_panel=LEARNING,
        ),
    ] = 0.03,
    period: Annotated[
        float,
        typer.Option(
            metavar="S",
            help="Controller period in seconds that the proof must cover; 0: any.",
            rich_help_panel=LEARNING,
        ),
    ] = 0.01,
    validate: Annotated[
        bool,
        typer.Option(
            "--validate",
            help="Also learn with each demonstration left out, and report the error on it.",
            rich_help_panel=LEARNING,
        ),
    ] = False,
) -> None:
    """Learn a skill from demonstrations, prove it stable, and write it.

    Nothing is written unless the proof holds. The same files and options give the same bytes; learning them
    again says "up to date" and only sets the time of FILE.h5.
    """
    from skillctl.demonstrations.options import Reading
    from skillctl.learning.options import LearnOptions
    from skillctl.usecases.learn import learn as learn_skill
    from skillctl.usecases.target import finish_target, require_target
    from skillctl.workers import Workers

    output: Output = context.obj
    learn_batch.require_one_kind(context, batch)
    if batch is not None:
        workers = Workers.chosen(jobs, backend, scheduler)
        raise typer.Exit(
            learn_batch.learn_batch(output, batch, store=store, force=force, explain=explain, workers=workers)
        )
    if not data:
        raise UsageError(
            "no demonstrations are given.", hint="Name their files, or list many with --batch F.toml."
        )
    require_target(output_file, depfile, if_changed)
    reading = Reading(input_format, columns, dt, units, scale, demos, frame)
    learning = LearnOptions(objective, metric, components, preset, seed, slowest_rate, period)
    paths = [Path(path) for path in data]
    with output.progress("learning") as progress:
        report = learn_skill(
            paths,
            output=output_file,
            name=name,
            store=store,
            note=message,
            options=learning,
            reading=reading,
            validated=validate,
            force=force,
            plot=plot,
            progress=progress,
        )
    finish_target(output_file, paths, created=report.written.created, depfile=depfile, if_changed=if_changed)
    words.explain(output, report.notes, report.reasons if explain else ())
    output.result(report, lambda: blocks(report))


def blocks(report: LearnReport) -> list[render.Block]:
    """Return the report for people."""
    if report.status == "up to date":
        return [words.up_to_date(report.written.skill, "files")]
    facts = render.Facts(
        (
            *words.written(report.written),
            ("components", str(report.n_components)),
            ("attractor", words.point(report.attractor, report.unit)),
            *words.proof(report.certificate),
            *words.held_out(report.held_out, report.unit),
        )
    )
    return [words.demonstrations(report.demonstrations, report.unit), facts]
