"""JᵀJ of velocity errors at fixed points, from moments of the points.

By ``Linearised`` every entry of JᵀJ is a sum over the points of a product of gates and spreads, which change
with the field, and a monomial of degree four or less, which does not. Of K² (d + F)² such sums only
K (K + 1) / 2 times the number of distinct monomials differ: J, (n d, p), is never written out.
"""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np

from skillctl.arrays import FloatArray, IntArray
from skillctl.learning.blocks import free_spans, spans
from skillctl.learning.field import Field, Linearised
from skillctl.model.mixture import quadratic_features


class VelocityMoments:
    """Σ_n (∂f/∂θ)ᵀ G_n ∂f/∂θ over points that stay where they are."""

    def __init__(self, positions: FloatArray, weights: FloatArray, metric: FloatArray | None) -> None:
        """Args: positions (d, n); weights (n,); metric: symmetric (n, d, d), or None for the identity."""
        self.positions, self.weights = positions, weights
        self.features = quadratic_features(positions)
        self.metric = None if metric is None else np.ascontiguousarray(metric.transpose(1, 2, 0))

    @cached_property
    def monomials(self) -> FloatArray:
        """Each monomial at each point, times its weight; large, and of use for ``normal`` only."""
        _, first, second, _ = _monomials(len(self.positions))
        return np.ascontiguousarray((self.weights * self.features[first] * self.features[second]).T)

    def linearised(self, field: Field) -> Linearised:
        """Return how the field's velocities at the points depend on its parameters."""
        return field.linearised(self.positions, self.features)

    def weighed(self, errors: FloatArray) -> FloatArray:
        """Return G e for errors (d, n), weights included."""
        if self.metric is not None:
            errors = (self.metric * errors).sum(axis=1)
        return np.asarray(self.weights * errors)

    def normal(self, at: Linearised) -> FloatArray:
        """Return the sum. Shape (p, p), ordered as in ``Field.split``."""
        k, d, n = at.spread.shape
        features = len(self.features)
        index, _, _, up_to = _monomials(d)
        first, second = np.triu_indices(k)
        pair = np.empty((k, k), dtype=np.int64)
        pair[first, second] = pair[second, first] = np.arange(first.size)
        linear = index[1 : 1 + d]  # ξ_j φ_f
        spread = at.spread if self.metric is None else (self.metric[None] * at.spread[:, None]).sum(axis=2)

        # Of coordinate i: where its row of each A_k stands among the free entries, and what it multiplies.
        rows, columns = [], []
        for span, place in zip(spans(at.blocks), free_spans(at.blocks), strict=True):
            length = span.stop - span.start
            rows += [slice(first, first + length) for first in range(place.start, place.stop, length)]
            columns += [span] * length
        free = rows[-1].stop
        size = k * free
        normal = np.zeros((size + k * features,) * 2)
        matrices = normal[:size, :size].reshape(k, free, k, free)
        mixed = normal[:size, size:].reshape(k, free, k, features)
        both = at.gates[first] * at.gates[second]
        for i in range(d):
            for j in range(i, d) if self.metric is not None else (i,):
                metric = 1.0 if self.metric is None else self.metric[i, j]
                sums = (both * metric) @ self.monomials[:, : up_to[2]]
                factors = index[1 : 1 + d, 1 : 1 + d][columns[i], columns[j]]  # ξ_a ξ_b
                block = sums[pair[:, None, :, None], factors[None, :, None, :]]
                matrices[:, rows[i], :, rows[j]] = block
                if i != j:
                    matrices[:, rows[j], :, rows[i]] = block.transpose(0, 3, 2, 1)
        sums = (at.gates[:, None, None] * spread.swapaxes(0, 1)).reshape(-1, n) @ self.monomials[
            :, : up_to[3]
        ]
        sums = sums.reshape(k, d, k, -1)
        for i in range(d):
            mixed[:, rows[i]] = sums[:, i][..., linear[columns[i]]].transpose(0, 2, 1, 3)
        normal[size:, :size] = normal[:size, size:].T
        sums = (at.spread[first] * spread[second]).sum(axis=1) @ self.monomials
        square = sums[pair[:, None, :, None], index[None, :, None, :]]
        normal[size:, size:] = square.reshape(k * features, -1)
        return normal


@lru_cache(maxsize=16)
def _monomials(d: int) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Return which monomial φ_f φ_g is, and how to make each monomial.

    Returns:
        The number of the monomial, shape (F, F); f and g of a product that is the monomial, one for each; and
        how many monomials have at most degree 0 … 4. They are sorted by degree.
    """
    exponents = np.zeros((1 + d + d * (d + 1) // 2, d), dtype=np.int64)
    exponents[1 : 1 + d] = np.eye(d)
    rows, columns = np.triu_indices(d)
    exponents[1 + d :] = np.eye(d)[rows] + np.eye(d)[columns]
    products = (exponents[:, None] + exponents).reshape(-1, d)
    keyed = np.column_stack([products.sum(axis=1), products])
    distinct, example, number = np.unique(keyed, axis=0, return_index=True, return_inverse=True)
    count = len(exponents)
    up_to = np.searchsorted(distinct[:, 0], np.arange(5), side="right")
    return number.reshape(count, count), example // count, example % count, up_to
