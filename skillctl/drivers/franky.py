"""A Franka arm, by the library franky, which turns velocities into smooth motions at 1 kHz."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from skillctl.drivers.driver import Driver, Measured, Setup, library, twist
from skillctl.errors import NotFoundError, UsageError

REALTIME = Path("/sys/kernel/realtime")  # of a real-time kernel, which libfranka looks for there, too
OPEN_SPEED, GRASP_SPEED, GRASP_FORCE = 0.1, 0.05, 20.0  # [m/s], [m/s], [N], of the fingers
WIDEST = 0.1  # [m], more than the fingers open: an object of any width counts as grasped


class FrankaArm(Driver):
    """``franky:HOST``: poses of the end effector in the base frame; fingers that ``close`` and ``open``."""

    untried = "the simulated FR3 of franky-sim"
    grips = True

    def __init__(self, setup: Setup) -> None:
        """Connect; errors of an earlier motion are cleared. See ``Driver``."""
        super().__init__(setup)
        setup.require_hand()
        self._franky = franky = library("franky", "Install it: pip install franky-control")
        if not setup.address:
            raise UsageError("driver: the address of the arm is missing.", hint="Add it: franky:172.16.0.2.")
        self._host = setup.address
        self.faults = franky.CommandException, franky.ControlException, franky.NetworkException
        urgent = franky.RealtimeConfig.Enforce if REALTIME.exists() else franky.RealtimeConfig.Ignore
        try:
            self._robot = franky.Robot(self._host, realtime_config=urgent)
            self._robot.recover_from_errors()
        except self.faults as error:
            raise NotFoundError(f"no Franka arm answers at {self._host}: {str(error).rstrip('.')}.") from None
        self._gripper: Any = None
        self._gripping: Any = None

    def state(self) -> Measured:
        """Return the pose of the end effector, O_T_EE."""
        state = self._robot.state
        pose = state.O_T_EE
        numbers = (*pose.translation.tolist(), *pose.quaternion.tolist())
        return Measured(state.time.to_msec(), numbers)

    def command(self, velocity: Sequence[float]) -> None:
        """Replace the motion by one with this twist, which ends by itself."""
        franky, six = self._franky, twist(velocity)
        motion = franky.CartesianVelocityMotion(
            franky.Twist(six[:3], six[3:]), duration=franky.Duration(round(1e3 * self.patience))
        )
        self._robot.move(motion, asynchronous=True)

    def event(self, text: str) -> bool:
        """Close or open the fingers."""
        if self._gripping is None and text in ("close", "open"):
            self._gripper = self._gripper or self._franky.Gripper(self._host)
            if text == "close":
                self._gripping = self._gripper.grasp_async(0.0, GRASP_SPEED, GRASP_FORCE, 0.0, WIDEST)
            else:
                self._gripping = self._gripper.open_async(OPEN_SPEED)
        if self._gripping is not None and not self._gripping.wait(0.0):
            return True
        self._gripping = None
        return False

    def close(self) -> None:
        """Wait until the arm rests."""
        self._robot.move(self._franky.CartesianVelocityStopMotion(), asynchronous=True)
        self._robot.join_motion(1.0)
