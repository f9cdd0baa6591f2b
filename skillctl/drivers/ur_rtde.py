"""An arm of Universal Robots, by the library ur_rtde."""

from __future__ import annotations

from collections.abc import Sequence

from skillctl.drivers.driver import Driver, Measured, Setup, library, twist
from skillctl.errors import NotFoundError, UsageError

GRIPPER = 0  # digital output of the tool: high closes
STOPPING = 2.0  # [m/s²], with which the arm is stopped if it still moves at the end


class UniversalRobot(Driver):
    """``ur_rtde:HOST``: poses of the tool in the base frame; ``close`` and ``open`` switch a tool output."""

    untried = "a stand-in of the library"
    grips = True
    faults = (RuntimeError,)

    def __init__(self, setup: Setup) -> None:
        """Connect, and upload the library's script to the arm. See ``Driver``."""
        super().__init__(setup)
        setup.require_hand()
        control, receive, io = (
            library(f"rtde_{part}", "Install it: pip install ur_rtde")
            for part in ("control", "receive", "io")
        )
        if not setup.address:
            raise UsageError(
                "driver: the address of the arm is missing.", hint="Add it: ur_rtde:192.168.0.2."
            )
        try:
            self._receive = receive.RTDEReceiveInterface(setup.address)
            self._control = control.RTDEControlInterface(setup.address)
            self._io = io.RTDEIOInterface(setup.address)
        except RuntimeError as error:
            raise NotFoundError(f"no arm answers at {setup.address}: {str(error).rstrip('.')}.") from None
        self._control.setWatchdog(1 / self.patience)
        self._acceleration = setup.max_acceleration

    def state(self) -> Measured:
        """Return the pose of the tool: position and rotation vector."""
        return Measured(self._receive.getTimestamp(), self._receive.getActualTCPPose())

    def command(self, velocity: Sequence[float]) -> None:
        """Have the tool move with this twist, which it takes up with the largest acceleration."""
        self._control.kickWatchdog()
        if not self._control.speedL(twist(velocity), self._acceleration, 0.0):
            raise RuntimeError("the arm does not take commands; is it in a protective stop?")

    def event(self, text: str) -> bool:
        """Switch the output of the gripper; how long it takes, a ``wait`` in the chain has to say."""
        if text in ("close", "open"):
            self._io.setToolDigitalOut(GRIPPER, text == "close")
        return False

    def close(self) -> None:
        """Stop the script."""
        self._control.speedStop(STOPPING)
        self._control.stopScript()
        for interface in (self._control, self._receive, self._io):
            interface.disconnect()
