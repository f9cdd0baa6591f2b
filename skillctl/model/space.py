"""What a state is: the meaning of its numbers, and how states are compared and moved."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from skillctl.arrays import LARGEST, FloatArray, length
from skillctl.errors import StateError

AXIS_NAMES = ("x", "y", "z")

Place: TypeAlias = Callable[[FloatArray], FloatArray]  # leads velocities of offsets to those of states


def default_names(dimension: int, unit: str = "m") -> tuple[str, ...]:
    """Return x, y, z for positions, and q1 … qd for joints (``rad``) or more than three dimensions."""
    if unit != "rad" and dimension <= len(AXIS_NAMES):
        return AXIS_NAMES[:dimension]
    return tuple(f"q{i + 1}" for i in range(dimension))


class Space(ABC):
    """A space of states. A new kind of space is one subclass.

    A skill moves *offsets* from its target: numbers in R^d, in the unit of the space, zero at the target.
    Where they are added to the target's ``anchor`` they are *charted* states: what mixtures are said of.

    Attributes:
        names: One name per coordinate of a state, as in the header of a table.
        unit: Unit of a position, ``m`` (Cartesian) or ``rad`` (joints); velocities are per second.
        frame: Frame in which positions are given, ``base`` unless the data says otherwise.
        kind: Which space it is, as an artifact states it.
        flat: Whether charted states are the states themselves.
        blocks: Sizes of the groups of offsets of which each contracts by itself.
    """

    __slots__ = ()
    names: tuple[str, ...]
    unit: Literal["m", "rad"]
    frame: str
    kind: str
    flat: ClassVar[bool]

    @property
    def dimension(self) -> int:
        """Number of coordinates of a state."""
        return len(self.names)

    @property
    def blocks(self) -> tuple[int, ...]:
        """Sizes of the groups of offsets of which each contracts by itself: one group, unless said."""
        return (self.dimension,)

    @property
    def positions(self) -> int:
        """How many of the coordinates, the first ones, are a position: all, unless said."""
        return self.dimension

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each coordinate of a state."""
        return (self.unit,) * self.dimension

    @property
    def sizes(self) -> tuple[int, ...]:
        """In how many numbers a target can be given."""
        return (self.dimension,)

    @abstractmethod
    def difference(self, to: FloatArray, start: FloatArray) -> FloatArray:
        """Return what leads from ``start`` to ``to``, both (..., d); a velocity times a duration is one."""

    @abstractmethod
    def displace(self, states: FloatArray, differences: FloatArray) -> FloatArray:
        """Return states (..., d) moved by differences (..., d): ``displace(a, difference(b, a))`` is b."""

    @abstractmethod
    def anchor(self, target: FloatArray) -> FloatArray:
        """Return what is added to offsets from a target (d,), so that they are charted states. Shape (d,)."""

    @abstractmethod
    def offsets(self, states: FloatArray, target: FloatArray) -> FloatArray:
        """Return the offsets of states (..., d) from a target (..., d), in the unit."""

    @abstractmethod
    def placed(self, offsets: FloatArray, target: FloatArray) -> FloatArray:
        """Return the states (..., d) at offsets (..., d) from a target (..., d)."""

    @abstractmethod
    def tangent(self, states: FloatArray, target: FloatArray) -> tuple[FloatArray, Place]:
        """Return the offsets of states (n, d), and what leads their velocities to those of the states."""

    @abstractmethod
    def speeds(self, velocity: FloatArray) -> tuple[float, float]:
        """Return how fast one velocity (d,) moves, and how fast it turns [rad/s], zero if nothing turns."""

    def offset_at(self, state: FloatArray, target: FloatArray, near: FloatArray | None = None) -> FloatArray:
        """Return the offset of one state (d,), on the side of an earlier offset ``near`` if there are two."""
        return self.offsets(state, target)

    def placed_at(self, offset: FloatArray, target: FloatArray) -> FloatArray:
        """Return the state (d,) at one offset (d,)."""
        return self.placed(offset, target)

    def tangent_at(self, state: FloatArray, target: FloatArray) -> tuple[FloatArray, Place]:
        """Return as ``tangent`` for one state (d,)."""
        offsets, place = self.tangent(state[None], target)
        return offsets[0], lambda velocity: place(velocity[None])[0]

    def carried(
        self, states: FloatArray, target: FloatArray, goal: FloatArray, *, turn: bool = False
    ) -> FloatArray:
        """Return states (..., d) moved with a target (d,) to a goal (d,): offsets stay.

        With ``turn`` they move as one body with the target: where it turns, offsets of positions turn, too.
        """
        return self.placed(self.offsets(states, target), goal)

    def mean(self, states: FloatArray, weights: FloatArray | None = None) -> FloatArray:
        """Return the mean (d,) of states (n, d), with weights (n,) that sum to one, or equal ones."""
        return np.asarray(states.mean(axis=0) if weights is None else weights @ states)

    def middle(self, states: FloatArray) -> FloatArray:
        """Return the median (d,) of states (n, d), of each coordinate: one far off hardly moves it."""
        return np.asarray(np.median(states, axis=0))

    def distance(self, to: FloatArray, start: FloatArray) -> FloatArray:
        """Return how far apart states (..., d) are, in the unit. Shape (...)."""
        return np.asarray(np.linalg.norm(self.difference(to, start), axis=-1))

    def difference_at(self, to: FloatArray, start: FloatArray) -> FloatArray:
        """Return as ``difference`` for two states (d,)."""
        return self.difference(to, start)

    def displace_at(self, state: FloatArray, difference: FloatArray) -> FloatArray:
        """Return as ``displace`` for one state (d,)."""
        return self.displace(state, difference)

    def distance_at(self, to: FloatArray, start: FloatArray) -> float:
        """Return how far apart two states (d,) are, in the unit."""
        return length(self.difference(to, start))

    def apart(self, to: FloatArray, start: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Return how far apart states (..., d) are: in position, and in orientation [rad] if they have it."""
        return self.distance(to, start), None

    def magnitudes(self, velocities: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Return how fast velocities (..., d) move, and how fast they turn [rad/s] if states can."""
        return np.asarray(np.linalg.norm(velocities, axis=-1)), None

    def turns(self, states: FloatArray) -> FloatArray | None:
        """Return the rotation vectors (..., 3) of states (..., d), if they have an orientation."""
        return None

    def given(self, state: FloatArray) -> tuple[float, ...]:
        """Return one state (d,) in the numbers in which a target is given."""
        return tuple(state.tolist())

    def rates(self, times: FloatArray, states: FloatArray) -> FloatArray:
        """Return velocities (T, d) of a motion (T, d) at increasing times (T,): differences of neighbours."""
        return np.asarray(np.gradient(states, times, axis=0))

    def continued(self, states: FloatArray) -> FloatArray:
        """Return a motion (T, d) in numbers that do not jump where the states do not."""
        return states

    def states(self, values: npt.ArrayLike) -> FloatArray:
        """Return one state (d,) or many (n, d) as an array, which need not be finite.

        Raises:
            StateError: Not numbers, or of another shape.
        """
        x = numbers(values)
        if x.ndim not in (1, 2) or x.shape[-1] != len(self.names):
            d = len(self.names)
            raise StateError(
                f"state: expected shape ({d},) or (n, {d}), got {x.shape}.",
                hint=f"The coordinates are {', '.join(self.names)}.",
            )
        return x

    def measured(self, state: npt.ArrayLike) -> FloatArray:
        """Return one measured state (d,), checked as a robot needs it: in shape, and finite.

        Numbers beyond 1e100, of which squares and sums overflow, count as infinite.

        Raises:
            StateError: It is neither.
        """
        x = self.states(state)
        if x.ndim != 1 or not all(abs(value) <= LARGEST for value in x.tolist()):
            problem = f"must be finite, got {x.tolist()}" if x.ndim == 1 else f"one at a time, got {x.shape}"
            raise StateError(f"state: {problem}.", hint="Check the measurement before it is passed on.")
        return x


def numbers(values: npt.ArrayLike) -> FloatArray:
    """Return values as an array, or raise StateError."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise StateError("state: not an array of numbers.") from None


@dataclass(frozen=True, slots=True)
class Euclidean(Space):
    """R^d: differences are vectors, distances are Euclidean. See ``Space`` for the attributes."""

    names: tuple[str, ...]
    unit: Literal["m", "rad"] = "m"
    frame: str = "base"
    kind: Literal["euclidean"] = "euclidean"
    flat: ClassVar[bool] = True

    def difference(self, to: FloatArray, start: FloatArray) -> FloatArray:
        """Return ``to`` − ``start``."""
        return to - start

    def displace(self, states: FloatArray, differences: FloatArray) -> FloatArray:
        """Return ``states`` + ``differences``."""
        return states + differences

    def anchor(self, target: FloatArray) -> FloatArray:
        """Return the target (d,)."""
        return target

    def offsets(self, states: FloatArray, target: FloatArray) -> FloatArray:
        """Return ``states`` − ``target``."""
        return states - target

    def placed(self, offsets: FloatArray, target: FloatArray) -> FloatArray:
        """Return ``offsets`` + ``target``."""
        return offsets + target

    def tangent(self, states: FloatArray, target: FloatArray) -> tuple[FloatArray, Place]:
        """Return ``states`` − ``target``, and the identity."""
        return states - target, _unchanged

    def tangent_at(self, state: FloatArray, target: FloatArray) -> tuple[FloatArray, Place]:
        """Return ``state`` − ``target``, and the identity."""
        return state - target, _unchanged

    def carried(
        self, states: FloatArray, target: FloatArray, goal: FloatArray, *, turn: bool = False
    ) -> FloatArray:
        """Return ``states`` + (``goal`` − ``target``)."""
        return states + (goal - target)

    def speeds(self, velocity: FloatArray) -> tuple[float, float]:
        """Return the length of one velocity (d,), and zero."""
        return length(velocity), 0.0

    @classmethod
    def cartesian(cls, dimension: int) -> Euclidean:
        """Return the space of positions in metres, with the default names."""
        return cls(default_names(dimension))


def _unchanged(velocities: FloatArray) -> FloatArray:
    return velocities
