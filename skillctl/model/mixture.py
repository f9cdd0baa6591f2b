"""Gaussian mixtures, evaluated in the log domain through quadratic features."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from skillctl.arrays import FloatArray, Frozen, frozen_array, require_simplex, require_spd
from skillctl.errors import InvalidModelError

BLOCK = 4096  # states evaluated together: their features and weights stay in the second-level cache
FARTHEST = 1e100  # squares of larger offsets would overflow; beyond it the direction alone still decides
LARGEST = 1e104  # of a coefficient: sums of 4096 of them, times ``FARTHEST`` squared, are numbers


def quadratic_coefficients(
    log_offsets: FloatArray, means: FloatArray, precisions: FloatArray, origin: FloatArray
) -> FloatArray:
    """Return W with W @ quadratic_features(x − origin) = log_offsets − ½ (x − μ)ᵀ Λ (x − μ).

    Args:
        log_offsets: Value of each quadratic at its own mean. Shape (K,).
        means: μ, shape (K, d).
        precisions: Λ, symmetric, shape (K, d, d).
        origin: Where the features are centred, shape (d,).

    Returns:
        Shape (K, 1 + d + d(d+1)/2): constant, linear, and upper-triangle quadratic coefficients.
    """
    d = means.shape[1]
    centred = means - origin
    linear = np.einsum("kij,kj->ki", precisions, centred)
    constant = log_offsets - 0.5 * np.einsum("ki,ki->k", linear, centred)
    rows, columns = np.triu_indices(d)
    factor = np.where(rows == columns, -0.5, -1.0)  # off-diagonal terms occur twice in eᵀΛe
    return np.hstack([constant[:, None], linear, factor * precisions[:, rows, columns]])


def quadratic_features(offsets: FloatArray) -> FloatArray:
    """Return the rows 1, e_i, e_i e_j (i ≤ j) for offsets e of shape (d, n). Shape (F, n).

    An offset with a coordinate beyond ``FARTHEST`` counts as the one in the same direction at that limit,
    so that the weights stay finite at any distance.
    """
    d, n = offsets.shape
    if np.abs(offsets).max(initial=0.0) > FARTHEST:
        offsets = offsets * (FARTHEST / np.maximum(np.abs(offsets).max(axis=0), FARTHEST))
    features = np.empty((1 + d + d * (d + 1) // 2, n))
    features[0] = 1.0
    features[1 : d + 1] = offsets
    row = d + 1
    for i in range(d):
        np.multiply(offsets[i], offsets[i:], out=features[row : row + d - i])
        row += d - i
    return features


def softmax(logits: FloatArray) -> FloatArray:
    """Return exp(logits) normalised to sum to one along the first axis, overwriting ``logits``."""
    logits -= logits.max(axis=0)
    np.exp(logits, out=logits)
    logits /= logits.sum(axis=0)
    return logits


def log_sum_exp(logits: FloatArray) -> FloatArray:
    """Return log Σ exp(logits) along the first axis; finite wherever the largest entry is."""
    peak = logits.max(axis=0)
    return np.asarray(peak + np.log(np.exp(logits - peak).sum(axis=0)))


@dataclass(frozen=True, eq=False, slots=True)
class GaussianMixture(Frozen):
    """K Gaussian components over d dimensions.

    Attributes:
        priors: Weight of each component, positive, summing to one. Shape (K,).
        means: Component centres. Shape (K, d).
        covariances: Symmetric positive definite. Shape (K, d, d).
    """

    priors: FloatArray
    means: FloatArray
    covariances: FloatArray
    _origin: FloatArray = field(init=False, repr=False)
    _coefficients: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        k, d = frozen_array("means", self.means, (None, None)).shape
        for name, shape in {"priors": (k,), "means": (k, d), "covariances": (k, d, d)}.items():
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), shape))
        require_simplex("priors", self.priors)
        require_spd("covariances", self.covariances)
        origin = self.priors @ self.means
        object.__setattr__(self, "_origin", origin)
        object.__setattr__(self, "_coefficients", self.coefficients(origin))

    @property
    def n_components(self) -> int:
        """Number of components, K."""
        return int(self.means.shape[0])

    @property
    def dimension(self) -> int:
        """Number of dimensions, d."""
        return int(self.means.shape[1])

    @property
    def log_peaks(self) -> FloatArray:
        """The largest value of each log π_k N(x; μ_k, Σ_k), taken at its mean. Shape (K,)."""
        _, log_determinants = np.linalg.slogdet(2 * np.pi * self.covariances)
        return np.asarray(np.log(self.priors) - 0.5 * log_determinants)

    def coefficients(self, origin: FloatArray) -> FloatArray:
        """Return the coefficients of log π_k N(x; μ_k, Σ_k) in the features of x − origin. Shape (K, F).

        Raises:
            InvalidModelError: They, or what is computed with them, are no numbers: covariances of 1e-300 or
                1e308 are definite, but useless.
        """
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            precisions = np.linalg.inv(self.covariances)
            precisions = 0.5 * (precisions + precisions.swapaxes(1, 2))
            found = quadratic_coefficients(self.log_peaks, self.means, precisions, origin)
        if not (np.abs(found) <= LARGEST).all():  # NaN is not
            raise InvalidModelError("means and covariances: too large or too small to compute with.")
        return found

    def log_joint(self, positions: FloatArray) -> FloatArray:
        """Return log π_k N(x; μ_k, Σ_k) for positions (n, d). Shape (K, n)."""
        return self._coefficients @ quadratic_features((positions - self._origin).T)

    def log_density(self, positions: FloatArray) -> FloatArray:
        """Return log Σ_k π_k N(x; μ_k, Σ_k) for positions (n, d). Shape (n,)."""
        return log_sum_exp(self.log_joint(positions))

    def responsibilities(self, positions: FloatArray) -> FloatArray:
        """Return π_k N(x; μ_k, Σ_k) / Σ_j π_j N(x; μ_j, Σ_j) for positions (n, d). Shape (n, K)."""
        return softmax(self.log_joint(positions)).T

    def translated(self, offset: FloatArray) -> GaussianMixture:
        """Return the mixture moved by ``offset`` (d,)."""
        return GaussianMixture(self.priors, self.means + offset, self.covariances)

    def mapped(self, matrix: FloatArray, origin: FloatArray) -> GaussianMixture:
        """Return the mixture of o + M (x − o), M a matrix (d, d) and o an ``origin`` (d,)."""
        means = origin + (self.means - origin) @ matrix.T
        return GaussianMixture(self.priors, means, congruent(self.covariances, matrix))


def congruent(symmetric: FloatArray, matrix: FloatArray) -> FloatArray:
    """Return M S Mᵀ for matrices S (..., d, d), symmetric to the last bit."""
    found = matrix @ symmetric @ matrix.T
    return np.asarray(0.5 * (found + found.swapaxes(-1, -2)))


def joined(mixtures: Sequence[GaussianMixture], weights: FloatArray) -> GaussianMixture:
    """Return the mixture of mixtures with weights (number of mixtures,), positive up to a common factor."""
    priors = np.concatenate([w * mixture.priors for w, mixture in zip(weights, mixtures, strict=True)])
    return GaussianMixture(
        priors / priors.sum(),
        np.concatenate([mixture.means for mixture in mixtures]),
        np.concatenate([mixture.covariances for mixture in mixtures]),
    )
