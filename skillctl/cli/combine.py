"""``skillctl combine``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from skillctl.cli import options, render, words
from skillctl.cli.output import Output

if TYPE_CHECKING:
    from skillctl.usecases.combine import CombineReport

EXAMPLES = """\b
Example:
  skillctl combine top-left top-centre top-right --align --target 0.63,0,0.76 --name shelf
  skillctl combine left.h5 right.h5 --priors 2,1 -o both.h5
  skillctl combine left.h5 right.h5 --calibrate -o both.h5"""

SELDOM = 0.5  # a part that acts at a smaller share of the starts of its demonstrations is worth a warning


def combine(
    context: typer.Context,
    skills: options.Skills,
    output_file: options.OutputFile = None,
    name: options.Name = None,
    message: options.Message = None,
    depfile: options.Depfile = None,
    if_changed: options.IfChanged = False,
    explain: options.Explain = False,
    force: options.Force = False,
    plot: options.Plot = None,
    gate: Annotated[
        options.CombineGate,
        typer.Option(
            help="latched: the acting skill is chosen at the start, and again after a disturbance; "
            "instantaneous: at every instant, without a guarantee unless aligned.",
            rich_help_panel=options.MOTION,
        ),
    ] = "latched",
    align: Annotated[
        bool,
        typer.Option(
            "--align",
            help="Move all skills to one target: where the motion starts from it decides which acts.",
            rich_help_panel=options.MOTION,
        ),
    ] = False,
    target: options.Target = None,
    priors: Annotated[
        options.Numbers | None,
        typer.Option(
            parser=options.read_numbers,
            metavar="B,B,...",
            help="How readily each skill is chosen, all positive. Default: equal.",
            rich_help_panel=options.MOTION,
        ),
    ] = None,
    calibrate: Annotated[
        bool,
        typer.Option(
            "--calibrate",
            help="Choose the priors so that motions that start where a skill was taught select it.",
            rich_help_panel=options.MOTION,
        ),
    ] = False,
    disturbance_distance: Annotated[
        float | None,
        typer.Option(
            metavar="D",
            help="A jump by more than this, in the unit of the skills, selects again. "
            "Default: 5 % of the smallest skill's extent.",
            rich_help_panel=options.MOTION,
        ),
    ] = None,
    no_refit: options.NoRefit = False,
    store: options.Store = None,
    locked: options.Locked = False,
) -> None:
    """Combine skills: one of them acts at a time, chosen by where the motion starts.

    Without --align every skill keeps its own target, so that where a motion starts decides where it ends.
    """
    from skillctl.compose.options import CombineOptions
    from skillctl.store import locate
    from skillctl.usecases.combine import combine as combine_skills
    from skillctl.usecases.target import finish_target, require_target

    output: Output = context.obj
    lock = options.chosen_lock(locked)
    require_target(output_file, depfile, if_changed)
    with output.progress("combining") as progress:
        report = combine_skills(
            skills,
            output=output_file,
            name=name,
            store=store,
            lock=lock,
            note=message,
            options=CombineOptions(priors, gate, align, target, disturbance_distance, calibrate),
            refit=not no_refit,
            force=force,
            plot=plot,
            progress=progress,
        )
    parts = [locate(part.skill, store).path for part in report.parts]
    parts += [lock.path] if lock is not None else []
    finish_target(output_file, parts, created=report.written.created, depfile=depfile, if_changed=if_changed)
    words.explain(output, report.notes, report.reasons if explain else ())
    for sentence in report.not_guaranteed:
        output.note(f"warning: not guaranteed: {sentence}")
    for sentence in _displaced(report):
        output.note(f"warning: {sentence}")
    output.result(report, lambda: blocks(report))


def blocks(report: CombineReport) -> list[render.Block]:
    """Return the report for people."""
    if report.status == "up to date":
        return [words.up_to_date(report.written.skill, "skills")]
    headings, coverage = _coverage(report)
    ends = report.attractors[:1] if report.aligned else report.attractors
    facts = (
        *words.written(report.written),
        ("gate", report.gate),
        ("attractors", "   ".join(words.point(end, report.unit) for end in ends)),
        ("selects again after", words.length(report.disturbance_distance, report.unit)),
        *words.proof(report.certificate),
    )
    again = [words.refits(report.refits, report.unit)] if report.refits else []
    return [words.parts(report.parts, "prior"), *again, render.Table(headings, coverage), render.Facts(facts)]


def _displaced(report: CombineReport) -> list[str]:
    """Return a sentence for each part that seldom acts where it was taught: a proof does not see that."""
    untried = report.status == "combined" and report.coverage_before is None
    advice = "; --calibrate chooses priors that give it more" if untried else ""
    return [
        f"part {part.part} acts at {round(part.selected * part.demonstrations)} of the {part.demonstrations} "
        f"starts of its own demonstrations, another part at the others{advice}."
        for part in report.coverage
        if part.selected < SELDOM
    ]


def _coverage(report: CombineReport) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """Return headings and rows: what each part keeps, and kept before calibration."""
    headings = ("part", "demonstrations", "start selects it", "and ends at its target")
    rows = [
        (str(part.part), str(part.demonstrations), f"{part.selected:.0%}", f"{part.kept:.0%}")
        for part in report.coverage
    ]
    if report.coverage_before is None:
        return headings, tuple(rows)
    before = [f"{part.kept:.0%}" for part in report.coverage_before]
    return (*headings, "with equal priors"), tuple((*row, b) for row, b in zip(rows, before, strict=True))
