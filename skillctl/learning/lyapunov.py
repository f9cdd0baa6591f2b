"""The Lyapunov matrix P from the demonstrations, and what a quadratic V costs them.

Along any solution V = ξᵀPξ falls, so s = √V falls. A demonstration on which s rises cannot be followed
exactly: between a dip and a later peak some point is off by at least half their difference. That distance,
known before anything is learned, is what P is chosen to make small (ours).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skillctl.arrays import FloatArray

CONDITION_WEIGHT = 0.02  # keeps P round where the data does not care; in rms distances per log-eigenvalue
SOFT = 0.02  # below this share of the rms distance a deviation counts quadratically


def forced_deviation(lyapunov: FloatArray, positions: FloatArray) -> FloatArray:
    """Return how far a motion with falling V must stay from each point of a demonstration.

    For s = √(ξᵀPξ) the monotone function nearest to s (in the largest difference) is the mean of the
    running maximum from the end and the running minimum from the start; the difference, divided by the
    length of the gradient of s, is a distance.

    Args:
        lyapunov: P, shape (d, d).
        positions: Relative to the attractor, shape (..., T, d), in the order of time.

    Returns:
        Shape (..., T), in the unit of the positions; zero everywhere iff V never rises.
    """
    gradient = positions @ lyapunov
    s = np.sqrt(np.maximum(np.einsum("...i,...i->...", gradient, positions), 0.0))
    lowest_before = np.minimum.accumulate(s, axis=-1)
    highest_after = np.maximum.accumulate(s[..., ::-1], axis=-1)[..., ::-1]
    norms = np.linalg.norm(gradient, axis=-1)
    slope = np.divide(norms, s, out=np.ones_like(s), where=s > 0)
    return np.asarray(0.5 * (highest_after - lowest_before) / slope)


def rising_share(lyapunov: FloatArray, positions: FloatArray) -> float:
    """Return the share of the path, by length, on which V would have to grow. positions (D, T, d)."""
    v = np.einsum("...i,ij,...j->...", positions, lyapunov, positions)
    lengths = np.linalg.norm(np.diff(positions, axis=-2), axis=-1)
    return float(lengths[np.diff(v, axis=-1) > 0].sum() / lengths.sum())


def learn_lyapunov(motions: Sequence[FloatArray]) -> FloatArray:
    """Return P ≻ 0 (d, d), trace d, that forces the demonstrations off their path the least.

    P = exp(S) with S symmetric and traceless; a soft-L1 least squares over S from round and from
    stretched starts.

    Args:
        motions: One array (D, T, d) or more, relative to their attractors, at rms distance one.
    """
    from scipy.optimize import least_squares

    d = motions[0].shape[-1]
    if d == 1:
        return np.eye(1)

    def residuals(parameters: FloatArray) -> FloatArray:
        lyapunov = _exponential(parameters, d)
        forced = np.concatenate([forced_deviation(lyapunov, motion).ravel() for motion in motions])
        return np.append(forced / np.sqrt(forced.size), CONDITION_WEIGHT * parameters)

    fits = [
        least_squares(residuals, start, loss="soft_l1", f_scale=SOFT / 20, max_nfev=12)
        for start in _starts(d)
    ]
    best = min(fits, key=lambda fit: float(fit.cost))
    lyapunov = _exponential(best.x, d)
    return np.asarray(lyapunov * (d / np.trace(lyapunov)))


def _exponential(parameters: FloatArray, d: int) -> FloatArray:
    """Return exp(S) for the symmetric traceless S with these upper-triangle entries, the last left out."""
    symmetric = np.zeros((d, d))
    rows, columns = np.triu_indices(d)
    symmetric[rows[:-1], columns[:-1]] = parameters
    symmetric[columns, rows] = symmetric[rows, columns]
    symmetric[-1, -1] = -np.trace(symmetric)
    values, vectors = np.linalg.eigh(symmetric)
    matrix = (vectors * np.exp(values)) @ vectors.T
    return np.asarray(0.5 * (matrix + matrix.T))


def _starts(d: int) -> list[FloatArray]:
    """A round P, and P stretched along each axis and each diagonal of two axes."""
    rows, columns = np.triu_indices(d)
    starts = [np.zeros(rows.size - 1)]
    for i in range(d):
        for j in range(i, d):
            for sign in (1.0, -1.0):
                symmetric = np.zeros((d, d))
                symmetric[i, j] = symmetric[j, i] = sign
                symmetric -= np.trace(symmetric) / d * np.eye(d)
                starts.append(symmetric[rows, columns][:-1])
    return starts
