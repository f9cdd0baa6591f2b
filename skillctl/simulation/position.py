"""An arm with position motors: a reference moves as the skill says, and the motors follow its joints."""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray, length
from skillctl.simulation.arm import COMMANDED_SHARE, CONTROL_PERIOD, ArmBody, LiveArm, Tracking
from skillctl.simulation.ik import Kinematics

FEEDBACK_GAP = 0.01  # [m]: a hand this far from its reference was pushed, and the reference yields
FEEDBACK_RATE = 3.0  # [1/s]
POSITION_GAIN, VELOCITY_GAIN = 0.1, 1.0  # of Bullet's position motors; 0.03 to 0.6 track alike


class Follower:
    """Moves the reference, and the commanded joints with it, never faster than the joints can go.

    Attributes:
        tracking: Where the hand should be by now, and how well that was met.
        joints: Commanded joints, shape (n,), [rad].
    """

    def __init__(self, kinematics: Kinematics, joints: FloatArray) -> None:
        """Args: kinematics; joints: where the arm stands, shape (n,), [rad]."""
        self._kinematics = kinematics
        self._largest_step = COMMANDED_SHARE * CONTROL_PERIOD * np.array(kinematics.model.max_velocity)
        self.restart(joints)

    def restart(self, joints: FloatArray) -> None:
        """Go on from other joints (n,) [rad]."""
        self.joints = joints
        self.tracking = Tracking(self._kinematics.forward(joints))

    def advance(self, velocity: FloatArray, hand: FloatArray) -> float:
        """Move on for one period; return the share of the velocity (3,) that the joints allowed."""
        reference, _, refusals, _ = self.tracking
        gap = hand - reference
        if length(gap) > FEEDBACK_GAP:
            velocity = velocity + FEEDBACK_RATE * gap
        step = CONTROL_PERIOD * velocity
        solution = self._kinematics.follow(reference + step, self.joints)
        if not solution.accepted:  # stand still; the reference goes on and may become reachable again
            limiting = self._limiting(solution.joints)
            self.tracking = Tracking(reference + step, solution.residual, refusals + 1, limiting)
            return 1.0
        joint_step = solution.joints - self.joints
        share = 1.0 / max(1.0, float((np.abs(joint_step) / self._largest_step).max()))
        self.tracking = Tracking(reference + share * step, solution.residual)
        self.joints = self.joints + share * joint_step
        return share

    def _limiting(self, joints: FloatArray) -> int | None:
        """Return the first joint that is clamped to a limit, or None."""
        limits = self._kinematics
        clamped = np.flatnonzero((joints <= limits.lower) | (joints >= limits.upper))
        return int(clamped[0]) if clamped.size else None


class PositionArm(LiveArm):
    """An arm whose position motors hold against pushes; torques never exceed the real arm's.

    A position motor is a velocity constraint: a push of 40 to 60 N moves nothing at all, and one that is too
    strong for a joint's torque carries the arm away. Only ``TorqueArm`` yields in proportion.
    """

    period = CONTROL_PERIOD

    def __init__(self, body: ArmBody, joints: FloatArray, kinematics: Kinematics) -> None:
        """Args: body, moved by nobody else; joints: its start, (n,), [rad]; kinematics, of a twin."""
        self._follower = Follower(kinematics, joints)
        super().__init__(body, joints)
        n = body.model.n_joints
        self._motors = {
            "forces": list(body.model.max_torque),
            "positionGains": [POSITION_GAIN] * n,
            "velocityGains": [VELOCITY_GAIN] * n,
        }

    @property
    def tracking(self) -> Tracking:
        """How well the joints of the reference were found."""
        return self._follower.tracking

    def drive(self, velocity: FloatArray, push: FloatArray | None = None) -> float:
        """Let one period pass, in which the hand shall move so: see ``LiveArm``."""
        joints = self._follower.joints
        share = self._follower.advance(velocity, self.state().hand)
        self.turn(joints, self._follower.joints, push)
        return share

    def turn(self, joints: FloatArray, goal: FloatArray, push: FloatArray | None = None) -> None:
        """Move from ``joints`` (n,), where the motors should be by now, to ``goal`` (n,) in one period.

        A position motor adds its correction to the velocity it is told. Corrected towards the goal it
        would run ahead by one period; corrected towards where it should be now, it arrives in time.
        """
        bullet = self.body.bullet
        bullet.setJointMotorControlArray(
            self.body.body,
            self.body.indices,
            bullet.POSITION_CONTROL,
            targetPositions=joints.tolist(),
            targetVelocities=((goal - joints) / CONTROL_PERIOD).tolist(),
            **self._motors,
        )
        self._step(push)

    def place(self, joints: FloatArray) -> None:
        """Put the joints (n,) [rad] elsewhere at once; the reference goes along."""
        self._follower.restart(joints)
        super().place(joints)
