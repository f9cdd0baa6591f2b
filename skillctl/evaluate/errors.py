"""How well a skill repeats what it was taught."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from skillctl import metrics
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.rollout import rollout
from skillctl.model.seds import SedsSkill
from skillctl.store import DemonstrationReport

STEPS_PER_DEMONSTRATION = 1000  # Euler's path error is then well below a thousandth of the motion's length
PATIENCE = 10  # durations of the longest demonstration, after which a motion counts as not arriving


def report_errors(
    skill: SedsSkill, demonstrations: DemonstrationSet, leaf: int = 0
) -> list[DemonstrationReport]:
    """Return how each demonstration differs from a rollout from its start and from the velocities along it.

    Args:
        skill: What was learned.
        demonstrations: What it was learned from, ending at its attractor.
        leaf: Which leaf of the whole skill tree ``skill`` is.
    """
    longest = max(demonstration.duration for demonstration in demonstrations)
    rollouts = rollout(
        skill,
        np.stack([demonstration.positions[0] for demonstration in demonstrations]),
        duration=PATIENCE * longest,
        period=longest / STEPS_PER_DEMONSTRATION,
    )
    paths = [rollouts.trajectory(index)[1] for index in range(len(demonstrations))]
    distances = [
        metrics.dtw(path, shown.positions) for path, shown in zip(paths, demonstrations, strict=True)
    ]
    return [
        DemonstrationReport(
            source=demonstration.source,
            leaf=leaf,
            n_points=len(demonstration.times),
            duration=demonstration.duration,
            velocity_rmse=metrics.velocity_rmse(
                skill.velocity(demonstration.positions), demonstration.velocities
            ),
            dtw=distance if np.isfinite(distance) else None,
            end_error=metrics.end_error(path, skill.attractor),
            arrived=bool(arrived),
        )
        for demonstration, path, distance, arrived in zip(
            demonstrations, paths, distances, rollouts.arrived, strict=True
        )
    ]


def mean_dtw(reports: list[DemonstrationReport] | tuple[DemonstrationReport, ...]) -> float | None:
    """Return the mean of the DTW distances, or None if one is missing."""
    distances = [report.dtw for report in reports]
    return (
        None
        if None in distances or not distances
        else float(np.mean([d for d in distances if d is not None]))
    )


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
        kept = {
            name.removeprefix("held_out_"): value for name, value in results.items() if "held_out_" in name
        }
        return cls(**kept) if kept else None

    def results(self) -> dict[str, Any]:
        """Return it as an operation's results keep it."""
        return {
            "held_out_demonstrations": self.demonstrations,
            "held_out_dtw": self.dtw,
            "held_out_worst_dtw": self.worst_dtw,
            "held_out_arrived": self.arrived,
        }
