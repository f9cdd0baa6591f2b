"""The record of one simulated episode, and its figures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from skillctl.arrays import BoolArray, FloatArray, IntArray
from skillctl.errors import GoalNotReachedError
from skillctl.geometry import arc_lengths, path_length
from skillctl.model.chained import ChainedSkill
from skillctl.model.skill import Skill
from skillctl.rotations import angles, vectors
from skillctl.simulation.arms import ArmModel
from skillctl.simulation.ik import ACCEPTED_RESIDUAL
from skillctl.simulation.motion import Plan
from skillctl.simulation.options import HandPolicy
from skillctl.simulation.placement import Placement
from skillctl.simulation.scenario import Scenario

SPACING = 1e-3  # [m]: paths are compared at this resolution

Outcome: TypeAlias = Literal[
    "reached",
    "grasped",
    "timeout",
    "unreachable",
    "joint_limit",
    "diverged",
    "shelf_contact",
    "bottle_contact",
    "tipped",
    "missed",
    "dropped",
    "start_collision",
    "placed",
    "misplaced",
]
"""How an episode ended. Three are successes:

- ``reached``: the hand stayed within the tolerances of the true target for the settle time;
- ``grasped``: the cup was lifted and held, and the arm never touched the scene; of a chain: it holds it at
  its end;
- ``placed``: a chain set the cup down: a second after it was let go it stands upright at its place, and the
  arm never touched the scene.

The others are failures:

- ``timeout``: the longest duration was over;
- ``unreachable``: there were no joints for the reference, for a quarter of a second or from the start;
- ``joint_limit``: the same, with a joint at its limit;
- ``diverged``: the hand moved far away from the target, or the skill's velocity is not finite;
- ``shelf_contact``: the arm touched the scene or an obstacle that does not move;
- ``bottle_contact``: the arm touched an obstacle that stands loose;
- ``tipped``: the cup fell over, or off its board, before the fingers closed;
- ``missed``: the cup was not between both fingers when they had closed; without a cup: the hand stayed where
  it perceived its target, and that is elsewhere;
- ``dropped``: the cup was not lifted far enough, or not held to the end, and of a chain it does not stand
  where it can be taken again;
- ``misplaced``: the cup was let go and stands elsewhere, or hangs on the hand;
- ``start_collision``: the arm touches something where it starts.
"""
OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)
SUCCESSES: tuple[Outcome, ...] = ("reached", "grasped", "placed")

Unit: TypeAlias = Literal["m", "rad"]
Phase: TypeAlias = Literal["approach", "close", "lift", "hold", "carry", "open", "leave", "lost"]
PHASES: tuple[Phase, ...] = get_args(Phase)


class RefusedError(GoalNotReachedError):
    """The episode cannot begin; ``outcome`` is its class of failure in a batch."""

    def __init__(self, outcome: Outcome, message: str, *, hint: str = "") -> None:
        super().__init__(message, hint=hint)
        self.outcome = outcome


@dataclass(frozen=True, eq=False, slots=True)
class Setup:
    """Everything an episode needs to begin.

    Attributes:
        skill: The skill, moved to its target.
        arm, placement, hand, base_yaw: The choices of the scenario, or the automatic ones; base_yaw in [rad].
        joints: Posture at the start, shape (n,), [rad].
        plan: The ideal motion from there to the true target, undisturbed.
        followable: Whether neighbouring joints exist all along the plan.
        duration: Duration of the plan at the speed of the arm's joints, [s].
        joint_plan: The plan in joint angles, for a skill that moves joints; else None.
        avoided: What of the scene the hand keeps out of, and what not, in a sentence; empty for nothing.
    """

    skill: Skill
    arm: ArmModel
    placement: Placement
    hand: HandPolicy
    base_yaw: float
    joints: FloatArray
    plan: Plan
    followable: bool
    duration: float
    joint_plan: Plan | None = None
    avoided: str = ""

    @property
    def turns(self) -> bool:
        """Whether the skill turns the hand."""
        return self.hand == "taught"

    @property
    def unit(self) -> Unit:
        """Unit of the target and of the errors: metres of the hand, or radians of the joints."""
        return "m" if self.joint_plan is None else "rad"


@dataclass(frozen=True, eq=False, slots=True)
class TimeSeries:
    """One row per control period of 1/240 s, or per 5 ms under torque control, from the start at rest on.

    Attributes:
        times: Shape (T,), [s].
        reference: Positions asked of the hand, shape (T, 3), [m].
        hand: Its measured positions, shape (T, 3), [m].
        joints, velocities, torques: Measured, shape (T, n), [rad], [rad/s], [Nm].
        residuals: Error of inverse kinematics, shape (T,), [m].
        parts: Part of a combined skill that acted, shape (T,).
        phases: Index in ``PHASES``, shape (T,).
        targets: True positions of the target, with a cup its grasp point, shape (T, 3), [m].
        fingers: Position of each finger joint, shape (T, m), [m].
        cups: Position and orientation q_xyzw of the cup's middle, shape (T, 7); NaN without a cup.
        contacts: Number of points at which the arm touched the scene (not the cup), shape (T,).
        clearances: Distance of arm and scene, at most 0.2 m, in every eighth row; NaN in the others, and
            without a scene. Shape (T,), [m].
        manipulability: That of the posture (see ``ArmBody``), in every eighth row; NaN in the others.
            Shape (T,).
        hand_turns: Measured orientation of the hand, q_xyzw, shape (T, 4).
        reference_turns, target_turns: Orientations asked of a taught hand, and of its target, q_xyzw, shape
            (T, 4); NaN for other hands.
    """

    times: FloatArray
    reference: FloatArray
    hand: FloatArray
    joints: FloatArray
    velocities: FloatArray
    torques: FloatArray
    residuals: FloatArray
    parts: IntArray
    phases: IntArray
    targets: FloatArray
    fingers: FloatArray
    cups: FloatArray
    contacts: IntArray
    clearances: FloatArray
    manipulability: FloatArray
    hand_turns: FloatArray
    reference_turns: FloatArray
    target_turns: FloatArray


@dataclass(frozen=True, slots=True)
class Metrics:
    """The figures of one episode. A figure that does not exist is NaN.

    Distances to the target, tracking, deviation and path length are measured until a lift begins, while the
    skill moves the hand; the other figures are of the whole episode. For a skill that moves joints, final
    error and tracking are distances of the joints, [rad].

    Attributes:
        final_error: Distance from the hand to the target at the end, or when the lift began, [m].
        final_turn: Angle of a taught hand to the orientation of its target then, [rad].
        time_to_target: Time from which the hand stayed within the tolerances, or near enough for the fingers
            to close, [s]; of a chain with a cup, when it had let it go; NaN if it did not.
        simulated_time: Length of the episode, [s].
        tracking_median, tracking_rmse, tracking_p95: Distance between hand and reference, [m].
        plan_deviation: Largest distance of the hand from the path of the ideal rollout, [m].
        path_ratio: Length of the hand's path over that of the ideal rollout; NaN if the latter is 0.
        clearance: Smallest distance of arm and scene, [m]; negative if they penetrated.
        joint_margin: Smallest distance of any joint to its limit, [rad]; NaN if no joint has limits.
        manipulability: Smallest one of all postures (see ``ArmBody``).
        velocity_ratio, torque_ratio: Largest measured |q̇| and |τ| over the real arm's limits.
        joint_jump: Largest change of a joint in one control period, [rad].
        ik_residual: Largest inverse-kinematics residual, [m].
        ik_failures: Control periods whose residual was above 5 mm.
        contacts: Pairs that touched, each once, as in ``panda_hand - upper board``.
        cup_moved: Distance by which the hand moved the cup before the fingers closed, [m].
        cup_rise: Height of the cup above its start at the end, [m].
        grip_width: Distance of the fingers at the end, [m].
        cup_off: Distance of the cup at the end from the place where a chain sets it down, no height, [m].
        cup_lost, cup_stood: How often a chain lost the cup, and how often it then stood in reach.
        cup_tries: How often the fingers of a chain closed.
    """

    final_error: float
    time_to_target: float
    simulated_time: float
    tracking_median: float
    tracking_rmse: float
    tracking_p95: float
    plan_deviation: float
    path_ratio: float
    clearance: float
    joint_margin: float
    velocity_ratio: float
    torque_ratio: float
    joint_jump: float
    ik_residual: float
    ik_failures: int
    contacts: tuple[str, ...]
    cup_moved: float
    cup_rise: float
    grip_width: float
    final_turn: float
    manipulability: float
    cup_off: float = np.nan
    cup_lost: int = 0
    cup_stood: int = 0
    cup_tries: int = 0


@dataclass(frozen=True, slots=True)
class StageTime:
    """When a stage of a chain, from 1, began and ended, [s]; one that began anew is listed again."""

    stage: int
    began: float
    ended: float


@dataclass(frozen=True, eq=False, slots=True)
class Episode:
    """One run of a skill on an arm.

    Attributes:
        scenario: The scenario as it was given.
        setup: The arm, the placement and the plan with which it began.
        outcome: How it ended.
        detail: What happened, for a failure, as the end of a sentence; else empty.
        series: The measured motion.
        metrics: The figures.
        wall_seconds: Time that the simulation took, [s]; only this differs between equal runs.
    """

    scenario: Scenario
    setup: Setup
    outcome: Outcome
    detail: str
    series: TimeSeries
    metrics: Metrics
    wall_seconds: float

    @property
    def target(self) -> FloatArray:
        """Workspace position of the target at the end, shape (3,), [m]."""
        return np.asarray(self.series.targets[-1])

    @property
    def stages(self) -> tuple[StageTime, ...]:
        """The stages of a chain in the order in which they acted; none of any other skill."""
        skill, series = self.setup.skill, self.series
        if not isinstance(skill, ChainedSkill):
            return ()
        acting = np.array([skill.stage_of(part) for part in series.parts.tolist()])
        again = (np.diff(series.phases, prepend=0) != 0) & (series.phases == PHASES.index("approach"))
        first = np.flatnonzero((np.diff(acting, prepend=-1) != 0) | again)
        ends = series.times[[*first[1:].tolist(), len(acting) - 1]]
        rows = zip((acting[first] + 1).tolist(), series.times[first].tolist(), ends.tolist(), strict=True)
        return tuple(StageTime(*row) for row in rows)

    @property
    def success(self) -> bool:
        """Whether the hand reached the target, grasped the cup, or set it down at its place."""
        return self.outcome in SUCCESSES


def measure(
    series: TimeSeries,
    plan: Plan,
    model: ArmModel,
    tolerance: float,
    contacts: tuple[str, ...] = (),
    turn_tolerance: float = np.inf,
) -> Metrics:
    """Return the figures of a motion (T ≥ 1 rows) that followed ``plan``.

    Args:
        series: The measured motion.
        plan: The ideal rollout.
        model: The arm, for its limits.
        tolerance: Distance to the target that counts as reached, [m].
        contacts: Pairs that touched, in words.
        turn_tolerance: Angle to its orientation that counts as reached, [rad].
    """
    by_skill = ~np.isin(series.phases, [PHASES.index("lift"), PHASES.index("hold")])
    hand = series.hand[by_skill]
    tracking = np.linalg.norm(hand - series.reference[by_skill], axis=1)
    distances = np.linalg.norm(hand - series.targets[by_skill], axis=1)
    turns = angles(vectors(series.hand_turns[by_skill]), vectors(series.target_turns[by_skill]))
    margins = np.minimum(series.joints - model.lower, model.upper - series.joints)
    planned = thinned(plan.path, SPACING)
    planned_length = float(path_length(plan.path))
    cup = series.cups[:, :3]
    open_hand = series.phases == PHASES.index("approach")
    aside = (cup - series.targets)[open_hand]  # without the jumps of the target, which the hand did not cause
    return Metrics(
        final_error=float(distances[-1]),
        time_to_target=arrival(
            (distances > tolerance) | (turns > turn_tolerance),  # a NaN is not larger
            series.times[by_skill],
        ),
        simulated_time=float(series.times[-1]),
        tracking_median=float(np.median(tracking)),
        tracking_rmse=float(np.sqrt(np.mean(tracking**2))),
        tracking_p95=float(np.percentile(tracking, 95)),
        plan_deviation=float(distances_to_path(thinned(hand, SPACING), planned).max()),
        path_ratio=float(path_length(hand)) / planned_length if planned_length > tolerance else np.nan,
        clearance=_smallest(series.clearances),
        joint_margin=float(margins.min()) if np.isfinite(margins.min()) else np.nan,
        velocity_ratio=float((np.abs(series.velocities) / model.max_velocity).max()),
        torque_ratio=float((np.abs(series.torques) / model.max_torque).max()),
        joint_jump=float(np.abs(np.diff(series.joints, axis=0)).max(initial=0.0)),
        ik_residual=float(series.residuals.max()),
        ik_failures=int((series.residuals > ACCEPTED_RESIDUAL).sum()),
        contacts=contacts,
        cup_moved=float(np.linalg.norm(aside[-1] - aside[0])),
        cup_rise=float(cup[-1, 2] - cup[0, 2]),
        grip_width=float(series.fingers[-1].sum()) if series.fingers.shape[1] else np.nan,
        final_turn=float(turns[-1]),
        manipulability=_smallest(series.manipulability),
    )


def _smallest(values: FloatArray) -> float:
    measured = values[np.isfinite(values)]
    return float(measured.min()) if measured.size else np.nan


def arrival(away: BoolArray, times: FloatArray) -> float:
    """Return the time since which the hand has not been ``away`` (T,) from its target, NaN if it is."""
    outside = np.flatnonzero(away)
    first = int(outside[-1]) + 1 if outside.size else 0
    return float(times[first]) if first < len(times) else np.nan


def spread_out(points: FloatArray, spacing: float) -> IntArray:
    """Return indices of points (n, d) about ``spacing`` apart along their path, with both ends."""
    way = arc_lengths(points)
    wanted = np.searchsorted(way, np.arange(0.0, way[-1], spacing))
    return np.unique([0, *wanted.tolist(), len(points) - 1])


def thinned(points: FloatArray, spacing: float) -> FloatArray:
    """Return those of the points (n, 3) that ``spread_out`` chooses, about ``spacing`` [m] apart."""
    return np.asarray(points[spread_out(points, spacing)])


def distances_to_path(points: FloatArray, path: FloatArray) -> FloatArray:
    """Return the distance of each point (n, 3) to the polyline through path (m, 3). Shape (n,), [m]."""
    starts, edges = path[:-1], np.diff(path, axis=0)
    if not len(edges):
        return np.asarray(np.linalg.norm(points - path[0], axis=1))
    lengths = np.maximum((edges**2).sum(axis=1), np.finfo(np.float64).tiny)  # an edge may have no length
    nearest = np.empty(len(points))
    for i, point in enumerate(points):
        offset = point - starts
        along = np.clip((offset * edges).sum(axis=1) / lengths, 0.0, 1.0)
        nearest[i] = np.sqrt(((offset - along[:, None] * edges) ** 2).sum(axis=1).min())
    return nearest
