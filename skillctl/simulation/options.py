"""The options of a simulated run on the command line; a scenario file has more."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

from skillctl.options import MOTION, changed, option, read_numbers, read_point
from skillctl.simulation.arms import ARMS

Plane: TypeAlias = Literal["xy", "xz", "yz"]
Board: TypeAlias = Literal["top", "bottom"]
Control: TypeAlias = Literal["position", "torque"]
HandPolicy: TypeAlias = Literal["horizontal", "down", "free", "taught"]

Name: TypeAlias = Literal["cup", "place", "home"]

BOARDS: tuple[Board, ...] = get_args(Board)
NAMES: tuple[Name, ...] = get_args(Name)  # of things in a scene that stages of a chain go to

PLACING = "The arm, and where the skill is"
SCENE = "Scene and cup"
TROUBLE = "Disturbances"
BATCH = "Many episodes"
HOME = "home"


def read_start(text: str) -> tuple[float, ...] | str:
    """Read ``home``, or coordinates; or raise ValueError."""
    return text if text == HOME else read_point(text)


def read_target(text: str) -> tuple[float, ...] | str:
    """Read ``cup``, or coordinates; or raise ValueError."""
    return text if text == "cup" else read_point(text)


def read_bound(text: str) -> tuple[str, Any]:
    """Read ``STAGE=NAME`` or ``STAGE=X,Y,Z``, or raise ValueError."""
    stage, sign, what = text.partition("=")
    if not (sign and stage.strip().isdigit()):
        raise ValueError(f"{text!r} is not STAGE=NAME, as in 1=cup.")
    name = what.strip()
    if name.isalpha() and name not in NAMES:
        raise ValueError(f"{name!r} is none of {', '.join(NAMES)}; or give coordinates, as in 1=0.4,0,0.5.")
    return stage.strip(), name if name in NAMES else read_point(name)


def read_held(text: str) -> tuple[str, float]:
    """Read ``JOINT=Q``, or raise ValueError."""
    joint, sign, place = text.rpartition("=")
    if not (sign and joint):
        raise ValueError(f"{text!r} is not JOINT=Q, as in torso_lift_joint=0.2.")
    (number,) = _numbers(place, 1)
    return joint.strip(), number


def read_standing(text: str) -> dict[str, Any]:
    """Read ``0.62,0.1``, or ``0.62,0.1,bottom``; or raise ValueError."""
    place, comma, last = text.rpartition(",")
    board = {"board": last.strip()} if comma and last.strip() in BOARDS else {}
    numbers = read_numbers(place if board else text)
    if len(numbers) != 2:
        raise ValueError(f"{text!r} is not X,Y or X,Y,top or X,Y,bottom.")
    return {"position": numbers, **board}


def read_push(text: str) -> dict[str, Any]:
    """Read ``T,DUR,FX,FY,FZ``, or raise ValueError."""
    time, duration, *force = _numbers(text, 5)
    return {"kind": "push", "time": time, "duration": duration, "force": force}


def read_jump(text: str) -> dict[str, Any]:
    """Read ``T,DX,DY,DZ`` of the target, or raise ValueError."""
    time, *offset = _numbers(text, 4)
    return {"kind": "move-target", "time": time, "offset": offset}


def read_knock(text: str) -> dict[str, Any]:
    """Read ``T,DX,DY,DZ`` of a cup in the hand, or raise ValueError."""
    time, *offset = _numbers(text, 4)
    return {"kind": "knock", "time": time, "offset": offset}


def read_displacement(text: str) -> dict[str, Any]:
    """Read ``T,DX,DY,DZ`` or ``T,DX,DY,DZ,RX,RY,RZ``, or raise ValueError."""
    numbers = read_numbers(text)
    turn = numbers[4:] if len(numbers) == 7 else (0.0, 0.0, 0.0)
    if len(numbers) not in (4, 7):
        raise ValueError(f"expected 4 or 7 numbers, got {len(numbers)}: {text!r}.")
    return {"kind": "displace", "time": numbers[0], "offset": numbers[1:4], "turn": turn}


def _titles() -> str:
    first, *others = (arm.title for arm in ARMS.values())
    return ", ".join([f"{first} (default)", *others])


def _numbers(text: str, count: int) -> tuple[float, ...]:
    numbers = read_numbers(text)
    if len(numbers) != count:
        raise ValueError(f"expected {count} numbers, got {len(numbers)}: {text!r}.")
    return numbers


@dataclass(frozen=True)
class ScenarioOptions:
    """Changes to the fields of a ``Scenario``; None and empty tuples change nothing."""

    arm: str | None = option(
        metavar="|".join([*ARMS, "FILE.urdf"]), group=PLACING, help=f"{_titles()}, or the arm in a URDF file."
    )
    tip: str | None = option(
        metavar="LINK",
        group=PLACING,
        help="Hand of an arm by file: one of its links. Default: chosen by structure and names, and printed.",
    )
    home: tuple[float, ...] | None = option(
        read=read_numbers,
        metavar="Q1,Q2,…",
        group=PLACING,
        help="Ready posture of an arm by file, rad. Default: the middle of each joint's range.",
    )
    hold: tuple[tuple[str, float], ...] = option(
        (),
        read=read_held,
        repeated=True,
        metavar="JOINT=Q",
        group=PLACING,
        help="Hold a joint of an arm by file at Q, rad or m, such as a slow torso. May be repeated.",
    )
    package: tuple[str, ...] = option(
        (),
        repeated=True,
        metavar="DIR",
        group=PLACING,
        help="Let an arm by file name meshes in DIR, too, not only in its own package: the nearest folder "
        "above it with a package.xml, else its own. May be repeated.",
    )
    start: tuple[float, ...] | str | None = option(
        read=read_start,
        metavar="home|X,Y,Z[,QX,QY,QZ,QW]",
        group=MOTION,
        help="Start, in the skill's coordinates. Default: home, the ready posture of the arm; in a scene, "
        "a place in front of it. For a pose skill, X,Y,Z is turned as the nearest demonstrated start.",
    )
    target: tuple[float, ...] | str | None = option(
        read=read_target,
        metavar="X,Y,Z[,QX,QY,QZ,QW]|cup",
        group=MOTION,
        help="Target of the motion, in the skill's coordinates; cup: the middle of the cup. A pose skill "
        "keeps the orientation of its target with cup and X,Y,Z.",
    )
    bind: tuple[tuple[str, Any], ...] = option(
        (),
        read=read_bound,
        repeated=True,
        metavar="STAGE=cup|place|home|X,Y,Z",
        group=MOTION,
        help="Target of a stage of a chain, counted from 1: the cup, the place to set it down, the place of "
        "--start home, or coordinates. May be repeated.",
    )
    turn: bool = option(
        False, group=MOTION, help="Turn the whole motion of a pose skill with its --target, way and all."
    )
    max_speed: float | None = option(
        name="speed", metavar="M/S", group=MOTION, help="Largest speed of the hand. Default: 0.3."
    )
    max_turn: float | None = option(
        name="turn-speed",
        metavar="RAD/S",
        group=MOTION,
        help="Largest turning speed of the hand of a pose skill. Default: 1.5.",
    )
    control: Control | None = option(
        group=MOTION,
        help="Stiff position motors (default), or torques at 1 kHz, with which the hand yields to pushes.",
    )
    max_duration: float | None = option(
        metavar="S", group=MOTION, help="Longest simulated time. Default: by the duration of the plan."
    )
    plane: Plane | None = option(
        group=PLACING, help="Workspace plane of a 2-D skill. Default: by its coordinate names."
    )
    scale: float | None = option(
        metavar="F",
        group=PLACING,
        help="Workspace metres per metre of the skill. Default: 1, or a scale with which a 2-D skill fits.",
    )
    origin: tuple[float, ...] | None = option(
        read=read_point,
        metavar="X,Y,Z",
        group=PLACING,
        help="Workspace position of the skill's zero. Default: the arm's base; a 2-D skill is centred "
        "in front of the arm.",
    )
    hand: HandPolicy | None = option(
        group=PLACING,
        help="Orientation of the hand. Default: the first that works; for a pose skill as taught.",
    )
    scene: Literal["none", "table", "shelf"] | None = option(
        group=SCENE, help="Furniture in front of the arm. Default: none."
    )
    cup: dict[str, Any] | None = option(
        read=read_standing,
        metavar="X,Y[,top|bottom]",
        group=SCENE,
        help="Place of the cup to grasp, and its board.",
    )
    place: dict[str, Any] | None = option(
        read=read_standing,
        metavar="X,Y[,top|bottom]",
        group=SCENE,
        help="Where a chain sets the cup down, and the board there.",
    )
    avoid: bool | None = option(
        name="avoid/--no-avoid",
        group=SCENE,
        help="Keep the hand out of scene and obstacles. Default: yes, for a skill in three dimensions.",
    )
    adapt: bool | None = option(
        group=SCENE,
        help="Choose the weights of a merged skill for each target, start and scene; its proof holds for all "
        "weights.",
    )
    push: tuple[dict[str, Any], ...] = option(
        (),
        read=read_push,
        repeated=True,
        metavar="T,DUR,FX,FY,FZ",
        group=TROUBLE,
        help="Push the hand from time T for DUR seconds, N. This and the next three may be repeated.",
    )
    move_target: tuple[dict[str, Any], ...] = option(
        (),
        read=read_jump,
        repeated=True,
        metavar="T,DX,DY,DZ",
        group=TROUBLE,
        help="Move the target, and the cup with it, at time T.",
    )
    displace: tuple[dict[str, Any], ...] = option(
        (),
        read=read_displacement,
        repeated=True,
        metavar="T,DX,DY,DZ[,RX,RY,RZ]",
        group=TROUBLE,
        help="Displace the hand at time T; of a pose skill also turn it, by a rotation vector, rad.",
    )
    knock: tuple[dict[str, Any], ...] = option(
        (),
        read=read_knock,
        repeated=True,
        metavar="T,DX,DY,DZ",
        group=TROUBLE,
        help="Knock the cup out of the hand of a chain, by an offset, T seconds after it was taken.",
    )
    noise: float | None = option(
        metavar="M", group=TROUBLE, help="Standard deviation of the measured position of the hand."
    )
    target_error: float | None = option(
        metavar="M", group=TROUBLE, help="Standard deviation of the perceived place of the target or cup."
    )
    episodes: int | None = option(
        metavar="N",
        group=BATCH,
        help="Number of episodes. Unless a scenario says what is drawn, they differ in the place of the cup, "
        "and in the start, which is near that of a demonstration.",
    )
    seed: int | None = option(metavar="S", group=BATCH, help="Seed of all that is drawn. Default: 0.")

    def given(self) -> dict[str, Any]:
        """Return the fields of ``Scenario`` that are given, as ``scenario_file.overridden`` takes them."""
        values = {each.field: getattr(self, each.field) for each in changed(self)}
        disturbances = [values.pop(name, ()) for name in ("push", "move_target", "displace", "knock")]
        if values.get("start") == HOME:
            values["start"] = None
        values |= {name: dict(values[name]) for name in ("hold", "bind") if name in values}
        return {**values, "disturbances": sum(disturbances, ())}
