"""Within one control period: how the commanded joints move on."""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray, length
from skillctl.simulation.arm import CONTROL_PERIOD
from skillctl.simulation.ik import Kinematics

FEEDBACK_GAP = 0.01  # [m]: a hand this far from its reference was pushed, and the reference yields
FEEDBACK_RATE = 3.0  # [1/s]
COMMANDED_SHARE = 0.95  # of the real arm's joint velocity: the motors overshoot a little


class Follower:
    """Moves the reference, and the commanded joints with it, never faster than the joints can go.

    Attributes:
        reference: Where the hand should be by now, shape (3,), [m].
        joints: Commanded joints, shape (n,), [rad].
        residual: How far inverse kinematics missed the reference at the last step, [m].
        refusals: Steps in a row, up to the last, for which there were no joints.
        at_limit: Joint, from 0, that was at its limit when that last happened; None if none was.
    """

    def __init__(self, kinematics: Kinematics, joints: FloatArray) -> None:
        """Args: kinematics; joints: where the arm stands, shape (n,), [rad]."""
        self._kinematics = kinematics
        self._largest_step = COMMANDED_SHARE * CONTROL_PERIOD * kinematics.model.max_velocity
        self.restart(joints)

    def restart(self, joints: FloatArray) -> None:
        """Go on from other joints (n,) [rad]."""
        self.reference = self._kinematics.forward(joints)
        self.joints = joints
        self.residual = 0.0
        self.refusals = 0
        self.at_limit: int | None = None

    def advance(self, velocity: FloatArray, hand: FloatArray) -> float:
        """Move on for one period; return the share of the velocity (3,) that the joints allowed."""
        gap = hand - self.reference
        if length(gap) > FEEDBACK_GAP:
            velocity = velocity + FEEDBACK_RATE * gap
        step = CONTROL_PERIOD * velocity
        solution = self._kinematics.follow(self.reference + step, self.joints)
        self.residual = solution.residual
        if not solution.accepted:  # stand still; the reference goes on and may become reachable again
            self.refusals += 1
            self.at_limit = self._limiting(solution.joints)
            self.reference = self.reference + step
            return 1.0
        self.refusals = 0
        joint_step = solution.joints - self.joints
        share = 1.0 / max(1.0, float((np.abs(joint_step) / self._largest_step).max()))
        self.reference = self.reference + share * step
        self.joints = self.joints + share * joint_step
        return share

    def _limiting(self, joints: FloatArray) -> int | None:
        """Return the first joint that is clamped to a limit, or None."""
        limits = self._kinematics
        clamped = np.flatnonzero((joints <= limits.lower) | (joints >= limits.upper))
        return int(clamped[0]) if clamped.size else None
