"""The choices before an episode: placement, hand, base, posture at the start, and plan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.model.chained import ChainedSkill
from skillctl.model.coordinates.bodies import Body
from skillctl.model.retarget import retargeted
from skillctl.model.skill import Skill
from skillctl.simulation.arm import COMMANDED_SHARE, CONTROL_PERIOD, ArmBody
from skillctl.simulation.arms import ArmModel
from skillctl.simulation.avoid import Avoidance, avoidance
from skillctl.simulation.bullet import silenced
from skillctl.simulation.disturbances import Displace, Knock
from skillctl.simulation.episode import RefusedError, Setup
from skillctl.simulation.grasp import require_gripper
from skillctl.simulation.ik import POSE_POSITION, Kinematics, Solution
from skillctl.simulation.joint_space import joint_setup, moves_joints
from skillctl.simulation.motion import Plan, plan_motion
from skillctl.simulation.obstacles import require_meshes
from skillctl.simulation.options import HandPolicy, Name
from skillctl.simulation.placement import Placement, placements
from skillctl.simulation.scenario import Scenario, Shelf, Table
from skillctl.simulation.scene import board_height, cup_middle, set_down_at
from skillctl.simulation.urdf import find_arm

UPRIGHT_HANDS: tuple[HandPolicy, ...] = ("horizontal", "down", "free")
TABLE_HANDS: tuple[HandPolicy, ...] = ("down", "horizontal", "free")
REHEARSAL_RESIDUAL, REHEARSAL_TURN = 1e-3, 0.02  # [m], [rad]: stricter than on the way, to track well
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
    _require_start(skill, scenario)
    _require_hand(skill, scenario)
    _require_bound(skill, scenario)
    if isinstance(scenario.target, tuple):
        skill = retargeted(skill, scenario.target, turn=scenario.turn)
    elif scenario.turn:
        raise UsageError(
            "turn: there is no target to turn with.", hint="Add --target X,Y,Z,QX,QY,QZ,QW, a pose."
        )
    fallback: Setup | None = None
    for placement in placements(skill, model, scenario):
        moved = skill
        if scenario.target == "cup":
            moved = retargeted(skill, placement.to_state(cup_middle(scenario)))
        base_yaw = _base_yaw(moved, placement, scenario)
        with ArmBody(model, base_yaw, shapes="none") as body:
            for hand in _hands(skill, placement, scenario):
                kinematics = Kinematics(body, hand, base_yaw)
                moved = bound(moved, placement, kinematics, scenario)
                try:
                    avoid = avoidance(scenario, placement, kinematics)
                    joints, plan = _start_and_plan(moved, placement, kinematics, scenario, avoid)
                except RefusedError as error:
                    refusal = error
                    continue
                followable, duration = _rehearsed(kinematics, joints, plan)
                setup = Setup(
                    moved,
                    model,
                    placement,
                    hand,
                    base_yaw,
                    joints,
                    plan,
                    followable,
                    duration,
                    avoided=avoid.said(moved) if avoid else "",
                )
                if followable:
                    return setup
                fallback = fallback or setup
    if fallback is None:
        raise refusal
    return fallback


@dataclass(frozen=True, eq=False, slots=True)
class AmongScene:
    """A skill at its target in a scene, as ``simulate`` runs it.

    Attributes:
        skill: It keeps out of what it can.
        avoided: The bodies that it keeps out of, as the hand's point sees them.
        others: The other bodies, with reasons.
    """

    skill: Skill
    avoided: tuple[Body, ...]
    others: tuple[tuple[Body, str], ...]


def among_scene(skill: Skill, scenario: Scenario) -> AmongScene:
    """Return a skill among what is in a scenario; nothing is planned or run.

    Raises:
        UsageError: There is nothing to keep out of, or the skill is not in three dimensions at scale 1.
    """
    model = arm_of(scenario)
    placement = placements(skill, model, scenario)[0]
    if scenario.target == "cup":
        skill = retargeted(skill, placement.to_state(cup_middle(scenario)))
    elif scenario.target is not None:
        skill = retargeted(skill, scenario.target, turn=scenario.turn)
    base_yaw = _base_yaw(skill, placement, scenario)
    with silenced(1), ArmBody(model, base_yaw, shapes="none") as body:
        kinematics = Kinematics(body, _hands(skill, placement, scenario)[0], base_yaw)
        avoid = avoidance(scenario.changed(avoid=True), placement, kinematics)
        if avoid is None:
            raise UsageError("scene: there is nothing in it to keep out of.")
        avoided, others = avoid.admitted(skill, np.zeros(3))
        return AmongScene(avoid.applied(skill, np.zeros(3)), tuple(avoided), others)


def arm_of(scenario: Scenario) -> ArmModel:
    """Return the scenario's arm; errors are those of ``find_arm``."""
    held = tuple(scenario.hold.items())
    return find_arm(scenario.arm, scenario.tip, scenario.home, held, scenario.package)


def _require_start(skill: Skill, scenario: Scenario) -> None:
    sizes = skill.space.sizes
    if scenario.start is not None and len(scenario.start) not in sizes:
        numbers = " or ".join(map(str, sizes))
        raise UsageError(f"start: expected {numbers} numbers, got {len(scenario.start)}.")


def _require_hand(skill: Skill, scenario: Scenario) -> None:
    if _turns(skill):
        if scenario.hand not in (None, "taught"):
            raise UsageError(
                f"hand: this skill turns the hand as taught, not {scenario.hand}.", hint="Leave it out."
            )
    elif scenario.hand == "taught":
        raise UsageError(
            "hand: this skill was taught positions only.",
            hint="Leave it out, or learn the skill from demonstrations with orientations.",
        )
    elif any(isinstance(event, Displace) and any(event.turn) for event in scenario.disturbances):
        raise UsageError("displace: only a skill that was taught orientations can have its hand turned.")


def _require_bound(skill: Skill, scenario: Scenario) -> None:
    if not isinstance(skill, ChainedSkill):
        for name in ("bind", "place"):
            if getattr(scenario, name):
                raise UsageError(
                    f"{name}: only a chain has stages, and sets a cup down.", hint="Use --target."
                )
        if any(isinstance(event, Knock) for event in scenario.disturbances):
            raise UsageError("knock: only a chain carries a cup that can be knocked out of its hand.")
        return
    if scenario.target is not None:
        raise UsageError("target: a chain has one for each stage.", hint="Bind stages: --bind 1=cup.")
    kinds = {event.kind for event in scenario.disturbances}
    if "move-target" in kinds and not scenario.stages_at("cup"):
        raise UsageError("move-target: no stage of the chain is bound to the cup.", hint="As in 1=cup.")
    for stage in scenario.bind:
        if not (stage.isdigit() and 1 <= int(stage) <= len(skill.parts)):
            raise UsageError(f"bind: this chain has stages 1 to {len(skill.parts)}, and no {stage!r}.")


def bound(skill: Skill, placement: Placement, kinematics: Kinematics, scenario: Scenario) -> Skill:
    """Return a chain whose stages end where the scenario binds them; any other skill as it is."""
    if not isinstance(skill, ChainedSkill):
        return skill
    for stage, what in scenario.bind.items():
        index = int(stage) - 1
        goal = what if isinstance(what, tuple) else placement.to_state(_named(what, kinematics, scenario))
        skill = skill.with_stage(index, retargeted(skill.parts[index], goal))
    return skill


def _named(name: Name, kinematics: Kinematics, scenario: Scenario) -> FloatArray:
    """Return where the hand is to be for a thing of a name, (3,), [m]; the ready posture has no furniture."""
    if name == "cup":
        return cup_middle(scenario)
    if name == "place":
        above = 0.0 if scenario.place is None else scenario.place.above
        x, y, height = set_down_at(scenario)
        return np.array([x, y, height + above])
    if scenario.scene is None:
        return kinematics.forward(kinematics.home)[:3]
    return _before(scenario.scene)


def _before(scene: Shelf | Table) -> FloatArray:
    return np.array([scene.x_range[0] - START_BEFORE, 0.0, board_height(scene, "bottom") + START_ABOVE])


def _turns(skill: Skill) -> bool:
    """Return whether a skill of hands turns the hand."""
    return skill.space.positions < skill.dimension


def _hands(skill: Skill, placement: Placement, scenario: Scenario) -> Sequence[HandPolicy]:
    if _turns(skill):
        return ("taught",)
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
    x, y = placement.to_workspace(skill.attractors).mean(axis=0)[:2]
    return round(math.atan2(y, x) / (math.pi / 2)) * (math.pi / 2)


def _start_and_plan(
    skill: Skill,
    placement: Placement,
    kinematics: Kinematics,
    scenario: Scenario,
    avoid: Avoidance | None,
) -> tuple[FloatArray, Plan]:
    joints, place = kinematics.home, start_of(placement, kinematics, scenario)
    if place is not None:
        joints = _required("start", place, kinematics.search(place), scenario)
    plan = plan_motion(skill, placement, scenario, kinematics.forward(joints), avoid=avoid)
    _required("target", plan.target, kinematics.search(plan.target), scenario)
    return joints, plan


def start_of(placement: Placement, kinematics: Kinematics, scenario: Scenario) -> FloatArray | None:
    """Return the place of the hand at the start; None for the ready posture."""
    if scenario.start is not None:
        start = np.array(scenario.start)
        if len(start) > 3:
            return placement.to_workspace(kinematics.space.measured(start))
        return kinematics.at(placement.to_workspace(start))
    if scenario.scene is None:
        return None
    return kinematics.at(_before(scenario.scene))


def _required(name: str, place: FloatArray, solution: Solution, scenario: Scenario) -> FloatArray:
    if solution.accepted:
        return solution.joints
    (x, y, z), missed = place[:3], f"{1e3 * solution.residual:.0f} mm"
    if len(place) > 3 or solution.residual < POSE_POSITION:  # the orientation is what is missing
        missed += f" and {math.degrees(solution.turn):.0f}°"
    option = "cup" if name == "target" and scenario.target == "cup" else name
    raise RefusedError(
        "unreachable",
        f"unreachable: no posture of the {scenario.arm} arm was found for the {name} "
        f"({x:.3f}, {y:.3f}, {z:.3f}) m; the closest leaves the hand {missed} away.",
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
        if not (
            solution.accepted and solution.residual < REHEARSAL_RESIDUAL and solution.turn < REHEARSAL_TURN
        ):
            return False, plan.duration
        needed = float((np.abs(solution.joints - joints) / fastest).max())
        duration += max(0.0, needed - REHEARSAL_STRIDE * CONTROL_PERIOD)
        joints = solution.joints
    return True, duration
