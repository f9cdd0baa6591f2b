"""Skills whose states are joint angles: they move the joints themselves, without inverse kinematics.

Reference, judge and plan are those of hand positions, with joint angles in place of coordinates. So distances
and tolerances are in radians. Coordinates with the names of joints move these; others are taken in order.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skillctl.arrays import BoolArray, FloatArray
from skillctl.errors import UsageError
from skillctl.model.retarget import retargeted
from skillctl.model.skill import Skill
from skillctl.simulation.arm import COMMANDED_SHARE, CONTROL_PERIOD, LIMIT_MARGIN, ArmBody, Tracking
from skillctl.simulation.arms import ArmModel
from skillctl.simulation.episode import Metrics, RefusedError, Setup, TimeSeries, arrival
from skillctl.simulation.ik import Kinematics
from skillctl.simulation.motion import Plan, plan_motion
from skillctl.simulation.placement import Placement
from skillctl.simulation.position import FEEDBACK_RATE, MotorArm
from skillctl.simulation.scenario import Scenario

JOINT_ACCELERATION = 5.0  # [rad/s²], of all joints together, as a vector
FARTHEST = 100.0  # [rad] from zero: a plan that goes farther diverges
PUSHED = 0.05  # [rad]: a joint this far from its reference was pushed, and the reference moves towards it
OF_HANDS = ("plane", "scale", "origin", "hand", "cup", "noise", "target_error")


def moves_joints(skill: Skill) -> bool:
    """Return whether a skill's states are joint angles."""
    return skill.space.unit == "rad"


def joint_setup(skill: Skill, model: ArmModel, scenario: Scenario) -> Setup:
    """Return the setup of an episode in which a skill moves the joints.

    Raises:
        UsageError: The skill has another number of joints than the arm, or the scenario is about a hand.
        RefusedError: The start or the target is beyond a joint's limits.
    """
    _require_joints(skill, model, scenario)
    if isinstance(scenario.target, tuple):
        skill = retargeted(skill, scenario.target, turn=scenario.turn)
    placement = _placement(skill, model)
    home = np.array(model.home_joints(0.0))
    start = home if scenario.start is None else placement.to_workspace(np.array(scenario.start))
    for name, joints in (
        ("start", start),
        *(("target", end) for end in placement.to_workspace(skill.attractors)),
    ):
        _require_within(name, joints, model)
    plan = plan_motion(skill, placement, joint_limits(scenario, model), start, farthest=FARTHEST)
    base_yaw = 0.0 if scenario.base_yaw is None else scenario.base_yaw
    with ArmBody(model, base_yaw, shapes="none") as body:
        positions = []
        for joints in (*plan.positions, plan.target):
            body.pose(joints)
            positions.append(body.hand()[0])
    hand = Plan(np.stack(positions[:-1]), positions[-1], plan.arrived)
    speeds = (
        np.abs(np.diff(plan.positions, axis=0))
        / CONTROL_PERIOD
        / (COMMANDED_SHARE * np.array(model.max_velocity))
    )
    slowed = float(np.maximum(speeds.max(axis=1), 1.0).sum()) * CONTROL_PERIOD if len(speeds) else 0.0
    return Setup(
        skill,
        model,
        placement,
        "free",
        base_yaw,
        start,
        hand,
        bool(within(plan.positions, model).all()),
        slowed,
        plan,
    )


def _placement(skill: Skill, model: ArmModel) -> Placement:
    """Return the order of the skill's coordinates among the joints."""
    names, n = skill.space.names, model.n_joints
    order = [model.joints.index(name) for name in names] if set(names) == set(model.joints) else range(n)
    return Placement(np.eye(n)[:, list(order)], np.zeros(n), 1.0, None)


def joint_limits(scenario: Scenario, model: ArmModel) -> Scenario:
    """Return a scenario whose largest speed and acceleration are of all joints together, as a vector."""
    fastest = float(np.linalg.norm(model.max_velocity))
    return scenario.changed(max_speed=fastest, max_acceleration=JOINT_ACCELERATION)


def within(joints: FloatArray, model: ArmModel) -> BoolArray:
    """Return which joints (…, n) are within the limits that can be commanded."""
    lower, upper = np.array(model.lower) + LIMIT_MARGIN, np.array(model.upper) - LIMIT_MARGIN
    return np.asarray((joints >= lower) & (joints <= upper))


def _require_joints(skill: Skill, model: ArmModel, scenario: Scenario) -> None:
    d, n = skill.dimension, model.n_joints
    if d != n:
        raise UsageError(
            f"this skill moves {d} joints; the {model.name} arm has {n}.",
            hint="Choose --arm; of an arm by file, --tip and --hold leave joints out.",
        )
    if scenario.start is not None and len(scenario.start) != d:
        raise UsageError(f"start: expected {d} numbers, got {len(scenario.start)}.")
    if scenario.control == "torque":
        raise UsageError("control: torques follow a hand; this skill moves joints.", hint="Leave it out.")
    kinds = [event.kind for event in scenario.disturbances if event.kind != "push"]
    for name in (*(name for name in OF_HANDS if getattr(scenario, name)), *kinds):
        raise UsageError(f"{name}: is about a hand; this skill moves joints.", hint="Leave it out.")


def _require_within(name: str, joints: FloatArray, model: ArmModel) -> None:
    for i in np.flatnonzero(~within(joints, model)).tolist():
        raise RefusedError(
            "joint_limit",
            f"joint_limit: the {name} has joint {i + 1} at {joints[i]:.3f} rad; on the {model.name} arm "
            f"it can be between {model.lower[i]:.3f} and {model.upper[i]:.3f}.",
            hint=f"Choose another --{name}, or the arm that it was taught on.",
        )


class JointArm(MotorArm):
    """An arm whose joints follow a reference of their own."""

    def __init__(self, body: ArmBody, joints: FloatArray, kinematics: Kinematics) -> None:
        """Args: body, which nothing else moves; joints at the start, (n,), [rad]; kinematics of a twin."""
        self.reference = joints
        self._refusals = 0
        self._at_limit: int | None = None
        self.gaps = [0.0]  # distance of the joints to their reference, one a period, [rad]
        super().__init__(body, joints, kinematics)

    @property
    def place_now(self) -> FloatArray:
        """The joints, shape (n,), [rad]."""
        return self.state.joints

    @property
    def tracking(self) -> Tracking:
        """How well the joints follow the reference."""
        hand = self.kinematics.forward(self.reference)
        return Tracking(hand, 0.0, self._refusals, self._at_limit)

    def drive(self, velocity: FloatArray, push: FloatArray | None = None) -> float:
        """Let one period pass, in which the joints should move with ``velocity`` (n,): see ``LiveArm``."""
        fastest = COMMANDED_SHARE * self._fastest
        share = 1.0 / max(1.0, float((np.abs(velocity) / fastest).max()))
        gap = self.state.joints - self.reference
        pushed = np.where(np.abs(gap) > PUSHED, FEEDBACK_RATE * gap, 0.0)
        wanted = self.reference + CONTROL_PERIOD * np.clip(share * velocity + pushed, -fastest, fastest)
        goal = np.clip(wanted, self.kinematics.lower, self.kinematics.upper)
        blocked = np.flatnonzero(goal != wanted)
        self._refusals = self._refusals + 1 if blocked.size else 0
        self._at_limit = int(blocked[0]) if blocked.size else None
        before, self.reference = self.reference, goal
        self.turn(before, goal, push)
        self.gaps.append(float(np.linalg.norm(self.state.joints - goal)))
        return share

    def place(self, joints: FloatArray) -> None:
        """Put the joints at these angles (n,) [rad], at rest, and the reference with them."""
        self.reference = joints
        super().place(joints)


def joint_metrics(
    metrics: Metrics, series: TimeSeries, target: FloatArray, gaps: list[float], tolerance: float
) -> Metrics:
    """Return metrics whose errors to the target and in tracking are of the joints, [rad].

    Args:
        metrics: Those of the hand.
        series: The measured motion.
        target: Joints of the target, shape (n,), [rad].
        gaps: Distances of the joints to their reference, [rad].
        tolerance: Distance to the target that counts as reached, [rad].
    """
    distances = np.linalg.norm(series.joints - target, axis=1)
    return replace(
        metrics,
        final_error=float(distances[-1]),
        time_to_target=arrival(distances > tolerance, series.times),
        tracking_median=float(np.median(gaps)),
        tracking_rmse=float(np.sqrt(np.mean(np.square(gaps)))),
        tracking_p95=float(np.percentile(gaps, 95)),
    )
