"""``skillctl diff``."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skillctl.cli import options, render, words
from skillctl.cli.exit_codes import ExitCode
from skillctl.cli.output import Output

if TYPE_CHECKING:
    from skillctl.evaluate.comparison import FieldDifference
    from skillctl.evaluate.stage_comparison import StageDifference
    from skillctl.usecases.diff import DiffReport

EXAMPLES = """\b
Example:
  skillctl diff reach@1 reach@2
  skillctl diff reach.h5 reach@release --exit-code --atol 1e-4

Exit codes: 0 compared; 1 with --exit-code: behaviour or certificate differ by more than the tolerances."""

SHOWN = 46  # characters of a value in the table
REPORTS = "reports."  # three numbers a demonstration, which differ whenever skills do


def diff(
    context: typer.Context,
    first: Annotated[str, typer.Argument(metavar="A", help=options.SKILL)],
    second: Annotated[str, typer.Argument(metavar="B", help=options.SKILL)],
    exit_code: Annotated[
        bool, typer.Option("--exit-code", help="Exit 1 if they behave differently.")
    ] = False,
    atol: Annotated[
        float,
        typer.Option(
            metavar="X",
            help="Positions, angles, velocities and rates may differ by this much, in SI units.",
        ),
    ] = 1e-9,
    rtol: Annotated[
        float, typer.Option(metavar="X", help="They may also differ by this share of their value in A.")
    ] = 1e-9,
    *,
    place: options.LockedPlace,
) -> None:
    """Compare two skills: metadata, numbers, how they move, what is proved.

    Components are matched before they are compared. Motions are compared on the demonstrations that the
    skills carry and on a grid around them. Behaviour and certificate alone decide whether they differ.
    """
    from skillctl.usecases.diff import diff as diff_skills

    output: Output = context.obj
    report = diff_skills(first, second, atol=atol, rtol=rtol, store=place.store, lock=place.lock)
    output.result(report, lambda: blocks(report))
    if exit_code and report.differs:
        raise typer.Exit(ExitCode.NEGATIVE)


def blocks(report: DiffReport) -> list[render.Block]:
    """Return the report for people."""
    named = (("a", report.a), ("b", report.b))
    sides = tuple((letter, f"{side.skill}  {words.short(side.digest)}") for letter, side in named)
    if report.identical:
        return [render.Facts((*sides, ("result", "identical")))]
    shown = [change for change in report.metadata if not change.field.startswith(REPORTS)]
    changes = [(change.field, _shown(change.a), _shown(change.b)) for change in shown]
    if left := len(report.metadata) - len(shown):
        changes.append(("training errors", f"{left} differ; --json has them", words.NONE))
    result = "they behave differently" if report.differs else "they behave the same"
    return [
        render.Facts(sides),
        render.Table(("metadata", "a", "b"), tuple(changes)),
        *([_stages(report)] if report.stages else []),
        _numbers(report),
        render.Facts((*_motion(report), ("proved", _proofs(report)), ("result", result))),
    ]


def _stages(report: DiffReport) -> render.Table:
    """Return what has become of each stage of a chain."""

    def motion(stage: StageDifference) -> str:
        if stage.a is None or stage.b is None:
            return "only in b" if stage.a is None else "only in a"
        return "the same" if stage.same_motion else "another"

    columns = {
        "stage of a": lambda stage: words.NONE if stage.a is None else stage.a,
        "of b": lambda stage: words.NONE if stage.b is None else stage.b,
        "motion": motion,
        "targets apart": lambda stage: words.apart(stage.target, stage.target_angle, report.unit),
        "level": lambda stage: _became(*(words.number(level) for level in stage.levels)),
        "events": lambda stage: _became(*(", ".join(each or ()) or words.NONE for each in stage.events)),
    }
    return render.table(report.stages, columns)


def _became(before: str, after: str) -> str:
    return before if before == after else f"{before} → {after}"


def _numbers(report: DiffReport) -> render.Block:
    if report.leaves is None:
        return "Not made of equally many leaves in one space: their numbers are not compared."
    columns = {
        "leaf": lambda leaf: leaf.leaf,
        "unmatched": lambda leaf: leaf.unmatched,
        "attractor": lambda leaf: words.apart(leaf.attractor, leaf.attractor_angle, report.unit),
        "priors": lambda leaf: words.number(leaf.priors),
        "means": lambda leaf: words.apart(leaf.means, leaf.means_angle, report.unit),
        "covariances": lambda leaf: f"{leaf.covariances:.2%}",
        "matrices": lambda leaf: f"{leaf.system_matrices:.2%}",
        "Lyapunov": lambda leaf: f"{leaf.lyapunov:.2%}",
        "coordinates": lambda leaf: "same" if leaf.coordinates else "other",
    }
    return render.table(report.leaves, columns)


def _motion(report: DiffReport) -> list[tuple[str, str]]:
    behaviour, unit = report.behaviour, report.unit
    if behaviour.incomparable == "other spaces":
        return [("behaviour", "not comparable: they live in different spaces")]
    fields = [
        ("velocity on demonstrations", _field(behaviour.demonstrations, unit)),
        ("velocity on a grid", _field(behaviour.grid, unit)),
    ]
    if behaviour.incomparable == "other stages":
        fields = [("velocity", "not comparable: they have other stages")]
    return [
        *fields,
        ("motions apart", words.apart(behaviour.rollouts, behaviour.rollouts_angle, unit)),
        ("attractors apart", words.apart(behaviour.attractors, behaviour.attractors_angle, unit)),
    ]


def _field(difference: FieldDifference | None, unit: str) -> str:
    if difference is None:
        return words.NONE
    greatest = words.per_second(difference.greatest, unit, difference.greatest_turn)
    speed = words.per_second(difference.speed, unit, difference.turn)
    return f"{greatest} apart at most, of {speed} ({difference.points} points)"


def _proofs(report: DiffReport) -> str:
    said = []
    for certificate in report.certificates:
        rate, period, _ = words.rate_and_period(certificate.rate, certificate.period)
        said.append(f"{certificate.verdict}, {certificate.scope}, rate {rate}, period {period}")
    return said[0] if said[0] == said[1] else f"a: {said[0]}; b: {said[1]}"


def _shown(value: Any) -> str:
    """Return a metadata value in one short line."""
    if isinstance(value, float):
        return f"{value:.6g}"
    text = words.NONE if value is None else json.dumps(value, ensure_ascii=False).strip('"')
    return text if len(text) <= SHOWN else f"{text[: SHOWN - 1]}…"
