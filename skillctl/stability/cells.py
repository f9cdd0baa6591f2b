"""Upper bounds of functions over a box, from bounds over ever smaller cells of it: branch and bound."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from skillctl.arrays import FloatArray

# From cells (n, d) to bounds (n, k), −∞ for cells outside the domain, and to values reached in them (n, k).
Evaluate: TypeAlias = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]

CLOSE = 2.0**-8  # a bound this share above a value that is reached is good enough
MOST_CELLS = 2**16  # in the plane a thousand do; more coordinates end here, with looser bounds


def highest(low: FloatArray, high: FloatArray, evaluate: Evaluate) -> FloatArray:
    """Return an upper bound of each of k non-negative functions over the box from ``low`` to ``high``, (d,).

    Every cell that the search stops to divide counts with its bound, so the result is as true as
    ``evaluate``, however good or bad the values reached are; those only say where to look closer. Shape (k,).
    """
    lows, highs = low[None], high[None]
    sides = np.where(high > low, high - low, 1.0)
    settled = reached = np.array(-np.inf)
    cells = 0
    while True:
        with np.errstate(all="ignore"):  # where numbers are beyond float64, bounds are infinite
            bounds, values = evaluate(lows, highs)
        bounds = np.where(np.isnan(bounds), np.inf, bounds)
        reached = np.fmax(reached, np.fmax.reduce(values))
        cells += len(lows)
        loose = (bounds > reached + CLOSE * np.abs(reached)).any(axis=1)
        if not loose.any() or cells + 2 * loose.sum() > MOST_CELLS:
            return np.asarray(np.maximum(settled, bounds.max(axis=0)))
        settled = np.maximum(settled, bounds[~loose].max(axis=0, initial=-np.inf))
        lows, highs = _halved(lows[loose], highs[loose], sides)


def _halved(low: FloatArray, high: FloatArray, sides: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return cells (n, d), each cut in two across the side that is longest relative to the box's."""
    rows, axes = np.arange(len(low)), np.argmax((high - low) / sides, axis=1)
    middle = 0.5 * (low + high)[rows, axes]
    below, above = high.copy(), low.copy()
    below[rows, axes] = above[rows, axes] = middle
    return np.concatenate([low, above]), np.concatenate([below, high])
