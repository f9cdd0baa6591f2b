"""``skillctl simulate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from skillctl.cli import many, options, reach, render, scene, words
from skillctl.cli.exit_codes import ExitCode
from skillctl.cli.output import Output
from skillctl.errors import UsageError

if TYPE_CHECKING:
    from skillctl.usecases.simulate import SimulateReport

EXAMPLES = """\b
Example:
  skillctl simulate reach --picture reach.png
  skillctl simulate reach --start 0.42,0,0.55 --target 0.6,0.1,0.5 --log reach.csv
  skillctl simulate g-shape --plane yz --scale 5 --demo 0 --arm iiwa
  skillctl simulate reach --arm robots/mine.urdf --tip tool0 --check
  skillctl simulate shelf --scene shelf --target cup --cup 0.62,-0.2 --picture grasp.png
  skillctl simulate --scene shelf --target cup --move-target 1,0,0.08,0 --print-scenario > moved.toml
  skillctl simulate shelf --scenario moved.toml --log moved.csv
  skillctl simulate reach --episodes 50 --jobs 2 --table reach.csv --overview reach.png
  skillctl simulate reach --episode 17 --video failure.gif

Exit codes: 0 the hand reached the target, or lifted the cup, in at least --min-success of the episodes
(--check: it can be reached); 1 it did not."""

BATCH = "Many episodes"


def simulate(
    context: typer.Context,
    skill: scene.OptionalSkill = None,
    scenario: scene.File = None,
    print_scenario: scene.PrintIt = False,
    arm: scene.Arm = None,
    tip: scene.Tip = None,
    home: scene.Home = None,
    start: scene.Start = None,
    demo: scene.Demo = None,
    target: scene.Target = None,
    speed: scene.Speed = None,
    control: scene.ControlMode = None,
    max_duration: scene.MaxDuration = None,
    plane: scene.Plane = None,
    scale: scene.Scale = None,
    origin: scene.Origin = None,
    hand: scene.Hand = None,
    standing: scene.Kind = None,
    cup: scene.Cup = None,
    push: scene.Push = None,
    move_target: scene.MoveTarget = None,
    displace: scene.Displace = None,
    noise: scene.Noise = None,
    target_error: scene.TargetError = None,
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="Only say whether start, path and target can be reached; nothing moves.",
            rich_help_panel=options.MOTION,
        ),
    ] = False,
    gui: Annotated[
        bool,
        typer.Option("--gui", help="Show it in a window, in real time.", rich_help_panel=options.RESULT),
    ] = False,
    log: Annotated[
        Path | None,
        typer.Option(metavar="F.csv|F.h5", help="Write the time series.", rich_help_panel=options.RESULT),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="F.png", help="Write a contact sheet.", rich_help_panel=options.RESULT),
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(
            metavar="F.gif|F.mp4",
            help="Write a film, in real time. (.mp4 needs: pip install '.[video]'.)",
            rich_help_panel=options.RESULT,
        ),
    ] = None,
    episodes: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Run so many episodes. Unless a scenario says what differs between them: the place of the "
            "cup, and the start, which is a demonstration's, scattered.",
            rich_help_panel=BATCH,
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(metavar="S", help="Of everything that is drawn. Default: 0.", rich_help_panel=BATCH),
    ] = None,
    episode: Annotated[
        int | None,
        typer.Option(
            metavar="I",
            help="Run only episode I, from 0, to look at it: it is the one of the batch.",
            rich_help_panel=BATCH,
        ),
    ] = None,
    jobs: options.Jobs = None,
    backend: options.Backend = "processes",
    scheduler: options.Scheduler = None,
    min_success: Annotated[
        float,
        typer.Option(
            metavar="R",
            help="Share of successes that is enough for exit code 0.",
            rich_help_panel=BATCH,
        ),
    ] = 1.0,
    table: Annotated[
        Path | None,
        typer.Option(metavar="F.csv", help="Write one row per episode.", rich_help_panel=BATCH),
    ] = None,
    overview: Annotated[
        Path | None,
        typer.Option(metavar="F.png", help="Write all episodes in one picture.", rich_help_panel=BATCH),
    ] = None,
    colour: Annotated[
        options.ColourBy | None,
        typer.Option(
            help="Colour the overview by outcome, or by the part of a combined skill that acted. Default: "
            "outcome, but part if the parts end at different places.",
            rich_help_panel=BATCH,
        ),
    ] = None,
    store: options.Store = None,
    locked: options.Locked = False,
) -> None:
    """Run a skill on a simulated arm and say whether, and how well, its hand reached the target.

    The same command gives the same motion, bit for bit, on the same machine.
    """
    from skillctl.usecases.scenario import scenario_of, scenario_text
    from skillctl.usecases.simulate import simulate as simulate_skill
    from skillctl.usecases.simulate_many import simulate_many
    from skillctl.workers import Workers

    output: Output = context.obj
    chosen = scenario_of(
        scenario,
        scene.given(
            arm=arm,
            tip=tip,
            home=home,
            start=start,
            target=target,
            max_speed=speed,
            control=control,
            max_duration=max_duration,
            plane=plane,
            scale=scale,
            origin=origin,
            hand=hand,
            scene=standing,
            cup=cup,
            disturbances=scene.disturbances(push, move_target, displace),
            noise=noise,
            target_error=target_error,
            episodes=episodes,
            seed=seed,
        ),
    )
    if print_scenario:
        output.verbatim(scenario_text(chosen))
        raise typer.Exit(ExitCode.DONE)
    if skill is None:
        raise UsageError("SKILL: is missing: say which skill shall be run.")
    lock = options.chosen_lock(locked)
    if check:
        from skillctl.usecases.check_reach import check_reach

        told = check_reach(skill, chosen, demo=demo, episode=episode, store=store, lock=lock)
        output.result(told, lambda: reach.blocks(told))
        raise typer.Exit(ExitCode.DONE if told.reachability.reachable else ExitCode.NEGATIVE)
    if episode is None and (chosen.episodes > 1 or episodes is not None):
        many.refuse_for_many(demo=demo, log=log, picture=picture, video=video, gui=gui or None)
        with output.progress("simulating") as progress:
            batch = simulate_many(
                skill,
                chosen,
                workers=Workers.chosen(jobs, backend, scheduler),
                min_success=min_success,
                table=table,
                overview=overview,
                colour_by=colour,
                store=store,
                lock=lock,
                progress=progress,
            )
        words.explain(output, batch.notes)
        output.result(batch, lambda: many.blocks(batch))
        raise typer.Exit(ExitCode.DONE if batch.enough else ExitCode.NEGATIVE)
    many.refuse_for_one(table=table, overview=overview, jobs=jobs, scheduler=scheduler)
    with output.progress("simulating") as progress:
        report = simulate_skill(
            skill,
            chosen,
            demo=demo,
            episode=episode,
            log=log,
            picture=picture,
            video=video,
            gui=gui,
            store=store,
            lock=lock,
            progress=progress,
        )
    words.explain(output, report.notes)
    output.result(report, lambda: blocks(report))
    raise typer.Exit(ExitCode.DONE if report.success else ExitCode.NEGATIVE)


def blocks(report: SimulateReport) -> list[render.Block]:
    """Return the report for people."""
    figures = report.metrics
    outcome = f"{report.outcome}: {report.detail}" if report.detail else report.outcome
    placed = "" if report.plane is None else f", plane {report.plane}"
    facts = [
        ("skill", report.skill),
        ("outcome", outcome),
        ("arm", f"{report.arm}, hand {report.hand}"),
        ("placed", f"scale {report.scale:g}, origin {words.point(report.origin, 'm')}{placed}"),
        ("target", words.point(report.target, "m")),
        ("final error", words.length(figures.final_error, "m")),
        ("time to target", words.number(figures.time_to_target, "s")),
        ("tracking", _tracking(report)),
        ("off the ideal path", f"{words.length(figures.plan_deviation, 'm')} at most"),
        ("path length", f"{figures.path_ratio:.3f} of the ideal"),
        ("joint margin", f"{figures.joint_margin:.2f} rad to the nearest limit"),
        ("joint speed", f"{figures.velocity_ratio:.0%} of the limit at most"),
        ("joint torque", f"{figures.torque_ratio:.0%} of the limit at most"),
        ("inverse kinematics", _kinematics(report)),
        *_scene_facts(report),
        ("simulated", f"{figures.simulated_time:.2f} s in {report.wall_seconds:.2f} s"),
    ]
    files = (("log", report.log), ("picture", report.picture), ("video", report.video))
    facts += [(name, str(path)) for name, path in files if path]
    return [render.Facts(tuple(facts))]


def _tracking(report: SimulateReport) -> str:
    """Return how near the hand was to its reference; a hand that yields has none."""
    figures = report.metrics
    if report.scenario["control"] == "torque":
        return words.NONE
    median, most = (words.length(d, "m") for d in (figures.tracking_median, figures.tracking_p95))
    return f"{median} median, {most} at most in 95 % of the time"


def _kinematics(report: SimulateReport) -> str:
    """Return what inverse kinematics missed; torque control needs none."""
    figures = report.metrics
    if report.scenario["control"] == "torque":
        return words.NONE
    return f"{words.length(figures.ik_residual, 'm')} off at most, {figures.ik_failures} failures"


def _scene_facts(report: SimulateReport) -> list[tuple[str, str]]:
    """Return what there is to say about scene and cup; nothing without them."""
    figures, facts = report.metrics, []
    if report.scenario["scene"] is not None:
        facts.append(
            (
                "clearance",
                f"{words.length(figures.clearance, 'm')} to the {report.scenario['scene']['kind']} at least",
            )
        )
        facts.append(("touched", ", ".join(figures.contacts) or "nothing"))
    if report.scenario["cup"] is not None:
        rise, moved = words.length(figures.cup_rise, "m"), words.length(figures.cup_moved, "m")
        facts.append(("cup", f"{rise} up at the end, moved {moved} before the grasp"))
    return facts
