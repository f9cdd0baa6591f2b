"""``skillctl run``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from skillctl.cli import options, render, words
from skillctl.cli.exit_codes import ExitCode
from skillctl.cli.output import Output
from skillctl.drivers.options import RunOptions

if TYPE_CHECKING:
    from skillctl.drivers.measures import Timing
    from skillctl.usecases.run import RunReport

EXAMPLES = """\b
Example:
  skillctl run shelf
  skillctl run shelf --driver pybullet --start 0.42,0,0.55 --log shelf.h5
  skillctl run shelf --driver udp:5005 --period 0.001 --box 0:1,-0.5:0.5,0:1
  skillctl run shelf --driver franky:172.16.0.2 --speed 0.1 --log shelf.h5
  skillctl run shelf --dry-run shelf.h5

Exit codes: 0 the hand has arrived; 1 it has not, or the skill is not proved; 130 and 143 it was stopped by
Ctrl-C or SIGTERM."""

ENDED = {"arrived": ExitCode.DONE, "interrupted": ExitCode.INTERRUPTED, "terminated": ExitCode.TERMINATED}


def run(context: typer.Context, skill: options.Skill, *, how: RunOptions, place: options.LockedPlace) -> None:
    """Run a skill on a robot, and report whether its hand has arrived.

    The skill is proved first. Ctrl-C slows the hand down and stops it; press it twice to stop at once. The
    emergency stop, and what else keeps your robot safe, stays in force: this command replaces none of it.
    """
    from skillctl.usecases.run import run as run_skill

    output: Output = context.obj
    report = run_skill(skill, how, store=place.store, lock=place.lock, tell=output.warning)
    output.result(report, lambda: blocks(report))
    raise typer.Exit(ENDED.get(report.outcome, ExitCode.NEGATIVE))


def blocks(report: RunReport) -> list[render.Block]:
    """Return the report for people."""
    place, timing = report.place, report.timing
    longest = "none is proved" if report.longest is None else f"up to {report.longest:.3g} s is proved"
    facts = [
        ("skill", report.skill),
        ("driver", report.driver),
        ("outcome", f"{report.outcome}: {report.detail}" if report.detail else report.outcome),
        ("duration", f"{report.duration:.2f} s"),
        ("period", f"{report.period:.6g} s; {longest}"),
        ("steps", f"{timing.steps}, the longest {words.number(timing.longest_step, 's')}"),
        ("late steps", late(timing)),
        ("start", words.point(report.start, report.unit)),
        ("end", words.point(place.end, report.unit)),
        ("from target", words.apart(place.distance, place.turn, report.unit)),
        *((f"at {each.time:.2f} s", f"{each.event}, after stage {each.stage + 1}") for each in report.events),
    ]
    if report.difference is not None:
        facts.append(("commands differ", f"{report.difference:.3g} {report.unit}/s at most"))
    if report.log is not None:
        facts.append(("log", str(report.log)))
    return [render.Facts(tuple(facts))]


def late(timing: Timing) -> str:
    """Return how many steps are not covered by the proof, and how many commands came late."""
    missed = f"{timing.missed} ({timing.missed_share:.2%}) a period or more behind"
    return f"{timing.late} ({timing.late_share:.2%}) longer than proved; {missed}"
