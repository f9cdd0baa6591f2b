"""Whether an arm can follow a skill, by inverse kinematics alone, without dynamics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.model.skill import Skill
from skillctl.simulation.arm import CONTROL_PERIOD, ArmBody
from skillctl.simulation.bullet import silenced
from skillctl.simulation.episode import RefusedError, Setup, Unit
from skillctl.simulation.ik import Kinematics
from skillctl.simulation.joint_space import within
from skillctl.simulation.motion import Plan
from skillctl.simulation.options import HandPolicy
from skillctl.simulation.prepare import arm_of, prepare, start_of
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.scene import SceneBodies

STRIDE = 8  # control periods between the postures whose torques and contacts are computed


@dataclass(frozen=True)
class Reachability:
    """How much of a motion an arm can reach. A value that could not be computed is None.

    Attributes:
        reachable: Whether start, path and target can be reached.
        reason: What cannot be reached, in one sentence; else empty.
        arm, hand, base_yaw: The arm, the orientation of its hand, the turn of its base [rad].
        tip, held, notes: The link that is the hand; for an arm by file, joints that do not move and where
            they stay, and what was not taken from the file.
        scale, origin: The placement: workspace = origin [m] + scale · coordinates.
        start, target: Positions in the workspace, [m]; joints for a skill that moves joints; of a pose skill
            position and rotation vector.
        unit: That of start and target: ``m``, or ``rad``.
        duration: Duration of the ideal motion, [s].
        start_residual, target_residual: Smallest distance of the hand to them, [m].
        path_residual: Largest distance of the hand to the path, [m].
        start_turn, target_turn, path_turn: The same for the orientation of a taught hand, [rad].
        lost_at: Workspace position where the path cannot be followed any more, [m]; None if it can.
        joint_margin: Smallest distance of a joint to its limit on the path, [rad].
        tightest_joint: The joint with this margin, from 1.
        manipulability: Smallest one on the path (see ``ArmBody``).
        velocity_ratio: Largest joint velocity of the ideal motion, over the limit. Above 1 the arm slows the
            motion down, on the same path.
        torque_ratio: Largest joint torque that carries the arm at rest on the path, over the limit.
    """

    reachable: bool
    reason: str
    arm: str
    hand: HandPolicy | None = None
    base_yaw: float | None = None
    scale: float | None = None
    origin: tuple[float, ...] | None = None
    start: tuple[float, ...] | None = None
    target: tuple[float, ...] | None = None
    duration: float | None = None
    start_residual: float | None = None
    target_residual: float | None = None
    path_residual: float | None = None
    lost_at: tuple[float, ...] | None = None
    joint_margin: float | None = None
    tightest_joint: int | None = None
    velocity_ratio: float | None = None
    torque_ratio: float | None = None
    unit: Unit = "m"
    tip: str | None = None
    held: dict[str, float] | None = None
    notes: tuple[str, ...] = ()
    start_turn: float | None = None
    target_turn: float | None = None
    path_turn: float | None = None
    manipulability: float | None = None


def check(skill: Skill, scenario: Scenario) -> Reachability:
    """Return whether an arm can reach the start, the path and the target of a skill.

    Placement, hand and base are chosen as in ``simulate``. Of the torques, only those that carry the arm are
    checked, and of contacts those of the ideal motion; disturbances are not. Only ``simulate`` shows those.

    Raises:
        UsageError: Start or target of another dimension, or a skill that cannot be placed in a workspace.
        NotFoundError: PyBullet is not installed.
    """
    with silenced(1):
        try:
            setup = prepare(skill, scenario)
        except RefusedError as refusal:
            arm = arm_of(scenario)
            return Reachability(
                False, str(refusal), arm.name, tip=arm.tip_link, held=dict(arm.held), notes=arm.notes
            )
        with ArmBody(setup.arm, setup.base_yaw, shapes="none") as body:
            return _along(setup, body, Kinematics(body, setup.hand, setup.base_yaw), scenario)


class _Way(NamedTuple):
    """Postures (k, n) along the plan as far as there are any, its ends, and how far the hand is off.

    Distances are in [m]; ``turns`` are the angles at the start, at the target and at most on the path, [rad].
    """

    postures: FloatArray
    start: FloatArray
    target: FloatArray
    start_residual: float
    target_residual: float
    path_residual: float
    turns: tuple[float, float, float]
    lost: tuple[float, ...] | None


def _by_hand(setup: Setup, kinematics: Kinematics, scenario: Scenario) -> _Way:
    """Follow the plan by inverse kinematics, one control period after the other."""
    plan = setup.plan
    start = plan.positions[0]
    if scenario.start is not None and (asked := start_of(setup.placement, kinematics, scenario)) is not None:
        start = asked
    off = kinematics.space.difference_at(kinematics.forward(setup.joints), start)
    start_residual, start_turn = kinematics.space.speeds(off)
    target = kinematics.search(plan.target)
    solutions = list(kinematics.along(plan.positions[1:], setup.joints))
    lost = None
    if solutions:
        last, whole = solutions[-1], len(solutions) == len(plan.positions) - 1
        if not last.accepted or (whole and last.residual >= scenario.tolerance):
            lost = tuple(plan.path[len(solutions)].tolist())
    return _Way(
        np.stack([setup.joints, *(each.joints for each in solutions if each.accepted)]),
        start,
        plan.target,
        start_residual,
        target.residual,
        max([start_residual, *(each.residual for each in solutions)]),
        (start_turn, target.turn, max([start_turn, *(each.turn for each in solutions)])),
        lost,
    )


def _by_joints(setup: Setup, plan: Plan) -> _Way:
    """Follow a plan of the joints up to the first limit; the hand is nowhere off."""
    beyond = np.flatnonzero(~within(plan.positions, setup.arm).all(axis=1))
    count = int(beyond[0]) if beyond.size else len(plan.positions)
    lost = tuple(setup.plan.positions[count].tolist()) if beyond.size else None
    exact = (0.0, 0.0, 0.0)
    return _Way(plan.positions[:count], plan.positions[0], plan.target, *exact, exact, lost)


def _along(setup: Setup, body: ArmBody, kinematics: Kinematics, scenario: Scenario) -> Reachability:
    """Return what the postures along the plan show."""
    plan, arm = setup.plan, setup.arm
    if setup.joint_plan is None:
        way = _by_hand(setup, kinematics, scenario)
    else:
        way = _by_joints(setup, setup.joint_plan)
    followed, lost = way.postures, way.lost
    margins = np.minimum(followed - arm.lower, arm.upper - followed)
    limited = np.isfinite(margins.min())
    speeds = np.abs(np.diff(followed, axis=0)) / CONTROL_PERIOD / arm.max_velocity
    sampled = [*followed[::STRIDE], followed[-1]]
    torques = np.abs([body.carrying(joints) for joints in sampled]) / arm.max_torque
    reason = _reason(setup, lost, torques.max(axis=0)) or _touched(setup, scenario, sampled)
    return Reachability(
        reachable=not reason,
        reason=reason,
        arm=arm.name,
        tip=arm.tip_link,
        held=dict(arm.held),
        notes=arm.notes,
        hand=setup.hand,
        base_yaw=setup.base_yaw,
        scale=setup.placement.scale,
        origin=tuple(setup.placement.origin.tolist()),
        start=tuple(way.start.tolist()),
        target=tuple(way.target.tolist()),
        duration=plan.duration,
        unit=setup.unit,
        start_residual=way.start_residual,
        target_residual=way.target_residual,
        path_residual=way.path_residual,
        lost_at=lost,
        joint_margin=float(margins.min()) if limited else None,
        tightest_joint=int(margins.min(axis=0).argmin()) + 1 if limited else None,
        velocity_ratio=float(speeds.max(initial=0.0)),
        torque_ratio=float(torques.max()),
        manipulability=min(map(body.manipulability, sampled)),
        start_turn=way.turns[0] if setup.turns else None,
        target_turn=way.turns[1] if setup.turns else None,
        path_turn=way.turns[2] if setup.turns else None,
    )


def _touched(setup: Setup, scenario: Scenario, postures: list[FloatArray]) -> str:
    """Return what the arm would touch first in one of the postures, in a sentence; else nothing."""
    if not scenario.furnished:
        return ""
    with ArmBody(setup.arm, setup.base_yaw, shapes="collision") as body:
        scene = SceneBodies(body, scenario)
        for joints in postures:
            body.pose(joints)
            for contact in scene.contacts_now():
                if contact.thing != "cup":
                    x, y, z = body.hand()[0]
                    place = f"({x:.3f}, {y:.3f}, {z:.3f}) m"
                    return f"{contact.link} would touch the {contact.thing} with the hand at {place}."
    return ""


def _reason(setup: Setup, lost: tuple[float, ...] | None, torques: FloatArray) -> str:
    if lost is not None:
        x, y, z = lost
        return (
            f"the path cannot be followed beyond ({x:.3f}, {y:.3f}, {z:.3f}) m: the arm would have to jump "
            "to another posture, or has none."
            if setup.joint_plan is None
            else "a joint would have to pass its limit."
        )
    if torques.max() >= 1:
        joint = int(torques.argmax())
        limit = setup.arm.max_torque[joint]
        return (
            f"joint {joint + 1} cannot carry the arm on this path: that takes "
            f"{limit * torques[joint]:.3g} Nm of its {limit:.3g} Nm."
        )
    return "" if setup.plan.arrived else "the skill itself does not reach its target within a minute."
