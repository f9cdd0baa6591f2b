"""The sublevel sets {V ≤ c} of one part: how large V gets over a box, and how far such a set reaches."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from fractions import Fraction
from itertools import product
from typing import TypeAlias

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.exact import Dyadic, is_positive_definite
from skillctl.model.coordinates.enclosure import GUARD
from skillctl.stability.blocks import Block
from skillctl.stability.cells import highest
from skillctl.stability.exact import inverse_diagonal, largest_proved, root_above, rounded_up

# From boxes (n, d) of offsets ξ − ξ* to numbers (n, k) that no offset in them exceeds.
Measure: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]

MOST_COORDINATES = 14  # 2^14 vertices of a box, each an exact number
TRIES = 50  # the first or second radius passes, unless the coordinates bend within the arrival distance


class Sublevels(ABC):
    """Bounds of the V of one block of a part, each true whatever is rounded."""

    @abstractmethod
    def level(self, low: FloatArray, high: FloatArray) -> float:
        """Return c with V ≤ c over the box from ``low`` to ``high``, (d,) each; may be infinite."""

    @abstractmethod
    def extent(self, level: float) -> tuple[FloatArray, FloatArray]:
        """Return the corners (d,) of a box around {V ≤ c}."""

    @abstractmethod
    def radius(self, near: float) -> float | None:
        """Return ρ > 0 with {√V ≤ ρ} within the distance ``near`` of the attractor; None: not found."""

    @abstractmethod
    def farthest(self, level: float) -> float:
        """Return a distance from the attractor within which {V ≤ c} lies; may be infinite."""


def sublevels_of(block: Block) -> Sublevels:
    """Return the bounds of a block of a part that is proved."""
    return BentSublevels(block) if block.coordinates.links else PlainSublevels(block)


class PlainSublevels(Sublevels):
    """Bounds in plain coordinates, decided in exact arithmetic."""

    def __init__(self, block: Block) -> None:
        self._anchor = block.anchor
        self._lyapunov = Dyadic.of(block.lyapunov)
        self._smallest = float(np.linalg.eigvalsh(block.lyapunov)[0])

    def level(self, low: FloatArray, high: FloatArray) -> float:
        """Return the largest V over a box, reached at a vertex, since V is convex; rounded up."""
        vertices = np.array(list(product(*zip(low, high, strict=True))))
        offsets = Dyadic.of(vertices) + -Dyadic.of(self._anchor)
        values = (offsets @ self._lyapunov) * offsets
        return rounded_up(Fraction(values.integers.sum(axis=1).max(), values.denominator))

    def extent(self, level: float) -> tuple[FloatArray, FloatArray]:
        """Return the corners of the smallest box around {V ≤ c}: ξᵢ* ± √(c (P⁻¹)ᵢᵢ), rounded outwards."""
        sides = half_sides(self._lyapunov, level)
        centre = self._anchor.tolist()
        high = [_sum_up(middle, side) for middle, side in zip(centre, sides, strict=True)]
        low = [-_sum_up(-middle, side) for middle, side in zip(centre, sides, strict=True)]
        return np.array(low), np.array(high)

    def radius(self, near: float) -> float | None:
        """Return nearly the largest ρ with near² P − ρ² I ≻ 0."""
        root = self._root()
        return None if root is None else near * root * (1 - GUARD)

    def farthest(self, level: float) -> float:
        """Return √c / s for nearly the largest s with P − s² I ≻ 0."""
        root = self._root()
        return math.inf if root is None else math.sqrt(level) / root * (1 + GUARD)

    def _root(self) -> float | None:
        """Return nearly the largest s with s ‖e‖ ≤ ‖e‖_P; None below float64's range."""
        identity = Dyadic.of(np.eye(len(self._anchor)))
        return largest_proved(
            math.sqrt(max(self._smallest, 0.0)),
            1.0,
            lambda root: is_positive_definite(self._lyapunov + -(identity * (root * root))),
        )


def half_sides(lyapunov: Dyadic, level: float) -> list[float]:
    """Return √(c (P⁻¹)ᵢᵢ) for each coordinate, rounded up: how far {eᵀPe ≤ c} reaches."""
    if math.isinf(level):
        return [math.inf] * len(lyapunov.integers)
    return [root_above(Fraction(level) * entry) for entry in inverse_diagonal(lyapunov)]


def _sum_up(left: float, right: float) -> float:
    return right if math.isinf(right) else rounded_up(Fraction(left) + Fraction(right))


class BentSublevels(Sublevels):
    """Bounds in other coordinates y = ξ* + c(ξ − ξ*), by interval arithmetic over cells."""

    def __init__(self, block: Block) -> None:
        self._anchor, self._lyapunov, self._form = block.anchor, block.lyapunov, block.form
        self._coordinates = block.coordinates

    def level(self, low: FloatArray, high: FloatArray) -> float:
        """Return an upper bound of V over a box, from enclosures of c over its cells."""

        def evaluate(lows: FloatArray, highs: FloatArray) -> tuple[FloatArray, FloatArray]:
            _, bounds = _bounds_of_v(self._lyapunov, *self._coordinates.bounds_forward(lows, highs))
            values = self._form.value(self._coordinates.forward(0.5 * (lows + highs)))
            return bounds[:, None], values[:, None]

        return float(highest(_down(low - self._anchor), _up(high - self._anchor), evaluate)[0])

    def extent(self, level: float) -> tuple[FloatArray, FloatArray]:
        """Return the corners of a box around {V ≤ c}, from enclosures of c⁻¹ over cells of {yᵀPy ≤ c}."""
        bounds = self._over_sublevel(level, lambda low, high: np.concatenate([-low, high], axis=1))
        below, above = np.split(bounds, 2)
        return _down(self._anchor - below), _up(self._anchor + above)

    def radius(self, near: float) -> float | None:
        """Return a ρ whose {√V ≤ ρ} is seen to lie within ``near`` of the attractor."""
        rho = near * math.sqrt(max(float(np.linalg.eigvalsh(self._lyapunov)[0]), 0.0))
        for _ in range(TRIES if rho > 0 else 0):
            reached = self.farthest(rho**2)
            if reached <= near:
                return rho * (1 - GUARD)
            rho *= 0.95 * max(near / reached, 0.1)
        return None

    def farthest(self, level: float) -> float:
        """Return how far enclosures of c⁻¹ over cells of {yᵀPy ≤ c} reach."""

        def distance(low: FloatArray, high: FloatArray) -> FloatArray:
            reached = np.maximum(np.abs(low), np.abs(high))
            return np.asarray((1 + GUARD) * np.linalg.norm(reached, axis=1, keepdims=True))

        return float(self._over_sublevel(level, distance)[0])

    def _over_sublevel(self, level: float, measure: Measure) -> FloatArray:
        """Return upper bounds of what ``measure`` says of boxes of ξ − ξ*, over {V ≤ c}."""
        half = np.array(half_sides(Dyadic.of(self._lyapunov), level))
        if not np.isfinite(half).all():
            return np.full(measure(-half[None], half[None]).shape[1], np.inf)

        def evaluate(lows: FloatArray, highs: FloatArray) -> tuple[FloatArray, FloatArray]:
            least, _ = _bounds_of_v(self._lyapunov, lows, highs)
            bounds = measure(*self._coordinates.bounds_back(lows, highs))
            bounds[least > level] = -np.inf
            middle = 0.5 * (lows + highs)  # pushed out to the border of {V ≤ c}, where extremes lie
            distance = self._form.distance(middle)
            stretch = np.where(distance > 0, math.sqrt(level) / distance, 0.0)
            points = self._coordinates.back(stretch[:, None] * middle)
            return bounds, measure(points, points)

        return highest(-half, half, evaluate)


def _bounds_of_v(lyapunov: FloatArray, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return bounds from below and above of eᵀPe over boxes (n, d). Shape (n,) each.

    With the middle m, |δ| ≤ h and e = m + δ, eᵀPe = mᵀPm + 2 (Pm)ᵀδ + δᵀPδ.
    """
    middle = 0.5 * (low + high)
    half = _up(np.maximum(high - middle, middle - low))
    pm, size = middle @ lyapunov, np.abs(lyapunov)
    value, change = (pm * middle).sum(axis=1), 2 * (np.abs(pm) * half).sum(axis=1)
    farthest = np.abs(middle) + half
    guard = GUARD * ((farthest @ size) * farthest).sum(axis=1)
    return value - change - guard, value + change + ((half @ size) * half).sum(axis=1) + guard


def _up(values: FloatArray) -> FloatArray:
    """Return values above what rounding may have made too small by half a unit in the last place."""
    return np.asarray(np.nextafter(values, np.inf))


def _down(values: FloatArray) -> FloatArray:
    return np.asarray(np.nextafter(values, -np.inf))
