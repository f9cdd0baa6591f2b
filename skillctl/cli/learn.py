"""``skillctl learn``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from skillctl.cli import learn_batch, options, render, words
from skillctl.cli.making import make
from skillctl.cli.output import Output
from skillctl.demonstrations.formats import described
from skillctl.demonstrations.options import Reading
from skillctl.errors import UsageError
from skillctl.learning.options import LearnOptions
from skillctl.usecases.options import Validation

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


def learn(
    context: typer.Context,
    data: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="DATA...",
            help=f"Files with demonstrations: {described()}.",
        ),
    ] = None,
    *,
    making: options.Making,
    place: options.Place,
    batch: Annotated[
        Path | None,
        typer.Option(
            metavar="F.toml",
            help="Learn many skills: the file lists them, each with its files and options.",
            rich_help_panel=options.WORK,
        ),
    ] = None,
    work: options.Work,
    reading: Reading,
    learning: LearnOptions,
    validation: Validation,
) -> None:
    """Learn a skill from demonstrations, prove it stable, and write it.

    Nothing is written unless the proof holds. The same files and options give the same bytes; learning them
    again says "up to date" and only sets the time of FILE.h5.
    """
    from skillctl.usecases.learn import learn as learn_skill

    output: Output = context.obj
    learn_batch.require_one_kind(context, batch)
    if batch is not None:
        raise typer.Exit(learn_batch.learn_batch(output, batch, making, place, work))
    if not data:
        raise UsageError(
            "no demonstrations are given.", hint="Name their files, or list many with --batch F.toml."
        )
    paths = [Path(path) for path in data]
    call = partial(
        learn_skill,
        paths,
        store=place.store,
        options=learning,
        reading=reading,
        validated=validation.validate,
    )
    make(output, "learning", making, call, blocks, lambda report: paths)


def blocks(report: LearnReport) -> list[render.Block]:
    """Return the report for people."""
    facts = (
        *words.written(report.written),
        ("components", str(report.n_components)),
        ("attractor", words.point(report.attractor, report.unit)),
        *words.proof(report.certificate),
        *words.stages(report.stages),
        *words.held_out(report.held_out, report.unit),
    )
    return [words.demonstrations(report.demonstrations, report.unit), render.Facts(facts)]
