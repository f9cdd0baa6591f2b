"""Whether two convex bodies have no point in common, by a direction that separates them."""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray, length
from skillctl.model.coordinates.gauge import Gauge

MOST_STEPS = 40
SMALLEST = 1e-9  # a difference of two points that is none, as a share of that of the poles


def separating(first: Gauge, second: Gauge, times: tuple[float, float]) -> FloatArray | None:
    """Return a direction along which {ν₁ ≤ t₁} lies before {ν₂ ≤ t₂}; None if none was found, (d,).

    The bodies' own axes are tried first: of boxes side by side one of them does it. Then Gilbert's method on
    the differences of points of the two: w is the one that is farthest against v, and v, the least
    difference known, moves to the least one between v and w. Once w·v > 0, v separates.

    References:
        E. G. Gilbert, An iterative procedure for computing the minimum of a quadratic form on a convex set,
        SIAM J. Control 4 (1966) 61–80.
    """
    between = second.pole - first.pole
    for axis in (between, *first.frame, *second.frame):
        v = axis if axis.dot(between) > 0 else -axis
        if v.dot(second.farthest(-v, times[1]) - first.farthest(v, times[0])) > 0:
            return np.asarray(v / length(v))
    v = between
    for _ in range(MOST_STEPS):
        w = second.farthest(-v, times[1]) - first.farthest(v, times[0])
        if w.dot(v) > 0:
            return np.asarray(v / length(v))
        step = v - w
        v = v - min(1.0, max(0.0, float(v.dot(step) / step.dot(step)))) * step
        if length(v) < SMALLEST * length(between):
            return None
    return None


def separated(first: Gauge, second: Gauge, times: tuple[float, float]) -> bool:
    """Return whether {ν₁ ≤ t₁} and {ν₂ ≤ t₂} are proved to have no point in common.

    The direction is found in floating point; that it separates is checked with rationals, from the stored
    numbers as they are. True is exact; false may also mean that they are too near to each other to tell.
    """
    direction = separating(first, second, times)
    if direction is None:
        return False
    n = direction.tolist()
    before = first.support_above(n, times[0])
    return before + second.support_above([-each for each in n], times[1]) < 0
