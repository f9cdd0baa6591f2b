"""How well a skill repeats demonstrations, those it was learned from or others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from skillctl import metrics
from skillctl.arrays import FloatArray
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.rollout import rollout
from skillctl.model.skill import ActingSkill
from skillctl.model.space import Space
from skillctl.store import DemonstrationReport

STEPS_PER_DEMONSTRATION = 1000  # Euler's path error is then well below a thousandth of the motion's length
PREFIX = "held_out_"  # of the names under which an operation keeps a ``HeldOut``
PATIENCE = 10  # durations of the longest demonstration, after which a motion counts as not arriving


def report_errors(
    skill: ActingSkill,
    demonstrations: DemonstrationSet,
    leaf: int = 0,
    *,
    ends: Sequence[FloatArray] | None = None,
) -> list[DemonstrationReport]:
    """Return how each demonstration differs from a rollout from its start and from the velocities along it.

    Args:
        skill: What was learned, or merged.
        demonstrations: What it was learned from, ending at its attractor.
        leaf: Which leaf of the whole skill tree ``skill`` is.
        ends: Where each ended when it was recorded, (d,), before it was moved to end there: errors against
            the demonstrations as they were recorded are reported, too.
    """
    space, target = skill.space, skill.attractor
    longest = max(demonstration.duration for demonstration in demonstrations)
    taught = [demonstration.positions for demonstration in demonstrations]
    run = partial(rollout, skill, duration=PATIENCE * longest, period=longest / STEPS_PER_DEMONSTRATION)
    rollouts = run(np.stack([states[0] for states in taught]))
    recorded, shown = rollouts, taught
    if ends is not None and any((end != target).any() for end in ends):
        shown = [space.carried(states, target, end) for states, end in zip(taught, ends, strict=True)]
        recorded = run(np.stack([states[0] for states in shown]))
    reports = []
    for index, demonstration in enumerate(demonstrations):
        path = rollouts.trajectory(index)[1]
        distance, angle = _warped(path, taught[index], space)
        as_recorded, turned = _warped(recorded.trajectory(index)[1], shown[index], space)
        moving, turning = _rmse(skill.velocity(taught[index]), demonstration.velocities, space)
        end_error, end_angle = _numbers(space.apart(path[-1], target))
        moved, moved_angle = (None, None) if ends is None else _numbers(space.apart(target, ends[index]))
        reports.append(
            DemonstrationReport(
                source=demonstration.source,
                leaf=leaf,
                n_points=len(demonstration.times),
                duration=demonstration.duration,
                velocity_rmse=moving,
                dtw=distance,
                end_error=end_error,
                arrived=bool(rollouts.arrived[index]),
                moved=moved,
                dtw_unmoved=None if ends is None else as_recorded,
                turning_rmse=turning,
                dtw_angle=angle,
                end_angle=end_angle,
                moved_angle=moved_angle,
                dtw_angle_unmoved=None if ends is None else turned,
            )
        )
    return reports


def _warped(path: FloatArray, shown: FloatArray, space: Space) -> tuple[float | None, float | None]:
    """Return the DTW distances of positions and of orientations; None if it diverged, or there is none."""
    n = space.positions
    distance = metrics.dtw(path[:, :n], shown[:, :n])
    angle = np.inf if n == space.dimension else metrics.dtw_angle(path[:, n:], shown[:, n:])
    return distance if np.isfinite(distance) else None, angle if np.isfinite(angle) else None


def _rmse(predicted: FloatArray, observed: FloatArray, space: Space) -> tuple[float, float | None]:
    """Return the velocity error of positions, and that of orientations if there are any."""
    n = space.positions
    turning = None if n == space.dimension else metrics.velocity_rmse(predicted[:, n:], observed[:, n:])
    return metrics.velocity_rmse(predicted[:, :n], observed[:, :n]), turning


def _numbers(apart: tuple[FloatArray, FloatArray | None]) -> tuple[float, float | None]:
    return float(apart[0]), None if apart[1] is None else float(apart[1])


def mean_dtw(reports: Sequence[DemonstrationReport]) -> float | None:
    """Return the mean of the DTW distances, or None if there are none, or one is missing."""
    return _mean([report.dtw for report in reports])


def mean_dtw_angle(reports: Sequence[DemonstrationReport]) -> float | None:
    """Return the mean of the DTW distances of orientations, [rad], or None as ``mean_dtw``."""
    return _mean([report.dtw_angle for report in reports])


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if values and len(known) == len(values) else None


def strays(skill: ActingSkill, taught: Sequence[DemonstrationSet | None]) -> tuple[float, ...]:
    """Return how far a merged skill stays from the demonstrations of each of its leaves that has any.

    The mean DTW distance of its motions from their starts, in extents of the leaf's demonstrations; infinite
    if a motion diverges.
    """
    found = []
    for motions in taught:
        if motions is not None:
            ending = [motion.ending_at(skill.attractor, motions.space) for motion in motions]
            distance = mean_dtw(report_errors(skill, DemonstrationSet(tuple(ending), motions.space)))
            found.append(np.inf if distance is None else distance / motions.extent)
    return tuple(found)


@dataclass(frozen=True)
class HeldOut:
    """Errors on demonstrations that were not learned from.

    Attributes:
        demonstrations: How many, each left out once.
        dtw: Mean DTW distance, None if some motion diverged; in the unit of the space.
        worst_dtw: The largest.
        dtw_angle, worst_dtw_angle: The same of orientations, [rad]; None if there are none.
        arrived: How many of the motions reached the attractor.
    """

    demonstrations: int
    dtw: float | None
    worst_dtw: float | None
    arrived: int
    dtw_angle: float | None = None
    worst_dtw_angle: float | None = None

    @classmethod
    def recorded(cls, results: Mapping[str, Any]) -> HeldOut | None:
        """Return what an operation's results hold of it, if anything."""
        kept = {name.removeprefix(PREFIX): value for name, value in results.items() if PREFIX in name}
        return cls(**kept) if kept else None

    def results(self) -> dict[str, Any]:
        """Return it as an operation's results keep it: without angles where there are none."""
        angles = {"dtw_angle", "worst_dtw_angle"} if self.dtw_angle is None else set()
        return {PREFIX + name: value for name, value in asdict(self).items() if name not in angles}
