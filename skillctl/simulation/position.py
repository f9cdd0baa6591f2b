"""Arms with position motors: a reference moves with the skill's velocity, and the motors follow it."""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.simulation.arm import COMMANDED_SHARE, CONTROL_PERIOD, ArmBody, LiveArm, Tracking
from skillctl.simulation.ik import Kinematics

# [m], [rad]: a hand this far from its reference was pushed, and the reference moves towards it
FEEDBACK_GAP, FEEDBACK_TURN = 0.01, 0.05
FEEDBACK_RATE = 3.0  # [1/s]
POSITION_GAIN, VELOCITY_GAIN = 0.1, 1.0  # of Bullet's position motors; 0.03 to 0.6 track alike


class Follower:
    """Moves the reference, and the commanded joints with it, within the velocity limits of the joints.

    Attributes:
        tracking: Where the hand should be now, and the error of the joints found for it.
        joints: Commanded joints, shape (n,), [rad].
    """

    def __init__(self, kinematics: Kinematics, joints: FloatArray) -> None:
        """Args: kinematics; joints of the arm, shape (n,), [rad]."""
        self._kinematics = kinematics
        self._largest_step = COMMANDED_SHARE * CONTROL_PERIOD * np.array(kinematics.model.max_velocity)
        self.restart(joints)

    def restart(self, joints: FloatArray) -> None:
        """Go on from other joints (n,) [rad]."""
        self.joints = joints
        self.tracking = Tracking(self._kinematics.forward(joints))

    def advance(self, velocity: FloatArray, hand: FloatArray) -> float:
        """Advance by one period and return the share of the velocity that the joints allowed.

        Args:
            velocity: Shape (3,), or a twist (6,); see ``LiveArm``.
            hand: The measured place of the hand.
        """
        space, (reference, _, refusals, _) = self._kinematics.space, self.tracking
        gap = space.difference_at(hand, reference)
        moved, turned = space.speeds(gap)
        if moved > FEEDBACK_GAP or turned > FEEDBACK_TURN:
            velocity = velocity + FEEDBACK_RATE * gap
        step = CONTROL_PERIOD * velocity
        goal = space.displace_at(reference, step)
        solution = self._kinematics.follow(goal, self.joints)
        if not solution.accepted:  # the joints stop; the reference goes on and may become reachable again
            limiting = self._limiting(solution.joints)
            self.tracking = Tracking(goal, solution.residual, refusals + 1, limiting)
            return 1.0
        joint_step = solution.joints - self.joints
        share = 1.0 / max(1.0, float((np.abs(joint_step) / self._largest_step).max()))
        self.tracking = Tracking(space.displace_at(reference, share * step), solution.residual)
        self.joints = self.joints + share * joint_step
        return share

    def _limiting(self, joints: FloatArray) -> int | None:
        """Return the first joint that is clamped to a limit, or None."""
        limits = self._kinematics
        clamped = np.flatnonzero((joints <= limits.lower) | (joints >= limits.upper))
        return int(clamped[0]) if clamped.size else None


class MotorArm(LiveArm):
    """An arm whose position motors hold against pushes, with the torque limits of the real arm.

    A position motor is a velocity constraint: a push of 40 to 60 N does not move the arm, and a push that
    exceeds the torque of a joint carries it away. Only ``TorqueArm`` yields in proportion to a push.
    """

    period = CONTROL_PERIOD

    def __init__(self, body: ArmBody, joints: FloatArray, kinematics: Kinematics) -> None:
        """Args: body, which nothing else moves; joints at the start, (n,), [rad]; kinematics of a twin."""
        super().__init__(body, joints, kinematics)
        n = body.model.n_joints
        self._motors = {
            "forces": list(body.model.max_torque),
            "positionGains": [POSITION_GAIN] * n,
            "velocityGains": [VELOCITY_GAIN] * n,
        }

    def turn(self, joints: FloatArray, goal: FloatArray, push: FloatArray | None = None) -> None:
        """Move from ``joints`` (n,), where the motors should be now, to ``goal`` (n,) in one period.

        A position motor adds its correction to the commanded velocity. A correction towards the goal would
        take it ahead by one period, so it is corrected towards ``joints``.
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


class PositionArm(MotorArm):
    """An arm whose hand follows a reference, by inverse kinematics and position motors."""

    def __init__(self, body: ArmBody, joints: FloatArray, kinematics: Kinematics) -> None:
        """Args: body, which nothing else moves; joints at the start, (n,), [rad]; kinematics of a twin."""
        self._follower = Follower(kinematics, joints)
        super().__init__(body, joints, kinematics)

    @property
    def tracking(self) -> Tracking:
        """How well the joints follow the reference."""
        return self._follower.tracking

    def drive(self, velocity: FloatArray, push: FloatArray | None = None) -> float:
        """Let one period pass: see ``LiveArm``."""
        joints = self._follower.joints
        share = self._follower.advance(velocity, self.place_now)
        self.turn(joints, self._follower.joints, push)
        return share

    def place(self, joints: FloatArray) -> None:
        """Put the joints at these angles (n,) [rad], at rest, and the reference with them."""
        self._follower.restart(joints)
        super().place(joints)
