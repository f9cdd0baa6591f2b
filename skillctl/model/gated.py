"""Linear systems under quadratic gates, evaluated fast: one state per control tick, or millions at once."""

from __future__ import annotations

import math

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.model.mixture import BLOCK, FARTHEST, quadratic_features, softmax

# Beyond these the largest logit is taken out before the gates are normalised: exp of them is far from 0 and
# infinity, and so are sums.
LOWEST_PEAK, HIGHEST_PEAK = -400.0, 400.0


class GatedField:
    """f(ξ) = Σ_k h_k(ξ) M_k (ξ − o), h = softmax of quadratics of ξ − o.

    The logits of Gaussian components have a maximum, which is moved to zero once; so exp of them never
    overflows, and near the data their sum does not vanish. Where it does, the largest is taken out first; so
    it is where covariances are so small (1e-30) that rounding lifts logits above their maximum.

    Args:
        coefficients: Logits in the quadratic features of ξ − o, shape (K, F).
        peak: An upper bound of all logits.
        matrices: M, shape (K, d, d).
        origin: o, shape (d,).
    """

    __slots__ = ("_coefficients", "_constants", "_linear", "_origin", "_quadratic", "_shape", "_table")

    def __init__(
        self, coefficients: FloatArray, peak: float, matrices: FloatArray, origin: FloatArray
    ) -> None:
        k, d, _ = matrices.shape
        rows, columns = np.triu_indices(d)
        quadratic = np.zeros((k, d, d))
        quadratic[:, rows, columns] = coefficients[:, 1 + d :]
        self._origin = origin
        coefficients = coefficients - peak * np.eye(1, coefficients.shape[1])
        self._coefficients = coefficients
        self._constants = coefficients[:, 0].copy()
        self._linear = coefficients[:, 1 : 1 + d].ravel()
        self._quadratic = quadratic.reshape(k * d, d)
        self._table = np.vstack([matrices.reshape(k, d * d).T, np.ones(k)])  # the last row sums the gates
        self._shape = (k, d)

    def gates(self, positions: FloatArray) -> FloatArray:
        """Return h for positions (n, d). Shape (n, K); rows sum to one at any distance."""
        return softmax(self._coefficients @ quadratic_features(positions.T - self._origin[:, None])).T

    def velocity(self, position: FloatArray) -> FloatArray:
        """Return f for one state (d,)."""
        k, d = self._shape
        offset = position - self._origin
        if math.hypot(*offset.tolist()) > FARTHEST:  # squares would overflow
            return np.asarray(self.velocities(position[None])[0])
        slopes = self._quadratic.dot(offset)
        slopes += self._linear
        logits = slopes.reshape(k, d).dot(offset)
        logits += self._constants
        peak = max(logits.tolist())  # twice as fast as NumPy's, for the few that there are
        if not LOWEST_PEAK < peak < HIGHEST_PEAK:  # far away, or huge numbers rounded
            logits -= peak
        mixed = self._table.dot(np.exp(logits))
        velocity: FloatArray = mixed[:-1].reshape(d, d).dot(offset)
        velocity /= mixed[-1]
        return velocity

    def velocities(self, positions: FloatArray) -> FloatArray:
        """Return f for many states (n, d)."""
        n, d = positions.shape
        result = np.empty((n, d))
        for start in range(0, n, BLOCK):
            offsets = positions[start : start + BLOCK].T - self._origin[:, None]
            mixed = self._table @ self._unnormalised(offsets)
            for i in range(d):
                component = mixed[i * d] * offsets[0]
                for j in range(1, d):
                    component += mixed[i * d + j] * offsets[j]
                component /= mixed[-1]
                result[start : start + BLOCK, i] = component
        return result

    def _unnormalised(self, offsets: FloatArray) -> FloatArray:
        """Return gates for offsets (d, n) up to one positive factor per state. Shape (K, n)."""
        logits = self._coefficients @ quadratic_features(offsets)
        peaks = logits.max(axis=0)
        if peaks.min() > LOWEST_PEAK and peaks.max() < HIGHEST_PEAK:
            return np.asarray(np.exp(logits, out=logits))
        return softmax(logits)
