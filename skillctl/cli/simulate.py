"""``skillctl simulate``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from skillctl.cli import many, options, reach, render, words
from skillctl.cli.exit_codes import ExitCode
from skillctl.cli.output import Output
from skillctl.errors import UsageError
from skillctl.options import MOTION, RESULT, option
from skillctl.simulation.options import BATCH, SCENE, ScenarioOptions

if TYPE_CHECKING:
    from skillctl.simulation.scenario import Scenario
    from skillctl.usecases.simulate import SimulateReport

EXAMPLES = """\b
Example:
  skillctl simulate reach --picture reach.png
  skillctl simulate reach --start 0.4,0,0.5 --target 0.6,0,0.5 --log reach.csv
  skillctl simulate g-shape --plane yz --scale 5 --demo 0 --arm iiwa
  skillctl simulate reach --arm robots/mine.urdf --tip tool0 --check
  skillctl simulate shelf --scene shelf --target cup --picture grasp.png
  skillctl simulate --scene shelf --target cup --print-scenario > cup.toml
  skillctl simulate shelf --scenario cup.toml --log cup.csv
  skillctl simulate reach --episodes 50 --table reach.csv --overview reach.png
  skillctl simulate reach --episode 17 --video failure.gif

Exit codes: 0 the hand reached the target, or lifted the cup, in at least --min-success of the episodes
(--check: it can be reached); 1 it did not."""


@dataclass(frozen=True)
class Watching:
    """Options of one episode."""

    demo: int | None = option(
        metavar="N", group=MOTION, help="Start where demonstration N of the skill starts, from 0."
    )
    task: Path | None = option(
        metavar="T.toml",
        group=RESULT,
        help="The motion has to fulfil every clause of this task, too; see `skillctl adapt`.",
    )
    gui: bool = option(False, group=RESULT, help="Show the motion in a window, in real time.")
    log: Path | None = option(metavar="F.csv|F.h5", group=RESULT, help="Write the time series.")
    picture: Path | None = option(metavar="F.png", group=RESULT, help="Write a contact sheet.")
    video: Path | None = option(
        metavar="F.gif|F.mp4",
        group=RESULT,
        help="Write a film, in real time. (.mp4 needs: pip install av.)",
    )


@dataclass(frozen=True)
class Counting:
    """Options of many episodes."""

    min_success: float | None = option(
        metavar="R", group=BATCH, help="Share of successes that is enough for exit code 0. Default: 1, all."
    )
    table: Path | None = option(metavar="F.csv", group=BATCH, help="Write one row per episode.")
    overview: Path | None = option(metavar="F.png", group=BATCH, help="Write all episodes in one picture.")
    colour: Literal["outcome", "part"] | None = option(
        group=BATCH,
        help="Colour the overview by outcome, or by the part of a combined skill that acted. Default: "
        "outcome, but part if the parts end at different places.",
    )


def simulate(
    context: typer.Context,
    skill: Annotated[str | None, typer.Argument(metavar="SKILL", help=options.SKILL)] = None,
    scenario: Annotated[
        Path | None,
        typer.Option(
            metavar="F.toml",
            help="File with all of the following; options given here replace its values.",
            rich_help_panel=SCENE,
        ),
    ] = None,
    print_scenario: Annotated[
        bool,
        typer.Option(
            "--print-scenario",
            help="Only print the scenario as such a file. This needs no SKILL.",
            rich_help_panel=SCENE,
        ),
    ] = False,
    *,
    changes: ScenarioOptions,
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="Only check whether start, path and target can be reached; nothing moves.",
            rich_help_panel=MOTION,
        ),
    ] = False,
    watching: Watching,
    episode: Annotated[
        int | None,
        typer.Option(
            metavar="I",
            help="Run only episode I of the batch, from 0, for a closer look.",
            rich_help_panel=BATCH,
        ),
    ] = None,
    counting: Counting,
    work: options.Work,
    place: options.LockedPlace,
) -> None:
    """Run a skill on a simulated arm, and report whether and how well its hand reached the target.

    The same command gives the same motion, bit for bit, on the same machine.
    """
    from skillctl.simulation.scenario import Scenario
    from skillctl.simulation.scenario_file import overridden, read_scenario, to_toml

    output: Output = context.obj
    chosen = overridden(Scenario() if scenario is None else read_scenario(scenario), changes.given())
    if print_scenario:
        output.verbatim(to_toml(chosen))
        return
    if skill is None:
        raise UsageError("SKILL: is missing; name the skill to run.")
    if check:
        many.refuse_for_check(watching, counting, work)
        if episode is None and changes.episodes is not None:
            raise UsageError("--episodes are runs; with --check nothing moves.", hint="Add --episode I.")
        from skillctl.usecases.check_reach import check_reach

        checked = check_reach(
            skill, chosen, demo=watching.demo, episode=episode, store=place.store, lock=place.lock
        )
        words.explain(output, checked.reachability.notes)
        output.result(checked, lambda: reach.blocks(checked))
        done = checked.reachability.reachable
    elif episode is None and (chosen.episodes > 1 or changes.episodes is not None):
        many.refuse_for_many(watching)
        done = _run_many(output, skill, chosen, counting, work, place)
    else:
        many.refuse_for_one(counting, work)
        done = _run_one(output, skill, chosen, episode, watching, place)
    raise typer.Exit(ExitCode.DONE if done else ExitCode.NEGATIVE)


def _run_many(
    output: Output,
    skill: str,
    scenario: Scenario,
    counting: Counting,
    work: options.Work,
    place: options.LockedPlace,
) -> bool:
    """Run a batch, print its report, and return whether enough episodes succeeded."""
    from skillctl.usecases.simulate_many import simulate_many

    with output.progress("simulating") as progress:
        report = simulate_many(
            skill,
            scenario,
            workers=work.workers(),
            min_success=1.0 if counting.min_success is None else counting.min_success,
            table=counting.table,
            overview=counting.overview,
            colour_by=counting.colour,
            store=place.store,
            lock=place.lock,
            progress=progress,
        )
    words.explain(output, report.notes)
    output.result(report, lambda: many.blocks(report))
    return report.enough


def _run_one(
    output: Output,
    skill: str,
    scenario: Scenario,
    episode: int | None,
    watching: Watching,
    place: options.LockedPlace,
) -> bool:
    """Run one episode, print its report, and return whether it succeeded."""
    from skillctl.usecases.simulate import simulate as simulate_skill

    with output.progress("simulating") as progress:
        report = simulate_skill(
            skill,
            scenario,
            demo=watching.demo,
            episode=episode,
            log=watching.log,
            picture=watching.picture,
            video=watching.video,
            gui=watching.gui,
            task=watching.task,
            store=place.store,
            lock=place.lock,
            progress=progress,
        )
    words.explain(output, report.notes)
    output.result(report, lambda: blocks(report))
    return report.success


def blocks(report: SimulateReport) -> list[render.Block]:
    """Return the report for people."""
    figures = report.metrics
    outcome = f"{report.outcome}: {report.detail}" if report.detail else report.outcome
    placed = f"scale {report.scale:g}, origin {words.point(report.origin, 'm')}"
    placed += "" if report.plane is None else f", plane {report.plane}"
    facts = [
        ("skill", report.skill),
        ("outcome", outcome),
        *words.arm(report.arm, report.hand if report.unit == "m" else None, report.tip, report.held),
        *([("placed", placed)] if report.unit == "m" else []),
        *_stages(report),
        ("target", words.point((*report.target, *(report.target_turn or ())), report.unit)),
        ("final error", _final(report)),
        ("time to target", words.number(figures.time_to_target, "s")),
        ("tracking", _tracking(report)),
        ("off the ideal path", f"{words.length(figures.plan_deviation, 'm')} at most"),
        ("path length", f"{figures.path_ratio:.3f} of the ideal"),
        ("joint margin", f"{words.number(figures.joint_margin, 'rad')} to the nearest limit"),
        ("manipulability", f"{words.number(figures.manipulability)} at least"),
        ("joint speed", f"{figures.velocity_ratio:.0%} of the limit at most"),
        ("joint torque", f"{figures.torque_ratio:.0%} of the limit at most"),
        ("inverse kinematics", _kinematics(report)),
        *_scene_facts(report),
        ("simulated", f"{figures.simulated_time:.2f} s in {report.wall_seconds:.2f} s"),
    ]
    files = (("log", report.log), ("picture", report.picture), ("video", report.video))
    facts += [(name, str(path)) for name, path in files if path]
    clauses = [words.clauses(report.task, report.skill)] if report.task else []
    return [render.Facts(tuple(facts)), *clauses]


def _stages(report: SimulateReport) -> list[tuple[str, str]]:
    """Return when the stages of a chain began."""
    began = ", ".join(f"{stage.stage} from {stage.began:.2f} s" for stage in report.stages)
    return [("stages", began)] if began else []


def _length(value: float, unit: str) -> str:
    """Return a distance, and an angle in degrees, too."""
    if unit != "rad" or not math.isfinite(value):
        return words.length(value, unit)
    return f"{words.number(value, 'rad')} ({math.degrees(value):.3g}°)"


def _final(report: SimulateReport) -> str:
    """Return how far the hand or the joints were from their target, and how far the hand was turned."""
    turn = report.metrics.final_turn
    angle = f", {math.degrees(turn):.2f}°" if math.isfinite(turn) else ""
    return _length(report.metrics.final_error, report.unit) + angle


def _tracking(report: SimulateReport) -> str:
    """Return the distance of the hand to its reference, which a hand that yields does not have."""
    figures = report.metrics
    if report.scenario["control"] == "torque":
        return words.NONE
    median, most = (_length(d, report.unit) for d in (figures.tracking_median, figures.tracking_p95))
    return f"{median} median, {most} at most in 95 % of the time"


def _kinematics(report: SimulateReport) -> str:
    """Return the error of inverse kinematics, which neither torque control nor a skill of joints needs."""
    figures = report.metrics
    if report.scenario["control"] == "torque" or report.unit == "rad":
        return words.NONE
    return f"{words.length(figures.ik_residual, 'm')} off at most, {figures.ik_failures} failures"


def _scene_facts(report: SimulateReport) -> list[tuple[str, str]]:
    """Return the facts about scene and cup, if there are any."""
    figures, facts = report.metrics, []
    if report.scenario["scene"] is not None or report.scenario["obstacles"]:
        clearance, scene = words.length(figures.clearance, "m"), report.scenario["scene"]
        kind = "scene" if report.scenario["obstacles"] else scene["kind"]
        facts.append(("clearance", f"{clearance} to the {kind} at least"))
        facts.append(("touched", ", ".join(figures.contacts) or "nothing"))
    if report.scenario["cup"] is not None and report.stages:
        off = "" if math.isnan(figures.cup_off) else f"{words.length(figures.cup_off, 'm')} from its place, "
        lost = (
            f"; lost: {figures.cup_lost}, stood in reach then: {figures.cup_stood}"
            if figures.cup_lost
            else ""
        )
        facts.append(("cup", f"{off}fingers closed: {figures.cup_tries}{lost}"))
    elif report.scenario["cup"] is not None:
        rise, moved = words.length(figures.cup_rise, "m"), words.length(figures.cup_moved, "m")
        facts.append(("cup", f"{rise} up at the end, moved {moved} before the grasp"))
    return facts
