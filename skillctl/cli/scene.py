"""The options of ``simulate`` that make a scenario, each declared once, and what they come to."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import typer

from skillctl.cli.options import ARMS, MOTION, SKILL, Numbers, read_numbers
from skillctl.cli.options import Hand as HandPolicy
from skillctl.cli.options import Plane as PlaneName

PLACING = "The arm, and where the skill is"
SCENE = "Scene and cup"
TROUBLE = "Disturbances"

SceneKind: TypeAlias = Literal["none", "table", "shelf"]
Control: TypeAlias = Literal["position", "torque"]
BOARDS = ("top", "bottom")
HOME = "home"


class CupPlace(tuple[float, float, str]):
    """``0.62,0.1`` or ``0.62,0.1,bottom``; an empty board says nothing."""


def read_target(text: str) -> Numbers | str:
    """Read ``cup``, or coordinates."""
    return text if text == "cup" else read_numbers(text)


def read_start(text: str) -> Numbers | str:
    """Read ``home``, or coordinates."""
    return text if text == HOME else read_numbers(text)


def read_cup(text: str) -> CupPlace:
    """Read ``0.62,0.1``, or ``0.62,0.1,bottom``."""
    place, comma, last = text.rpartition(",")
    board = last.strip() if comma and last.strip() in BOARDS else ""
    numbers = read_numbers(place if board else text)
    if len(numbers) != 2:
        raise typer.BadParameter(f"{text!r} is not X,Y or X,Y,top or X,Y,bottom.")
    return CupPlace((*numbers, board))


OptionalSkill = Annotated[str | None, typer.Argument(metavar="SKILL", help=SKILL)]
Arm = Annotated[
    str | None,
    typer.Option(
        metavar="panda|iiwa|xarm6|FILE.urdf",
        help="Franka Panda (default), KUKA LBR iiwa, UFACTORY xArm6, or the arm in a URDF file.",
        autocompletion=lambda: list(ARMS),
        rich_help_panel=PLACING,
    ),
]
Tip = Annotated[
    str | None,
    typer.Option(
        metavar="LINK",
        help="Of an arm by file: the link that is its hand. Default: the last before it branches.",
        rich_help_panel=PLACING,
    ),
]
Home = Annotated[
    Numbers | None,
    typer.Option(
        parser=read_numbers,
        metavar="Q1,Q2,…",
        help="Of an arm by file: its ready posture, rad. Default: the middle of each joint's range.",
        rich_help_panel=PLACING,
    ),
]
Start = Annotated[
    Any,
    typer.Option(
        parser=read_start,
        metavar="home|X,Y,Z",
        help="Start, in the skill's coordinates. Default: home, the ready posture of the arm; before a "
        "shelf or table a place in front of it.",
        rich_help_panel=MOTION,
    ),
]
Demo = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        help="Start where the skill's demonstration N starts, counted from 0.",
        rich_help_panel=MOTION,
    ),
]
Target = Annotated[
    Any,
    typer.Option(
        parser=read_target,
        metavar="X,Y,Z|cup",
        help="Where the motion shall end, in the unit of the skill; cup: in the middle of the cup.",
        rich_help_panel=MOTION,
    ),
]
Speed = Annotated[
    float | None,
    typer.Option(metavar="M/S", help="Largest speed of the hand. Default: 0.3.", rich_help_panel=MOTION),
]
ControlMode = Annotated[
    Control | None,
    typer.Option(
        "--control",
        help="Stiff position motors (default), or torques at 1 kHz: then the hand yields to pushes.",
        rich_help_panel=MOTION,
    ),
]
MaxDuration = Annotated[
    float | None,
    typer.Option(
        metavar="S",
        help="Longest simulated time. Default: from how long the skill takes.",
        rich_help_panel=MOTION,
    ),
]
Plane = Annotated[
    PlaneName | None,
    typer.Option(help="Workspace plane of a 2-D skill. Default: by its names.", rich_help_panel=PLACING),
]
Scale = Annotated[
    float | None,
    typer.Option(
        metavar="F",
        help="Workspace metres per metre of the skill. Default: 1, or what makes a 2-D skill fit.",
        rich_help_panel=PLACING,
    ),
]
Origin = Annotated[
    Numbers | None,
    typer.Option(
        parser=read_numbers,
        metavar="X,Y,Z",
        help="Workspace position of the skill's zero. Default: the arm's base; a 2-D skill is centred "
        "in front of the arm.",
        rich_help_panel=PLACING,
    ),
]
Hand = Annotated[
    HandPolicy | None,
    typer.Option(help="How the hand is held. Default: the first that works.", rich_help_panel=PLACING),
]
File = Annotated[
    Path | None,
    typer.Option(
        "--scenario",
        metavar="F.toml",
        help="Everything that follows, in a file; what is typed here comes on top of it.",
        rich_help_panel=SCENE,
    ),
]
PrintIt = Annotated[
    bool,
    typer.Option(
        "--print-scenario",
        help="Only write what would be run, as such a file. Needs no SKILL.",
        rich_help_panel=SCENE,
    ),
]
Kind = Annotated[
    SceneKind | None,
    typer.Option("--scene", help="What stands in front of the arm. Default: none.", rich_help_panel=SCENE),
]
Cup = Annotated[
    Any,
    typer.Option(
        parser=read_cup,
        metavar="X,Y[,top|bottom]",
        help="Where the cup stands that is to be grasped, and on which board.",
        rich_help_panel=SCENE,
    ),
]
Push = Annotated[
    list[str] | None,
    typer.Option(
        metavar="T,DUR,FX,FY,FZ",
        help="Push the hand from time T on for DUR seconds, N. May be repeated, as the next two.",
        rich_help_panel=TROUBLE,
    ),
]
MoveTarget = Annotated[
    list[str] | None,
    typer.Option(
        metavar="T,DX,DY,DZ",
        help="Move the target, and the cup with it, at time T.",
        rich_help_panel=TROUBLE,
    ),
]
Displace = Annotated[
    list[str] | None,
    typer.Option(
        metavar="T,DX,DY,DZ",
        help="Take the hand elsewhere at time T.",
        rich_help_panel=TROUBLE,
    ),
]
Noise = Annotated[
    float | None,
    typer.Option(
        metavar="M",
        help="Standard deviation of the hand's position as the skill sees it.",
        rich_help_panel=TROUBLE,
    ),
]
TargetError = Annotated[
    float | None,
    typer.Option(
        metavar="M",
        help="Standard deviation of the target's, or cup's, place as it is seen.",
        rich_help_panel=TROUBLE,
    ),
]


def disturbances(push: list[str] | None, move: list[str] | None, displace: list[str] | None) -> list[Any]:
    """Return the disturbances that were typed, as a scenario has them."""
    found: list[Any] = []
    for text in push or ():
        time, duration, *force = _numbers("--push", text, 5)
        found.append({"kind": "push", "time": time, "duration": duration, "force": force})
    for option, kind, texts in (
        ("--move-target", "move-target", move),
        ("--displace", "displace", displace),
    ):
        for text in texts or ():
            time, *offset = _numbers(option, text, 4)
            found.append({"kind": kind, "time": time, "offset": offset})
    return found


def _numbers(option: str, text: str, count: int) -> Numbers:
    numbers = read_numbers(text)
    if len(numbers) != count:
        raise typer.BadParameter(f"{option}: expected {count} numbers, got {len(numbers)}: {text!r}.")
    return numbers


def given(**values: Any) -> dict[str, Any]:
    """Return the options that were given, as ``overridden`` takes them."""
    found = {name: value for name, value in values.items() if value is not None and value != []}
    if found.get("start") == HOME:
        found["start"] = None
    if "cup" in found:
        x, y, board = found["cup"]
        found["cup"] = {"position": (x, y), **({"board": board} if board else {})}
    return {name: tuple(value) if isinstance(value, Numbers) else value for name, value in found.items()}
