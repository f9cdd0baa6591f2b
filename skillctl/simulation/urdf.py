"""Arms by path: a URDF file becomes an ``ArmModel`` after another process has read it safely."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from skillctl.errors import InputDataError, NotFoundError, UsageError, did_you_mean, printable
from skillctl.simulation import probe
from skillctl.simulation.arm import ArmBody
from skillctl.simulation.arms import ARMS, Angles, ArmModel
from skillctl.simulation.bullet import load_bullet, silenced
from skillctl.workers.child import Child, ChildDiedError
from skillctl.workers.limits import Limits

LIMITS = Limits(seconds=60.0, memory=2**32)  # to load the file and its meshes
MAX_BYTES = 16 * 2**20  # of the file itself; meshes are files of their own
FEWEST_JOINTS = 3  # to move a hand in three dimensions
REDUNDANT = 7  # joints: with fewer, a hand that does not turn with the arm meets singularities of the wrist
FULL_TURN = 2 * math.pi  # [rad]: how far a joint without limits is turned either way
SURVEY_POSTURES = 400  # from which the comfortable workspace is estimated

Joint = dict[str, Any]  # as ``probe`` describes it


def find_arm(name: str, tip: str | None = None, home: tuple[float, ...] | None = None) -> ArmModel:
    """Return the arm of this name, or the one in this URDF file.

    The joints of an arm by file are those between its base and the tip; all others are fixed. The limits of
    position, velocity and torque are the file's; a continuous joint may make one turn either way.

    Args:
        name: A name in ``ARMS``, or the path of a URDF file.
        tip: Link whose frame is the hand, its z axis the approach direction. None: the last link before the
            robot branches into several moving parts.
        home: Ready posture, one number a joint, [rad]. None: the middle of each joint's range.

    Raises:
        UsageError: ``tip`` or ``home`` does not fit this arm.
        NotFoundError: No such arm or file, or PyBullet is not installed.
        InputDataError: The file is damaged, refers to damaged or missing meshes, or describes no arm.
    """
    if name in ARMS:
        if tip is not None or home is not None:
            option = "tip" if tip is not None else "home"
            raise UsageError(
                f"{option}: the arm {name} has its own; this is for arms by path.",
                hint="Leave it out.",
            )
        return ARMS[name]
    path = Path(name)
    try:
        stamp = path.stat()
    except OSError as error:
        raise NotFoundError(
            f"{name}: there is no such arm.", hint=f"One of {', '.join(ARMS)}, or the path of a URDF file."
        ) from error
    if not path.is_file() or stamp.st_size > MAX_BYTES:
        raise InputDataError(f"{name}: is no file, or larger than {MAX_BYTES / 2**20:.0f} MiB.")
    load_bullet()  # its absence is reported before anything about the file
    return _read(path.resolve(), stamp.st_mtime_ns, tip, home)


@lru_cache(maxsize=8)  # every episode of a batch asks for the same arm
def _read(path: Path, _: int, tip: str | None, home: tuple[float, ...] | None) -> ArmModel:
    joints = _probed(path)
    last = _default_tip(joints) if tip is None else _named_link(path, joints, tip)
    chain = _chain(joints, last)
    _require_arm(path, joints, chain, last)
    lower, upper = zip(*map(_range, chain), strict=True)
    ready = [0.5 * (low + high) for low, high in zip(lower, upper, strict=True)]
    model = ArmModel(
        name=path.name,
        title=path.name,
        urdf=str(path),
        indices=tuple(joint["index"] for joint in chain),
        tip=last,
        lower=lower,
        upper=upper,
        max_velocity=tuple(joint["velocity"] for joint in chain),
        max_torque=tuple(joint["torque"] for joint in chain),
        home=tuple(ready) if home is None else _checked(home, chain),
        pitch_joint=None,
        finger_axis=-1,
        fingers=(),
        reach_centre=(0.0, 0.0, 0.0),
        yaw_share=1.0 if len(chain) < REDUNDANT else 0.5,
        held=tuple(
            (joint["index"], float(np.clip(0.0, *_range(joint))))
            for joint in joints
            if joint["moves"] and joint not in chain
        ),
    )
    return replace(model, reach_centre=_reach_centre(model))


def _probed(path: Path) -> list[Joint]:
    """Return the joints of the file, which a process of its own reads."""
    try:
        with Child(LIMITS) as child:
            return list(child.call(probe.joints, str(path)))
    except InputDataError as refusal:
        reason = str(refusal)
    except TimeoutError:
        reason = f"takes longer than {LIMITS.seconds:g} s to load"
    except (ChildDiedError, MemoryError, ValueError) as error:
        how = f"the process that tries {error}" if isinstance(error, ChildDiedError) else str(error)
        reason = f"cannot be loaded ({how or 'no memory is left'}); it, or a mesh it names, is damaged"
    raise _refused(path, reason)


def _refused(path: Path, reason: str) -> InputDataError:
    return InputDataError(
        printable(f"{path}: this URDF file {reason}."), hint="Check the file and the meshes it names."
    )


def _default_tip(joints: list[Joint]) -> int:
    """Return the last link from the base on before the robot branches into several moving parts."""
    link = -1
    while below := [joint for joint in joints if joint["parent"] == link]:
        moving = [joint for joint in below if _moves_something(joint, joints)]
        if len(moving) > 1:
            return link
        link = (moving or below)[-1]["index"]
    return link


def _moves_something(joint: Joint, joints: list[Joint]) -> bool:
    return joint["moves"] or any(
        _moves_something(below, joints) for below in joints if below["parent"] == joint["index"]
    )


def _named_link(path: Path, joints: list[Joint], tip: str) -> int:
    links = {joint["link"]: int(joint["index"]) for joint in joints}
    if tip in links:
        return links[tip]
    raise UsageError(
        f"tip: {path} has no link {tip!r} beyond its base.",
        hint=did_you_mean(tip, list(links)) or f"Its links are {', '.join(links)}.",
    )


def _chain(joints: list[Joint], last: int) -> list[Joint]:
    """Return the moving joints between the base and a link, in this order."""
    chain, index = [], last
    while index >= 0:
        joint = next(joint for joint in joints if joint["index"] == index)
        chain.append(joint)
        index = joint["parent"]
    return [joint for joint in reversed(chain) if joint["moves"]]


def _require_arm(path: Path, joints: list[Joint], chain: list[Joint], last: int) -> None:
    if not any(joint["moves"] for joint in joints):
        raise _refused(path, "has no joint that moves")
    if len(chain) < FEWEST_JOINTS:
        links = {joint["index"]: joint["link"] for joint in joints}
        raise InputDataError(
            printable(
                f"{path}: between its base and {links.get(last, 'the hand')} this robot has {len(chain)} "
                f"moving joint{'' if len(chain) == 1 else 's'}; a hand needs at least {FEWEST_JOINTS}."
            ),
            hint=f"Name the hand with --tip: {', '.join(links.values())}.",
        )
    for joint in chain:
        lower, upper = _range(joint)
        numbers = {"velocity": joint["velocity"], "effort": joint["torque"], "range": upper - lower}
        for limit, value in numbers.items():
            if not (math.isfinite(value) and value > 0):
                raise InputDataError(
                    printable(f"{path}: joint {joint['name']} has no {limit} limit above zero."),
                    hint='A joint needs <limit lower="…" upper="…" velocity="…" effort="…"/>.',
                )


def _range(joint: Joint) -> tuple[float, float]:
    if joint["continuous"]:
        return -FULL_TURN, FULL_TURN
    return joint["lower"], joint["upper"]


def _checked(home: Angles, chain: list[Joint]) -> Angles:
    if len(home) != len(chain):
        names = ", ".join(joint["name"] for joint in chain)
        raise UsageError(f"home: expected {len(chain)} numbers ({names}), got {len(home)}.")
    for joint, angle in zip(chain, home, strict=True):
        lower, upper = _range(joint)
        if not lower <= angle <= upper:
            raise UsageError(
                f"home: joint {joint['name']} can be between {lower:g} and {upper:g}, not {angle:g}."
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
