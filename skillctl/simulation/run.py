"""Run a skill on an arm: prepare, control at 240 Hz, judge."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.model.skill import Skill, retargeted
from skillctl.simulation.arm import CONTROL_PERIOD, ArmBody, ArmState, DrivenArm
from skillctl.simulation.bullet import silenced
from skillctl.simulation.control import Follower, Judge
from skillctl.simulation.episode import Episode, Outcome, TimeSeries, measure
from skillctl.simulation.ik import Kinematics
from skillctl.simulation.motion import Motion
from skillctl.simulation.prepare import Setup, prepare
from skillctl.simulation.scenario import Scenario

HORIZON_FACTOR, HORIZON_SLACK = 1.5, 2.0  # of the plan's duration; [s]
PROGRESS_STEPS = 24  # control periods between two reports

Progress = Callable[[float, float], None]  # simulated seconds so far, and the horizon


def simulate(skill: Skill, scenario: Scenario, *, progress: Progress | None = None) -> Episode:
    """Return what happens when an arm moves its hand as the skill says, in simulation.

    Every control period the reference moves with the skill's velocity at the *measured* hand position,
    and the arm's position motors follow it. Equal arguments give equal results, bit for bit, in any
    process on the same machine and build. A success shows that the arm's workspace, speed and torque
    allow the motion. It says nothing about obstacles, and the arm may pass through itself.

    Args:
        skill: Any skill over hand positions in two or three dimensions.
        scenario: Arm, placement, start, target, limits.
        progress: Called every tenth of a simulated second.

    Raises:
        NotFoundError: PyBullet is not installed.
        UsageError: Start or target of another dimension, or a skill that has no place in a workspace.
        GoalNotReachedError: Start or target lies where the arm's hand cannot be.
    """
    began = time.perf_counter()
    if scenario.start is not None and len(scenario.start) != skill.dimension:
        raise UsageError(f"start: expected {skill.dimension} numbers, got {len(scenario.start)}.")
    if scenario.target is not None and scenario.target != "cup":
        skill = retargeted(skill, scenario.target)
    with silenced(1):
        setup = prepare(skill, scenario)
        model, plan = setup.model, setup.plan
        motion = Motion(skill, setup.placement, scenario)
        with ArmBody(model, setup.base_yaw) as twin, ArmBody(model, setup.base_yaw) as body:
            kinematics = Kinematics(twin, setup.hand, setup.base_yaw)
            outcome, series = _drive(
                setup, kinematics, DrivenArm(body, setup.joints), motion, scenario, progress
            )
    target = motion.target(series.hand[-1])
    return Episode(
        scenario=scenario,
        outcome=outcome,
        detail="" if outcome == "reached" else outcome,
        arm=model,
        hand=setup.hand,
        base_yaw=setup.base_yaw,
        placement=setup.placement,
        target=target,
        plan=plan,
        series=series,
        metrics=measure(series, plan, model, scenario.tolerance),
        wall_seconds=time.perf_counter() - began,
    )


def _drive(
    setup: Setup,
    kinematics: Kinematics,
    arm: DrivenArm,
    motion: Motion,
    scenario: Scenario,
    progress: Progress | None,
) -> tuple[Outcome, TimeSeries]:
    horizon = _horizon(setup, scenario)
    judge, log = Judge.of(setup.plan, scenario), _Log()
    follower = Follower(kinematics, setup.joints)
    outcome: Outcome | None = None
    for step in range(math.ceil(horizon / CONTROL_PERIOD) + 1):
        state = arm.state()
        velocity = motion.velocity(state.hand)
        log.add(step, state, follower, motion.part)
        outcome = judge.outcome(motion, state.hand, velocity, follower.refusals)
        if outcome is not None:
            break
        joints = follower.joints
        motion.slowed(follower.advance(velocity, state.hand))
        arm.drive(joints, follower.joints)
        if progress is not None and step % PROGRESS_STEPS == 0:
            progress(step * CONTROL_PERIOD, horizon)
    log.target = motion.target(state.hand)
    return outcome or "timeout", log.series()


def _horizon(setup: Setup, scenario: Scenario) -> float:
    if scenario.max_duration is not None:
        return scenario.max_duration
    if not setup.plan.arrived:
        return setup.plan.duration
    return HORIZON_FACTOR * setup.plan.duration + HORIZON_SLACK


@dataclass(slots=True)
class _Log:
    """Collects rows, and turns them into a time series."""

    rows: list[tuple[int, ArmState, FloatArray, float, int]] = field(default_factory=list)
    target: FloatArray = field(default_factory=lambda: np.zeros(3))

    def add(self, step: int, state: ArmState, follower: Follower, part: int) -> None:
        self.rows.append((step, state, follower.reference, follower.residual, part))

    def series(self) -> TimeSeries:
        steps, states, references, residuals, parts = zip(*self.rows, strict=True)
        count = len(steps)
        return TimeSeries(
            phases=np.zeros(count, dtype=np.int64),
            targets=np.tile(self.target, (count, 1)),
            fingers=np.zeros((count, 0)),
            cups=np.full((count, 7), np.nan),
            contacts=np.zeros(count, dtype=np.int64),
            clearances=np.full(count, np.nan),
            times=CONTROL_PERIOD * np.array(steps, dtype=np.float64),
            reference=np.stack(references),
            hand=np.stack([state.hand for state in states]),
            joints=np.stack([state.joints for state in states]),
            velocities=np.stack([state.velocities for state in states]),
            torques=np.stack([state.torques for state in states]),
            residuals=np.array(residuals, dtype=np.float64),
            parts=np.array(parts, dtype=np.int64),
        )
