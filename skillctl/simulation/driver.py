"""What moves the arm: the one interface between the loop of an episode and the ways to control an arm."""

from __future__ import annotations

from typing import Protocol

from skillctl.arrays import FloatArray
from skillctl.simulation.arm import ArmState, DrivenArm
from skillctl.simulation.control import Follower


class Driver(Protocol):
    """An arm in its world, told once per control period how its hand shall move.

    Attributes:
        reference: Where the hand should be by now, shape (3,), [m].
        residual: How far inverse kinematics missed the reference at the last step, [m].
        refusals: Steps in a row, up to the last, for which there were no joints.
    """

    @property
    def reference(self) -> FloatArray: ...  # noqa: D102

    @property
    def residual(self) -> float: ...  # noqa: D102

    @property
    def refusals(self) -> int: ...  # noqa: D102

    def state(self) -> ArmState:
        """Return the measured state."""

    def drive(self, velocity: FloatArray, hand: FloatArray, push: FloatArray | None = None) -> float:
        """Let one control period pass, in which the hand shall move so.

        Args:
            velocity: Of the hand, shape (3,), [m/s].
            hand: Where it was measured at the beginning of the period, shape (3,), [m].
            push: Force on the hand all through the period, shape (3,), [N].

        Returns:
            The share of the velocity that the joints' limits allowed.
        """


class PositionDriver:
    """Position motors follow the joints of a reference that moves with the asked velocity."""

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

    def state(self) -> ArmState:
        """Return the measured state."""
        return self._arm.state()

    def drive(self, velocity: FloatArray, hand: FloatArray, push: FloatArray | None = None) -> float:
        """Let one control period pass, in which the hand shall move so."""
        joints = self._follower.joints
        share = self._follower.advance(velocity, hand)
        self._arm.push = push
        self._arm.drive(joints, self._follower.joints)
        return share
