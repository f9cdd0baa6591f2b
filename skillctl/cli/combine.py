"""``skillctl combine``."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from skillctl.cli import options, render, words
from skillctl.cli.chain import make_chain
from skillctl.cli.making import files_of, make
from skillctl.cli.output import Output
from skillctl.compose.options import CombineOptions, HandOver

if TYPE_CHECKING:
    from skillctl.usecases.combine import CombineReport

EXAMPLES = """\b
Example:
  skillctl combine left centre right --align --target 0.63,0,0.76 --name shelf
  skillctl combine left.h5 right.h5 --priors 2,1 -o both.h5
  skillctl combine left.h5 right.h5 --calibrate -o both.h5"""

SEQUENCE = "With --gate sequence"
LOST = 0.25  # a part that loses a larger share of its left-out demonstrations is worth a warning


def combine(
    context: typer.Context,
    skills: options.Skills,
    *,
    making: options.Making,
    combining: CombineOptions,
    hand_over: Annotated[HandOver, SEQUENCE],
    no_refit: options.NoRefit = False,
    place: options.LockedPlace,
) -> None:
    """Combine skills: one of them acts at a time, chosen by where the motion starts.

    Without --align every skill keeps its own target, so that where a motion starts decides where it ends.
    """
    if (chaining := combining.chained(hand_over)) is not None:
        make_chain(context.obj, skills, making, chaining, place)
        return
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
    ends = report.targets[:1] if report.aligned else report.targets
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
    seldom = {part.part: part for part in report.coverage if part.lost > LOST * part.demonstrations}
    untried = report.status == "combined" and report.coverage_before is None
    sentences = []
    for part in seldom.values():
        if part.instead in seldom:
            more = ": both were taught from much the same places, so the start does not tell which is wanted"
        else:
            more = "; --calibrate chooses priors that give it more" if untried else ""
        sentences.append(
            f"{part.lost} of the {part.demonstrations} demonstrations of part {part.part}, left out in turn, "
            f"start where another part acts, mostly part {part.instead}{more}."
        )
    return sentences


def _coverage(report: CombineReport) -> render.Table:
    """Return what each part keeps of demonstrations that were left out, and kept before calibration."""
    columns = {
        "part": lambda part: part.part,
        "demonstrations": lambda part: part.demonstrations,
        "left out: selects it": lambda part: words.percent(part.selected),
        "and ends there": lambda part: words.percent(part.kept),
    }
    if report.coverage_before is not None:
        before = {part.part: words.percent(part.kept) for part in report.coverage_before}
        columns["with equal priors"] = lambda part: before[part.part]
    return render.table(report.coverage, columns)
