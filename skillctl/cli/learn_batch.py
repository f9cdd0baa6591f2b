"""``skillctl learn --batch``: its options' rules, and its report for people."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from skillctl.cli import render, words
from skillctl.cli.errors import describe
from skillctl.cli.exit_codes import ExitCode
from skillctl.cli.options import Making, Place, Work
from skillctl.cli.output import Output
from skillctl.errors import UsageError

if TYPE_CHECKING:
    from skillctl.usecases.learn_many import LearnManyReport, SkillOutcome

# What is said once for all skills; all other options of `learn` stand in the manifest.
FOR_ALL = {"batch", "store", "force", "explain", "jobs", "backend", "scheduler"}
WORK = {"jobs", "backend", "scheduler"}


def require_one_kind(context: Any, batch: Path | None) -> None:
    """Refuse options that are about one skill where many are asked for, and the other way round.

    Raises:
        UsageError: One of them was given.
    """
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name)
        if source is None or source.name != "COMMANDLINE":
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


def learn_batch(output: Output, manifest: Path, making: Making, place: Place, work: Work) -> ExitCode:
    """Learn the skills of a manifest, tell about them, and return the exit code: the worst of all."""
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
    output.result(report, lambda: blocks(report))
    failures = [describe(each.error) for each in report.skills if each.error is not None]
    output.failures(failures, len(report.skills), "learned")
    return max((failure.code for failure in failures), default=ExitCode.DONE)


def blocks(report: LearnManyReport) -> list[render.Block]:
    """Return the report for people."""
    headings = ("skill", "outcome", "components", "DTW", "rate", "controller ≥", "digest")
    return [render.Table(headings, tuple(map(_row, report.skills)))]


def _row(outcome: SkillOutcome) -> tuple[str, ...]:
    from skillctl.evaluate.errors import mean_dtw  # late: it imports NumPy

    report = outcome.report
    if report is None:
        return (outcome.skill, outcome.outcome, *[words.NONE] * 5)
    rate, _, frequency = words.rate_and_period(report.certificate.rate, report.certificate.period)
    distance, skill = words.length(mean_dtw(report.demonstrations), report.unit), report.written
    learned = (str(report.n_components), distance, rate, frequency)
    return (skill.skill, outcome.outcome, *learned, words.short(skill.digest))
