"""The options of a run on a robot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from skillctl.errors import UsageError
from skillctl.options import MOTION, RESULT, option, read_point, read_ratio
from skillctl.stability.requirements import Ranges, read_box

ROBOT = "The robot"
SAFETY = "What ends the motion"


@dataclass(frozen=True)
class RunOptions:
    """How a skill is run on a robot.

    Attributes:
        driver: Name of the driver, and what it connects to behind a colon.
        start: Where a simulated robot starts; None: where the skill's first demonstration does.
        period: Time between two commands, [s]; None: that of the driver.
        max_speed, max_turn: Largest speed [m/s] and turning speed [rad/s] of the hand.
        max_acceleration, max_turn_acceleration: Limits of both, [m/s²] and [rad/s²].
        max_jerk, max_turn_jerk: Limits of both, [m/s³] and [rad/s³]; None: no limit.
        tolerance, turn_tolerance: The hand has arrived this near to its target, [m] and [rad].
        timeout: Longest time of the motion, [s].
        stale: The run ends if no new state comes for so long, [s]; None: 0.1 s, or five periods if these are
            longer.
        box: The position never leaves it, nor would it while the hand slows down; None: no limit.
        allow_unproved: Run also what is not proved, or not for this period.
        log: File for what was measured and commanded, HDF5.
        dry_run: Log whose states are replayed instead of those of a robot.
    """

    driver: str = option(
        "fake",
        metavar="DRIVER",
        group=ROBOT,
        help="Which robot, and behind a colon its address: fake, fake:real, pybullet:ARM, udp:PORT, "
        "franky:HOST, ur_rtde:HOST, ros2-twist:NAMESPACE, ros2-pose:NAMESPACE, or that of a plug-in.",
    )
    start: tuple[float, ...] | None = option(
        read=read_point,
        metavar="X,Y,Z[,QX,QY,QZ,QW]",
        group=ROBOT,
        help="Where a simulated robot starts. Default: where the first demonstration does.",
    )
    period: float | None = option(
        read=read_ratio,
        metavar="S",
        group=ROBOT,
        help="Time between two commands, as in 0.001 or 1/60. Default: by the driver, mostly 0.01.",
    )
    max_speed: float = option(
        0.25, name="speed", metavar="M/S", group=MOTION, help="Largest speed of the hand."
    )
    max_turn: float = option(
        1.0, name="turn-speed", metavar="RAD/S", group=MOTION, help="Largest turning speed."
    )
    max_acceleration: float = option(
        1.0,
        name="acceleration",
        metavar="M/S²",
        group=MOTION,
        help="Largest acceleration of the hand, also where it is stopped.",
    )
    max_jerk: float | None = option(
        name="jerk", metavar="M/S³", group=MOTION, help="Largest jerk of the hand. Default: no limit."
    )
    max_turn_acceleration: float = option(
        4.0,
        name="turn-acceleration",
        metavar="RAD/S²",
        group=MOTION,
        help="Largest acceleration of turning.",
    )
    max_turn_jerk: float | None = option(
        name="turn-jerk", metavar="RAD/S³", group=MOTION, help="Largest jerk of turning. Default: no limit."
    )
    tolerance: float = option(
        0.002, metavar="M", group=SAFETY, help="The hand has arrived this near to the target."
    )
    turn_tolerance: float = option(
        0.035, metavar="RAD", group=SAFETY, help="And turned as near to it as this."
    )
    timeout: float = option(60.0, metavar="S", group=SAFETY, help="Stop if it has not arrived after so long.")
    stale: float | None = option(
        metavar="S",
        group=SAFETY,
        help="Stop if the robot sends no new state for so long. Default: 0.1, at least five periods.",
    )
    box: Ranges | None = option(
        read=read_box,
        metavar="X1:X2,Y1:Y2,…",
        group=SAFETY,
        help="Stop within this box, before the hand leaves it. A side may be open, as in 0:.",
    )
    allow_unproved: bool = option(
        False,
        group=SAFETY,
        help="Run a skill that is not proved stable, or for a longer period than is proved.",
    )
    log: Path | None = option(
        metavar="F.h5", group=RESULT, help="Write every state and command, and what they were made of."
    )
    dry_run: Path | None = option(
        metavar="LOG.h5",
        group=RESULT,
        help="Move nothing: replay the states in a log of `run` or `simulate`, and say (and log) what would "
        "have been commanded.",
    )

    def __post_init__(self) -> None:
        for name, value in (
            ("period", self.period),
            ("speed", self.max_speed),
            ("turn-speed", self.max_turn),
            ("acceleration", self.max_acceleration),
            ("turn-acceleration", self.max_turn_acceleration),
            ("jerk", self.max_jerk),
            ("turn-jerk", self.max_turn_jerk),
            ("tolerance", self.tolerance),
            ("turn-tolerance", self.turn_tolerance),
            ("timeout", self.timeout),
            ("stale", self.stale),
        ):
            if value is not None and not 0 < value < math.inf:
                raise UsageError(f"{name}: must be a positive number, got {value:g}.")
        for low, high in self.box or ():
            if not low < high:
                raise UsageError(f"box: a range must end after it starts, got {low:g}:{high:g}.")
