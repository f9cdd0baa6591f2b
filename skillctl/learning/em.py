"""Constrained EM: the joint mixture of positions and velocities whose every A_k is stable (Eq. 5 and 6).

With b_k = −A_k ξ* fixed, component k of the joint density factors into N(ξ; μ, Σ) N(ξ̇; A ξ, C), so the
M-step is in closed form except for A_k, which a small convex problem gives.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from skillctl.arrays import FloatArray, IntArray
from skillctl.learning.barrier import StabilityBarrier, constrained_regression
from skillctl.learning.outcome import Result, StageResult
from skillctl.model.mixture import log_sum_exp, softmax

POSITION_FLOOR = 1e-4  # smallest variance of a component, in squared rms distances: 1 % of the rms distance
VELOCITY_FLOOR = 1e-4  # likewise in squared rms speeds
TRACE = 1e-6  # share of each point's responsibility that is spread evenly over all components


@dataclass(frozen=True, eq=False, slots=True)
class JointMixture:
    """Parameters in the learner's units, target at the origin.

    Attributes:
        priors (K,), means (K, d), covariances (K, d, d): of the positions.
        matrices (K, d, d): A_k; residual_covariances (K, d, d): of ξ̇ − A_k ξ.
    """

    priors: FloatArray
    means: FloatArray
    covariances: FloatArray
    matrices: FloatArray
    residual_covariances: FloatArray

    def log_joint(self, positions: FloatArray, velocities: FloatArray | None = None) -> FloatArray:
        """Return log π_k N(ξ; μ_k, Σ_k) [+ log N(ξ̇; A_k ξ, C_k)] for N points. Shape (N, K)."""
        logs = np.log(self.priors) + log_normal(positions[:, None] - self.means, self.covariances)
        if velocities is not None:
            predicted = np.einsum("kij,nj->nki", self.matrices, positions)
            logs = logs + log_normal(velocities[:, None] - predicted, self.residual_covariances)
        return np.asarray(logs)


def log_normal(deviations: FloatArray, covariances: FloatArray) -> FloatArray:
    """Return log N(deviation; 0, Σ_k) for deviations (N, K, d). Shape (N, K).

    It whitens by the inverse of the Cholesky factor. The quadratic features of ``GaussianMixture.log_joint``
    are faster, but lose more digits to cancellation where a component is narrow.
    """
    factors = np.linalg.inv(np.linalg.cholesky(covariances))
    white = np.einsum("kij,nkj->nki", factors, deviations)
    log_root = np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
    d = deviations.shape[-1]
    return np.asarray(log_root - 0.5 * d * np.log(2 * np.pi) - 0.5 * np.einsum("nki,nki->nk", white, white))


def log_likelihood(mixture: JointMixture, positions: FloatArray, velocities: FloatArray) -> float:
    """Return Σ log p(ξ, ξ̇) / N, the negative of Eq. 6, in the learner's units."""
    return float(np.mean(log_sum_exp(mixture.log_joint(positions, velocities).T)))


def expectation(logs: FloatArray) -> FloatArray:
    """Return responsibilities (N, K) from log joint densities (N, K).

    Every component keeps a small share of every point, so that a component that has lost all its points
    becomes a copy of the whole instead of causing a division by zero.
    """
    shares = softmax(logs.copy().T).T
    return np.asarray((1 - TRACE) * shares + TRACE / logs.shape[1])


def position_moments(
    responsibilities: FloatArray, positions: FloatArray, floor: float = POSITION_FLOOR
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the priors, means and covariances that maximise the expected log-likelihood of positions."""
    mass = responsibilities.sum(axis=0)
    priors = mass / mass.sum()
    means = responsibilities.T @ positions / mass[:, None]
    deviations = positions[:, None] - means
    covariances = _weighted_covariance(responsibilities / mass, deviations, floor)
    return priors, means, covariances


def maximisation(
    responsibilities: FloatArray,
    positions: FloatArray,
    velocities: FloatArray,
    barrier: StabilityBarrier,
    previous: JointMixture | None = None,
    floor: float = POSITION_FLOOR,
) -> JointMixture:
    """Return the mixture that maximises the expected log-likelihood, every A_k stable."""
    k, d = responsibilities.shape[1], positions.shape[1]
    priors, means, covariances = position_moments(responsibilities, positions, floor)
    shares = responsibilities / responsibilities.sum(axis=0)
    weighted = shares.T[:, :, None] * positions  # (K, N, d)
    gram = weighted.swapaxes(1, 2) @ positions + floor * np.eye(d)
    cross = velocities.T @ weighted
    # A_k and C_k depend on each other: A_k is fitted with the C_k of the iteration before.
    precisions: FloatArray = np.tile(np.eye(d), (k, 1, 1))
    if previous is not None:
        precisions = np.asarray(np.linalg.inv(previous.residual_covariances), dtype=np.float64)
    start = None if previous is None else previous.matrices
    matrices = constrained_regression(gram, cross, precisions, barrier, start=start, final_weight=1e-4)
    residuals = velocities[:, None] - np.einsum("kij,nj->nki", matrices, positions)
    residual_covariances = _weighted_covariance(shares, residuals, VELOCITY_FLOOR)
    return JointMixture(priors, means, covariances, matrices, residual_covariances)


def constrained_em(
    labels: IntArray,
    positions: FloatArray,
    velocities: FloatArray,
    barrier: StabilityBarrier,
    *,
    iterations: int,
    tolerance: float = 1e-5,
    floor: float = POSITION_FLOOR,
) -> tuple[JointMixture, StageResult]:
    """Return the mixture that EM reaches from a partition of the data, and how EM ended.

    Args:
        labels: Component of each point at the start, 0 … K − 1, shape (N,).
        positions: Relative to the attractor, shape (N, d).
        velocities: Shape (N, d).
        barrier: The stability constraint.
        iterations: At most this many.
        tolerance: Stop when the mean log-likelihood gains less.
        floor: Variance added to every position covariance, in squared rms distances.
    """
    mixture = maximisation(np.eye(labels.max() + 1)[labels], positions, velocities, barrier, floor=floor)
    last = -np.inf
    for step in range(1, iterations + 1):
        responsibilities = expectation(mixture.log_joint(positions, velocities))
        mixture = maximisation(responsibilities, positions, velocities, barrier, mixture, floor)
        current = log_likelihood(mixture, positions, velocities)
        if current - last < tolerance:
            return mixture, StageResult("mixture", Result.CONVERGED, step)
        last = current
    return mixture, StageResult("mixture", Result.OUT_OF_STEPS, iterations)


def position_em(
    mixture: JointMixture, points: FloatArray, positions: FloatArray, *, iterations: int = 20
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return priors, means and covariances of a mixture fitted to positions alone: the position density.

    Args:
        mixture: Where EM starts from: a mixture of ``points``.
        points: y of each position, shape (N, d).
        positions: ξ, shape (N, d).
        iterations: Of EM.
    """
    density, shares = mixture, expectation(mixture.log_joint(points))
    for step in range(iterations):
        moments = position_moments(shares, positions)
        density = replace(density, priors=moments[0], means=moments[1], covariances=moments[2])
        if step < iterations - 1:
            shares = expectation(density.log_joint(positions))
    return density.priors, density.means, density.covariances


def _weighted_covariance(shares: FloatArray, deviations: FloatArray, floor: float) -> FloatArray:
    moments = np.einsum("nk,nki,nkj->kij", shares, deviations, deviations)
    return np.asarray(0.5 * (moments + moments.swapaxes(1, 2)) + floor * np.eye(deviations.shape[-1]))
