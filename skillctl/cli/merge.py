"""``skillctl merge``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from skillctl.cli import options, render, words
from skillctl.cli.output import Output

if TYPE_CHECKING:
    from skillctl.usecases.merge import MergeReport

EXAMPLES = """\b
Example:
  skillctl merge bottom-left top-centre --target 0.63,0.28,0.76 --name top-left
  skillctl merge a.h5 b.h5 --weights 2,1 --gate experts --sharpness 4 -o c.h5"""

ORIGINS = {
    "shared": "all parts were learned under one already",
    "found": "one was found for all parts",
    "refitted": "none exists for the parts as they were: they were learned again under one",
}


def merge(
    context: typer.Context,
    skills: options.Skills,
    output_file: options.OutputFile = None,
    name: options.Name = None,
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
    no_refit: Annotated[
        bool,
        typer.Option(
            "--no-refit",
            help="Refuse skills that cannot be proved together as they are, instead of learning them again "
            "from the demonstrations they carry.",
            rich_help_panel=options.MOTION,
        ),
    ] = False,
    store: options.Store = None,
) -> None:
    """Merge skills: all of them act together on one target, and the result is proved stable.

    The target is --target, else the weighted mean of the skills' targets. Combined skills cannot be merged.
    """
    from skillctl.usecases.merge import MergeOptions
    from skillctl.usecases.merge import merge as merge_skills

    output: Output = context.obj
    with output.progress("merging") as progress:
        report = merge_skills(
            skills,
            output=output_file,
            name=name,
            store=store,
            options=MergeOptions(weights, gate, sharpness, speed, target),
            refit=not no_refit,
            progress=progress,
        )
    for note in report.notes:
        output.note(f"note: {note}")
    output.result(report, lambda: blocks(report))


def blocks(report: MergeReport) -> list[render.Block]:
    """Return the report for people."""
    blocks: list[render.Block] = [words.parts(report.parts, "weight")]
    if report.refits:
        rows = tuple(
            (
                refit.skill,
                words.length(refit.dtw_before, report.unit),
                words.length(refit.dtw_after, report.unit),
            )
            for refit in report.refits
        )
        blocks.append(render.Table(("learned again", "DTW before", "DTW after"), rows))
    gate = report.gate if report.gate != "experts" else f"experts, sharpness {report.sharpness:g}"
    facts = (
        *words.written(report.skill, report.path, report.digest, report.created),
        ("gate", gate),
        ("speed", f"{report.speed:g}"),
        ("attractor", words.point(report.attractor, report.unit)),
        ("Lyapunov matrix", ORIGINS[report.lyapunov]),
        *words.proof("stable", report.rate, report.period),
    )
    return [*blocks, render.Facts(facts)]
