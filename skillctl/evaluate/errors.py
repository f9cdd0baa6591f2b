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
    longest = max(demonstration.duration for demonstration in demonstrations)
    starts = np.stack([demonstration.positions[0] for demonstration in demonstrations])
    offsets = np.zeros_like(starts) if ends is None else skill.attractor - np.stack(ends)
    run = partial(rollout, skill, duration=PATIENCE * longest, period=longest / STEPS_PER_DEMONSTRATION)
    rollouts = run(starts)
    recorded = run(starts - offsets) if offsets.any() else rollouts
    reports = []
    for index, demonstration in enumerate(demonstrations):
        path = rollouts.trajectory(index)[1]
        distance = metrics.dtw(path, demonstration.positions)
        as_recorded = metrics.dtw(recorded.trajectory(index)[1], demonstration.positions - offsets[index])
        velocities = skill.velocity(demonstration.positions)
        reports.append(
            DemonstrationReport(
                source=demonstration.source,
                leaf=leaf,
                n_points=len(demonstration.times),
                duration=demonstration.duration,
                velocity_rmse=metrics.velocity_rmse(velocities, demonstration.velocities),
                dtw=distance if np.isfinite(distance) else None,
                end_error=metrics.end_error(path, skill.attractor),
                arrived=bool(rollouts.arrived[index]),
                moved=None if ends is None else float(np.linalg.norm(offsets[index])),
                dtw_unmoved=None if ends is None or not np.isfinite(as_recorded) else as_recorded,
            )
        )
    return reports


def mean_dtw(reports: Sequence[DemonstrationReport]) -> float | None:
    """Return the mean of the DTW distances, or None if there are none, or one is missing."""
    distances = [report.dtw for report in reports if report.dtw is not None]
    return float(np.mean(distances)) if reports and len(distances) == len(reports) else None


def strays(skill: ActingSkill, taught: Sequence[DemonstrationSet | None]) -> tuple[float, ...]:
    """Return how far a merged skill stays from the demonstrations of each of its leaves that has any.

    The mean DTW distance of its motions from their starts, in extents of the leaf's demonstrations; infinite
    if a motion diverges.
    """
    found = []
    for motions in taught:
        if motions is not None:
            ending = [motion.translated(skill.attractor - motion.positions[-1]) for motion in motions]
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
        arrived: How many of the motions reached the attractor.
    """

    demonstrations: int
    dtw: float | None
    worst_dtw: float | None
    arrived: int

    @classmethod
    def recorded(cls, results: Mapping[str, Any]) -> HeldOut | None:
        """Return what an operation's results hold of it, if anything."""
        kept = {name.removeprefix(PREFIX): value for name, value in results.items() if PREFIX in name}
        return cls(**kept) if kept else None

    def results(self) -> dict[str, Any]:
        """Return it as an operation's results keep it."""
        return {PREFIX + name: value for name, value in asdict(self).items()}
