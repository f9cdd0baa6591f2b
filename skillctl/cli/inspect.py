"""``skillctl inspect``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skillctl.cli import options, render, words
from skillctl.cli.output import Output
from skillctl.cli.parameters import parser
from skillctl.errors import UsageError
from skillctl.options import RESULT, read_numbers

if TYPE_CHECKING:
    from skillctl.evaluate.place import Place
    from skillctl.usecases.history import Ancestor, LineageReport
    from skillctl.usecases.inspect import InspectReport, Node

EXAMPLES = """\b
Example:
  skillctl inspect reach
  skillctl inspect shelf --lineage
  skillctl inspect shelf --demos
  skillctl inspect reach --plot reach.png --html reach.html
  skillctl inspect shelf --at 0.42,0,0.55
  skillctl inspect reach@2 --json | jq '.leaves[0].joint_mixture.means'"""

MANY = 30  # demonstrations beyond which only --demos shows each


def inspect(
    context: typer.Context,
    skill: options.Skill,
    lineage: Annotated[
        bool, typer.Option("--lineage", help="Show instead what it was made from, and whether that is there.")
    ] = False,
    at: Annotated[
        Any,
        typer.Option(
            parser=parser(read_numbers),
            metavar="X,Y,Z",
            help="Show also what the skill does there: which part acts, the velocity, where the motion ends.",
        ),
    ] = None,
    demos: Annotated[
        bool, typer.Option("--demos", help="Show each demonstration of a skill with many, too.")
    ] = False,
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="F.png|svg|pdf",
            help="Draw it: field, demonstrations, motions, regions.",
            rich_help_panel=RESULT,
        ),
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option(
            metavar="F.html",
            help="Write all of it as one page: tables, pictures, proof, lineage. It needs no network.",
            rich_help_panel=RESULT,
        ),
    ] = None,
    *,
    place: options.LockedPlace,
) -> None:
    """Show what is in a skill: parts, target, what is proved, training errors, where it comes from.

    With --json also every number, including the joint Gaussian mixture over positions and velocities.
    """
    from skillctl.usecases.history import lineage as lineage_of
    from skillctl.usecases.inspect import inspect as inspect_skill

    output: Output = context.obj
    if lineage and at is not None:
        raise UsageError("--lineage and --at exclude each other.", hint="Ask for one after the other.")
    _require_places(plot, html)
    if plot is not None or html is not None:
        drawn = inspect_skill(skill, store=place.store, lock=place.lock)
        _write_files(drawn, plot, html, lambda: lineage_of(skill, store=place.store, lock=place.lock))
    if lineage:
        tree = lineage_of(skill, store=place.store, lock=place.lock)
        output.result(tree, lambda: [ancestry(tree)])
        return
    report = inspect_skill(skill, store=place.store, lock=place.lock, position=at)
    output.result(report, lambda: blocks(report, every=demos))


def _require_places(plot: Path | None, html: Path | None) -> None:
    """Raise UsageError unless the files that are asked for can be written."""
    if plot is not None:
        from skillctl.plotting.formats import require_picture

        require_picture(plot)
    if html is not None:
        from skillctl.cli.page import require_page

        require_page(html)


def _write_files(
    report: InspectReport, plot: Path | None, html: Path | None, lineage: Callable[[], LineageReport]
) -> None:
    """Write the picture and the page of a skill."""
    from skillctl.cli.page import page
    from skillctl.store import write_file
    from skillctl.usecases.pictures import picture_skill, pictures_of, reopened

    artifact = reopened(report.path, report.digest)
    if plot is not None:
        picture_skill(report.skill, artifact, plot)
    if html is not None:
        tree, pictures = lineage(), pictures_of(report.skill, artifact, report.certificate)
        written = page(report, blocks(report, for_page=True), (tree, ancestry(tree)), pictures)
        write_file(html, written.encode())


def blocks(report: InspectReport, *, for_page: bool = False, every: bool = False) -> list[render.Block]:
    """Return the report for people; for a page, which travels, without the place of the file."""
    from skillctl.evaluate.errors import HeldOut

    space, certificate = report.space, report.certificate
    facts = (
        ("skill", report.skill),
        *(() if for_page else (("file", words.near(report.path)),)),
        ("digest", report.digest),
        ("kind", " ".join([report.kind, *_how(report.tree)])),
        ("space", f"{', '.join(space.names)} in {space.unit}, frame {space.frame}"),
        *words.proof(certificate),
        *words.stages(report.operation.results.get("stages", ())),
        *words.held_out(HeldOut.recorded(report.operation.results), space.unit),
    )
    rows = tuple(
        (
            str(leaf.part),
            str(leaf.leaf),
            str(leaf.n_components),
            words.point(leaf.attractor.tolist(), space.unit),
            f"{leaf.speed:g}",
            str(leaf.demonstrations),
        )
        for leaf in report.leaves
    )
    leaves = render.Table(("part", "leaf", "components", "attractor", "speed", "demonstrations"), rows)
    all_of_them = every or for_page or (len(report.leaves) == 1 and len(report.reports) <= MANY)
    errors = (
        words.demonstrations(report.reports, space.unit, with_leaf=len(report.leaves) > 1)
        if all_of_them
        else _errors(report)
    )
    place = [_place(report.at, space.unit)] if report.at is not None else []
    regions = [_regions(report)] if report.regions else []
    tables = [leaves, *regions, *([errors] if report.reports else [])]
    return [render.Facts(facts), *place, *tables, _origin(report)]


def _errors(report: InspectReport) -> render.Table:
    """Return how well each leaf repeats its demonstrations, a row a leaf."""
    unit, rows = report.space.unit, []
    for leaf in report.leaves:
        of_leaf = [one for one in report.reports if one.leaf + 1 == leaf.leaf]
        if of_leaf:
            velocity = words.per_second(median(one.velocity_rmse or 0.0 for one in of_leaf), unit)
            distances = [one.dtw or 0.0 for one in of_leaf]
            spread = words.length(median(distances), unit), words.length(max(distances), unit)
            arrive = f"{sum(bool(one.arrived) for one in of_leaf)} of {len(of_leaf)}"
            rows.append((str(leaf.leaf), velocity, *spread, arrive))
    return render.Table(("leaf", "median velocity RMSE", "median DTW", "worst DTW", "arrive"), tuple(rows))


def _place(place: Place, unit: str) -> render.Facts:
    """Return what the skill does at one place."""
    acting = "all parts" if len(place.weights) > 1 else "the skill"
    shares = ", ".join(f"{weight:.3g}" for weight in place.weights)
    verb, when = ("arrives", "after") if place.arrives else ("has not arrived", "within")
    return render.Facts(
        (
            ("at", words.point(place.position, unit)),
            ("acts", acting if place.part is None else f"part {place.part}"),
            ("weights", shares),
            ("velocity", f"{words.point(place.velocity)} {unit}/s"),
            ("motion", f"{verb} {when} {place.time:.3g} s, at {words.point(place.end, unit)}"),
        )
    )


def _regions(report: InspectReport) -> render.Table:
    """Return the regions of influence of a combined skill's parts."""
    rows = tuple(
        (
            str(region.part),
            f"{region.prior:.3g}",
            words.point(region.attractor, report.space.unit),
            words.NONE if region.selected is None else f"{region.selected:.0%}",
            words.length(region.radius, report.space.unit),
        )
        for region in report.regions
    )
    return render.Table(("region", "prior", "ends at", "own starts in it", "proved radius"), rows)


def ancestry(report: LineageReport) -> render.Block:
    """Return what a skill was made from, as an indented list."""
    rows = tuple(_ancestors(report.lineage, 0))
    return render.Table(("skill", "role", "there", "made by", "digest", "note"), rows)


def _ancestors(ancestor: Ancestor, depth: int) -> Iterator[tuple[str, ...]]:
    yield (
        f"{'  ' * depth}{ancestor.skill}",
        ancestor.role,
        ancestor.presence,
        ancestor.command or words.NONE,
        words.short(ancestor.digest),
        ancestor.note or words.NONE,
    )
    for parent in ancestor.parents:
        yield from _ancestors(parent, depth + 1)


def _how(node: Node) -> list[str]:
    """Return how the parts of a skill act together."""
    if node.gate is None:
        return []
    shares = ", ".join(f"{part.share:.3g}" for part in node.parts)
    gate = words.gate(node.gate, node.parameters)
    return [f"({gate}; shares {shares}; speed {node.speed:g})"]


def _origin(report: InspectReport) -> render.Facts:
    provenance = report.provenance
    items = [("made by", words.maker(report.operation.command, provenance.tool))]
    items += [(parent.role, f"{parent.shown}  {words.short(parent.digest)}") for parent in provenance.parents]
    items += [
        ("input", f"{file.path}  {file.importer}  {words.short(file.sha256)}") for file in provenance.inputs
    ]
    return render.Facts(tuple(items))
