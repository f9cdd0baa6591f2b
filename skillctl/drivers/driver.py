"""What a robot has to offer so that a skill can be run on it. A new kind of robot is one subclass."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, ClassVar, NamedTuple

from skillctl.arrays import FloatArray
from skillctl.errors import NotFoundError, UsageError
from skillctl.model.skill import Skill

PATIENCE, PATIENCE_PERIODS = 0.1, 3  # [s], periods


class Measured(NamedTuple):
    """A state that a robot has measured.

    Attributes:
        stamp: A number that is another one for each new measurement, such as the robot's own time.
        numbers: Of a hand: x, y, z [m], and a rotation vector [rad] or qx, qy, qz, qw if it is known how the
            hand is turned. Of joints: their angles [rad]. In the frame of the skill.
    """

    stamp: float
    numbers: Sequence[float]


@dataclass(frozen=True, eq=False, slots=True)
class Setup:
    """What a driver is made with.

    Attributes:
        address: What stands behind the colon of ``--driver``; empty if nothing does.
        skill: What will be run.
        period: Time between two commands, [s]; None leaves it to the driver.
        max_acceleration: Of the commands, [m/s²].
        start: Where a simulated robot starts, a state (d,); None if nobody says.
    """

    address: str
    skill: Skill
    period: float | None = None
    max_acceleration: float = 1.0
    start: FloatArray | None = None

    def require_hand(self) -> None:
        """Raise UsageError unless the skill moves a hand in three dimensions: no joints, no plane."""
        space = self.skill.space
        if space.unit != "m" or space.positions != 3:
            raise UsageError(
                f"this driver moves a hand in three dimensions; the skill moves {', '.join(space.names)} in "
                f"{space.unit}.",
                hint="Use the driver fake or udp, or one of your own.",
            )


class Driver(ABC):
    """A robot that measures its state and follows commands. It is made with a ``Setup``, which connects it.

    Attributes:
        period: Time between two commands, [s], if nobody asks for another.
        patience: The robot has to stop by itself if no command comes for so long, [s].
        untried: What it was tried on instead of hardware, in words; empty for what needs none.
        grips: Whether ``event`` does something.
        place: Where states come from, in words.
        faults: Exceptions of the robot's library with which it refuses to go on; the run ends with them.
    """

    faults: tuple[type[Exception], ...] = ()
    untried: ClassVar[str] = ""
    grips: bool = False
    place: str = "the robot"

    def __init__(self, setup: Setup) -> None:
        """Connect to the robot, which must not move yet.

        Raises:
            NotFoundError: A library that is not installed, or no robot.
            UsageError: A skill or an address that is not for this robot.
        """
        self.period = setup.period or 0.01
        self.patience = max(PATIENCE, PATIENCE_PERIODS * self.period)

    @abstractmethod
    def state(self) -> Measured | None:
        """Return the newest measurement, without waiting for it; None before the first."""

    @abstractmethod
    def command(self, velocity: Sequence[float]) -> None:
        """Have the robot move with a velocity until the next command.

        Args:
            velocity: Of a hand in its frame: (vx, vy, vz [m/s]), or a twist with (ωx, ωy, ωz [rad/s]); of
                joints theirs.
        """

    def event(self, text: str) -> bool:
        """Do what a chain asks for, such as ``close``; return whether it is still being done.

        It is called once a period until it returns False.
        """
        return False

    def now(self) -> float:
        """Return the time, [s], of which only differences have a meaning."""
        return time.monotonic()

    def wait(self, until: float) -> None:
        """Return at this time, or at once if it is past."""
        if (ahead := until - self.now()) > 0:
            time.sleep(ahead)

    def close(self) -> None:  # noqa: B027 - most have nothing to do
        """Let the robot go, at rest."""


def twist(velocity: Sequence[float]) -> list[float]:
    """Return the twist (6) of a hand: one that is told to move only does not turn."""
    return [*velocity, 0.0, 0.0, 0.0][:6]


def library(module: str, package: str) -> Any:
    """Return a module of a robot's library.

    Raises:
        NotFoundError: It is not installed, or does not load.
    """
    try:
        return import_module(module)
    except ImportError as error:
        absent = isinstance(error, ModuleNotFoundError) and error.name == module.partition(".")[0]
        what = "is not installed" if absent else f"cannot be loaded ({error})"
        raise NotFoundError(f"{module}, which this driver needs, {what}.", hint=f"{package}.") from None
