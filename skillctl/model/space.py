"""What a state is: the meaning of its numbers, and how states are compared and moved."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import isfinite
from typing import Literal

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray
from skillctl.errors import StateError

AXIS_NAMES = ("x", "y", "z")


def default_names(dimension: int, unit: str = "m") -> tuple[str, ...]:
    """Return x, y, z for positions, and q1 … qd for joints (``rad``) or more than three dimensions."""
    if unit != "rad" and dimension <= len(AXIS_NAMES):
        return AXIS_NAMES[:dimension]
    return tuple(f"q{i + 1}" for i in range(dimension))


class Space(ABC):
    """A space of states. A new kind of space is one subclass.

    Attributes:
        names: One name per coordinate of a state, as in the header of a table.
        unit: Unit of a position, ``m`` (Cartesian) or ``rad`` (joints); velocities are per second.
        frame: Frame in which positions are given, ``base`` unless the data says otherwise.
        kind: Which space it is, as an artifact states it.
    """

    __slots__ = ()
    names: tuple[str, ...]
    unit: Literal["m", "rad"]
    frame: str
    kind: str

    @property
    def dimension(self) -> int:
        """Number of coordinates of a state."""
        return len(self.names)

    @abstractmethod
    def difference(self, to: FloatArray, start: FloatArray) -> FloatArray:
        """Return what leads from ``start`` to ``to``, both (..., d); a velocity times a duration is one."""

    @abstractmethod
    def displace(self, states: FloatArray, differences: FloatArray) -> FloatArray:
        """Return states (..., d) moved by differences (..., d): ``displace(a, difference(b, a))`` is b."""

    def distance(self, to: FloatArray, start: FloatArray) -> FloatArray:
        """Return how far apart states (..., d) are, in the unit. Shape (...)."""
        return np.asarray(np.linalg.norm(self.difference(to, start), axis=-1))

    def states(self, values: npt.ArrayLike) -> FloatArray:
        """Return one state (d,) or many (n, d) as an array, which need not be finite.

        Raises:
            StateError: Not numbers, or of another shape.
        """
        try:
            x = np.asarray(values, dtype=np.float64)
        except (TypeError, ValueError):
            raise StateError("state: not an array of numbers.") from None
        if x.ndim not in (1, 2) or x.shape[-1] != len(self.names):
            d = len(self.names)
            raise StateError(
                f"state: expected shape ({d},) or (n, {d}), got {x.shape}.",
                hint=f"The coordinates are {', '.join(self.names)}.",
            )
        return x

    def measured(self, state: npt.ArrayLike) -> FloatArray:
        """Return one measured state (d,), checked as a robot needs it: in shape, and finite.

        Raises:
            StateError: It is neither.
        """
        x = self.states(state)
        if x.ndim != 1 or not all(map(isfinite, x.tolist())):
            problem = f"must be finite, got {x.tolist()}" if x.ndim == 1 else f"one at a time, got {x.shape}"
            raise StateError(f"state: {problem}.", hint="Check the measurement before it is passed on.")
        return x


@dataclass(frozen=True, slots=True)
class Euclidean(Space):
    """R^d: differences are vectors, distances are Euclidean. See ``Space`` for the attributes."""

    names: tuple[str, ...]
    unit: Literal["m", "rad"] = "m"
    frame: str = "base"
    kind: Literal["euclidean"] = "euclidean"

    def difference(self, to: FloatArray, start: FloatArray) -> FloatArray:
        """Return ``to`` − ``start``."""
        return to - start

    def displace(self, states: FloatArray, differences: FloatArray) -> FloatArray:
        """Return ``states`` + ``differences``."""
        return states + differences

    @classmethod
    def cartesian(cls, dimension: int) -> Euclidean:
        """Return the space of positions in metres, with the default names."""
        return cls(default_names(dimension))
