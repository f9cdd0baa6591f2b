"""From recordings to training data: rests trimmed, ends aligned, resampled, one scale for each quantity."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import InputDataError
from skillctl.geometry import extent, segment_lengths
from skillctl.learning.blocks import Sizes
from skillctl.model.coordinates.chain import IDENTITY, Chain, Pull
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.space import Space

REST_SHARE = 0.005  # a recording rests while it stays this close to its end, as a share of its extent
SPIKE_SHARE = 0.02  # a jump and back by more than this share of the extent is an error of the sensor
EMBEDDED_POINTS = 200  # points kept of each demonstration inside an artifact


@dataclass(frozen=True, eq=False, slots=True)
class TrainingData:
    """Demonstrations in the learner's own units: target at the origin, rms distance and rms speed one.

    Attributes:
        positions: Shape (D, T, d): D demonstrations, T samples each, uniform in time; the last is zero.
        velocities: Shape (D, T, d).
        steps: Time between two samples of each demonstration, shape (D,), in units of ``time_scale``.
        length_scale: One unit of position, in the unit of the space.
        speed_scale: One unit of velocity, per second.
        attractor: The common end of the demonstrations, a state of the space, shape (d,).
        coordinates: c, on positions in these units. The mixture is learned of y = c(ξ); errors count in ξ.
        blocks: Sizes of the groups of coordinates of which each contracts by itself; default: one.
    """

    positions: FloatArray
    velocities: FloatArray
    steps: FloatArray
    length_scale: float
    speed_scale: float
    attractor: FloatArray
    coordinates: Chain = IDENTITY
    blocks: Sizes = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "blocks", self.blocks or (self.dimension,))

    @property
    def dimension(self) -> int:
        """Number of coordinates of a state."""
        return int(self.positions.shape[2])

    @property
    def states(self) -> FloatArray:
        """All positions stacked, shape (D·T, d)."""
        return self.positions.reshape(-1, self.dimension)

    @property
    def moved(self) -> TrainingData:
        """The same of y = c(ξ), as if it were the state: what the mixture moves."""
        if not self.coordinates.links:
            return self
        y, pull = self.coordinates.tangent(self.states)
        shape = self.positions.shape
        velocities = np.linalg.solve(_inverse(pull, *y.shape), self.velocities.reshape(*y.shape, 1))
        velocities = np.asarray(velocities, dtype=np.float64).reshape(shape)
        return replace(self, positions=y.reshape(shape), velocities=velocities, coordinates=IDENTITY)

    @property
    def points(self) -> tuple[FloatArray, FloatArray]:
        """All y and ẏ stacked, each of shape (D·T, d)."""
        moved = self.moved
        return moved.states, moved.velocities.reshape(-1, self.dimension)

    def factors(self, coordinates: FloatArray) -> FloatArray | None:
        """Return W = Dc⁻¹ at y (..., d), shape (..., d, d), or None for the identity.

        A small error e of y, or of ẏ, is one of W e in the state: that is what counts.
        """
        if not self.coordinates.links:
            return None
        y = coordinates.reshape(-1, self.dimension)
        _, pull = self.coordinates.tangent(self.coordinates.back(y))
        return _inverse(pull, *y.shape).reshape(*coordinates.shape, -1)

    @property
    def time_scale(self) -> float:
        """One unit of time, [s]."""
        return self.length_scale / self.speed_scale


def _inverse(pull: Pull, count: int, dimension: int) -> FloatArray:
    """Return Dc⁻¹ at ``count`` points from what leads velocities back there. Shape (count, d, d)."""
    return np.stack([pull(np.tile(unit, (count, 1))) for unit in np.eye(dimension)], axis=2)


def without_spikes(demonstration: Demonstration) -> Demonstration:
    """Return the demonstration with spikes replaced by points on the line between their neighbours.

    A spike lies farther from the median of the five samples around it than ``SPIKE_SHARE`` of the motion's
    extent, and than twenty times the usual such distance; a fast but continuous motion does neither.
    """
    x, t = demonstration.positions, demonstration.times
    if len(x) < 5:
        return demonstration
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(x, ((2, 2), (0, 0)), mode="edge"), 5, axis=0)
    off = np.linalg.norm(x - np.median(windows, axis=-1), axis=1)
    limit = max(SPIKE_SHARE * extent(x), 20 * float(np.median(off)))
    good = off <= limit
    good[[0, -1]] = True  # a spike jumps off the path and back, which an end cannot
    if good.all():
        return demonstration
    repaired = np.stack([np.interp(t, t[good], column[good]) for column in x.T], axis=1)
    return Demonstration.from_positions(t, repaired, demonstration.source)


def trim_rests(demonstration: Demonstration) -> Demonstration:
    """Return the demonstration without the samples in which it rests at its start or its end."""
    x = demonstration.positions
    limit = REST_SHARE * extent(x)
    away_from_start = np.flatnonzero(np.linalg.norm(x - x[0], axis=1) > limit)
    away_from_end = np.flatnonzero(np.linalg.norm(x - x[-1], axis=1) > limit)
    if away_from_end.size == 0 or away_from_start.size == 0:
        return demonstration
    first = max(int(away_from_start[0]) - 1, 0)
    last = min(int(away_from_end[-1]) + 1, len(x) - 1)
    if last - first < 1:
        return demonstration
    # The end of a motion is where it came to rest, not where it crossed the limit.
    positions = np.vstack([x[first:last], x[-1:]])
    times = np.append(demonstration.times[first:last], _arrival(demonstration, last, limit))
    return Demonstration.from_positions(times - times[0], positions, demonstration.source)


def _arrival(demonstration: Demonstration, last: int, limit: float) -> float:
    """Return when a motion arrives that keeps the speed at which it reached the limit, [s].

    If the trimmed recording ended at the first sample within the limit, it would cover the rest of the way in
    one sample interval. The arrival is not later than the end of the recording.

    Args:
        demonstration: Not yet trimmed.
        last: Index of the first sample from which on the motion stays within the limit of its end.
        limit: In the unit of the space.
    """
    x, t = demonstration.positions, demonstration.times
    away = np.linalg.norm(x - x[-1], axis=1)
    before = int(np.flatnonzero(away[:last] > 2 * limit)[-1]) if (away[:last] > 2 * limit).any() else 0
    covered = away[before] - away[last - 1]
    if covered <= 0:
        return float(t[last])
    arrival = t[last - 1] + away[last - 1] * (t[last - 1] - t[before]) / covered
    return float(np.clip(arrival, t[last], t[-1]))


def align(demonstrations: DemonstrationSet) -> tuple[DemonstrationSet, FloatArray]:
    """Repair and trim all demonstrations and move each so that it ends at the typical end.

    That is the median of each coordinate, and for orientations the one from which the others are least far in
    sum: one demonstration that ends elsewhere hardly moves it.

    Returns:
        The aligned demonstrations, as charted states, and their common end (d,), which becomes the attractor.

    Raises:
        InputDataError: A demonstration turns to more than 180° from its end, where no chart holds it.
    """
    space = demonstrations.space
    charted = [_from_end(demonstration, space) for demonstration in demonstrations]
    trimmed = [trim_rests(without_spikes(demonstration)) for demonstration in charted]
    attractor = space.middle(np.stack([demonstration.positions[-1] for demonstration in demonstrations]))
    anchor = space.anchor(attractor)
    aligned = tuple(d.translated(anchor - d.positions[-1]) for d in trimmed)
    return DemonstrationSet(aligned, space), attractor


def _from_end(demonstration: Demonstration, space: Space) -> Demonstration:
    """Return offsets from the demonstration's own end; in a flat space the demonstration itself.

    Raises:
        InputDataError: It turns to more than 180° from its end.
    """
    if space.flat:
        return demonstration
    states = demonstration.positions
    offsets = space.offsets(states, states[-1])
    steps = segment_lengths(offsets)
    jump = int(steps.argmax())
    if steps[jump] > 2 * space.distance(states[jump + 1], states[jump]) + 1e-9:
        raise InputDataError(
            f"{demonstration.source}: at sample {jump + 2} it has turned 180° away from where it ends.",
            hint="Cut the recording into motions that turn less, or learn them with --position-only.",
        )
    return Demonstration.from_positions(demonstration.times, offsets, demonstration.source)


def resample(demonstration: Demonstration, samples: int) -> Demonstration:
    """Return ``samples`` points uniform in time; velocities are differences over one sample spacing.

    The velocity at t is (x(t + δ) − x(t − δ)) / 2δ with δ half a spacing (one-sided at the ends): noise
    faster than the spacing averages out, and velocities always agree with positions.
    """
    t = demonstration.times
    grid = np.linspace(t[0], t[-1], samples)
    half = 0.5 * (grid[1] - grid[0])
    before, after = np.maximum(grid - half, t[0]), np.minimum(grid + half, t[-1])
    at = [
        np.stack([np.interp(moments, t, column) for column in demonstration.positions.T], axis=1)
        for moments in (before, grid, after)
    ]
    velocities = (at[2] - at[0]) / (after - before)[:, None]
    return Demonstration(grid, at[1], velocities, demonstration.source)


def embedded(aligned: DemonstrationSet, attractor: FloatArray) -> DemonstrationSet:
    """Return aligned demonstrations as an artifact keeps them: states, at most ``EMBEDDED_POINTS`` each."""
    space = aligned.space
    kept = tuple(resample(d, EMBEDDED_POINTS) if len(d.times) > EMBEDDED_POINTS else d for d in aligned)
    if not space.flat:
        anchor = space.anchor(attractor)
        states = [space.placed(d.positions - anchor, attractor) for d in kept]
        kept = tuple(
            Demonstration.from_positions(d.times, x, d.source, space)
            for d, x in zip(kept, states, strict=True)
        )
    return DemonstrationSet(kept, space)


def training_data(aligned: DemonstrationSet, attractor: FloatArray, samples: int) -> TrainingData:
    """Return aligned demonstrations in the learner's units (invariant to the unit of the data).

    Raises:
        InputDataError: All demonstrations stay at one point.
    """
    sampled = [resample(demonstration, samples) for demonstration in aligned]
    positions = np.stack([s.positions for s in sampled]) - aligned.space.anchor(attractor)
    positions[:, -1] = 0.0
    velocities = np.stack([s.velocities for s in sampled])
    length_scale = float(np.sqrt(np.mean(np.sum(positions**2, axis=2))))
    speed_scale = float(np.sqrt(np.mean(np.sum(velocities**2, axis=2))))
    if not (length_scale > 0 and speed_scale > 0):
        raise InputDataError("the demonstrations do not move.", hint="Check the position columns.")
    time_scale = length_scale / speed_scale
    steps = np.array([s.duration for s in sampled]) / (samples - 1) / time_scale
    return TrainingData(
        positions / length_scale,
        velocities / speed_scale,
        steps,
        length_scale,
        speed_scale,
        attractor,
        blocks=aligned.space.blocks,
    )
