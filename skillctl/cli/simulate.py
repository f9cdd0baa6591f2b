"""``skillctl simulate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skillctl.cli import many, options, render, words
from skillctl.cli.exit_codes import ExitCode
from skillctl.cli.output import Output

if TYPE_CHECKING:
    from skillctl.usecases.simulate import SimulateReport

EXAMPLES = """\b
Example:
  skillctl simulate reach --picture reach.png
  skillctl simulate reach --start 0.42,0,0.55 --target 0.6,0.1,0.5 --log reach.csv
  skillctl simulate g-shape --plane yz --scale 5 --demo 0 --arm iiwa
  skillctl simulate reach --episodes 50 --jobs 2 --table reach.csv --overview reach.png
  skillctl simulate reach --episode 17 --video failure.gif

Exit codes: 0 the hand reached the target, in at least --min-success of the episodes; 1 it did not."""

PLACING = "Placing the skill"
BATCH = "Many episodes"


def simulate(
    context: typer.Context,
    skill: options.Skill,
    arm: Annotated[options.Arm, typer.Option(help="Franka Panda, or KUKA LBR iiwa.")] = "panda",
    start: Annotated[
        Any,
        typer.Option(
            parser=options.read_start,
            metavar="home|X,Y,Z",
            help="Start, in the skill's coordinates. Default: home, the ready posture of the arm.",
            rich_help_panel=options.MOTION,
        ),
    ] = None,
    demo: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Start where the skill's demonstration N starts, counted from 0.",
            rich_help_panel=options.MOTION,
        ),
    ] = None,
    target: options.Target = None,
    max_duration: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="Longest simulated time. Default: from how long the skill takes.",
            rich_help_panel=options.MOTION,
        ),
    ] = None,
    plane: Annotated[
        options.Plane | None,
        typer.Option(help="Workspace plane of a 2-D skill. Default: by its names.", rich_help_panel=PLACING),
    ] = None,
    scale: Annotated[
        float | None,
        typer.Option(
            metavar="F",
            help="Workspace metres per metre of the skill. Default: 1, or what makes a 2-D skill fit.",
            rich_help_panel=PLACING,
        ),
    ] = None,
    origin: Annotated[
        options.Numbers | None,
        typer.Option(
            parser=options.read_numbers,
            metavar="X,Y,Z",
            help="Workspace position of the skill's zero. Default: the arm's base; a 2-D skill is centred "
            "in front of the arm.",
            rich_help_panel=PLACING,
        ),
    ] = None,
    hand: Annotated[
        options.Hand | None,
        typer.Option(help="How the hand is held. Default: the first that works.", rich_help_panel=PLACING),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(metavar="F.csv", help="Write the time series.", rich_help_panel=options.RESULT),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="F.png", help="Write a contact sheet.", rich_help_panel=options.RESULT),
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(
            metavar="F.gif|F.mp4",
            help="Write a film, in real time. (.mp4 needs: pip install 'skillctl[video]'.)",
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
    jobs: Annotated[
        int,
        typer.Option(
            "--jobs", "-j", metavar="J", help="Processes; changes no result.", rich_help_panel=BATCH
        ),
    ] = 1,
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
    from skillctl.simulation import Scenario
    from skillctl.usecases.simulate import simulate as simulate_skill
    from skillctl.usecases.simulate_many import simulate_many

    output: Output = context.obj
    chosen = Scenario(
        arm=arm,
        start=start,
        target=target,
        plane=plane,
        scale=scale,
        origin=origin,  # type: ignore[arg-type]  # checked there
        hand=hand,
        max_duration=max_duration,
    )
    drawing = {name: value for name, value in (("episodes", episodes), ("seed", seed)) if value is not None}
    chosen = chosen.changed(**drawing)
    lock = options.chosen_lock(locked)
    if episode is None and (chosen.episodes > 1 or episodes is not None):
        many.refuse_for_many(demo=demo, log=log, picture=picture, video=video)
        with output.progress("simulating") as progress:
            batch = simulate_many(
                skill,
                chosen,
                jobs=jobs,
                min_success=min_success,
                table=table,
                overview=overview,
                colour_by=colour,
                store=store,
                lock=lock,
                progress=progress,
            )
        for note in batch.notes:
            output.note(f"note: {note}")
        output.result(batch, lambda: many.blocks(batch))
        raise typer.Exit(ExitCode.DONE if batch.enough else ExitCode.NEGATIVE)
    many.refuse_for_one(table=table, overview=overview)
    with output.progress("simulating") as progress:
        report = simulate_skill(
            skill,
            chosen,
            demo=demo,
            episode=episode,
            log=log,
            picture=picture,
            video=video,
            store=store,
            lock=lock,
            progress=progress,
        )
    for note in report.notes:
        output.note(f"note: {note}")
    output.result(report, lambda: blocks(report))
    raise typer.Exit(ExitCode.DONE if report.success else ExitCode.NEGATIVE)


def blocks(report: SimulateReport) -> list[render.Block]:
    """Return the report for people."""
    figures = report.metrics
    placed = "" if report.plane is None else f", plane {report.plane}"
    facts = [
        ("skill", report.skill),
        ("outcome", report.outcome),
        ("arm", f"{report.arm}, hand {report.hand}"),
        ("placed", f"scale {report.scale:g}, origin {words.point(report.origin, 'm')}{placed}"),
        ("target", words.point(report.target, "m")),
        ("final error", words.length(figures.final_error, "m")),
        ("time to target", words.number(figures.time_to_target, "s")),
        (
            "tracking",
            f"{words.length(figures.tracking_median, 'm')} median, "
            f"{words.length(figures.tracking_p95, 'm')} at most in 95 % of the time",
        ),
        ("off the ideal path", f"{words.length(figures.plan_deviation, 'm')} at most"),
        ("path length", f"{figures.path_ratio:.3f} of the ideal"),
        ("joint margin", f"{figures.joint_margin:.2f} rad to the nearest limit"),
        ("joint speed", f"{figures.velocity_ratio:.0%} of the limit at most"),
        ("joint torque", f"{figures.torque_ratio:.0%} of the limit at most"),
        (
            "inverse kinematics",
            f"{words.length(figures.ik_residual, 'm')} off at most, {figures.ik_failures} failures",
        ),
        ("simulated", f"{figures.simulated_time:.2f} s in {report.wall_seconds:.2f} s"),
    ]
    files = (("log", report.log), ("picture", report.picture), ("video", report.video))
    facts += [(name, str(path)) for name, path in files if path]
    return [render.Facts(tuple(facts))]
