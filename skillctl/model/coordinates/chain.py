"""A chain of links: the coordinates of a skill. The empty chain is the identity.

Links act on offsets x = s − ξ* of the state from the target, and leave the target where it is. So a motion
that is moved to another target keeps its coordinates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import TypeAlias

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError

Pull: TypeAlias = Callable[[FloatArray], FloatArray]  # leads velocities ẏ back to ẋ = Dc⁻¹ ẏ


class Link(ABC):
    """One exactly invertible map of R^d onto (part of) itself. A new kind of link is one subclass.

    Whatever its parameters, ``back(forward(x))`` is x up to rounding, and ``forward(0)`` is 0; that is what
    carries the proof of the mixture over to the state.
    """

    __slots__ = ()

    @abstractmethod
    def forward(self, offsets: FloatArray) -> FloatArray:
        """Return y = c(x) for offsets (n, d). Shape (n, d)."""

    @abstractmethod
    def back(self, coordinates: FloatArray) -> FloatArray:
        """Return x = c⁻¹(y) for coordinates (n, d). Shape (n, d)."""

    @abstractmethod
    def tangent(self, offsets: FloatArray) -> tuple[FloatArray, Pull]:
        """Return y = c(x) for offsets (n, d), and what leads velocities ẏ (n, d) there back to ẋ (n, d)."""

    @abstractmethod
    def in_unit(self, unit: float) -> Link:
        """Return x ↦ u c(x / u): the same map of lengths of which ``unit`` u make one of the old."""

    @abstractmethod
    def check(self) -> tuple[str, ...]:
        """Return why the map is not exactly invertible, in sentences; none if it is."""

    def turned(self, rotation: FloatArray) -> tuple[Link, FloatArray]:
        """Return a map c′ of the same kind, and a rotation U (d, d), with c′(Q x) = U c(x) for a rotation Q.

        Raises:
            UsageError: Maps of this kind are tied to their directions.
        """
        raise UsageError(f"turn: coordinates of the kind {type(self).__name__} cannot be turned.")

    def forward_at(self, offset: FloatArray) -> FloatArray:
        """Return y = c(x) for one offset (d,)."""
        return np.asarray(self.forward(offset[None])[0])

    def back_at(self, coordinate: FloatArray) -> FloatArray:
        """Return x = c⁻¹(y) for one y (d,)."""
        return np.asarray(self.back(coordinate[None])[0])

    def tangent_at(self, offset: FloatArray) -> tuple[FloatArray, Pull]:
        """Return y = c(x) for one offset (d,), and what leads a velocity ẏ (d,) there back to ẋ (d,)."""
        y, pull = self.tangent(offset[None])
        return y[0], lambda velocity: pull(velocity[None])[0]

    def longest(self, offsets: FloatArray) -> FloatArray:
        """Return how far a state may move from offsets (n, d) in a straight line. Shape (n,); infinite here.

        Between two states the robot moves straight, which is not what the map says of states in between.
        """
        return np.full(len(offsets), np.inf)

    def longest_at(self, offset: FloatArray) -> float:
        """Return how far a state may move from one offset (d,) in a straight line, as ``longest`` does."""
        return inf

    def bounds_forward(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return boxes that hold c(s) for all s in the boxes from ``low`` to ``high``, (n, d) each.

        They hold the exact images: rounding is added. A link that knows no better returns the whole space.
        """
        return np.full_like(low, -np.inf), np.full_like(high, np.inf)

    def bounds_back(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return boxes that hold c⁻¹(y) for all y in the boxes from ``low`` to ``high``, as above."""
        return np.full_like(low, -np.inf), np.full_like(high, np.inf)


@dataclass(frozen=True, slots=True)
class Chain(Link):
    """c = c_m ∘ … ∘ c_1.

    Attributes:
        links: c_1 first, nearest to the state.
    """

    links: tuple[Link, ...] = ()

    def forward(self, offsets: FloatArray) -> FloatArray:
        """Return y = c(x) for offsets (n, d). Shape (n, d)."""
        for link in self.links:
            offsets = link.forward(offsets)
        return offsets

    def back(self, coordinates: FloatArray) -> FloatArray:
        """Return x = c⁻¹(y) for coordinates (n, d). Shape (n, d)."""
        for link in reversed(self.links):
            coordinates = link.back(coordinates)
        return coordinates

    def tangent(self, offsets: FloatArray) -> tuple[FloatArray, Pull]:
        """Return y for offsets (n, d), and what leads velocities back; see ``Link``."""
        pulls = []
        for link in self.links:
            offsets, pull = link.tangent(offsets)
            pulls.append(pull)
        return offsets, _one_after_the_other(pulls)

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

    def longest(self, offsets: FloatArray) -> FloatArray:
        """Return how far a state may move in a straight line; see ``Link``. Only the first link knows it."""
        return self.links[0].longest(offsets) if self.links else np.full(len(offsets), np.inf)

    def longest_at(self, offset: FloatArray) -> float:
        """Return how far a state may move from one offset (d,); see ``longest``."""
        return self.links[0].longest_at(offset) if self.links else inf

    def in_unit(self, unit: float) -> Chain:
        """Return the same coordinates in other lengths; see ``Link``."""
        return Chain(tuple(link.in_unit(unit) for link in self.links))

    def turned(self, rotation: FloatArray) -> tuple[Chain, FloatArray]:
        """Return the chain in a turned frame, and how what it leads to is turned; see ``Link``."""
        links = []
        for link in self.links:
            link, rotation = link.turned(rotation)
            links.append(link)
        return Chain(tuple(links)), rotation

    def check(self) -> tuple[str, ...]:
        """Return why the chain is not exactly invertible, in sentences; none if it is."""
        return tuple(sentence for link in self.links for sentence in link.check())

    def forward_at(self, offset: FloatArray) -> FloatArray:
        """Return y for one offset (d,)."""
        for link in self.links:
            offset = link.forward_at(offset)
        return offset

    def back_at(self, coordinate: FloatArray) -> FloatArray:
        """Return x for one y (d,)."""
        for link in reversed(self.links):
            coordinate = link.back_at(coordinate)
        return coordinate

    def tangent_at(self, offset: FloatArray) -> tuple[FloatArray, Pull]:
        """Return y for one offset (d,), and what leads a velocity back; see ``Link``."""
        pulls = []
        for link in self.links:
            offset, pull = link.tangent_at(offset)
            pulls.append(pull)
        return offset, _one_after_the_other(pulls)


@dataclass(frozen=True, slots=True)
class OnPosition(Link):
    """A link that acts on the first coordinates of an offset, the position, and leaves the others alone.

    Attributes:
        link: The map of the position.
        size: Number of coordinates of a position.
    """

    link: Link
    size: int = 3

    def forward(self, offsets: FloatArray) -> FloatArray:
        """Return y = c(x) for offsets (n, d). Shape (n, d)."""
        return self._with(self.link.forward(offsets[:, : self.size]), offsets)

    def back(self, coordinates: FloatArray) -> FloatArray:
        """Return x = c⁻¹(y) for coordinates (n, d). Shape (n, d)."""
        return self._with(self.link.back(coordinates[:, : self.size]), coordinates)

    def tangent(self, offsets: FloatArray) -> tuple[FloatArray, Pull]:
        """Return y for offsets (n, d), and what leads velocities back; see ``Link``."""
        y, pull = self.link.tangent(offsets[:, : self.size])
        return self._with(y, offsets), lambda velocities: self._with(
            pull(velocities[:, : self.size]), velocities
        )

    def longest(self, offsets: FloatArray) -> FloatArray:
        """Return how far a position may move in a straight line; see ``Link``."""
        return self.link.longest(offsets[:, : self.size])

    def longest_at(self, offset: FloatArray) -> float:
        """Return how far a position may move from one offset (d,); see ``Link``."""
        return self.link.longest_at(offset[: self.size])

    def in_unit(self, unit: float) -> OnPosition:
        """Return the same map in other lengths; see ``Link``."""
        return OnPosition(self.link.in_unit(unit), self.size)

    def turned(self, rotation: FloatArray) -> tuple[OnPosition, FloatArray]:
        """Return the map in a frame whose positions alone are turned; see ``Link``."""
        link, inner = self.link.turned(rotation[: self.size, : self.size])
        whole = rotation.copy()
        whole[: self.size, : self.size] = inner
        return OnPosition(link, self.size), whole

    def check(self) -> tuple[str, ...]:
        """Return why the map is not exactly invertible, in sentences; none if it is."""
        return self.link.check()

    def forward_at(self, offset: FloatArray) -> FloatArray:
        """Return y for one offset (d,)."""
        return np.concatenate([self.link.forward_at(offset[: self.size]), offset[self.size :]])

    def back_at(self, coordinate: FloatArray) -> FloatArray:
        """Return x for one y (d,)."""
        return np.concatenate([self.link.back_at(coordinate[: self.size]), coordinate[self.size :]])

    def tangent_at(self, offset: FloatArray) -> tuple[FloatArray, Pull]:
        """Return y for one offset (d,), and what leads a velocity back; see ``Link``."""
        y, pull = self.link.tangent_at(offset[: self.size])
        return np.concatenate([y, offset[self.size :]]), lambda velocity: np.concatenate(
            [pull(velocity[: self.size]), velocity[self.size :]]
        )

    def bounds_forward(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return boxes that hold c(s) for all s in boxes, (n, d) each; see ``Link.bounds_forward``."""
        lower, upper = self.link.bounds_forward(low[:, : self.size], high[:, : self.size])
        return self._with(lower, low), self._with(upper, high)

    def bounds_back(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return boxes that hold c⁻¹(y) for all y in boxes, (n, d) each; see ``Link.bounds_forward``."""
        lower, upper = self.link.bounds_back(low[:, : self.size], high[:, : self.size])
        return self._with(lower, low), self._with(upper, high)

    def _with(self, positions: FloatArray, rest: FloatArray) -> FloatArray:
        return np.concatenate([positions, rest[:, self.size :]], axis=1)


def _one_after_the_other(pulls: list[Pull]) -> Pull:
    if len(pulls) == 1:  # as it nearly always is
        return pulls[0]

    def pull_all(velocities: FloatArray) -> FloatArray:
        for pull in reversed(pulls):
            velocities = pull(velocities)
        return velocities

    return pull_all


IDENTITY = Chain()
