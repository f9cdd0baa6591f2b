"""``skillctl chain``."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import typer

from skillctl.cli import options, render, words
from skillctl.cli.making import files_of, make
from skillctl.cli.output import Output
from skillctl.compose.options import ChainOptions

if TYPE_CHECKING:
    from skillctl.usecases.chain import ChainReport

EXAMPLES = """\b
Example:
  skillctl chain approach retreat --event 1:close --within 2:2cm --name take
  skillctl chain take carry leave --within 5mm --on-jump back -o cup.h5
  skillctl chain reach reach --target 2=0.62,-0.1,0.76 --name twice"""


def chain(
    context: typer.Context,
    skills: options.Skills,
    *,
    making: options.Making,
    chaining: ChainOptions,
    place: options.LockedPlace,
) -> None:
    """Chain skills: one acts after the other, each towards its own target, with events between them.

    A stage is over as near to its target as --within says; then come its events, and the next stage. Nothing
    is written unless every stage is proved from wherever the one before it can be over.
    """
    make_chain(context.obj, skills, making, chaining, place)


def make_chain(
    output: Output,
    skills: list[str],
    making: options.Making,
    chaining: ChainOptions,
    place: options.LockedPlace,
) -> None:
    """Chain skills, and show the report."""
    from skillctl.usecases.chain import chain as chain_skills

    call = partial(chain_skills, skills, store=place.store, lock=place.lock, options=chaining)
    make(output, "chaining", making, call, blocks, lambda report: files_of(report.parts, place))


def blocks(report: ChainReport) -> list[render.Block]:
    """Return the report for people."""
    course = report.certificate.course
    assert course is not None  # a chain without one is not written
    jump = words.length(report.disturbance_distance, report.unit)
    facts = (
        *words.written(report.written),
        ("after a jump", f"{report.on_jump} (it is one from {jump} on)"),
        *words.proof(report.certificate),
        *words.course(course),
    )
    columns = {
        # where and by when each stage is over, and what happens then
        "stage": lambda row: row[1].stage,
        "skill": lambda row: row[0].skill,
        "target": lambda row: "   ".join(words.point(end, report.unit) for end in row[0].targets),
        "over within": lambda row: words.length(row[1].within, report.unit),
        "at the latest after": lambda row: words.seconds_at_most(row[1].arrival),
        "then": lambda row: ", ".join(row[0].events) or words.NONE,
        "digest": lambda row: words.short(row[0].digest),
    }
    return [render.table(zip(report.parts, course.stages, strict=True), columns), render.Facts(facts)]
