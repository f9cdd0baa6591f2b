"""``skillctl inspect``."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import typer

from skillctl.cli import options, render, words
from skillctl.cli.output import Output
from skillctl.errors import UsageError
from skillctl.options import RESULT, option, read_numbers

if TYPE_CHECKING:
    from skillctl.evaluate.place import Place, Region
    from skillctl.evaluate.timeline import Timeline
    from skillctl.store import DemonstrationReport
    from skillctl.usecases.history import Ancestor, LineageReport
    from skillctl.usecases.inspect import InspectReport, Node, StateMeaning

EXAMPLES = """\b
Example:
  skillctl inspect reach
  skillctl inspect shelf --lineage
  skillctl inspect shelf --demos
  skillctl inspect reach --plot reach.png --html reach.html
  skillctl inspect shelf --at 0.42,0,0.55
  skillctl inspect reach@2 --json | jq '.leaves[0].joint_mixture.means'"""

MANY = 30  # demonstrations beyond which only --demos shows each


@dataclass(frozen=True)
class Shown:
    """What is shown of a skill, and where."""

    lineage: bool = option(
        False, help="Show instead what it was made from, and whether each of these skills is present."
    )
    at: tuple[float, ...] | None = option(
        read=read_numbers,
        metavar="X,Y,Z[,QX,QY,QZ,QW]",
        help="Show also what the skill does there: which part acts, the velocity, where the motion ends.",
    )
    demos: bool = option(False, help="Show every demonstration, also where there are many.")
    plot: Path | None = option(
        metavar="F.png|svg|pdf", group=RESULT, help="Draw it: field, demonstrations, motions, regions."
    )
    html: Path | None = option(
        metavar="F.html",
        group=RESULT,
        help="Write all of it as one page: tables, pictures, proof, lineage. It needs no network.",
    )


def inspect(
    context: typer.Context, skill: options.Skill, *, shown: Shown, place: options.LockedPlace
) -> None:
    """Show what is in a skill: parts, target, what is proved, training errors, where it comes from.

    With --json also every number, including the joint Gaussian mixture over positions and velocities.
    """
    from skillctl.cli.page import require_page
    from skillctl.plotting.formats import require_picture
    from skillctl.usecases.history import lineage as lineage_of
    from skillctl.usecases.inspect import inspect as inspect_skill

    output: Output = context.obj
    if shown.lineage and shown.at is not None:
        raise UsageError("--lineage and --at exclude each other.", hint="Ask for one after the other.")
    if shown.plot is not None:
        require_picture(shown.plot)
    if shown.html is not None:
        require_page(shown.html)
    if shown.plot is not None or shown.html is not None:
        drawn = inspect_skill(skill, store=place.store, lock=place.lock)
        _write_files(drawn, shown, lambda: lineage_of(skill, store=place.store, lock=place.lock))
    if shown.lineage:
        tree = lineage_of(skill, store=place.store, lock=place.lock)
        output.result(tree, lambda: [ancestry(tree)])
        return
    report = inspect_skill(skill, store=place.store, lock=place.lock, position=shown.at)
    output.result(report, lambda: blocks(report, every=shown.demos))


def _write_files(report: InspectReport, shown: Shown, lineage: Callable[[], LineageReport]) -> None:
    """Write the picture and the page of a skill."""
    from skillctl.cli.page import page
    from skillctl.store import write_file
    from skillctl.usecases.pictures import picture_skill, pictures_of, reopened

    artifact = reopened(report.path, report.digest)
    if shown.plot is not None:
        picture_skill(report.skill, artifact, shown.plot)
    if shown.html is not None:
        tree, pictures = lineage(), pictures_of(report.skill, artifact, report.certificate)
        written = page(report, blocks(report, for_page=True), (tree, ancestry(tree)), pictures)
        write_file(shown.html, written.encode())


def blocks(report: InspectReport, *, for_page: bool = False, every: bool = False) -> list[render.Block]:
    """Return the report for people; for a page, which travels, without the place of the file."""
    from skillctl.evaluate.errors import HeldOut

    space, unit, results = report.space, report.space.unit, report.operation.results
    chain, part = report.timeline, "part" if report.timeline is None else "stage"
    facts = (
        ("skill", report.skill),
        *(() if for_page else (("file", words.near(report.path)),)),
        ("digest", report.digest),
        *((("kind", " ".join([report.kind, *_how(report.tree)])),) if chain is None else _chain(chain, unit)),
        ("space", f"{words.state(space.names, space.units)}, frame {space.frame}"),
        *([] if space.length is None else [("one radian", f"counts as {words.length(space.length, unit)}")]),
        *words.proof(report.certificate),
        *(() if report.certificate.course is None else words.course(report.certificate.course)),
        *words.stages(results.get("stages", ())),
        *words.held_out(HeldOut.recorded(results), unit),
        *words.warnings(results.get("warnings", ())),
    )
    found: list[render.Block] = [render.Facts(facts), *words.recorded_clauses(results)]
    if report.at is not None:
        found.append(_place(report.at, space))
    if chain is not None:
        found.append(_timeline(chain, unit))
    turned = {"roll, pitch, yaw": lambda leaf: words.roll_pitch_yaw(leaf.roll_pitch_yaw)}
    leaves = {
        part: lambda leaf: leaf.part,
        "leaf": lambda leaf: leaf.leaf,
        "components": lambda leaf: leaf.n_components,
        "shears": lambda leaf: leaf.shears or words.NONE,
        "attractor": lambda leaf: words.point(leaf.target, unit),
        **({} if space.length is None else turned),
        "speed": lambda leaf: f"{leaf.speed:g}",
        "demonstrations": lambda leaf: leaf.demonstrations,
    }
    found.append(render.table(report.leaves, leaves))
    if report.regions:
        found.append(_regions(report.regions, unit))
    if report.reports:
        each = every or for_page or (len(report.leaves) == 1 and len(report.reports) <= MANY)
        several = len(report.leaves) > 1
        found.append(
            words.demonstrations(report.reports, unit, with_leaf=several) if each else _errors(report)
        )
    return [*found, _origin(report)]


def _errors(report: InspectReport) -> render.Table:
    """Return how well each leaf repeats its demonstrations, a row a leaf."""
    unit, reports = report.space.unit, report.reports
    taught = sorted({one.leaf for one in reports})
    columns = {
        "leaf": lambda of_leaf: of_leaf[0].leaf + 1,
        "median velocity RMSE": lambda of_leaf: words.per_second(
            _of(median, of_leaf, "velocity_rmse"), unit, _of(median, of_leaf, "turning_rmse")
        ),
        "median DTW": lambda of_leaf: words.apart(
            _of(median, of_leaf, "dtw"), _of(median, of_leaf, "dtw_angle"), unit
        ),
        "worst DTW": lambda of_leaf: words.apart(
            _of(max, of_leaf, "dtw"), _of(max, of_leaf, "dtw_angle"), unit
        ),
        "arrive": lambda of_leaf: f"{sum(bool(one.arrived) for one in of_leaf)} of {len(of_leaf)}",
    }
    return render.table([[one for one in reports if one.leaf == leaf] for leaf in taught], columns)


def _of(
    measure: Callable[[list[float]], float], reports: Sequence[DemonstrationReport], error: str
) -> float | None:
    """Return the median or largest of an error over reports; None where it is known of none."""
    known = [value for value in (getattr(report, error) for report in reports) if value is not None]
    return measure(known) if known else None


def _place(place: Place, space: StateMeaning) -> render.Facts:
    """Return what the skill does at one place."""
    unit = space.unit
    acting = "all parts" if len(place.weights) > 1 else "the skill"
    how = [("acts", acting if place.part is None else f"part {place.part}")]
    how.append(("weights", _listed(place.weights)))
    if place.stages is not None:
        here, after = place.stages
        how = [("acts", f"stage {here}, of a motion that starts here")]
        how.append(("goes on", f"stage {after}, after a jump here in the last stage"))
    verb, when = ("arrives", "after") if place.arrives else ("has not arrived", "within")
    return render.Facts(
        (
            ("at", words.point(place.given, unit)),
            *how,
            ("velocity", words.velocity(place.velocity, space.units)),
            ("motion", f"{verb} {when} {place.time:.3g} s, at {words.point(place.given_end, unit)}"),
        )
    )


def _chain(chain: Timeline, unit: str) -> tuple[tuple[str, str], ...]:
    """Return what a chain is, as facts."""
    far = words.length(chain.disturbance_distance, unit)
    jumps = {
        "stay": "the stage goes on from there",
        "back": "that stage goes on, of those begun, which was taught nearest to there",
    }
    seen = f"with all waits, seen from {chain.starts} starts"
    return (
        ("kind", f"chain of {len(chain.stages)} stages"),
        ("takes", f"{words.seconds(chain.duration)} {seen}"),
        ("after a jump", f"of more than {far}: {jumps[chain.on_jump]}"),
    )


def _timeline(chain: Timeline, unit: str) -> render.Table:
    """Return the stages of a chain, one after the other."""
    columns = {
        "stage": lambda stage: stage.stage,
        "skill": lambda stage: stage.skill or words.NONE,
        "begins": lambda stage: words.seconds(stage.begins),
        "takes": lambda stage: words.seconds(stage.duration),
        "at most": lambda stage: words.seconds_at_most(stage.bound),
        "ends at": lambda stage: " or ".join(words.point(target, unit) for target in stage.targets),
        "within": lambda stage: words.length(stage.within, unit),
        "then": lambda stage: ", ".join(stage.events) or words.NONE,
    }
    return render.table(chain.stages, columns)


def _regions(regions: Sequence[Region], unit: str) -> render.Table:
    """Return the regions of influence of a combined skill's parts."""
    columns = {
        "region": lambda region: region.part,
        "prior": lambda region: f"{region.prior:.3g}",
        "ends at": lambda region: words.point(region.target, unit),
        "left-out starts in it": lambda region: words.percent(region.selected),
        "proved radius": lambda region: words.length(region.radius, unit),
    }
    return render.table(regions, columns)


def ancestry(report: LineageReport) -> render.Table:
    """Return what a skill was made from, as an indented list."""
    columns = {
        "skill": lambda found: f"{'  ' * found[0]}{found[1].skill}",
        "role": lambda found: found[1].role,
        "there": lambda found: found[1].presence,
        "made by": lambda found: found[1].command or words.NONE,
        "digest": lambda found: words.short(found[1].digest),
        "note": lambda found: found[1].note or words.NONE,
    }
    return render.table(_ancestors(report.lineage, 0), columns)


def _ancestors(ancestor: Ancestor, depth: int) -> Iterator[tuple[int, Ancestor]]:
    yield depth, ancestor
    for parent in ancestor.parents:
        yield from _ancestors(parent, depth + 1)


def _how(node: Node) -> list[str]:
    """Return how the parts of a skill act together."""
    if node.gate is None:
        return []
    shares = _listed([part.share for part in node.parts])
    return [f"({words.gate(node.gate, node.parameters)}; shares {shares}; speed {node.speed:g})"]


def _listed(shares: Sequence[float]) -> str:
    return ", ".join(f"{share:.3g}" for share in shares)


def _origin(report: InspectReport) -> render.Facts:
    """Return what made a skill, and from what."""
    provenance = report.provenance
    items = [("made by", words.maker(report.operation.command, provenance.tool))]
    items += [(parent.role, f"{parent.shown}  {words.short(parent.digest)}") for parent in provenance.parents]
    items += [
        ("input", f"{file.path}  {file.importer}  {words.short(file.sha256)}") for file in provenance.inputs
    ]
    return render.Facts(tuple(items))
