"""Within one control period: how the commanded joints move on, and whether the episode is over."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.simulation.arm import CONTROL_PERIOD
from skillctl.simulation.episode import Outcome
from skillctl.simulation.ik import Kinematics
from skillctl.simulation.motion import Motion, Plan
from skillctl.simulation.scenario import Scenario

FEEDBACK_GAP = 0.01  # [m]: a hand this far from its reference was pushed, and the reference yields
FEEDBACK_RATE = 3.0  # [1/s]
COMMANDED_SHARE = 0.95  # of the real arm's joint velocity: the motors overshoot a little
UNREACHABLE_TIME = 0.25  # [s] without joints for the reference, in a row
DIVERGED_FACTOR, DIVERGED_ROOM = 1.5, 0.05  # of the plan's largest distance to its target; [m]


class Follower:
    """Moves the reference, and the commanded joints with it, never faster than the joints can go.

    Attributes:
        reference: Where the hand should be by now, shape (3,), [m].
        joints: Commanded joints, shape (n,), [rad].
        residual: How far inverse kinematics missed the reference at the last step, [m].
        refusals: Steps in a row, up to the last, for which there were no joints.
    """

    def __init__(self, kinematics: Kinematics, joints: FloatArray) -> None:
        """Args: kinematics; joints: where the arm stands, shape (n,), [rad]."""
        self._kinematics = kinematics
        self._largest_step = COMMANDED_SHARE * CONTROL_PERIOD * kinematics.model.max_velocity
        self.reference = kinematics.forward(joints)
        self.joints = joints
        self.residual = 0.0
        self.refusals = 0

    def advance(self, velocity: FloatArray, hand: FloatArray) -> float:
        """Move on for one period; return the share of the velocity (3,) that the joints allowed."""
        gap = hand - self.reference
        if np.linalg.norm(gap) > FEEDBACK_GAP:
            velocity = velocity + FEEDBACK_RATE * gap
        step = CONTROL_PERIOD * velocity
        solution = self._kinematics.follow(self.reference + step, self.joints)
        self.residual = solution.residual
        if not solution.accepted:  # stand still; the reference goes on and may become reachable again
            self.refusals += 1
            self.reference = self.reference + step
            return 1.0
        self.refusals = 0
        joint_step = solution.joints - self.joints
        share = 1.0 / max(1.0, float((np.abs(joint_step) / self._largest_step).max()))
        self.reference = self.reference + share * step
        self.joints = self.joints + share * joint_step
        return share


@dataclass(slots=True)
class Judge:
    """Decides when an episode is over, and how it ended.

    Attributes:
        tolerance: Distance to the target that counts as reached, [m].
        settle_steps: Control periods that the hand has to stay within it.
        farthest: Distance to every target at which the motion has diverged, [m].
        steps_near: Control periods within the tolerance so far, in a row.
    """

    tolerance: float
    settle_steps: int
    farthest: float
    steps_near: int = 0

    @classmethod
    def of(cls, plan: Plan, scenario: Scenario) -> Judge:
        """Return a judge of a motion that should go as planned."""
        distances = np.linalg.norm(plan.positions - plan.target, axis=1)
        planned = distances.max() if plan.arrived else distances[0]
        farthest = DIVERGED_FACTOR * float(planned) + DIVERGED_ROOM
        return cls(scenario.tolerance, math.ceil(scenario.settle_time / CONTROL_PERIOD), farthest)

    def outcome(
        self, motion: Motion, hand: FloatArray, velocity: FloatArray, refusals: int
    ) -> Outcome | None:
        """Return how the episode ended, None while it goes on."""
        if not np.isfinite(velocity).all() or not motion.distance_to_goals(hand) < self.farthest:
            return "diverged"
        if refusals * CONTROL_PERIOD >= UNREACHABLE_TIME:
            return "unreachable"
        near = np.linalg.norm(hand - motion.target(hand)) < self.tolerance
        self.steps_near = self.steps_near + 1 if near else 0
        return "reached" if self.steps_near > self.settle_steps else None
