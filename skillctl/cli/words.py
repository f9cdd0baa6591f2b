"""Numbers and reports in words that several commands share."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skillctl.cli.render import Table, table
from skillctl.simulation.arms import ARMS

if TYPE_CHECKING:
    from skillctl.adapt.report import TaskVerdict
    from skillctl.adapt.together import Refit
    from skillctl.cli.output import Output
    from skillctl.evaluate.errors import HeldOut
    from skillctl.stability.report import Certificate, Course
    from skillctl.store import DemonstrationReport
    from skillctl.usecases.destination import Written
    from skillctl.usecases.make import PartSummary

SHOWN = 0.01  # of the error of a demonstration: that it was moved by less is not worth a column
POSE_NUMBERS = 7  # x, y, z and a quaternion
NONE = "–"
SHORT_DIGEST = 12  # digits, enough to tell skills apart
MEANINGS = {  # of figures that are shown without a word about them
    "DTW": "how far the motion is from the demonstration on average, compared along their paths.",
    "rate": "proved: the distance to the target, measured by V, shrinks at least as exp(-rate · time).",
    "period": "proved: a controller that gives commands at least this often still converges.",
}


def length(value: float | None, unit: str) -> str:
    """Return a distance for people: metres in millimetres; a dash if there is none."""
    if value is None or not math.isfinite(value):
        return NONE
    return f"{1e3 * value:.2f} mm" if unit == "m" else f"{value:.4f} {unit}"


def angle(value: float | None) -> str:
    """Return an angle [rad] for people, in degrees; a dash if there is none."""
    return NONE if value is None or not math.isfinite(value) else f"{math.degrees(value):.2f}°"


def apart(distance: float | None, turned: float | None, unit: str) -> str:
    """Return a distance for people, and an angle [rad] beside it if there is one."""
    text = length(distance, unit)
    return text if turned is None else f"{text}, {angle(turned)}"


def roll_pitch_yaw(angles: Sequence[float] | None) -> str:
    """Return an orientation for people: degrees about the fixed axes x, then y, then z; a dash if none."""
    return NONE if angles is None else ", ".join(f"{math.degrees(each) + 0.0:.3g}°" for each in angles)


def state(names: Sequence[str], units: Sequence[str]) -> str:
    """Return the coordinates of a state, those of one unit together."""
    pairs = groupby(zip(names, units, strict=True), key=lambda pair: pair[1])
    return "; ".join(f"{', '.join(name for name, _ in group)} in {unit}" for unit, group in pairs)


def number(value: float | None, unit: str = "", digits: int = 3) -> str:
    """Return a number with a few significant digits; a dash if there is none."""
    if value is None or not math.isfinite(value):
        return NONE
    return f"{value:.{digits}g} {unit}".rstrip()


def seconds(value: float | None) -> str:
    """Return a duration that was seen, for people; a dash if there is none."""
    return NONE if value is None else f"{value:.2f} s"


def percent(share: float | None) -> str:
    """Return a share of one in percent; a dash if there is none."""
    return NONE if share is None else f"{share:.0%}"


def point(values: Sequence[float], unit: str = "") -> str:
    """Return coordinates as they are typed on the command line; the seven of a pose have no one unit."""
    unit = "" if len(values) == POSE_NUMBERS and unit == "m" else unit
    return f"{','.join(f'{value:.4g}' for value in values)} {unit}".rstrip()


def velocity(values: Sequence[float], units: Sequence[str]) -> str:
    """Return a velocity, coordinates of one unit together."""
    pairs = groupby(zip(values, units, strict=True), key=lambda pair: pair[1])
    return "; ".join(f"{point([value for value, _ in group])} {unit}/s" for unit, group in pairs)


def near(path: Path) -> str:
    """Return a path as one would type it here: relative where it lies below the working directory."""
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


def yes_no(value: bool | None) -> str:
    """Return ``yes``, ``no``, or a dash for what is not known."""
    return NONE if value is None else ("yes" if value else "no")


def arm(
    name: str, hand: str | None, tip: str | None, held: Mapping[str, float] | None
) -> list[tuple[str, str]]:
    """Return the facts about an arm; for one by file also its tip, and the joints that do not move."""
    parts = [name, *([] if hand is None else [f"hand {hand}"])]
    parts += [] if tip is None or name in ARMS else [f"tip {tip}"]
    facts = [("arm", ", ".join(parts))]
    if held:
        facts.append(("held joints", ", ".join(f"{joint} at {place:.4g}" for joint, place in held.items())))
    return facts


def maker(command: str, tool: str) -> str:
    """Return what made a skill: a command of a version of skillctl, or a program in Python with it."""
    return f"Python, with skillctl {tool}" if command == "python" else f"skillctl {tool} {command}"


def proof(certificate: Certificate) -> tuple[tuple[str, str], ...]:
    """Return what is proved, as facts; numbers are rounded to the side on which they stay true."""
    local = "" if certificate.scope == "global" else f" ({certificate.scope} proof)"
    facts = [("verdict", f"{certificate.verdict}{local}")]
    rate, period, frequency = rate_and_period(certificate.rate, certificate.period)
    if rate != NONE:
        facts.append(("decay rate", f"at least {rate}"))
    if period != NONE:
        facts.append(("controller period", f"up to {period} ({frequency} or faster)"))
    if certificate.all_weights:
        facts.append(("weights", "proved for all"))
    return tuple(facts)


def seconds_at_most(value: float | None) -> str:
    """Return a proved bound of a time, rounded up; a dash if there is none."""
    from skillctl.stability.report import at_most

    return NONE if value is None else f"{at_most(value)} s"


def course(bounds: Course) -> tuple[tuple[str, str], ...]:
    """Return by when a chain is done, as facts: proved, and from where."""
    from skillctl.stability.report import at_least, at_most

    ranges = zip(bounds.low, bounds.high, strict=True)
    box = ", ".join(f"{at_most(low)} … {at_least(high)}" for low, high in ranges)
    steps = "" if bounds.steps is None else f", or {bounds.steps} steps of {number(bounds.period, 's')}"
    return ("done at the latest", f"after {seconds_at_most(bounds.arrival)}{steps}"), ("from", box)


def gate(name: str, parameters: Mapping[str, float]) -> str:
    """Return a gate with its parameters."""
    return "".join([name, *(f", {parameter} {value:g}" for parameter, value in parameters.items())])


def rate_and_period(rate: float | None, period: float | None) -> tuple[str, str, str]:
    """Return a proved rate, a proved period, and that period as the frequency a controller needs."""
    from skillctl.stability.report import at_least, least_frequency

    return (
        NONE if rate is None else f"{at_least(rate)} 1/s",
        NONE if period is None else f"{at_least(period)} s",
        NONE if period is None else f"{least_frequency(period)} Hz",
    )


def margin(value: float | None, unit: str) -> str:
    """Return a margin of a clause with its sign; lengths in millimetres."""
    if value is None:
        return NONE
    scaled, unit = (1e3 * value, "mm") if unit == "m" else (value, unit)
    return f"{scaled:+.3g} {unit}"


def proved_margin(bound: float | None, unit: str) -> str:
    """Return whether a clause is proved, with the margin that is; a dash if it can only be measured."""
    return NONE if bound is None else f"{yes_no(bound >= 0)}, {margin(bound, unit)}"


def clauses(verdict: TaskVerdict, skill: str) -> Table:
    """Return a table of how a skill does a task, clause by clause."""
    columns = {
        f"{skill}: clause": lambda row: row.clause,
        "margin": lambda row: margin(row.margin, row.unit),
        "proved": lambda row: proved_margin(row.bound, row.unit),
    }
    return table(verdict.clauses, columns)


def recorded_clauses(results: Mapping[str, Any]) -> list[Table]:
    """Return a table of the clauses of the task that a skill was adapted to, if it was."""
    keys = ("clauses", "margins", "bounds", "units")
    columns = {
        "clause of its task": lambda row: row[0],
        "margin": lambda row: margin(row[1], row[3]),
        "proved": lambda row: proved_margin(row[2], row[3]),
    }
    rows = list(zip(*(results.get(key, ()) for key in keys), strict=True))
    return [table(rows, columns)] if rows else []


def held_out(errors: HeldOut | None, unit: str) -> tuple[tuple[str, str], ...]:
    """Return the errors on demonstrations left out, as facts; none if they were not asked for."""
    if errors is None:
        return ()
    mean, worst = (
        apart(distance, angle, unit)
        for distance, angle in ((errors.dtw, errors.dtw_angle), (errors.worst_dtw, errors.worst_dtw_angle))
    )
    distances = f"DTW {mean} on average; {worst} at worst"
    return (("left out", f"{distances}; {errors.arrived} of {errors.demonstrations} arrive"),)


def stages(ended: Any) -> tuple[tuple[str, str], ...]:
    """Return how the last stage of learning ended, as facts; none if no stage is recorded."""
    return tuple(("learning", stage) for stage in ended[-1:])


def warnings(sentences: Any) -> tuple[tuple[str, str], ...]:
    """Return what was wrong with what a skill was made from, as facts."""
    return tuple(("warning", sentence) for sentence in sentences)


def written(place: Written) -> tuple[tuple[str, str], ...]:
    """Return where a new skill is, and what it is."""
    name = place.skill if place.created else f"{place.skill} (unchanged)"
    return (("skill", name), ("file", near(place.path)), ("digest", place.digest))


def explain(output: Output, notes: Sequence[str], reasons: Sequence[str] = ()) -> None:
    """Say what was noticed, and why something was made."""
    for note in notes:
        output.note(f"note: {note}")
    for reason in reasons:
        output.note(f"because: {reason}")


def short(digest: str | None) -> str:
    """Return the first digits of a content digest."""
    return (digest or NONE).removeprefix("sha256:")[:SHORT_DIGEST]


def parts(summaries: Sequence[PartSummary], share: str) -> Table:
    """Return a table of what a skill was made of."""
    columns = {
        "part": lambda part: part[0],
        "skill": lambda part: part[1].skill,
        share: lambda part: f"{part[1].share:.3g}",
        "components": lambda part: part[1].n_components,
        "digest": lambda part: short(part[1].digest),
    }
    return table(enumerate(summaries, start=1), columns)


def refits(refits: Sequence[Refit], unit: str) -> list[Table]:
    """Return a table of the parts that were learned again, and what that did to their motions, if any."""
    columns = {
        "learned again": lambda refit: refit.skill,
        "DTW before": lambda refit: length(refit.dtw_before, unit),
        "DTW after": lambda refit: length(refit.dtw_after, unit),
    }
    return [table(refits, columns)] if refits else []


def demonstrations(reports: Sequence[DemonstrationReport], unit: str, *, with_leaf: bool = False) -> Table:
    """Return a table of how well each demonstration is repeated."""
    leaf = {"leaf": lambda report: report.leaf + 1} if with_leaf else {}
    moved = {
        "moved": lambda report: apart(report.moved, report.moved_angle, unit),
        "DTW unmoved": lambda report: apart(report.dtw_unmoved, report.dtw_angle_unmoved, unit),
    }
    columns = {
        **leaf,
        "demonstration": lambda report: report.source,
        "duration": lambda report: f"{report.duration:.2f} s",
        "velocity RMSE": lambda report: per_second(report.velocity_rmse, unit, report.turning_rmse),
        "DTW": lambda report: apart(report.dtw, report.dtw_angle, unit),
        **(moved if any(map(_was_moved, reports)) else {}),
        "arrives": lambda report: (
            f"no, {apart(report.end_error, report.end_angle, unit)} off"
            if report.arrived is False
            else yes_no(report.arrived)
        ),
    }
    return table(reports, columns)


def _was_moved(report: DemonstrationReport) -> bool:
    """Return whether a demonstration was moved so far that it is worth a column."""
    errors = (report.moved, report.dtw), (report.moved_angle, report.dtw_angle)
    return any((moved or 0.0) > SHOWN * (dtw or 0.0) for moved, dtw in errors)


def per_second(value: float | None, unit: str, turning: float | None = None) -> str:
    """Return a speed for people, and beside it how fast something turns, [rad/s], if it does."""
    text = length(value, unit)
    moving = text if text == NONE else f"{text}/s"
    return moving if turning is None else f"{moving}, {angle(turning)}/s"
