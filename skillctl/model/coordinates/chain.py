"""A chain of links: the coordinates of a skill. The empty chain is the identity."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray


class Link(ABC):
    """One exactly invertible map of R^d onto (part of) itself. A new kind of link is one subclass.

    Whatever its parameters, ``back(forward(s))`` is s up to rounding; that is what carries the proof of the
    mixture over to the state.
    """

    __slots__ = ()

    @abstractmethod
    def forward(self, states: FloatArray) -> FloatArray:
        """Return y = c(s) for states (n, d). Shape (n, d)."""

    @abstractmethod
    def back(self, coordinates: FloatArray) -> FloatArray:
        """Return s = c⁻¹(y) for coordinates (n, d). Shape (n, d)."""

    @abstractmethod
    def pull_back(self, coordinates: FloatArray, velocities: FloatArray) -> FloatArray:
        """Return ṡ = Dc⁻¹(y) ẏ for coordinates and velocities in them, (n, d) each. Shape (n, d)."""

    @abstractmethod
    def check(self) -> tuple[str, ...]:
        """Return why the map is not exactly invertible, in sentences; none if it is."""

    @abstractmethod
    def translated(self, offset: FloatArray) -> Link:
        """Return the link of the motion moved by ``offset`` (d,): c(s − offset) + offset."""

    def bounds_forward(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return boxes that hold c(s) for all s in the boxes from ``low`` to ``high``, (n, d) each.

        They hold the exact images: rounding is added. A link that knows no better returns the whole space.
        """
        return np.full_like(low, -np.inf), np.full_like(high, np.inf)

    def bounds_back(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return boxes that hold c⁻¹(y) for all y in the boxes from ``low`` to ``high``, as above."""
        return np.full_like(low, -np.inf), np.full_like(high, np.inf)


@dataclass(frozen=True, slots=True)
class Chain:
    """c = c_m ∘ … ∘ c_1.

    Attributes:
        links: c_1 first, nearest to the state.
    """

    links: tuple[Link, ...] = ()

    def forward(self, states: FloatArray) -> FloatArray:
        """Return y = c(s) for states (n, d). Shape (n, d)."""
        for link in self.links:
            states = link.forward(states)
        return states

    def back(self, coordinates: FloatArray) -> FloatArray:
        """Return s = c⁻¹(y) for coordinates (n, d). Shape (n, d)."""
        for link in reversed(self.links):
            coordinates = link.back(coordinates)
        return coordinates

    def pull_back(self, coordinates: FloatArray, velocities: FloatArray) -> FloatArray:
        """Return ṡ for velocities ẏ at coordinates y, (n, d) each. Shape (n, d)."""
        for link in reversed(self.links):
            velocities = link.pull_back(coordinates, velocities)
            coordinates = link.back(coordinates)
        return velocities

    def bounds_forward(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return boxes that hold c(s) for all s in boxes, (n, d) each; see ``Link.bounds_forward``."""
        for link in self.links:
            low, high = link.bounds_forward(low, high)
        return low, high

    def bounds_back(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return boxes that hold c⁻¹(y) for all y in boxes, (n, d) each; see ``Link.bounds_forward``."""
        for link in reversed(self.links):
            low, high = link.bounds_back(low, high)
        return low, high

    def check(self) -> tuple[str, ...]:
        """Return why the chain is not exactly invertible, in sentences; none if it is."""
        return tuple(sentence for link in self.links for sentence in link.check())

    def translated(self, offset: FloatArray) -> Chain:
        """Return the coordinates of the motion moved by ``offset`` (d,)."""
        return Chain(tuple(link.translated(offset) for link in self.links)) if self.links else self


IDENTITY = Chain()
