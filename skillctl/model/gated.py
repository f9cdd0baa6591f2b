"""Linear systems under quadratic gates, evaluated fast: one state per control tick, or millions at once."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.model.mixture import BLOCK, FARTHEST, GaussianMixture, log_sum_exp, quadratic_features, softmax

# Beyond these the largest logit is taken out before the gates are normalised: exp of them is far from 0 and
# infinity, and so are sums.
LOWEST_PEAK, HIGHEST_PEAK = -400.0, 400.0


class Quadratics:
    """K quadratic functions of ξ − o.

    For one state, the features of ``quadratic_features`` would cost more to build than the functions cost to
    evaluate, so the quadratic terms are kept as matrices, too: (Q (ξ − o) + l)ᵀ (ξ − o) + c is two products.

    Args:
        coefficients: In the quadratic features of ξ − o, shape (K, F).
        origin: o, shape (d,).
    """

    __slots__ = ("_constants", "_linear", "_quadratic", "_shape", "coefficients", "origin")

    def __init__(self, coefficients: FloatArray, origin: FloatArray) -> None:
        k, d = len(coefficients), len(origin)
        rows, columns = np.triu_indices(d)
        quadratic = np.zeros((k, d, d))
        quadratic[:, rows, columns] = coefficients[:, 1 + d :]
        self.coefficients, self.origin = coefficients.view(), origin.view()
        for array in (self.coefficients, self.origin):  # what is computed from them below would not follow
            array.setflags(write=False)
        self._constants = coefficients[:, 0].copy()
        self._linear = coefficients[:, 1 : 1 + d].ravel()
        self._quadratic = quadratic.reshape(k * d, d)
        self._shape = (k, d)

    def at(self, offset: FloatArray) -> FloatArray:
        """Return the values for one offset ξ − o (d,). Shape (K,)."""
        if math.hypot(*offset.tolist()) > FARTHEST:  # squares would overflow
            return np.asarray(self.many(offset[:, None])[:, 0])
        slopes = self._quadratic.dot(offset)
        slopes += self._linear
        values: FloatArray = slopes.reshape(self._shape).dot(offset)
        values += self._constants
        return values

    def many(self, offsets: FloatArray) -> FloatArray:
        """Return the values for many offsets (d, n). Shape (K, n)."""
        return np.asarray(self.coefficients @ quadratic_features(offsets))


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

    __slots__ = ("_table", "logits")

    def __init__(
        self, coefficients: FloatArray, peak: float, matrices: FloatArray, origin: FloatArray
    ) -> None:
        self.logits = Quadratics(coefficients - peak * np.eye(1, coefficients.shape[1]), origin)
        k = len(matrices)
        self._table = np.vstack([matrices.reshape(k, -1).T, np.ones(k)])  # the last row sums the gates

    def gates(self, positions: FloatArray) -> FloatArray:
        """Return h for positions (n, d). Shape (n, K); rows sum to one at any distance."""
        return softmax(self.logits.many(positions.T - self.logits.origin[:, None])).T

    def velocity(self, position: FloatArray) -> FloatArray:
        """Return f for one state (d,)."""
        offset = position - self.logits.origin
        logits = self.logits.at(offset)
        peak = max(logits.tolist())  # twice as fast as NumPy's, for the few that there are
        if not LOWEST_PEAK < peak < HIGHEST_PEAK:  # far away, or huge numbers rounded
            logits -= peak
        mixed = self._table.dot(np.exp(logits))
        velocity: FloatArray = mixed[:-1].reshape(offset.size, -1).dot(offset)
        velocity /= mixed[-1]
        return velocity

    def velocities(self, positions: FloatArray) -> FloatArray:
        """Return f for many states (n, d)."""
        n, d = positions.shape
        result = np.empty((n, d))
        for start in range(0, n, BLOCK):
            offsets = positions[start : start + BLOCK].T - self.logits.origin[:, None]
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
        logits = self.logits.many(offsets)
        peaks = logits.max(axis=0)
        if peaks.min() > LOWEST_PEAK and peaks.max() < HIGHEST_PEAK:
            return np.asarray(np.exp(logits, out=logits))
        return softmax(logits)


class StackedGates:
    """The gates of several fields around one origin, evaluated together; each field's sum to one.

    Args:
        fields: From left to right; all with the same origin.
    """

    __slots__ = ("_blocks", "_same", "logits", "owners")

    def __init__(self, fields: Sequence[GatedField]) -> None:
        counts = [len(field.logits.coefficients) for field in fields]
        coefficients = np.concatenate([field.logits.coefficients for field in fields])
        self.logits = Quadratics(coefficients, fields[0].logits.origin)
        self.owners, self._blocks = _blocks(counts)
        self._same = (self.owners[:, None] == self.owners).astype(np.float64)  # sums each field's gates

    def at(self, offset: FloatArray) -> FloatArray:
        """Return all gates for one offset from the origin (d,), fields side by side. Shape (K,)."""
        logits = self.logits.at(offset)
        values = logits.tolist()
        for start, end in self._blocks:
            peak = max(values[start:end])
            if not LOWEST_PEAK < peak < HIGHEST_PEAK:
                logits[start:end] -= peak
        gates = np.exp(logits)
        gates /= self._same.dot(gates)
        return gates

    def many(self, offsets: FloatArray) -> FloatArray:
        """Return all gates for many offsets (d, n), fields side by side. Shape (n, K)."""
        logits = self.logits.many(offsets)
        return np.concatenate([softmax(logits[start:end]) for start, end in self._blocks]).T


class StackedDensities:
    """Several mixtures, weighted, and evaluated together: wᵢ pᵢ / Σⱼ wⱼ pⱼ.

    Args:
        mixtures: From left to right.
        weights: wᵢ > 0, shape (mixtures,).

    Attributes:
        quadratics: log πₖ N(x; μₖ, Σₖ) of all components, side by side.
    """

    __slots__ = ("_log_weights", "_mixtures", "_sums", "quadratics")

    def __init__(self, mixtures: Sequence[GaussianMixture], weights: FloatArray) -> None:
        origin = np.mean([mixture.priors @ mixture.means for mixture in mixtures], axis=0)
        coefficients = np.concatenate([mixture.coefficients(origin) for mixture in mixtures])
        owners, _ = _blocks([mixture.n_components for mixture in mixtures])
        self._mixtures, self._log_weights = tuple(mixtures), np.log(weights)
        self.quadratics = Quadratics(coefficients, origin)
        self._sums = (owners == np.arange(len(mixtures))[:, None]) * weights[:, None]

    def shares(self, position: FloatArray) -> FloatArray:
        """Return the shares at one position (d,). Shape (mixtures,)."""
        logs = self.quadratics.at(position - self.quadratics.origin)
        logs -= max(logs.tolist())  # what underflows now is nothing beside the largest
        shares: FloatArray = self._sums.dot(np.exp(logs))
        shares /= sum(shares.tolist())
        return shares

    def scores(self, positions: FloatArray) -> FloatArray:
        """Return log wᵢ + log pᵢ for many positions (n, d). Shape (mixtures, n)."""
        logs = np.stack([log_sum_exp(mixture.log_joint(positions)) for mixture in self._mixtures])
        return np.asarray(logs + self._log_weights[:, None])


def _blocks(counts: Sequence[int]) -> tuple[np.typing.NDArray[np.int64], tuple[tuple[int, int], ...]]:
    """Return the owner of each of Σ counts rows, and where each owner's rows begin and end."""
    ends = np.cumsum(counts).tolist()
    return np.repeat(np.arange(len(counts)), counts), tuple(zip([0, *ends[:-1]], ends, strict=True))
