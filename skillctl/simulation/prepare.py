"""The choices before an episode: placement, hand, base, posture at the start, and plan."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.model.retarget import retargeted
from skillctl.model.skill import Skill
from skillctl.simulation.arm import COMMANDED_SHARE, CONTROL_PERIOD, ArmBody
from skillctl.simulation.arms import ArmModel
from skillctl.simulation.episode import RefusedError, Setup
from skillctl.simulation.grasp import require_gripper
from skillctl.simulation.ik import Kinematics, Solution
from skillctl.simulation.joint_space import joint_setup, moves_joints
from skillctl.simulation.motion import Plan, plan_motion
from skillctl.simulation.obstacles import require_meshes
from skillctl.simulation.options import HandPolicy
from skillctl.simulation.placement import Placement, placements
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.scene import board_height, cup_middle
from skillctl.simulation.urdf import find_arm

UPRIGHT_HANDS: tuple[HandPolicy, ...] = ("horizontal", "down", "free")
TABLE_HANDS: tuple[HandPolicy, ...] = ("down", "horizontal", "free")
REHEARSAL_RESIDUAL = 1e-3  # [m]: stricter than on the way, so that tracking stays good
START_BEFORE, START_ABOVE = 0.10, 0.13  # [m], of a scene's front edge and lowest board
REHEARSAL_STRIDE = 8  # control periods: at most 1 cm at the default speed


def prepare(skill: Skill, scenario: Scenario) -> Setup:
    """Return the first placement and hand with which the arm can follow the whole plan.

    If there is none, return the first whose start and target can be reached; the episode then shows where
    the plan cannot be followed.

    Raises:
        UsageError: Start or target of another dimension, or a skill or an arm that does not fit the scenario
            (see ``placements``, ``require_gripper``).
        RefusedError: No choice lets the hand be both at the start and at the target.
    """
    model = arm_of(scenario)
    require_meshes(scenario.obstacles)
    if moves_joints(skill):
        return joint_setup(skill, model, scenario)
    require_gripper(model, scenario)
    if scenario.start is not None and len(scenario.start) != skill.dimension:
        raise UsageError(f"start: expected {skill.dimension} numbers, got {len(scenario.start)}.")
    if isinstance(scenario.target, tuple):
        skill = retargeted(skill, scenario.target)
    fallback: Setup | None = None
    for placement in placements(skill, model, scenario):
        moved = skill
        if scenario.target == "cup":
            moved = retargeted(skill, placement.to_state(cup_middle(scenario)))
        base_yaw = _base_yaw(moved, placement, scenario)
        with ArmBody(model, base_yaw, shapes="none") as body:
            for hand in _hands(placement, scenario):
                kinematics = Kinematics(body, hand, base_yaw)
                try:
                    joints, plan = _start_and_plan(moved, placement, kinematics, scenario)
                except RefusedError as error:
                    refusal = error
                    continue
                followable, duration = _rehearsed(kinematics, joints, plan)
                setup = Setup(moved, model, placement, hand, base_yaw, joints, plan, followable, duration)
                if followable:
                    return setup
                fallback = fallback or setup
    if fallback is None:
        raise refusal
    return fallback


def arm_of(scenario: Scenario) -> ArmModel:
    """Return the scenario's arm; errors are those of ``find_arm``."""
    return find_arm(scenario.arm, scenario.tip, scenario.home, tuple(scenario.hold.items()))


def _hands(placement: Placement, scenario: Scenario) -> Sequence[HandPolicy]:
    if scenario.hand is not None:
        return (scenario.hand,)
    if scenario.cup is not None:
        return ("horizontal",)  # the fingers go round an upright cup
    return TABLE_HANDS if placement.plane == "xy" else UPRIGHT_HANDS


def _base_yaw(skill: Skill, placement: Placement, scenario: Scenario) -> float:
    """Return the yaw of the scenario, else 0 in a scene, else the one that faces the attractors' mean."""
    if scenario.base_yaw is not None:
        return scenario.base_yaw
    if scenario.scene is not None:
        return 0.0
    x, y, _ = placement.to_workspace(skill.attractors).mean(axis=0)
    return round(math.atan2(y, x) / (math.pi / 2)) * (math.pi / 2)


def _start_and_plan(
    skill: Skill, placement: Placement, kinematics: Kinematics, scenario: Scenario
) -> tuple[FloatArray, Plan]:
    joints, point = kinematics.home, _start(placement, scenario)
    if point is not None:
        joints = _required("start", point, kinematics.search(point), scenario)
    plan = plan_motion(skill, placement, scenario, kinematics.forward(joints))
    _required("target", plan.target, kinematics.search(plan.target), scenario)
    return joints, plan


def _start(placement: Placement, scenario: Scenario) -> FloatArray | None:
    """Return the workspace position (3,) of the start; None for the ready posture."""
    if scenario.start is not None:
        return placement.to_workspace(np.array(scenario.start))
    if scenario.scene is None:
        return None
    lowest = board_height(scenario.scene, "bottom")
    return np.array([scenario.scene.x_range[0] - START_BEFORE, 0.0, lowest + START_ABOVE])


def _required(name: str, point: FloatArray, solution: Solution, scenario: Scenario) -> FloatArray:
    if solution.accepted:
        return solution.joints
    (x, y, z), missed = point, 1e3 * solution.residual
    option = "cup" if name == "target" and scenario.target == "cup" else name
    raise RefusedError(
        "unreachable",
        f"unreachable: no posture of the {scenario.arm} arm was found for the {name} "
        f"({x:.3f}, {y:.3f}, {z:.3f}) m; the closest leaves the hand {missed:.0f} mm away.",
        hint=f"Choose another --{option}, or move the whole skill with --origin.",
    )


def _rehearsed(kinematics: Kinematics, joints: FloatArray, plan: Plan) -> tuple[bool, float]:
    """Return whether neighbouring joints exist all along the plan, without dynamics, and how long it takes.

    The duration [s] is that of the plan, and longer where the arm's joints are slower than the plan.
    """
    rehearsed = [*plan.positions[::REHEARSAL_STRIDE], plan.positions[-1]]
    fastest = COMMANDED_SHARE * np.array(kinematics.model.max_velocity)
    duration = plan.duration
    for solution in kinematics.along(rehearsed, joints):
        if not (solution.accepted and solution.residual < REHEARSAL_RESIDUAL):
            return False, plan.duration
        needed = float((np.abs(solution.joints - joints) / fastest).max())
        duration += max(0.0, needed - REHEARSAL_STRIDE * CONTROL_PERIOD)
        joints = solution.joints
    return True, duration
