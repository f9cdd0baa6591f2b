"""What moves the arm: the one interface between the loop of an episode and the ways to control an arm."""

from __future__ import annotations

from typing import Protocol

from skillctl.arrays import FloatArray
from skillctl.simulation.arm import CONTROL_PERIOD, ArmState, DrivenArm
from skillctl.simulation.control import Follower
from skillctl.simulation.torque import TORQUE_PERIOD, TorqueArm


class Driver(Protocol):
    """An arm in its world, told once per period how its hand shall move.

    Attributes:
        period: Time between two commands, [s].
        reference: Where the hand should be by now, shape (3,), [m].
        residual: How far inverse kinematics missed the reference at the last step, [m].
        refusals: Steps in a row, up to the last, for which there were no joints.
        at_limit: Joint, from 0, that was at its limit when that last happened; None if none was.
    """

    @property
    def period(self) -> float: ...  # noqa: D102

    @property
    def reference(self) -> FloatArray: ...  # noqa: D102

    @property
    def residual(self) -> float: ...  # noqa: D102

    @property
    def refusals(self) -> int: ...  # noqa: D102

    @property
    def at_limit(self) -> int | None: ...  # noqa: D102

    def state(self) -> ArmState:
        """Return the measured state."""

    def drive(self, velocity: FloatArray, push: FloatArray | None = None) -> float:
        """Let one period pass, in which the hand shall move with ``velocity`` (3,) [m/s].

        Args:
            velocity: Of the hand.
            push: Force on the hand all through the period, shape (3,), [N].

        Returns:
            The share of the velocity that the joints' limits allowed.
        """

    def displace(self, joints: FloatArray) -> None:
        """Put the joints (n,) [rad] elsewhere at once."""


class PositionDriver:
    """Position motors follow the joints of a reference that moves with the asked velocity."""

    period = CONTROL_PERIOD

    def __init__(self, follower: Follower, arm: DrivenArm) -> None:
        """Args: follower, on a twin of the arm; arm, standing at the follower's joints."""
        self._follower, self._arm = follower, arm

    @property
    def reference(self) -> FloatArray:
        """Where the hand should be by now, shape (3,), [m]."""
        return self._follower.reference

    @property
    def residual(self) -> float:
        """How far inverse kinematics missed the reference at the last step, [m]."""
        return self._follower.residual

    @property
    def refusals(self) -> int:
        """Steps in a row, up to the last, for which there were no joints."""
        return self._follower.refusals

    @property
    def at_limit(self) -> int | None:
        """Joint that was at its limit when there were no joints last, or None."""
        return self._follower.at_limit

    def state(self) -> ArmState:
        """Return the measured state."""
        return self._arm.state()

    def drive(self, velocity: FloatArray, push: FloatArray | None = None) -> float:
        """Let one period pass, in which the hand shall move so."""
        joints = self._follower.joints
        share = self._follower.advance(velocity, self._arm.state().hand)
        self._arm.push = push
        self._arm.drive(joints, self._follower.joints)
        return share

    def displace(self, joints: FloatArray) -> None:
        """Put the joints elsewhere at once; the reference goes along."""
        self._follower.restart(joints)
        self._arm.place(joints)


class TorqueDriver:
    """Torques make the hand move with the asked velocity, and yield when it is pushed.

    There is no reference: the hand is where it should be by definition.
    """

    period = TORQUE_PERIOD
    residual = 0.0
    refusals = 0
    at_limit = None

    def __init__(self, arm: TorqueArm) -> None:
        """Args: arm, at rest."""
        self._arm = arm

    @property
    def reference(self) -> FloatArray:
        """Where the hand is, shape (3,), [m]."""
        return self._arm.state().hand

    def state(self) -> ArmState:
        """Return the measured state."""
        return self._arm.state()

    def drive(self, velocity: FloatArray, push: FloatArray | None = None) -> float:
        """Let one period pass, in which the hand shall move so."""
        self._arm.push = push
        return self._arm.drive(velocity)

    def displace(self, joints: FloatArray) -> None:
        """Put the joints elsewhere at once."""
        self._arm.place(joints)
