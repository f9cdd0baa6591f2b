"""The Lyapunov matrix P from the demonstrations, and what a quadratic V costs them.

Along any solution V = ξᵀPξ falls, so s = √V falls. A demonstration on which s rises cannot be followed
exactly: of a dip and a later peak, it misses at least one by half their difference or more. P is chosen to
make this error small, before the components are learned (ours).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.geometry import norms, segment_lengths, squared_norms
from skillctl.learning.outcome import Result, StageResult
from skillctl.learning.robust import soft_least_squares, soft_loss

# All tuned on the 30 LASA motions.
CONDITION_WEIGHT = 0.02  # keeps P round where the data do not determine it; rms distances per log-eigenvalue
SOFT = 0.001  # a rise below this · √(number of points), in rms distances, counts quadratically
STARTS = 8  # of all that ``_starts`` names, those from which the search is made
EVALUATIONS = 12  # of the least squares from each start
ROUND = 1.05  # condition number below which P has no axes to stretch it along


def rise(lyapunov: FloatArray, positions: FloatArray) -> FloatArray:
    """Return half of how far V rises across each point of a demonstration, as a distance there.

    That is ½ (max of s from here on − min of s up to here) for s = √(ξᵀPξ), divided by the length of the
    gradient of s. The largest of them is what a motion with falling V must miss somewhere.

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
    lengths = segment_lengths(positions)
    rising = np.diff(squared_norms(positions, lyapunov), axis=-1) > 0
    return float(lengths[rising].sum() / lengths.sum())


def deviation_bound(lyapunov: FloatArray, positions: FloatArray) -> float:
    """Return a lower bound of the mean distance of any motion with falling V from the demonstrations.

    Match the points of a demonstration, in order, to points of any motion along which V falls: their s
    falls too, so the mean of |s − matched s| is at least that of the best falling fit of s, and s changes
    by at most √λ_max(P) per unit of distance. Exact for P = I and a radial detour, loose for a P far from
    round. Points count by the length of path they stand for.

    Args:
        lyapunov: P, shape (d, d).
        positions: Relative to the attractor, shape (D, T, d), in the order of time.

    Returns:
        In the unit of the positions.
    """
    s = norms(positions, lyapunov)
    lengths = segment_lengths(positions)
    # Each point stands for half of the segment before it and half of the one after it.
    weights = 0.5 * (np.pad(lengths, ((0, 0), (0, 1))) + np.pad(lengths, ((0, 0), (1, 0))))
    misses = [w @ np.abs(path - falling_fit(path, w)) for path, w in zip(s, weights, strict=True)]
    steepest = float(np.sqrt(np.linalg.eigvalsh(lyapunov)[-1]))
    return float(np.sum(misses) / weights.sum()) / steepest


def falling_fit(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the non-increasing sequence with the least Σ w |value − fit|, by pooling adjacent violators."""
    blocks: list[tuple[float, int, int]] = []  # weighted median, first, one past the last
    for index in range(len(values)):
        median, first = float(values[index]), index
        while blocks and blocks[-1][0] < median:
            first = blocks.pop()[1]
            median = _weighted_median(values[first : index + 1], weights[first : index + 1])
        blocks.append((median, first, index + 1))
    return np.concatenate([np.full(end - first, median) for median, first, end in blocks])


def _weighted_median(values: FloatArray, weights: FloatArray) -> float:
    order = np.argsort(values)
    covered = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(covered, 0.5 * covered[-1])])


def learn_lyapunov(motions: Sequence[FloatArray]) -> tuple[FloatArray, StageResult]:
    """Return P ≻ 0 (d, d), trace d, that forces the demonstrations off their path the least.

    P = exp(S) with S symmetric and traceless: a soft-L1 least-squares problem in S, solved from round and
    stretched starts, of which the best result counts. ``EVALUATIONS`` seldom suffice for SciPy's tolerances.
    Any P ≻ 0 gives a stable skill, so a P short of the optimum only costs accuracy.

    Args:
        motions: One array (D, T, d) or more, relative to their attractors, at rms distance one.
    """
    d = motions[0].shape[-1]
    if d == 1:
        return np.eye(1), StageResult("metric", Result.CONVERGED, 0)

    def linearise(parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        lyapunov, slopes = _exponential(parameters, d)
        found = [_rise_slopes(lyapunov, motion) for motion in motions]
        rises, by_entry = (np.concatenate(parts) / np.sqrt(points) for parts in zip(*found, strict=True))
        ridge = CONDITION_WEIGHT * np.eye(parameters.size)
        return np.append(rises, ridge @ parameters), np.vstack([by_entry @ slopes.T, ridge])

    points = sum(motion[..., 0].size for motion in motions)
    starts = sorted(_starts(d), key=lambda start: soft_loss(linearise(start)[0], SOFT))[:STARTS]
    fits = [soft_least_squares(linearise, start, SOFT, EVALUATIONS, longest=1.0) for start in starts]
    best = min(fits, key=lambda fit: fit.cost)
    result = Result.CONVERGED if best.converged else Result.OUT_OF_STEPS
    lyapunov, _ = _exponential(best.parameters, d)
    return np.asarray(lyapunov * (d / np.trace(lyapunov))), StageResult("metric", result, best.steps)


def _rise_slopes(lyapunov: FloatArray, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ``rise`` at all points and its derivatives by the entries of P, (n,) and (n, d²)."""
    gradient = positions @ lyapunov
    s = np.sqrt(np.maximum((gradient * positions).sum(axis=-1), 0.0))
    samples = np.arange(s.shape[-1])
    # Where s was lowest until now, and where it will be highest from now on.
    low = np.maximum.accumulate(np.where(s <= np.minimum.accumulate(s, axis=-1), samples, 0), axis=-1)
    backwards = s[..., ::-1]
    high = np.where(backwards >= np.maximum.accumulate(backwards, axis=-1), samples, 0)
    high = samples[-1] - np.maximum.accumulate(high, axis=-1)[..., ::-1]
    # ds = xᵀ dP x / 2s, and d‖Px‖ = (Px)ᵀ dP x / ‖Px‖; slope = ‖Px‖ / s.
    at = (s > 0)[..., None, None]
    safe = np.where(s > 0, s, 1.0)[..., None, None]
    norms = np.maximum(np.linalg.norm(gradient, axis=-1), 1e-100)[..., None, None]
    outer = at * positions[..., None] * positions[..., None, :] / (2 * safe)
    slope = np.where(at, norms / safe, 1.0)
    row = np.arange(len(s))[:, None]
    rises = 0.5 * (s[row, high] - s[row, low])[..., None, None] / slope
    turned = at * (gradient[..., None] * positions[..., None, :] / norms**2 - outer / safe)
    by_entry = 0.5 * (outer[row, high] - outer[row, low]) / slope - rises * turned
    return rises.ravel(), by_entry.reshape(rises.size, -1)


def stretched(lyapunov: FloatArray, factor: float = 2.0) -> FloatArray:
    """Return P with the same axes and trace and ``factor`` times the condition number; a round P as it is.

    Only learning shows the error that a P causes on a motion that contradicts it. Of the alternatives tried
    on the 30 LASA motions, a more stretched P was better most often.
    """
    values, vectors = np.linalg.eigh(lyapunov)
    condition = values[-1] / values[0]
    if condition < ROUND:
        return lyapunov
    longer = (vectors * values ** (1 + np.log(factor) / np.log(condition))) @ vectors.T
    longer = 0.5 * (longer + longer.T)
    return np.asarray(longer * (np.trace(lyapunov) / np.trace(longer)))


def _exponential(parameters: FloatArray, d: int) -> tuple[FloatArray, FloatArray]:
    """Return exp(S) and its derivatives (m, d²) for the symmetric traceless S with these parameters (m,).

    They are the entries of its upper triangle, the last left out.
    """
    rows, columns = (index[:-1] for index in np.triu_indices(d))
    units = np.zeros((rows.size, d, d))
    units[np.arange(rows.size), rows, columns] = units[np.arange(rows.size), columns, rows] = 1.0
    units[rows == columns, -1, -1] = -1.0
    values, vectors = np.linalg.eigh(np.tensordot(parameters, units, 1))
    matrix = (vectors * np.exp(values)) @ vectors.T
    # In the axes of S: d exp(S)_ij = dS_ij (e^a − e^b) / (a − b) with the eigenvalues a, b of i and j.
    half = 0.5 * (values[:, None] - values)
    ratio = np.divide(np.sinh(half), half, out=np.ones_like(half), where=half != 0)
    quotients = np.exp(0.5 * (values[:, None] + values)) * ratio
    slopes = vectors @ (quotients * (vectors.T @ units @ vectors)) @ vectors.T
    return np.asarray(0.5 * (matrix + matrix.T)), slopes.reshape(rows.size, -1)


def _starts(d: int) -> list[FloatArray]:
    """Return parameters of a round P, and of P stretched along each axis and each diagonal of two axes."""
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
