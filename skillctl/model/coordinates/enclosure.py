"""Where a smooth map takes a box: a centre, an interval Jacobian, and a bound on all rounding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray

# Each result below is a sum of fewer than a thousand float64 terms, each good to a few units in the last
# place (2^-52); this share of their magnitudes is more than that.
GUARD = 2.0**-38


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

    def moved(self, offset: FloatArray) -> Enclosure:
        """Return the set moved by ``offset`` (d,)."""
        slack = self.slack + GUARD * (np.abs(self.centre) + np.abs(offset))
        return Enclosure(self.centre + offset, self.jacobian, self.spread, self.half, slack)

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

    def sheared(
        self, direction: FloatArray, coefficients: FloatArray, centres: FloatArray, width: float
    ) -> Enclosure:
        """Return the image under x + Π a(w·x), a(t) = Σⱼ cⱼ (ψⱼ(t) − ψⱼ(0)), ψⱼ(t) = exp(−½((t − tⱼ)/σ)²).

        Args:
            direction: w ≠ 0, shape (d,); Π = I − w wᵀ/‖w‖².
            coefficients: cⱼ, shape (m, d).
            centres: tⱼ, shape (m,).
            width: σ > 0.
        """
        w, w_size = direction, np.abs(direction)
        outer = np.outer(w, w) / (w @ w)
        amounts = coefficients - coefficients @ outer
        sizes = np.abs(coefficients) @ (np.eye(len(w)) + np.abs(outer))
        along = self.centre @ w
        along_error = GUARD * (np.abs(self.centre) @ w_size)
        row = np.einsum("i,nij->nj", w, self.jacobian)  # wᵀ J
        row_size = np.einsum("i,nij->nj", w_size, np.abs(self.jacobian))
        row_spread = np.einsum("i,nij->nj", w_size, self.spread) + GUARD * row_size
        uncertain = self.slack @ w_size + along_error
        reach = ((np.abs(row) + row_spread) * self.half).sum(axis=1) * (1 + GUARD) + uncertain

        values = _bumps(along, centres, width) - _bumps(np.zeros(1), centres, width)
        value_error = GUARD * (2 + (np.abs(along)[:, None] + 2 * np.abs(centres)) / width) @ sizes
        middle, radius = _slopes(along, reach, centres, width)
        slope = middle @ amounts  # Π a′ over all of the set, up to `slope_spread`
        slope_spread = radius @ np.abs(amounts) + GUARD * (np.abs(middle) + radius) @ sizes
        steepest = np.abs(slope) + slope_spread

        change = slope[:, :, None] * row[:, None]
        spread = steepest[:, :, None] * row_spread[:, None] + slope_spread[:, :, None] * np.abs(row)[:, None]
        return Enclosure(
            self.centre + values @ amounts,
            self.jacobian + change,
            self.spread + spread + GUARD * (np.abs(self.jacobian) + np.abs(change)),
            self.half,
            self.slack + steepest * uncertain[:, None] + value_error + GUARD * np.abs(self.centre),
        )

    def box(self) -> tuple[FloatArray, FloatArray]:
        """Return the lowest and the highest coordinates of the set, (n, d) each; infinite if unknown."""
        sizes = np.abs(self.jacobian) + self.spread
        reach = (1 + GUARD) * (np.einsum("nij,nj->ni", sizes, self.half) + self.slack)
        low = np.nextafter(self.centre - reach, -np.inf)
        high = np.nextafter(self.centre + reach, np.inf)
        return np.where(np.isnan(low), -np.inf, low), np.where(np.isnan(high), np.inf, high)


def _bumps(along: FloatArray, centres: FloatArray, width: float) -> FloatArray:
    """Return ψⱼ(t) for t (n,). Shape (n, m)."""
    return np.asarray(np.exp(-0.5 * ((along[:, None] - centres) / width) ** 2))


def _slopes(
    along: FloatArray, reach: FloatArray, centres: FloatArray, width: float
) -> tuple[FloatArray, FloatArray]:
    """Return middle and radius of the range of ψⱼ′ over [t − r, t + r], for t and r (n,). Shape (n, m) each.

    ψⱼ′ = −z exp(−½z²)/σ in z = (t − tⱼ)/σ falls between its extrema at z = ±1 and rises outside of them.
    """
    rounding = GUARD * (1 + (np.abs(along) + reach)[:, None] + np.abs(centres)) / width
    low = (along - reach)[:, None] - centres
    high = (along + reach)[:, None] - centres
    low, high = low / width - rounding, high / width + rounding
    ends = np.stack([-z * np.exp(-0.5 * z**2) for z in (low, high)])
    peak = np.exp(-0.5)
    least = np.where((low <= 1) & (high >= 1), -peak, ends.min(axis=0)) / width
    most = np.where((low <= -1) & (high >= -1), peak, ends.max(axis=0)) / width
    return 0.5 * (least + most), 0.5 * (most - least) + GUARD / width


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
