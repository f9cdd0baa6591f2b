"""Rollouts: where the motion goes from many starts at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray, IntArray
from skillctl.errors import UsageError
from skillctl.model.skill import CombinedSkill, Skill, attractors_of

ARRIVAL_DISTANCE = 1e-3  # in the unit of the space: 1 mm, or 1 mrad


@dataclass(frozen=True, eq=False, slots=True)
class Rollouts:
    """Trajectories from n starts.

    Attributes:
        times: Shape (T,), [s].
        positions: Shape (n, T, d). A trajectory rests at its last state once all have arrived.
        arrival_times: First time within the arrival distance of an attractor, NaN if never. Shape (n,), [s].
        parts: Part that acted at the end, 0 for skills without regions. Shape (n,).
    """

    times: FloatArray
    positions: FloatArray
    arrival_times: FloatArray
    parts: IntArray

    @property
    def arrived(self) -> npt.NDArray[np.bool_]:
        """Whether each trajectory came within the arrival distance. Shape (n,)."""
        return np.isfinite(self.arrival_times)

    def trajectory(self, index: int) -> tuple[FloatArray, FloatArray]:
        """Return times and positions of one trajectory, cut at its arrival."""
        arrival = self.arrival_times[index]
        end = len(self.times) if np.isnan(arrival) else int(np.searchsorted(self.times, arrival)) + 1
        return self.times[:end], self.positions[index, :end]


def rollout(
    skill: Skill,
    starts: npt.ArrayLike,
    *,
    duration: float,
    period: float,
    arrival_distance: float = ARRIVAL_DISTANCE,
    parts: IntArray | None = None,
) -> Rollouts:
    """Integrate ξ̇ = f(ξ) from every start, as a controller with the given period would (ξ⁺ = ξ + Δt f).

    A latched combined skill keeps, per trajectory, the part chosen at the start. Integration ends when
    every trajectory has arrived, or after ``duration``.

    Args:
        skill: What to integrate.
        starts: Shape (n, d).
        duration: Longest time to integrate, [s].
        period: Step Δt, [s].
        arrival_distance: Distance to the nearest attractor at which a trajectory has arrived.
        parts: Which part of a latched combined skill acts on each trajectory, shape (n,), to go on with an
            earlier rollout. Default: the part that each start selects.

    Raises:
        UsageError: Starts of another dimension, or a period or duration that is not positive and finite.
    """
    x = np.array(starts, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] != skill.dimension:
        raise UsageError(f"starts: expected (n, {skill.dimension}), got {x.shape}.")
    if not (0 < period < np.inf and 0 < duration < np.inf):
        raise UsageError("period and duration: must be positive and finite.")
    steps = int(np.ceil(duration / period))
    goals = attractors_of(skill)
    if parts is None:
        parts = skill.part_at(x) if isinstance(skill, CombinedSkill) else np.zeros(len(x), dtype=np.int64)
    history = [x]
    arrival = np.full(len(x), np.nan)
    for step in range(steps + 1):
        near = np.linalg.norm(x[:, None] - goals, axis=2).min(axis=1) < arrival_distance
        arrival[near & np.isnan(arrival)] = step * period
        if step == steps or np.isfinite(arrival).all():
            break
        if isinstance(skill, CombinedSkill):
            if skill.gate == "instantaneous":
                parts = skill.part_at(x)
            x = x + period * skill.velocity(x, parts)
        else:
            x = x + period * skill.velocity(x)
        history.append(x)
    times = period * np.arange(len(history), dtype=np.float64)
    return Rollouts(times, np.stack(history, axis=1), arrival, parts)
