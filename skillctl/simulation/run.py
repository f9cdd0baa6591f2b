"""Run a skill on an arm: prepare, control, judge."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.memory import require
from skillctl.model.chained import ChainedSkill
from skillctl.model.skill import Skill
from skillctl.progress import Progress
from skillctl.simulation.arm import CONTROL_PERIOD, ArmBody, LiveArm
from skillctl.simulation.avoid import avoidance
from skillctl.simulation.bullet import silenced
from skillctl.simulation.disturbances import MoveTarget, Schedule, last_end
from skillctl.simulation.episode import Episode, Outcome, Phase, RefusedError, Setup, measure
from skillctl.simulation.grasp import Grasping, Gripper
from skillctl.simulation.gui import Pace, require_window
from skillctl.simulation.handling import STANDS, TRIES, Handling
from skillctl.simulation.ik import ACCEPTED_RESIDUAL, Kinematics, Solution
from skillctl.simulation.joint_space import JointArm, joint_limits, joint_metrics
from skillctl.simulation.judge import Judge, Verdict, apart
from skillctl.simulation.motion import Motion
from skillctl.simulation.options import Control
from skillctl.simulation.perception import Perception
from skillctl.simulation.position import PositionArm
from skillctl.simulation.prepare import prepare
from skillctl.simulation.recording import Recorder
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.scene import Contact, SceneBodies
from skillctl.simulation.torque import TorqueArm

HORIZON_FACTOR, HORIZON_SLACK = 1.5, 2.0  # of the duration that the joints allow; [s]
ROW = 4000.0  # [bytes] of the record, a control period; 3300 with an arm of seven joints and a cup
PROGRESS_TIME = 0.1  # [s] between two reports
LIFTED_STEP = 0.005  # [m], of a lift that is tried on the twin
DISPLACED_STEP, TURNED_STEP = 0.01, 0.05  # [m], [rad], in which inverse kinematics follows a displaced hand

CONTROLLED: dict[Control, type[PositionArm] | type[TorqueArm]] = {
    "position": PositionArm,
    "torque": TorqueArm,
}


def simulate(
    skill: Skill, scenario: Scenario, *, progress: Progress | None = None, gui: bool = False
) -> Episode:
    """Return the episode in which a simulated arm moves its hand with the velocity of a skill.

    Every control period takes the skill's velocity where the hand is *measured*. Under position control
    a reference moves with it, which the arm's position motors follow. Equal arguments give equal results,
    bit for bit, in any process on the same machine and build. A success shows that the arm's workspace,
    speed and torque allow the motion, and that it touches nothing of the scene. It does not show that the
    arm avoids other obstacles, or itself.

    Args:
        skill: Any skill over hand positions in two or three dimensions, over hand poses, or over the angles
            of the arm's joints.
        scenario: Arm, placement, scene, start, target, limits, disturbances.
        progress: Called every tenth of a simulated second, with milliseconds simulated and at most.
        gui: Show it in a window, in real time.

    Raises:
        NotFoundError: PyBullet is not installed, or no window can be opened.
        UsageError: Start or target of another dimension, or a skill that cannot be placed in a workspace.
        RefusedError: The hand cannot be at the start or target, or touches the scene there.
        ResourceError: The record of so long an episode would take more memory than may be used.
    """
    began = time.perf_counter()
    if gui:
        require_window()
    with silenced(1):
        setup = prepare(skill, scenario)
        with (
            ArmBody(setup.arm, setup.base_yaw, shapes="none") as twin,
            ArmBody(setup.arm, setup.base_yaw, shapes="all" if gui else "collision", gui=gui) as body,
        ):
            run = _Run(setup, scenario, twin, body)
            verdict = run.drive(progress, Pace() if gui else None)
    series = run.recorder.series()
    tolerance, turn_tolerance = _near(scenario)
    metrics = measure(series, setup.plan, setup.arm, tolerance, run.recorder.touched, turn_tolerance)
    if isinstance(run.arm, JointArm):
        metrics = joint_metrics(
            metrics, series, run.motion.target(run.arm.place_now), run.arm.gaps, scenario.tolerance
        )
    if isinstance(handled := run.grasping, Handling):
        off = float(np.linalg.norm(handled.off_place[:2]))
        metrics = replace(
            metrics,
            time_to_target=handled.let_go,
            cup_off=off,
            cup_lost=handled.lost,
            cup_stood=handled.stood,
            cup_tries=handled.closed,
        )
    return Episode(
        scenario=scenario,
        setup=setup,
        outcome=verdict.outcome,
        detail=verdict.detail,
        series=series,
        metrics=metrics,
        wall_seconds=time.perf_counter() - began,
    )


def _near(scenario: Scenario) -> tuple[float, float]:
    """Return distance [m] and angle [rad] at which the hand counts as at its target, or may grasp."""
    if scenario.cup is None:
        return scenario.tolerance, scenario.turn_tolerance
    grasp = scenario.grasp
    return max(scenario.tolerance, grasp.distance), max(scenario.turn_tolerance, grasp.turn)


class _Run:
    """One episode in its world."""

    def __init__(self, setup: Setup, scenario: Scenario, twin: ArmBody, body: ArmBody) -> None:
        self.setup, self.scenario = setup, scenario
        self.scene = SceneBodies(body, scenario)
        self.kinematics = Kinematics(twin, setup.hand, setup.base_yaw)
        control = CONTROLLED[scenario.control] if setup.joint_plan is None else JointArm
        self.arm: LiveArm = control(body, setup.joints, self.kinematics)
        self.perception = Perception(scenario)
        self.schedule = Schedule(scenario.disturbances)
        limits = scenario if setup.joint_plan is None else joint_limits(scenario, setup.arm)
        avoid = avoidance(scenario, setup.placement, self.kinematics) if setup.joint_plan is None else None
        self.motion = Motion(setup.skill, setup.placement, limits, self.arm.period, avoid)
        self.seen_off = np.zeros_like(self.arm.place_now)  # from the true target to the perceived one
        self._look()
        self.judge = Judge(setup.joint_plan or setup.plan, scenario, self.arm.period, setup.unit)
        self.grasping: Grasping | Handling | None = None
        if scenario.cup is not None:
            gripper, cup = Gripper(body), self.scene.cup_pose()
            if isinstance(setup.skill, ChainedSkill):
                self.grasping = Handling(scenario, gripper, self.motion, cup, self._in_reach)
            else:
                self.grasping = Grasping(scenario, gripper, cup, self._liftable)
        if isinstance(self.arm, TorqueArm):
            self.arm.posture_follows = scenario.posture == "follow"
        self.recorder = Recorder(self.arm, self.scene)

    @property
    def _phase(self) -> Phase:
        return self.grasping.phase if self.grasping else "approach"

    def _look(self) -> None:
        """Perceive the target, with a new error."""
        if not self.scenario.target_error:
            return
        seen_off = self.perception.read_target()
        self.motion.move(seen_off - self.seen_off[:3])
        self.seen_off[:3] = seen_off

    def drive(self, progress: Progress | None, pace: Pace | None) -> Verdict:
        """Let time pass until the episode is over, and return how it ended."""
        self._require_free_start()
        period, horizon = self.arm.period, self._horizon()
        rows = horizon / CONTROL_PERIOD
        require(ROW * rows, f"an episode of up to {horizon:.0f} s", "Choose a shorter --max-duration.")
        every = round(PROGRESS_TIME / period)
        for step in range(math.ceil(horizon / period) + 1):
            now = step * period
            verdict = self._disturbed(now) or self._step(now)
            if verdict is not None:
                return verdict
            if pace is not None:
                pace.wait(now)
            if progress is not None and step % every == 0:
                progress("moving", round(1e3 * now), round(1e3 * horizon))
        place = self.arm.place_now
        distance, turn = self.motion.gap(place, self._true_target(place))
        away = apart(distance, self.setup.unit, fine=True, turn=turn)
        return Verdict("timeout", f"{away} after {horizon:.1f} s")

    def _true_target(self, place: FloatArray) -> FloatArray:
        return self.motion.target(place) - self.seen_off

    def _step(self, now: float) -> Verdict | None:
        """Measure, judge, and let one period pass; return how the episode ended, None if it goes on."""
        place = self.arm.place_now
        contacts = self.scene.contacts()
        lifting = self.grasping.velocity(now, self.arm.tracking.reference[:3]) if self.grasping else None
        by_skill = lifting is None
        if lifting is None:
            busy = self.grasping.busy if self.grasping else False
            velocity = self.motion.velocity(self.perception.hand(place), busy=busy)
        else:
            velocity = np.concatenate([lifting, np.zeros(len(place) - 3)])  # the hand does not turn
        target = self._true_target(place)
        if self.setup.joint_plan is not None:
            target = self.kinematics.forward(target)
        self.recorder.add(now, self.motion.part, self._phase, target, contacts)
        verdict = self._verdict(now, place, velocity, contacts)
        if verdict is not None:
            return verdict
        share = self.arm.drive(velocity, self.schedule.push(now))
        if by_skill:
            self.motion.slowed(share)
        if self.grasping:
            self.grasping.proceed(now, *self.motion.gap(place, self.motion.target(place)))
            self.arm.load = self.grasping.load
        return None

    def _verdict(
        self, now: float, place: FloatArray, velocity: FloatArray, contacts: list[Contact]
    ) -> Verdict | None:
        began = self.grasping.began if self.grasping else 0.0
        for contact in contacts:
            if contact.thing != "cup":
                when = f"{now - began:.1f} s into the {self._phase}"
                outcome: Outcome = "bottle_contact" if contact.loose else "shelf_contact"
                return Verdict(outcome, f"{contact.link} touched the {contact.thing} {when}")
        failure = self.judge.failure(self.motion, place, velocity, self.arm.tracking)
        if failure is not None or not self.grasping:
            return failure or (
                self.judge.settled(self.motion, place, self.seen_off) if self.motion.done else None
            )
        return self.grasping.verdict(now, self.scene.cup_pose(), contacts)

    def _disturbed(self, now: float) -> Verdict | None:
        """Apply the jumps that are due; return a failure if the hand cannot be displaced so."""
        for event in self.schedule.due(now):
            offset = np.zeros_like(self.arm.place_now)
            offset[:3] = event.offset
            if isinstance(event, MoveTarget):
                self.scene.move_cup(offset[:3])
                if self.grasping:
                    self.grasping.cup_moved(offset[:3])
                self.motion.follow_cup(offset[:3])
                self._look()
                continue
            offset[3:] = event.turn[: len(offset) - 3]
            if not self._displaced(offset):
                where = "({:.2f}, {:.2f}, {:.2f}) m".format(*(self.arm.state.hand + offset[:3]))
                return Verdict("unreachable", f"no joints put the displaced hand at {where}")
        if isinstance(self.grasping, Handling) and (carried := self.grasping.carried(now)) is not None:
            knocked = self.schedule.knocked(carried)
            if knocked is not None:
                self.scene.move_cup(knocked)
        return None

    def _displaced(self, offset: FloatArray) -> bool:
        """Displace the hand by ``offset``, [m] and [rad]; return False if it cannot be there."""
        state, place = self.arm.state, self.arm.place_now
        moved, turned = self.kinematics.space.speeds(offset)
        steps = math.ceil(max(moved / DISPLACED_STEP, turned / TURNED_STEP))
        way = (self.kinematics.space.displace(place, step / steps * offset) for step in range(1, steps + 1))
        standing = Solution(state.joints, 0.0, accepted=True)  # in case the hand does not move
        *_, last = standing, *self.kinematics.along(way, state.joints)
        if last.accepted:
            self.arm.place(last.joints)
        return last.accepted

    def _liftable(self) -> float:
        """Return how far the hand can go straight up from here, at most as far as the lift goes, [m]."""
        place, lift = self.arm.place_now, self.scenario.grasp.lift
        up = np.zeros_like(place)
        up[2] = lift
        steps = math.ceil(lift / LIFTED_STEP)
        way = (place + up * step / steps for step in range(1, steps + 1))
        reached = sum(solution.accepted for solution in self.kinematics.along(way, self.arm.state.joints))
        return lift if reached == steps else lift * reached / steps

    def _in_reach(self, cup: FloatArray) -> bool:
        """Return whether a cup of this pose (7,) stands on a board, where the hand can be at its middle."""
        found = self.kinematics.search(self.kinematics.at(cup[:3]))
        return self.scene.stands(cup) and found.residual < ACCEPTED_RESIDUAL

    def _require_free_start(self) -> None:
        contacts = self.scene.contacts_now()
        if contacts:
            contact = contacts[0]
            raise RefusedError(
                "start_collision",
                f"start: {contact.link} would touch the {contact.thing} before anything has moved.",
                hint="Choose another --start, farther from the scene.",
            )

    def _horizon(self) -> float:
        scenario, plan = self.scenario, self.setup.plan
        if scenario.max_duration is not None:
            return scenario.max_duration
        end = last_end(scenario.disturbances)
        grasp = scenario.grasp
        after = grasp.close_time + grasp.lift_time + grasp.hold_time if scenario.cup else 0.0
        if isinstance(self.grasping, Handling):
            after = grasp.close_time + grasp.open_time + STANDS + TRIES * HORIZON_FACTOR * self.setup.duration
        if not plan.arrived:
            return plan.duration + end + after
        return HORIZON_FACTOR * self.setup.duration + HORIZON_SLACK + end + after
