"""Rollouts: where the motion goes from many starts at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from skillctl.arrays import BoolArray, FloatArray, IntArray
from skillctl.errors import UsageError
from skillctl.model.skill import Skill, extent
from skillctl.model.stepper import Stepper

ARRIVAL_DISTANCE = 1e-3  # in the unit of the space: 1 mm, or 1 mrad; of a small motion
ARRIVAL_SHARE = 0.02  # of its extent, if that is less
MOST_STATES = 20_000  # kept of each trajectory; of a longer one every second, third, …


@dataclass(frozen=True, eq=False, slots=True)
class Rollouts:
    """Trajectories from n starts.

    Attributes:
        times: Shape (T,), [s].
        positions: Shape (n, T, d). A trajectory rests at its last state once all have arrived.
        arrival_times: First time within the arrival distance of an attractor, NaN if never. Shape (n,), [s].
        acting: Part that acts at each of these states, 0 for skills without regions or stages. Shape (n, T).
    """

    times: FloatArray
    positions: FloatArray
    arrival_times: FloatArray
    acting: IntArray

    @property
    def parts(self) -> IntArray:
        """Part that acted at the end. Shape (n,)."""
        return self.acting[:, -1]

    @property
    def arrived(self) -> BoolArray:
        """Whether each trajectory came within the arrival distance. Shape (n,)."""
        return np.isfinite(self.arrival_times)

    def trajectory(self, index: int) -> tuple[FloatArray, FloatArray]:
        """Return times and positions of one trajectory, cut at its arrival."""
        arrival = self.arrival_times[index]
        end = len(self.times) if np.isnan(arrival) else int(np.searchsorted(self.times, arrival)) + 1
        return self.times[:end], self.positions[index, :end]


def arrival_distance_of(skill: Skill) -> float:
    """Return how near to an attractor a motion has arrived, in the unit of the space."""
    return min(ARRIVAL_DISTANCE, ARRIVAL_SHARE * extent(skill.density))


def rollout(
    skill: Skill,
    starts: npt.ArrayLike,
    *,
    duration: float,
    period: float,
    arrival_distance: float | None = None,
    parts: IntArray | None = None,
) -> Rollouts:
    """Integrate ξ̇ = f(ξ) from every start, as a controller with the given period would.

    A latched combined skill keeps, per trajectory, the part chosen at the start. The stages of a chain follow
    each other at once: its events, and waits, are the ``Controller``'s. Integration ends when every
    trajectory has arrived, or after ``duration``. However many steps that takes, at most ``MOST_STATES``
    states of each trajectory are kept.

    Args:
        skill: What to integrate.
        starts: Shape (n, d).
        duration: Longest time to integrate, [s].
        period: Step Δt, [s].
        arrival_distance: Distance to the nearest attractor at which a trajectory has arrived; by default
            ``ARRIVAL_DISTANCE``, or ``ARRIVAL_SHARE`` of the extent of a small skill.
        parts: Which part of a latched combined skill, or of a chain, acts on each trajectory, shape (n,), to
            go on with an earlier rollout. Default: the part that each start selects.

    Raises:
        UsageError: Starts of another dimension, or a period or duration that is not positive and finite.
    """
    x = np.array(starts, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] != skill.dimension:
        raise UsageError(f"starts: expected (n, {skill.dimension}), got {x.shape}.")
    if not (0 < period < np.inf and 0 < duration < np.inf):
        raise UsageError("period and duration: must be positive and finite.")
    steps = int(np.ceil(duration / period))
    every = -(-steps // MOST_STATES)
    near_enough = arrival_distance_of(skill) if arrival_distance is None else arrival_distance
    stepper = Stepper(skill, period)
    if parts is None:
        parts = skill.part_at(x)
    kept, times = [x], [0.0]
    acting: list[IntArray] = []
    arrival = np.full(len(x), np.nan)
    for step in range(steps + 1):
        parts = skill.onward(x, parts)
        if len(acting) < len(kept):
            acting.append(parts)
        near = skill.arrived(x, parts, near_enough)
        arrival[near & np.isnan(arrival)] = step * period
        if step == steps or np.isfinite(arrival).all():
            break
        stepped = stepper.step_many(x, parts)
        x, parts = stepped.states, np.asarray(stepped.parts)
        if (step + 1) % every == 0 or step + 1 == steps:
            kept.append(x)
            times.append((step + 1) * period)
    if times[-1] < (last := step * period):  # all arrived between two states that would be kept
        kept.append(x)
        times.append(last)
        acting.append(parts)
    return Rollouts(np.array(times), np.stack(kept, axis=1), arrival, np.stack(acting, axis=1))
