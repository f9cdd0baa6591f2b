"""``skillctl learn``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skillctl.cli import options, render, words
from skillctl.cli.errors import describe
from skillctl.cli.exit_codes import ExitCode
from skillctl.cli.making import make
from skillctl.cli.output import Output
from skillctl.cli.parameters import was_typed
from skillctl.demonstrations.formats import described, files_of
from skillctl.demonstrations.options import Reading
from skillctl.errors import UsageError
from skillctl.learning.options import LearnOptions
from skillctl.usecases.options import Robot, Validation

if TYPE_CHECKING:
    from skillctl.usecases.learn import LearnReport
    from skillctl.usecases.learn_many import LearnManyReport, SkillOutcome

EXAMPLES = """\b
Example:
  skillctl learn reach-*.csv --name reach
  skillctl learn rec.csv --columns x=a,y=b,z=c --units mm -o reach.h5
  skillctl learn low_dim.hdf5 --demos 0-19 --name lift
  skillctl learn *.bag --topic /joint_states --arm robot.urdf --name reach
  skillctl learn reach-*.csv --name reach --validate --plot reach.svg
  skillctl learn GShape.mat --name g --objective likelihood --metric euclidean
  skillctl learn --batch manifest.toml --jobs 4"""

# What is said once for all skills; all other options of `learn` stand in the manifest.
FOR_ALL = {"batch", "store", "force", "explain", "jobs", "backend", "scheduler", "patience"}
WORK = {"jobs", "backend", "scheduler", "patience"}


def learn(
    context: typer.Context,
    data: Annotated[
        list[str] | None, typer.Argument(metavar="DATA...", help=f"Files with demonstrations: {described()}.")
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
    robot: Robot,
    learning: LearnOptions,
    validation: Validation,
) -> None:
    """Learn a skill from demonstrations, prove it stable, and write it.

    Nothing is written unless the proof holds. The same files and options give the same bytes; learning them
    again says "up to date" and only sets the time of FILE.h5.
    """
    from skillctl.usecases.learn import learn as learn_skill

    output: Output = context.obj
    _require_one_kind(context, batch)
    if batch is not None:
        raise typer.Exit(_learn_batch(output, batch, making, place, work))
    if not data:
        raise UsageError(
            "no demonstrations are given.", hint="Name their files, or list many with --batch F.toml."
        )
    paths = [Path(path) for path in data]
    files = [file for path in paths for file in files_of(path)]
    call = partial(
        learn_skill,
        paths,
        store=place.store,
        options=learning,
        reading=reading,
        robot=robot,
        validated=validation.validate,
    )
    make(output, "learning", making, call, blocks, lambda report: [*files, *robot.files])


def blocks(report: LearnReport) -> list[render.Block]:
    """Return the report for people."""
    facts = (
        *words.written(report.written),
        ("components", str(report.n_components)),
        ("attractor", words.point(report.target, report.unit)),
        *words.proof(report.certificate),
        *words.stages(report.stages),
        *words.held_out(report.held_out, report.unit),
    )
    return [words.demonstrations(report.demonstrations, report.unit), render.Facts(facts)]


def _require_one_kind(context: Any, batch: Path | None) -> None:
    """Refuse options that are about one skill where many are to be learned, and the other way round.

    Raises:
        UsageError: One of them was given.
    """
    for parameter in context.command.params:
        if not was_typed(context, parameter.name):
            continue
        if batch is not None and parameter.param_type_name == "argument":
            raise UsageError("DATA and --batch exclude each other.", hint="The manifest names the files.")
        if batch is not None and parameter.expose_value and parameter.name not in FOR_ALL:
            raise UsageError(
                f"{parameter.opts[0]} is about one skill; --batch learns many.",
                hint="Say it in the manifest: for one in its [[skills]], for all in [options].",
            )
        if batch is None and parameter.name in WORK:
            raise UsageError(f"{parameter.opts[0]} is about many skills.", hint="List them: --batch F.toml.")


def _learn_batch(
    output: Output, manifest: Path, making: options.Making, place: options.Place, work: options.Work
) -> ExitCode:
    """Learn the skills of a manifest, report them, and return the exit code: the largest of all."""
    from skillctl.usecases.learn_many import learn_many

    with output.progress("learning") as progress:
        report = learn_many(
            manifest, store=place.store, force=making.force, workers=work.workers(), progress=progress
        )
    for each in report.skills:
        if (made := each.report) is not None:
            named = [f"{each.skill}: {note}" for note in made.notes]
            reasons = [f"{each.skill}: {reason}" for reason in made.reasons if making.explain]
            words.explain(output, named, reasons)
            for sentence in made.warnings:
                output.warning(f"{each.skill}: {sentence}")
    output.result(report, lambda: [_table(report)])
    failures = [describe(each.error) for each in report.skills if each.error is not None]
    output.failures(failures, len(report.skills), "learned")
    return max((failure.code for failure in failures), default=ExitCode.DONE)


def _table(report: LearnManyReport) -> render.Table:
    """Return the report on many skills for people."""
    headings = ("skill", "outcome", "components", "DTW", "rate", "controller ≥", "digest")
    return render.Table(headings, tuple(map(_row, report.skills)))


def _row(outcome: SkillOutcome) -> tuple[str, ...]:
    from skillctl.evaluate.errors import mean_dtw  # late: it imports NumPy

    report = outcome.report
    if report is None:
        return (outcome.skill, outcome.outcome, *[words.NONE] * 5)
    rate, _, frequency = words.rate_and_period(report.certificate.rate, report.certificate.period)
    distance, skill = words.length(mean_dtw(report.demonstrations), report.unit), report.written
    learned = (str(report.n_components), distance, rate, frequency)
    return (skill.skill, outcome.outcome, *learned, words.short(skill.digest))
