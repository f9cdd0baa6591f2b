"""Inverse kinematics: Bullet's solver, made reliable by damping, clamping, checks and restarts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray, length
from skillctl.model.pose import Pose
from skillctl.model.space import Euclidean, Space
from skillctl.rotations import quaternion_of, vector_of
from skillctl.simulation.arm import LIMIT_MARGIN, ArmBody, Quaternion
from skillctl.simulation.options import HandPolicy

HAND_PITCH: dict[HandPolicy, float] = {  # [rad], in the ready posture
    "horizontal": 0.25,
    "down": math.pi / 2,
    "free": 0.25,
    "taught": 0.25,
}

EASE = 0.05  # [rad] from all limits: such a posture is taken without looking for others
DAMPING = 0.003  # per joint, fingers included: Bullet silently ignores a list of another length
STEP_ITERATIONS, SEARCH_ITERATIONS, SEARCH_RESEEDS, SEARCH_RESTARTS = 20, 100, 20, 8
IK_THRESHOLD = 1e-6  # Bullet's own stopping criterion
ACCEPTED_RESIDUAL = 5e-3  # [m]; typical residuals are below 1e-4
ACCEPTED_TURN = math.radians(5.0)  # of a hand that is turned as the skill asks
ACCEPTED_JUMP = 0.3  # [rad] in one step; typical steps are 0.004 to 0.025
POSE_POSITION, POSE_ANGLE = 1e-4, math.radians(1.0)  # tolerances of a searched pose


@dataclass(frozen=True, eq=False, slots=True)
class Solution:
    """Joints (n,) [rad] within the limits, and the distance of the hand from the place asked for, [m].

    ``accepted``: the joints may be commanded. ``turn``: the angle to the orientation asked for, [rad].
    """

    joints: FloatArray
    residual: float
    accepted: bool
    turn: float = 0.0


class Kinematics:
    """The joints for a place of the hand, computed on an arm that nothing else moves.

    A place is a position p (3,), from which the hand's orientation follows with ψ = yaw + s (azimuth(p) −
    yaw), yaw being the base's and s the arm's ``yaw_share``. ``horizontal``: approach axis (cos ψ cos θ,
    sin ψ cos θ, −sin θ) with θ = 0.25 rad and a horizontal finger axis; ``down``: the same with θ = π/2;
    ``free``: any orientation. If the hand is ``taught``, a place is a pose (6,), see ``Pose``.

    Attributes:
        hand: How the hand is turned.
        space: What a place is.
    """

    def __init__(self, body: ArmBody, hand: HandPolicy, base_yaw: float) -> None:
        """Args: body, which nothing else moves; hand; base_yaw of the body, [rad]."""
        self._body = body
        self.hand = hand
        self.space: Space = Pose() if hand == "taught" else Euclidean.cartesian(3)
        self._base_yaw = base_yaw
        self.model = model = body.model
        self.lower, self.upper = np.array(model.lower) + LIMIT_MARGIN, np.array(model.upper) - LIMIT_MARGIN
        self.home = np.array(model.home_joints(HAND_PITCH[hand]))
        self._damping = [DAMPING] * (model.n_joints + len(model.fingers))
        self._columns = model.columns
        if model.pitch_joint is None:  # its home need not hold the hand as asked
            self.home = self._ready()

    def forward(self, joints: FloatArray) -> FloatArray:
        """Return the hand's place for joints (n,)."""
        self._body.pose(joints)
        return self.place(*self._body.hand())

    def place(self, position: FloatArray, orientation: Quaternion) -> FloatArray:
        """Return the place of a hand at a position (3,) and orientation q_xyzw: the position, or the pose."""
        if self.hand != "taught":
            return position
        return np.array([*position.tolist(), *vector_of(*orientation)])

    def at(self, position: FloatArray) -> FloatArray:
        """Return the place of a hand at a position (3,), turned as in the ready posture if it is taught."""
        return np.concatenate([position, self.forward(self.home)[3:]])

    def _ready(self) -> FloatArray:
        """Return joints with the hand oriented as asked: at its home if possible, else mid-workspace."""
        x, y, z = self.model.reach_centre
        cosine, sine = math.cos(self._base_yaw), math.sin(self._base_yaw)
        middle = np.array([cosine * x - sine * y, sine * x + cosine * y, z])
        for point in (self.forward(self.home), self.at(middle)):
            solution = self.search(point)
            if solution.accepted:
                return solution.joints
        return self.home

    def follow(self, point: FloatArray, joints: FloatArray) -> Solution:
        """Return the joints for a hand at a place that was at ``joints`` (n,) one period ago."""
        angles = self._solve(point, joints, STEP_ITERATIONS)
        position, orientation = self._body.hand()
        residual = length(position - point[:3])
        turn = self._angle_to(orientation, point) if self.hand == "taught" else 0.0
        jump = float(np.abs(angles - joints).max())
        # Written so that a NaN anywhere is a refusal.
        accepted = residual < ACCEPTED_RESIDUAL and turn < ACCEPTED_TURN and jump < ACCEPTED_JUMP
        return Solution(angles, residual, accepted, turn)

    def along(self, points: Iterable[FloatArray], joints: FloatArray) -> Iterator[Solution]:
        """Yield the joints for each of the places, one period apart, for a hand that was at ``joints``.

        A place whose joints are not accepted is the last.
        """
        for point in points:
            solution = self.follow(point, joints)
            yield solution
            if not solution.accepted:
                return
            joints = solution.joints

    def search(self, point: FloatArray) -> Solution:
        """Return joints for a hand at a place, from no joints near by; this decides reachability.

        It starts from the ready posture, from the same turned towards the point, then from random postures,
        which are the same at every call. A result within 0.1 mm and 1 degree is accepted. The first one whose
        joints are far enough from their limits is returned, else the one that is farthest from them, and
        without any the closest.
        """
        turned = self.home.copy()
        turned[0] = self._relative_azimuth(point)
        lowest, highest = np.maximum(self.lower, -math.pi), np.minimum(self.upper, math.pi)
        restarts = np.random.default_rng(0).uniform(lowest, highest, (SEARCH_RESTARTS, len(turned)))
        best = Solution(self.home, math.inf, False)
        for start in (self.home, turned, *restarts):
            solution = self._search_from(np.clip(start, self.lower, self.upper), point)
            if solution.accepted and self.margin(solution.joints) >= EASE:
                return solution
            best = max(best, solution, key=self._quality)
        return best

    def margin(self, joints: FloatArray) -> float:
        """Return the smallest distance of joints (n,) to their limits, [rad]."""
        return float(np.minimum(joints - self.lower, self.upper - joints).min())

    def _quality(self, solution: Solution) -> tuple[bool, float]:
        return solution.accepted, self.margin(solution.joints) if solution.accepted else -solution.residual

    def _search_from(self, joints: FloatArray, point: FloatArray) -> Solution:
        residual, angle = math.inf, math.inf
        for _ in range(SEARCH_RESEEDS):
            joints = self._solve(point, joints, SEARCH_ITERATIONS)
            position, orientation = self._body.hand()
            residual = length(position - point[:3])
            angle = self._angle_to(orientation, point)
            if residual < POSE_POSITION and angle < POSE_ANGLE:
                return Solution(joints, residual, True, angle)
        return Solution(joints, residual, False, angle)

    def _solve(self, point: FloatArray, joints: FloatArray, iterations: int) -> FloatArray:
        """Return clamped joints, in which the body is left."""
        body = self._body
        body.pose(joints)  # the solver's start; its argument currentPositions shifts the frame
        orientation = self.orientation(point)
        position = point[:3].tolist()
        target = (position,) if orientation is None else (position, orientation)
        angles = body.bullet.calculateInverseKinematics(
            body.body,
            body.model.tip,
            *target,
            jointDamping=self._damping,
            maxNumIterations=iterations,
            residualThreshold=IK_THRESHOLD,
        )
        clamped = np.clip([angles[column] for column in self._columns], self.lower, self.upper)
        body.pose(clamped)
        return np.asarray(clamped)

    def orientation(self, point: FloatArray) -> Quaternion | None:
        """Return the hand's orientation q_xyzw at a place; None if it does not matter."""
        if self.hand == "free":
            return None
        if self.hand == "taught":
            return quaternion_of(*point[3:].tolist())
        yaw = self._base_yaw + self.model.yaw_share * self._relative_azimuth(point)
        pitch = HAND_PITCH[self.hand]
        flipped = self._body.model.finger_axis < 0
        euler = (math.pi, pitch - math.pi / 2, yaw) if flipped else (0.0, pitch + math.pi / 2, yaw)
        x, y, z, w = self._body.bullet.getQuaternionFromEuler(euler)
        return x, y, z, w

    def _relative_azimuth(self, point: FloatArray) -> float:
        azimuth = math.atan2(point[1], point[0]) - self._base_yaw
        return math.remainder(azimuth, math.tau)

    def _angle_to(self, orientation: Quaternion, point: FloatArray) -> float:
        wanted = self.orientation(point)
        if wanted is None:
            return 0.0
        cosine = abs(float(np.dot(orientation, wanted)))
        return 2 * math.acos(min(1.0, cosine))
