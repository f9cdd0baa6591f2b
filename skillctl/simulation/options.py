"""What to simulate: the options of one episode, checked when they are made."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from skillctl.errors import UsageError
from skillctl.simulation.arm import ARMS
from skillctl.simulation.ik import HAND_PITCH, HandPolicy

Plane: TypeAlias = Literal["xy", "xz", "yz"]
Vector: TypeAlias = tuple[float, ...]

PLANES: tuple[Plane, ...] = get_args(Plane)
HANDS: tuple[HandPolicy, ...] = tuple(HAND_PITCH)


@dataclass(frozen=True, slots=True)
class SimulationOptions:
    """How a skill is put on an arm and run. None means: chosen automatically (see ``prepare``).

    Attributes:
        arm: A name in ``ARMS``.
        start: Where the motion begins, in the skill's own coordinates; None: the arm's ready posture.
        target: Where the skill's attractor is moved to, in the skill's own coordinates; None: not moved.
        plane: Workspace plane of a 2-D skill; None: the one its coordinate names say.
        scale: Workspace metres per metre of the skill. None: 1; a 2-D skill much smaller or larger than
            the workspace is brought to 0.3 m.
        origin: Workspace position of the skill's zero, [m]. None: 0 for a 3-D skill; a 2-D skill is
            centred in front of the arm.
        hand: Orientation of the hand (see ``Kinematics``). None: the first of horizontal, down and free
            (in the xy plane down, horizontal, free) with which the arm can follow the whole plan within 1 mm.
        base_yaw: How far the arm's base is turned about the vertical, [rad]. None: to the multiple of a
            quarter turn that faces the target.
        max_speed, max_acceleration: Of the hand, [m/s] and [m/s²].
        tolerance: Distance to the target that counts as reached, [m].
        settle_time: How long the hand must stay within the tolerance, [s].
        horizon: Longest simulated time, [s]. None: from how long the skill itself takes.
        seed: Of the random postures tried when the start's or target's joints are searched.
    """

    arm: str = "panda"
    start: Vector | None = None
    target: Vector | None = None
    plane: Plane | None = None
    scale: float | None = None
    origin: Vector | None = None
    hand: HandPolicy | None = None
    base_yaw: float | None = None
    max_speed: float = 0.3
    max_acceleration: float = 1.5
    tolerance: float = 2e-3
    settle_time: float = 0.5
    horizon: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        _require_choice("arm", self.arm, tuple(ARMS))
        _require_choice("plane", self.plane, (None, *PLANES))
        _require_choice("hand", self.hand, (None, *HANDS))
        for name in ("max_speed", "max_acceleration", "tolerance", "settle_time", "horizon", "scale"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise UsageError(f"{name}: must be a positive number, got {value!r}.")
        for name in ("start", "target", "origin"):
            vector = getattr(self, name)
            if vector is not None and not all(map(math.isfinite, vector)):
                raise UsageError(f"{name}: must be finite numbers, got {_listed(vector)}.")
        if self.origin is not None and len(self.origin) != 3:
            raise UsageError(f"origin: expected 3 numbers (x, y, z), got {len(self.origin)}.")
        if self.base_yaw is not None and not math.isfinite(self.base_yaw):
            raise UsageError(f"base_yaw: must be a finite angle, got {self.base_yaw!r}.")
        if self.seed < 0:
            raise UsageError(f"seed: must not be negative, got {self.seed}.")


def _require_choice(name: str, value: str | None, choices: tuple[str | None, ...]) -> None:
    if value not in choices:
        listed = ", ".join(str(choice) for choice in choices if choice is not None)
        raise UsageError(f"{name}: one of {listed}, not {value!r}.")


def _listed(values: Vector) -> str:
    return ", ".join(f"{value:g}" for value in values)
