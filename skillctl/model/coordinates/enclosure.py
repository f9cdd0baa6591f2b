"""Where a smooth map takes a box: a centre, an interval Jacobian, and a bound on all rounding."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from skillctl.arrays import FloatArray

# Each result below is a sum of fewer than a thousand float64 terms, each good to a few units in the last
# place (2^-52); this share of their magnitudes is more than that.
GUARD = 2.0**-38


class Shear(Protocol):
    """What is asked of a shear x + a(w·x), w·a = 0.

    Attributes:
        direction: w, shape (d,).
        blur: How far rounding moves w·x before it gets to a, as multiples of ``GUARD``, beside w·x itself.
        sizes: Magnitude of what is added up to a, shape (d,).
    """

    direction: FloatArray
    blur: float
    sizes: FloatArray

    def amounts(self, places: FloatArray) -> FloatArray:
        """Return a at places t (n,). Shape (n, d)."""

    def slope_bounds(self, places: FloatArray, reach: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return bounds of a′ within ``reach`` (n,) of places t (n,), rounded outwards. Shape (n, d) each."""


@dataclass(frozen=True, eq=False, slots=True)
class Enclosure:
    """A set that holds the images of n boxes: c + J δ + e with |δ| ≤ h, |J − J₀| ≤ R and |e| ≤ s.

    Jacobians are multiplied before the box is put in, so that a chain of maps costs no more overestimation
    than one map: it vanishes with the square of the size of the box (the mean value form).

    Attributes:
        centre: c, shape (n, d).
        jacobian: J₀, shape (n, d, d).
        spread: R, shape (n, d, d).
        half: h, shape (n, d).
        slack: s, shape (n, d): what rounding may have moved.

    References:
        R. E. Moore, R. B. Kearfott and M. J. Cloud, Introduction to Interval Analysis (2009), section 6.
    """

    centre: FloatArray
    jacobian: FloatArray
    spread: FloatArray
    half: FloatArray
    slack: FloatArray

    @classmethod
    def of(cls, low: FloatArray, high: FloatArray) -> Enclosure:
        """Return the boxes from ``low`` to ``high``, (n, d) each."""
        centre = 0.5 * low + 0.5 * high
        half = np.nextafter(np.maximum(high - centre, centre - low), np.inf)
        identity = np.broadcast_to(np.eye(low.shape[1]), (*low.shape, low.shape[1]))
        return cls(centre, identity, np.zeros_like(identity), half, np.zeros_like(centre))

    def multiplied(self, matrix: FloatArray, error: FloatArray | float = 0.0) -> Enclosure:
        """Return the image under a matrix (d, d) that is known up to ``error`` in each entry."""
        size = np.abs(matrix)
        error = error + GUARD * size
        return Enclosure(
            self.centre @ matrix.T,
            matrix @ self.jacobian,
            size @ self.spread + error @ (np.abs(self.jacobian) + self.spread),
            self.half,
            self.slack @ size.T + (np.abs(self.centre) + self.slack) @ error.T,
        )

    def sheared(self, shear: Shear, sign: int = 1) -> Enclosure:
        """Return the image under x ± a(w·x), + or − by ``sign``."""
        w, w_size = shear.direction, np.abs(shear.direction)
        along = self.centre @ w
        uncertain = self.slack @ w_size + GUARD * (np.abs(self.centre) @ w_size + shear.blur)
        row = np.einsum("i,nij->nj", w, self.jacobian)  # wᵀ J
        row_size = np.einsum("i,nij->nj", w_size, np.abs(self.jacobian))
        row_spread = np.einsum("i,nij->nj", w_size, self.spread) + GUARD * row_size
        reach = (1 + GUARD) * (((np.abs(row) + row_spread) * self.half).sum(axis=1) + uncertain)

        least, most = shear.slope_bounds(along, reach)
        slope, slope_spread = sign * 0.5 * (least + most), (0.5 + GUARD) * (most - least)
        steepest = np.abs(slope) + slope_spread
        change = slope[:, :, None] * row[:, None]
        spread = steepest[:, :, None] * row_spread[:, None] + slope_spread[:, :, None] * np.abs(row)[:, None]
        rounding = GUARD * (np.abs(self.centre) + shear.sizes)
        return Enclosure(
            self.centre + sign * shear.amounts(along),
            self.jacobian + change,
            self.spread + spread + GUARD * (np.abs(self.jacobian) + np.abs(change)),
            self.half,
            self.slack + steepest * uncertain[:, None] + rounding,
        )

    def box(self) -> tuple[FloatArray, FloatArray]:
        """Return the lowest and the highest coordinates of the set, (n, d) each; infinite if unknown."""
        sizes = np.abs(self.jacobian) + self.spread
        reach = (1 + GUARD) * (np.einsum("nij,nj->ni", sizes, self.half) + self.slack)
        low = np.nextafter(self.centre - reach, -np.inf)
        high = np.nextafter(self.centre + reach, np.inf)
        return np.where(np.isnan(low), -np.inf, low), np.where(np.isnan(high), np.inf, high)


def inverse_with_error(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return M near L⁻¹ (d, d), and a bound on |M − L⁻¹| in each entry; infinite if L may be singular.

    With R = I − L M and ‖R‖∞ ≤ ρ < 1, L⁻¹ − M = M R (I − R)⁻¹.

    References:
        N. J. Higham, Accuracy and Stability of Numerical Algorithms (2002), section 14.1.
    """
    inverse = np.asarray(np.linalg.inv(matrix))
    residual = np.abs(np.eye(len(matrix)) - matrix @ inverse)
    residual += GUARD * (np.eye(len(matrix)) + np.abs(matrix) @ np.abs(inverse))
    rho = float(residual.sum(axis=1).max()) * (1 + GUARD)
    worst = rho / (1 - rho) if rho < 1 else np.inf
    return inverse, np.repeat(np.abs(inverse).sum(axis=1, keepdims=True), len(matrix), axis=1) * worst
