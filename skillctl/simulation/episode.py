"""What happened in one simulated episode, and the figures that sum it up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from skillctl.arrays import FloatArray, IntArray
from skillctl.simulation.arm import CONTROL_PERIOD, ArmModel
from skillctl.simulation.ik import ACCEPTED_RESIDUAL, HandPolicy
from skillctl.simulation.motion import Plan
from skillctl.simulation.placement import Placement

SPACING = 1e-3  # [m]: paths are compared at this resolution

Outcome: TypeAlias = Literal["reached", "timeout", "unreachable", "diverged"]


@dataclass(frozen=True, eq=False, slots=True)
class TimeSeries:
    """One row per control period, the first at rest before the first command, the last at the end.

    Attributes:
        times: Shape (T,), [s].
        reference: Where the hand was asked to be, shape (T, 3), [m].
        hand: Where it was, shape (T, 3), [m].
        joints, velocities, torques: Measured, shape (T, n), [rad], [rad/s], [Nm].
        residuals: How far inverse kinematics missed the reference, shape (T,), [m].
        parts: Part of a combined skill that acted, shape (T,).
    """

    times: FloatArray
    reference: FloatArray
    hand: FloatArray
    joints: FloatArray
    velocities: FloatArray
    torques: FloatArray
    residuals: FloatArray
    parts: IntArray


@dataclass(frozen=True, slots=True)
class Metrics:
    """The figures of one episode. NaN where there is none.

    Attributes:
        final_error: Distance from the hand to the target at the end, [m].
        time_to_target: When the hand came within the tolerance to stay, [s]; NaN if it never did.
        simulated_time: Length of the episode, [s].
        tracking_median, tracking_rmse, tracking_p95: Distance between hand and reference, [m].
        plan_deviation: Largest distance of the hand from the path of the ideal rollout, [m].
        path_ratio: Length of the hand's path over that of the ideal rollout; NaN if there was no way to go.
        joint_margin: Smallest distance of any joint to its limit, [rad].
        velocity_ratio, torque_ratio: Largest measured |q̇| and |τ| over the real arm's limits.
        ik_residual: Largest inverse-kinematics residual, [m].
        ik_failures: Control periods whose residual was above 5 mm.
    """

    final_error: float
    time_to_target: float
    simulated_time: float
    tracking_median: float
    tracking_rmse: float
    tracking_p95: float
    plan_deviation: float
    path_ratio: float
    joint_margin: float
    velocity_ratio: float
    torque_ratio: float
    ik_residual: float
    ik_failures: int


@dataclass(frozen=True, eq=False, slots=True)
class Episode:
    """One run of a skill on an arm.

    Attributes:
        outcome: ``reached``: the hand stayed within the tolerance of the target; ``timeout``: the horizon
            came first; ``unreachable``: no joints for the reference for a quarter of a second;
            ``diverged``: the hand moved far away from the target, or the skill's velocity is not finite.
        arm, hand, base_yaw, placement: What the options, or their automatic choice, came to.
        target: Workspace position the motion was going to, shape (3,), [m].
        plan: The ideal rollout from the same start.
        series: The measured motion.
        metrics: The figures.
        wall_seconds: What the simulation cost. The only thing here that differs between two runs.
    """

    outcome: Outcome
    arm: ArmModel
    hand: HandPolicy
    base_yaw: float
    placement: Placement
    target: FloatArray
    plan: Plan
    series: TimeSeries
    metrics: Metrics
    wall_seconds: float

    @property
    def success(self) -> bool:
        """Whether the target was reached."""
        return self.outcome == "reached"


def measure(series: TimeSeries, plan: Plan, target: FloatArray, model: ArmModel, tolerance: float) -> Metrics:
    """Return the figures of a motion (T ≥ 1 rows) towards ``target`` (3,) that followed ``plan``."""
    tracking = np.linalg.norm(series.hand - series.reference, axis=1)
    distances = np.linalg.norm(series.hand - target, axis=1)
    margins = np.minimum(series.joints - model.lower, model.upper - series.joints)
    planned = thinned(plan.positions, SPACING)
    planned_length = path_length(plan.positions)
    return Metrics(
        final_error=float(distances[-1]),
        time_to_target=_arrival(distances, tolerance),
        simulated_time=float(series.times[-1]),
        tracking_median=float(np.median(tracking)),
        tracking_rmse=float(np.sqrt(np.mean(tracking**2))),
        tracking_p95=float(np.percentile(tracking, 95)),
        plan_deviation=float(distances_to_path(thinned(series.hand, SPACING), planned).max()),
        path_ratio=path_length(series.hand) / planned_length if planned_length > tolerance else np.nan,
        joint_margin=float(margins.min()),
        velocity_ratio=float((np.abs(series.velocities) / model.max_velocity).max()),
        torque_ratio=float((np.abs(series.torques) / model.max_torque).max()),
        ik_residual=float(series.residuals.max()),
        ik_failures=int((series.residuals > ACCEPTED_RESIDUAL).sum()),
    )


def _arrival(distances: FloatArray, tolerance: float) -> float:
    """Return the time since which the distance has stayed within the tolerance, NaN if it is outside."""
    outside = np.flatnonzero(distances > tolerance)
    first = int(outside[-1]) + 1 if outside.size else 0
    return first * CONTROL_PERIOD if first < len(distances) else np.nan


def path_length(points: FloatArray) -> float:
    """Return the length of the polyline through points (n, 3), [m]."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def thinned(points: FloatArray, spacing: float) -> FloatArray:
    """Return the points (n, 3) that lie about ``spacing`` [m] apart along their path, both ends included."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    wanted = np.searchsorted(way, np.arange(0.0, way[-1], spacing))
    return np.asarray(points[np.unique([0, *wanted.tolist(), len(points) - 1])])


def distances_to_path(points: FloatArray, path: FloatArray) -> FloatArray:
    """Return the distance of each point (n, 3) to the polyline through path (m, 3). Shape (n,), [m]."""
    starts, edges = path[:-1], np.diff(path, axis=0)
    if not len(edges):
        return np.asarray(np.linalg.norm(points - path[0], axis=1))
    lengths = np.maximum((edges**2).sum(axis=1), np.finfo(np.float64).tiny)  # an edge may be a point
    nearest = np.empty(len(points))
    for i, point in enumerate(points):
        offset = point - starts
        along = np.clip((offset * edges).sum(axis=1) / lengths, 0.0, 1.0)
        nearest[i] = np.sqrt(((offset - along[:, None] * edges) ** 2).sum(axis=1).min())
    return nearest
