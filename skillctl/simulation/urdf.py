"""Arms by path: a URDF file becomes an ``ArmModel`` after another process has read it safely."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from skillctl.errors import InputDataError, NotFoundError, UsageError, did_you_mean, printable
from skillctl.simulation import probe
from skillctl.simulation.arm import ArmBody, described
from skillctl.simulation.arms import ARMS, Angles, ArmModel
from skillctl.simulation.bullet import load_bullet, silenced
from skillctl.simulation.for_bullet import for_bullet
from skillctl.simulation.hand import FEWEST_JOINTS, arm_ends, free_joints, hand_frame
from skillctl.simulation.robot_file import Joint, Robot, read_robot
from skillctl.workers.child import Child, ChildDiedError
from skillctl.workers.limits import Limits

LIMITS = Limits(seconds=60.0, memory=2**32)  # to load the file and its meshes
REDUNDANT = 7  # joints: with fewer, a hand that does not turn with the arm meets singularities of the wrist
SURVEY_POSTURES = 400  # from which the comfortable workspace is estimated

Held = tuple[tuple[str, float], ...]


def find_arm(
    name: str,
    tip: str | None = None,
    home: tuple[float, ...] | None = None,
    hold: Held = (),
    packages: tuple[str, ...] = (),
) -> ArmModel:
    """Return the arm of this name, or the one in this URDF file.

    The joints of an arm by file are those between its base and the hand; all others are fixed. Masses,
    inertias and the limits of position, velocity and torque are the file's; a continuous joint has no limits.

    Args:
        name: A name in ``ARMS``, or the path of a URDF file.
        tip: Link whose frame is the hand, its z axis the approach direction. None: chosen by the structure of
            the robot and the names of its links (see ``hand``).
        home: Ready posture, one number a joint, [rad]. None: the middle of each joint's range.
        hold: Joints that do not move, with their places, [rad] or [m].
        packages: Folders whose meshes may be read besides those of the file's own package (see
            ``find_mesh``).

    Raises:
        UsageError: ``tip``, ``home`` or ``hold`` does not fit this arm.
        NotFoundError: No such arm or file, or PyBullet is not installed.
        InputDataError: The file is damaged, refers to damaged or missing meshes or to files that may not be
            read, or describes no arm.
    """
    if name in ARMS:
        for option, given in (
            ("tip", tip),
            ("home", home),
            ("hold", hold or None),
            ("package", packages or None),
        ):
            if given is not None:
                raise UsageError(
                    f"{option}: the arm {name} has its own; this is for arms by path.", hint="Leave it out."
                )
        return ARMS[name]
    path = Path(name)
    try:
        stamp = path.stat()
    except OSError as error:
        raise NotFoundError(
            f"{name}: there is no such arm.", hint=f"One of {', '.join(ARMS)}, or the path of a URDF file."
        ) from error
    load_bullet()  # its absence is reported before anything about the file
    paths = tuple(os.environ.get(variable, "") for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"))
    return _read(path, (path.resolve(), stamp.st_mtime_ns, *paths), tip, home, hold, packages)


@lru_cache(maxsize=8)  # every episode of a batch asks for the same arm
def _read(
    path: Path,
    _: object,
    tip: str | None,
    home: tuple[float, ...] | None,
    hold: Held,
    packages: tuple[str, ...],
) -> ArmModel:
    robot = read_robot(path)
    places = robot.places(dict(hold))
    hand = _default_hand(robot, places) if tip is None else _named_link(robot, tip)
    chain = free_joints(robot, hand, places)
    _require_arm(robot, chain, hand)
    fixed = _fixed(robot, chain, places)
    text, notes = for_bullet(robot, fixed, tuple(map(Path, packages)))
    joints, links = _probed(robot, text)
    lower, upper = (tuple(getattr(joint, end) for joint in chain) for end in ("lower", "upper"))
    model = ArmModel(
        name=path.name,
        title=path.name,
        urdf=str(path.resolve()),
        indices=tuple(joints.index(joint.name) for joint in chain),
        tip=links.index(hand),
        tip_link=hand,
        joints=tuple(joint.name for joint in chain),
        lower=lower,
        upper=upper,
        max_velocity=tuple(joint.velocity for joint in chain),
        max_torque=tuple(joint.effort for joint in chain),
        home=tuple(map(_middle, chain)) if home is None else _checked(home, chain),
        pitch_joint=None,
        finger_axis=-1,
        fingers=(),
        reach_centre=(0.0, 0.0, 0.0),
        yaw_share=1.0 if len(chain) < REDUNDANT else 0.5,
        text=text,
        held=tuple((name, place) for name, place in fixed.items() if robot.joints[name].moves),
        notes=(*_mimic_notes(robot, chain, fixed), *notes),
    )
    return replace(model, reach_centre=_reach_centre(model))


def _probed(robot: Robot, text: str) -> tuple[list[str], list[str]]:
    """Return the names of joints and links in Bullet's order; another process loads the description first."""
    try:
        with described(text) as file, Child(LIMITS) as child:
            joints, links = child.call(probe.robot, file)
            return list(joints), list(links)
    except InputDataError as refusal:
        reason = str(refusal)
    except TimeoutError:
        reason = f"takes longer than {LIMITS.seconds:g} s to load"
    except (ChildDiedError, MemoryError, ValueError) as error:
        how = f"the process that tries {error}" if isinstance(error, ChildDiedError) else str(error)
        reason = f"cannot be loaded ({how or 'no memory is left'}); it, or a mesh it names, is damaged"
    raise robot.refused(reason)


def _default_hand(robot: Robot, places: Mapping[str, float]) -> str:
    hands = [hand_frame(robot, end, places) for end in arm_ends(robot, places)]
    if len(hands) == 1:
        return hands[0]
    raise InputDataError(
        printable(f"{robot.path}: this robot has {len(hands)} arms of equal length."),
        hint=printable(f"Name the hand with --tip: {', '.join(hands)}."),
    )


def _named_link(robot: Robot, tip: str) -> str:
    if tip in robot.links[1:]:
        return tip
    raise UsageError(
        f"tip: {robot.path} has no link {tip!r} beyond its base.",
        hint=did_you_mean(tip, robot.links[1:]) or f"Its links are {', '.join(robot.links[1:])}.",
    )


def _require_arm(robot: Robot, chain: list[Joint], hand: str) -> None:
    if not any(joint.moves for joint in robot.joints.values()):
        raise robot.refused("has no joint that moves")
    for joint in chain:
        if joint.mimic is not None:
            raise robot.refused(
                f"has a joint between base and hand, {joint.name}, that mimics another, {joint.mimic.joint}",
                "This is not simulated. Name a hand before that joint with --tip, or hold both: "
                f"--hold {joint.mimic.joint}=0.",
            )
    if len(chain) < FEWEST_JOINTS:
        raise InputDataError(
            printable(
                f"{robot.path}: between its base and {hand} this robot has {len(chain)} "
                f"moving joint{'' if len(chain) == 1 else 's'}; a hand needs at least {FEWEST_JOINTS}."
            ),
            hint=printable(f"Name the hand with --tip: {', '.join(robot.links[1:])}."),
        )
    for joint in chain:
        if math.isnan(joint.lower) or math.isnan(joint.upper):
            raise robot.refused(f"gives joint {joint.name} no lower and upper limit")
        numbers = {"velocity": joint.velocity, "effort": joint.effort}
        if joint.kind != "continuous":
            numbers["range"] = joint.upper - joint.lower
        for limit, value in numbers.items():
            if not (math.isfinite(value) and value > 0):
                raise InputDataError(
                    printable(f"{robot.path}: joint {joint.name} has no {limit} limit above zero."),
                    hint='A joint needs <limit lower="…" upper="…" velocity="…" effort="…"/>.',
                )


def _fixed(robot: Robot, chain: list[Joint], places: Mapping[str, float]) -> dict[str, float]:
    """Return where the joints stay that are not the arm's: where they are held, else next to 0."""
    resting = {
        name: joint.clipped(0.0)
        for name, joint in robot.joints.items()
        if joint.moves and joint not in chain and joint.mimic is None
    }
    followers = {
        name: joint.clipped(joint.mimic.offset)
        for name, joint in robot.joints.items()
        if joint.mimic is not None and joint not in chain
    }
    found = {**followers, **resting, **robot.places(resting), **places}
    return {name: found[name] for name in robot.joints if name in found}


def _mimic_notes(robot: Robot, chain: list[Joint], fixed: Mapping[str, float]) -> list[str]:
    """Return notes on joints that should follow one of the arm's, and are not between base and hand."""
    names = [joint.name for joint in chain]
    return [
        f"joint {joint.name} mimics {joint.mimic.joint}, but stays where it is: it does not move the hand."
        for joint in robot.joints.values()
        if joint.mimic is not None and joint.mimic.joint in names and joint.name in fixed
    ]


def _middle(joint: Joint) -> float:
    return 0.0 if joint.kind == "continuous" else 0.5 * (joint.lower + joint.upper)


def _checked(home: Angles, chain: list[Joint]) -> Angles:
    if len(home) != len(chain):
        names = ", ".join(joint.name for joint in chain)
        raise UsageError(f"home: expected {len(chain)} numbers ({names}), got {len(home)}.")
    for joint, angle in zip(chain, home, strict=True):
        if joint.clipped(angle) != angle:
            raise UsageError(
                f"home: joint {joint.name} can be between {joint.lower:g} and {joint.upper:g}, not {angle:g}."
            )
    return home


def _reach_centre(model: ArmModel) -> tuple[float, float, float]:
    """Return a position in front that the hand reaches in many postures, not too near the base, [m]."""
    generator = np.random.default_rng(0)
    postures = generator.uniform(
        np.maximum(model.lower, -math.pi),
        np.minimum(model.upper, math.pi),
        (SURVEY_POSTURES, model.n_joints),
    )
    with silenced(1), ArmBody(model, 0.0, shapes="none") as body:
        hands = []
        for posture in postures:
            body.pose(posture)
            hands.append(body.hand()[0])
    places = np.array(hands)
    front = places[(places[:, 0] > 0) & (places[:, 2] > 0)]
    chosen = front if len(front) else places
    return float(np.percentile(chosen[:, 0], 75)), 0.0, float(np.median(chosen[:, 2]))
