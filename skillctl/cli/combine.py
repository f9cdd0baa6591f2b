"""``skillctl combine``."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import typer

from skillctl.cli import options, render, words
from skillctl.cli.making import files_of, make
from skillctl.cli.output import Output
from skillctl.compose.options import CombineOptions

if TYPE_CHECKING:
    from skillctl.usecases.combine import CombineReport

EXAMPLES = """\b
Example:
  skillctl combine left centre right --align --target 0.63,0,0.76 --name shelf
  skillctl combine left.h5 right.h5 --priors 2,1 -o both.h5
  skillctl combine left.h5 right.h5 --calibrate -o both.h5"""

SELDOM = 0.5  # a part that acts at a smaller share of the starts of its demonstrations is worth a warning


def combine(
    context: typer.Context,
    skills: options.Skills,
    *,
    making: options.Making,
    combining: CombineOptions,
    no_refit: options.NoRefit = False,
    place: options.LockedPlace,
) -> None:
    """Combine skills: one of them acts at a time, chosen by where the motion starts.

    Without --align every skill keeps its own target, so that where a motion starts decides where it ends.
    """
    from skillctl.usecases.combine import combine as combine_skills

    call = partial(
        combine_skills, skills, store=place.store, lock=place.lock, options=combining, refit=not no_refit
    )
    output: Output = context.obj
    report = make(output, "combining", making, call, blocks, lambda report: files_of(report.parts, place))
    guaranteed = [f"not guaranteed: {sentence}" for sentence in report.not_guaranteed]
    for sentence in (*guaranteed, *_displaced(report)):
        output.note(f"warning: {sentence}")


def blocks(report: CombineReport) -> list[render.Block]:
    """Return the report for people."""
    ends = report.attractors[:1] if report.aligned else report.attractors
    facts = (
        *words.written(report.written),
        ("gate", report.gate),
        ("attractors", "   ".join(words.point(end, report.unit) for end in ends)),
        ("selects again after", words.length(report.disturbance_distance, report.unit)),
        *words.proof(report.certificate),
    )
    again = words.refits(report.refits, report.unit)
    return [words.parts(report.parts, "prior"), *again, _coverage(report), render.Facts(facts)]


def _displaced(report: CombineReport) -> list[str]:
    """Return a sentence for each part that seldom acts where it was taught: a proof does not show that."""
    untried = report.status == "combined" and report.coverage_before is None
    advice = "; --calibrate chooses priors that give it more" if untried else ""
    return [
        f"part {part.part} acts at {round(part.selected * part.demonstrations)} of the {part.demonstrations} "
        f"starts of its own demonstrations, another part at the others{advice}."
        for part in report.coverage
        if part.selected < SELDOM
    ]


def _coverage(report: CombineReport) -> render.Table:
    """Return what each part keeps of its demonstrations, and kept before calibration."""
    columns = {
        "part": lambda part: part.part,
        "demonstrations": lambda part: part.demonstrations,
        "start selects it": lambda part: words.percent(part.selected),
        "and ends at its target": lambda part: words.percent(part.kept),
    }
    if report.coverage_before is not None:
        before = {part.part: words.percent(part.kept) for part in report.coverage_before}
        columns["with equal priors"] = lambda part: before[part.part]
    return render.table(report.coverage, columns)
