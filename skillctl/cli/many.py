"""``skillctl simulate --episodes``: the rules of its options, and its report for people."""

from __future__ import annotations

import math
from itertools import chain
from typing import TYPE_CHECKING, Any

from skillctl.cli import render, words
from skillctl.errors import UsageError
from skillctl.options import changed

if TYPE_CHECKING:
    from skillctl.usecases.simulate_many import SimulateManyReport

SHOWN_FAILURES, SHOWN_NUMBERS = 5, 8
OF_STATES = ("final_error", "tracking_rmse")  # figures in the unit of the skill
MEDIANS = {  # figure → heading, unit
    "final_error": ("final error", "m"),
    "final_turn": ("final angle", "°"),
    "time_to_target": ("time to target", "s"),
    "tracking_rmse": ("tracking error", "m"),
    "plan_deviation": ("off the ideal path", "m"),
    "path_ratio": ("path length / ideal", ""),
    "clearance": ("clearance", "m"),
    "joint_margin": ("joint margin", "rad"),
    "manipulability": ("manipulability", ""),
    "velocity_ratio": ("joint speed / limit", ""),
    "torque_ratio": ("joint torque / limit", ""),
    "cup_moved": ("cup moved before the grasp", "m"),
}


def refuse_for_many(watching: Any) -> None:
    """Raise UsageError if an option of one episode is given."""
    for option in changed(watching):
        raise UsageError(
            f"--{option.key} is about one episode; many were asked for.",
            hint=f"Add --episode I to run one of them with --{option.key}, or see --table and --overview.",
        )


def refuse_for_one(*options: Any) -> None:
    """Raise UsageError if an option of many episodes is given."""
    for option in chain.from_iterable(map(changed, options)):
        raise UsageError(
            f"--{option.key} is about many episodes; one was asked for.", hint="Give a number: --episodes 50."
        )


def refuse_for_check(watching: Any, *others: Any) -> None:
    """Raise UsageError if an option of a run is given; a check only takes a demonstration's start."""
    for option in chain.from_iterable(map(changed, (watching, *others))):
        if option.key != "demo":
            raise UsageError(
                f"--{option.key} is about a run; with --check nothing moves.",
                hint=f"Leave out --check, or --{option.key}.",
            )


def blocks(report: SimulateManyReport) -> list[render.Block]:
    """Return the report for people."""
    low, high = report.interval
    facts = [
        ("skill", report.skill),
        *words.arm(report.arm, _hands(report), report.tip, report.held),
        (
            "successes",
            f"{report.successes} of {report.episodes}: {report.success_rate:.0%} "
            f"({report.confidence:.0%} interval {low:.1%} to {high:.1%})",
        ),
        ("enough", f"{words.yes_no(report.enough)}, {report.min_success:.0%} was asked for"),
        ("simulated", f"{report.simulated_seconds:.0f} s in {report.wall_seconds:.0f} s, seed {report.seed}"),
    ]
    if (lost := report.lost).episodes:
        again = f"{lost.again} were taken again, {lost.succeeded} of them with success"
        facts.append(("cups lost", f"{lost.episodes}; {lost.stood} then stood in reach, of which {again}"))
    files = (("table", report.table), ("overview", report.overview))
    facts += [(name, str(path)) for name, path in files if path]
    found: list[render.Block] = [render.Facts(tuple(facts))]
    if report.failures:
        found += _failures(report)
    if report.parts:
        parts = [(part.name, str(part.episodes), str(part.successes)) for part in report.parts]
        found.append(render.Table(("part that acted", "episodes", "successes"), tuple(parts)))
    medians = [
        (heading, _figure(value, unit))
        for name, (heading, hand_unit) in MEDIANS.items()
        for unit in [report.unit if name in OF_STATES else hand_unit]
        if (value := report.medians[name]) == value  # NaN: no episode has it
    ]
    found.append(render.Table(("figure", "median"), tuple(medians)))
    return found


def _figure(value: float, unit: str) -> str:
    if unit == "°":
        return f"{math.degrees(value):.2f}°"
    return words.length(value, unit) if unit == "m" else words.number(value, unit)


def _hands(report: SimulateManyReport) -> str | None:
    """Return the orientations of the hand; with their numbers of episodes if there are several."""
    if report.unit == "rad":
        return None
    if len(report.hands) < 2:
        return next(iter(report.hands), None)
    return " and ".join(f"{hand} ({count})" for hand, count in report.hands.items())


def _failures(report: SimulateManyReport) -> list[render.Block]:
    rows = []
    for kind, count in report.failures.items():
        which = [str(failed.episode) for failed in report.failed if failed.outcome == kind]
        listed = [*which[:SHOWN_NUMBERS], *(["…"] if len(which) > SHOWN_NUMBERS else [])]
        rows.append((kind, str(count), ", ".join(listed)))
    causes = [f"episode {failed.episode}: {failed.detail}" for failed in report.failed if failed.detail]
    more = len(causes) - SHOWN_FAILURES
    sentences = causes[:SHOWN_FAILURES] + ([f"and {more} more"] if more > 0 else [])
    return [
        render.Table(("failure", "episodes", "which"), tuple(rows)),
        render.Lines("what happened", tuple(sentences)),
    ]
