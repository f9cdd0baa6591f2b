"""Demonstrations: what a person showed, as times, positions and velocities in a named state space."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray, Frozen, frozen_array
from skillctl.errors import InputDataError, InvalidModelError
from skillctl.geometry import extent
from skillctl.model.space import Space


@dataclass(frozen=True, eq=False, slots=True)
class Demonstration(Frozen):
    """One showing of a motion.

    Attributes:
        times: Strictly increasing, shape (T,), [s].
        positions: States, shape (T, d), in the units of the state space.
        velocities: Shape (T, d), per second; of poses twists in the base frame.
        source: Where it came from, for messages and reports.
    """

    times: FloatArray
    positions: FloatArray
    velocities: FloatArray
    source: str = "demonstration"

    def __post_init__(self) -> None:
        try:
            positions = frozen_array("positions", self.positions, (None, None))
            times = frozen_array("times", self.times, (positions.shape[0],))
            velocities = frozen_array("velocities", self.velocities, positions.shape)
        except InvalidModelError as error:
            raise InputDataError(f"{self.source}: {error}") from error
        if times.size < 2:
            raise InputDataError(
                f"{self.source}: one point only; a motion needs at least two.",
                hint="Check that the file holds a whole recording.",
            )
        if (np.diff(times) <= 0).any():
            first = int(np.argmax(np.diff(times) <= 0)) + 1
            raise InputDataError(
                f"{self.source}: time does not increase at sample {first + 1} (t = {times[first]:g} s).",
                hint="Remove samples with repeated or decreasing time stamps.",
            )
        if (positions == positions[0]).all():
            raise InputDataError(
                f"{self.source}: all points are equal; there is no motion to learn.",
                hint="Check the position columns.",
            )
        for name, value in {"times": times, "positions": positions, "velocities": velocities}.items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_positions(
        cls,
        times: npt.ArrayLike,
        positions: npt.ArrayLike,
        source: str = "demonstration",
        space: Space | None = None,
    ) -> Demonstration:
        """Return a demonstration whose velocities are central differences of its positions, as of vectors.

        In a ``space`` that is not flat, differences are taken there, and positions become continuous.
        """
        t = np.asarray(times, dtype=np.float64)
        x = np.asarray(positions, dtype=np.float64)
        usable = x.ndim == 2 and t.ndim == 1 and len(t) == len(x) >= 2 and bool((np.diff(t) > 0).all())
        # Unusable input gets its sentence from the constructor.
        if not usable or not np.isfinite(x).all():
            return cls(t, x, np.zeros_like(x), source)
        if space is None:
            return cls(t, x, np.gradient(x, t, axis=0), source)
        return cls(t, space.continued(x), space.rates(t, x), source)

    @property
    def dimension(self) -> int:
        """Number of coordinates of a state."""
        return int(self.positions.shape[1])

    @property
    def duration(self) -> float:
        """Time from the first to the last sample, [s]."""
        return float(self.times[-1] - self.times[0])

    def translated(self, offset: FloatArray) -> Demonstration:
        """Return the same motion, moved by ``offset`` (d,)."""
        return Demonstration(self.times, self.positions + offset, self.velocities, self.source)

    def ending_at(self, goal: FloatArray, space: Space) -> Demonstration:
        """Return the same motion, moved in its space so that it ends at ``goal`` (d,)."""
        if space.flat:
            return self.translated(goal - self.positions[-1])
        moved = space.carried(self.positions, self.positions[-1], goal)
        return Demonstration.from_positions(self.times, moved, self.source, space)


@dataclass(frozen=True, eq=False, slots=True)
class DemonstrationSet(Frozen):
    """Demonstrations of one motion, all in one state space; at least one."""

    demonstrations: tuple[Demonstration, ...]
    space: Space

    def __post_init__(self) -> None:
        if not self.demonstrations:
            raise InputDataError("no demonstrations.", hint="Name at least one demonstration file.")
        for demonstration in self.demonstrations:
            if demonstration.dimension != self.space.dimension:
                raise InputDataError(
                    f"{demonstration.source}: {demonstration.dimension} dimensions, "
                    f"but {self.demonstrations[0].source} has {self.space.dimension}.",
                    hint="All demonstrations of one skill need the same columns.",
                )

    def __iter__(self) -> Iterator[Demonstration]:
        return iter(self.demonstrations)

    def __len__(self) -> int:
        return len(self.demonstrations)

    @property
    def dimension(self) -> int:
        """Number of coordinates of a state."""
        return self.space.dimension

    @property
    def extent(self) -> float:
        """Length of the diagonal of the box around all positions, in the unit of the space."""
        stacked = np.vstack([demonstration.positions for demonstration in self.demonstrations])
        return extent(stacked[:, : self.space.positions])

    def translated(self, offset: FloatArray) -> DemonstrationSet:
        """Return the same motions, moved by ``offset`` (d,)."""
        return DemonstrationSet(tuple(d.translated(offset) for d in self.demonstrations), self.space)

    def carried(self, target: FloatArray, goal: FloatArray, *, turn: bool = False) -> DemonstrationSet:
        """Return the same motions, moved as a target (d,) to a goal (d,) is; see ``Space.carried``."""
        return DemonstrationSet(
            tuple(
                Demonstration.from_positions(
                    d.times, self.space.carried(d.positions, target, goal, turn=turn), d.source, self.space
                )
                for d in self.demonstrations
            ),
            self.space,
        )
