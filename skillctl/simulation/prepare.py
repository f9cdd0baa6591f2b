"""Before the first step: placement, hand, base, start posture and plan; refuses what cannot be reached."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import GoalNotReachedError
from skillctl.model.skill import Skill, attractors_of
from skillctl.simulation.arm import ARMS, ArmBody, ArmModel
from skillctl.simulation.episode import RefusedError
from skillctl.simulation.ik import HandPolicy, Kinematics, Solution
from skillctl.simulation.motion import Plan, plan_motion
from skillctl.simulation.placement import Placement, placements
from skillctl.simulation.scenario import Scenario

UPRIGHT_HANDS: tuple[HandPolicy, ...] = ("horizontal", "down", "free")
TABLE_HANDS: tuple[HandPolicy, ...] = ("down", "horizontal", "free")
REHEARSAL_RESIDUAL = 1e-3  # [m]: well within what is accepted on the way, so that tracking stays good
REHEARSAL_STRIDE = 8  # control periods: at most 1 cm at the default speed


@dataclass(frozen=True, eq=False, slots=True)
class Setup:
    """Everything an episode needs to begin.

    Attributes:
        model, placement, hand, base_yaw: The choices made.
        joints: Start posture, shape (n,), [rad].
        plan: The ideal motion from there.
    """

    model: ArmModel
    placement: Placement
    hand: HandPolicy
    base_yaw: float
    joints: FloatArray
    plan: Plan


def prepare(skill: Skill, scenario: Scenario) -> Setup:
    """Return the first placement and hand with which the arm can follow the whole plan.

    If there is none, the first whose start and target can be reached: the episode then shows where the
    plan cannot be followed.

    Raises:
        UsageError: See ``placements``.
        GoalNotReachedError: No choice lets the hand be both at the start and at the target.
    """
    model = ARMS[scenario.arm]
    fallback: Setup | None = None
    for placement in placements(skill, model, scenario):
        base_yaw = _facing(skill, placement) if scenario.base_yaw is None else scenario.base_yaw
        with ArmBody(model, base_yaw) as body:
            for hand in _hands(placement, scenario):
                kinematics = Kinematics(body, hand, base_yaw)
                try:
                    joints, plan = _start_and_plan(skill, placement, kinematics, scenario)
                except GoalNotReachedError as error:
                    refusal = error
                    continue
                setup = Setup(model, placement, hand, base_yaw, joints, plan)
                if _followable(kinematics, joints, plan):
                    return setup
                fallback = fallback or setup
    if fallback is None:
        raise refusal
    return fallback


def _hands(placement: Placement, scenario: Scenario) -> Sequence[HandPolicy]:
    if scenario.hand is not None:
        return (scenario.hand,)
    return TABLE_HANDS if placement.plane == "xy" else UPRIGHT_HANDS


def _facing(skill: Skill, placement: Placement) -> float:
    """Return the multiple of a quarter turn nearest to the azimuth of the middle of all attractors."""
    x, y, _ = placement.to_workspace(attractors_of(skill)).mean(axis=0)
    return round(math.atan2(y, x) / (math.pi / 2)) * (math.pi / 2)


def _start_and_plan(
    skill: Skill, placement: Placement, kinematics: Kinematics, scenario: Scenario
) -> tuple[FloatArray, Plan]:
    joints = kinematics.home
    if scenario.start is not None:
        point = placement.to_workspace(np.array(scenario.start))
        joints = _required("start", point, kinematics.search(point, scenario.seed), scenario)
    plan = plan_motion(skill, placement, scenario, kinematics.forward(joints))
    _required("target", plan.target, kinematics.search(plan.target, scenario.seed), scenario)
    return joints, plan


def _required(name: str, point: FloatArray, found: Solution, scenario: Scenario) -> FloatArray:
    if found.accepted:
        return found.joints
    x, y, z = point
    raise RefusedError(
        "unreachable",
        f"unreachable: the {name} ({x:.3f}, {y:.3f}, {z:.3f}) m lies outside the workspace of the "
        f"{scenario.arm} arm; the closest posture found leaves the hand {1e3 * found.residual:.0f} mm away.",
        hint=f"Choose another --{name}, or move the whole skill with --origin.",
    )


def _followable(kinematics: Kinematics, joints: FloatArray, plan: Plan) -> bool:
    """Whether neighbouring joints exist all along the plan, without dynamics."""
    for point in [*plan.positions[::REHEARSAL_STRIDE], plan.positions[-1]]:
        solution = kinematics.follow(point, joints)
        if not (solution.accepted and solution.residual < REHEARSAL_RESIDUAL):
            return False
        joints = solution.joints
    return True
