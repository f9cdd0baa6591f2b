"""How far a reproduced motion is from a demonstrated one: distances between curves, velocity errors.

Curves are arrays of positions (T, d). All distances are in the unit of the
positions. A curve that diverged (not finite, or beyond any physical size) is infinitely far from any other.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from skillctl import rotations
from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.geometry import resample_by_arc_length

CURVE_POINTS = 200  # resampling of curves whose distance is measured point by point
DIVERGED = 1e50  # a curve that leaves this range has diverged; squares still fit a float


def dtw(first: npt.ArrayLike, second: npt.ArrayLike, count: int = CURVE_POINTS) -> float:
    """Return the mean distance between matched points under dynamic time warping.

    Both curves are resampled to ``count`` points equally spaced in arc length. Of all monotone matchings
    from both starts to both ends, in steps (1, 0), (0, 1) and (1, 1), each of weight one, the one with the
    smallest *sum* of distances is taken; returned is that sum divided by the number of matched pairs.

    Args:
        first: Shape (T, d).
        second: Shape (U, d).
        count: Points per resampled curve.

    Returns:
        In the unit of the positions; infinite if a curve diverged.

    References:
        Sakoe & Chiba 1978, symmetric steps with weight one; the mean over the path is a convention.
    """
    costs = _pairwise_distances(first, second, count)
    return np.inf if costs is None else _warped(costs)


def dtw_angle(first: npt.ArrayLike, second: npt.ArrayLike, count: int = CURVE_POINTS) -> float:
    """Return the mean angle between matched orientations under dynamic time warping.

    As ``dtw``, of curves on the unit sphere of quaternions, whose arc length is half the angle turned.

    Args:
        first: Rotation vectors, shape (T, 3), [rad].
        second: Shape (U, 3).
        count: Orientations per resampled curve.

    Returns:
        In [rad]; infinite if a curve diverged.
    """
    a, b = _curve(first), _curve(second)
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        return np.inf
    p, q = (_resampled_turns(each, count)[:, None] for each in (a, b))
    q = q.swapaxes(0, 1)
    # Quaternions q and −q are one orientation; 2 sin(θ/4) is the length of the chord between the nearer two.
    chords = np.minimum(np.linalg.norm(p - q, axis=2), np.linalg.norm(p + q, axis=2))
    return _warped(np.asarray(4 * np.arcsin(np.minimum(0.5 * chords, 1.0))))


def _resampled_turns(turns: FloatArray, count: int) -> FloatArray:
    """Return ``count`` quaternions (count, 4), equally far apart, along rotation vectors (T, 3)."""
    q = rotations.quaternions(turns)
    flips = np.where((q[1:] * q[:-1]).sum(axis=1) < 0, -1.0, 1.0)
    q[1:] *= np.cumprod(flips)[:, None]
    chords = resample_by_arc_length(q, count)
    return np.asarray(chords / np.linalg.norm(chords, axis=1, keepdims=True))


def _warped(costs: FloatArray) -> float:
    """Return the mean cost of matched pairs on the matching with the least sum of costs (N, M)."""
    table = _alignment_table(costs)
    return float(table[-1, -1] / _path_length(table))


def velocity_rmse(predicted: npt.ArrayLike, observed: npt.ArrayLike) -> float:
    """Return √mean‖v̂ − v‖² over samples (n, d), per second; per sample the norm counts, not per axis."""
    difference = np.asarray(predicted, dtype=np.float64) - np.asarray(observed, dtype=np.float64)
    return float(np.sqrt(np.mean(np.sum(difference**2, axis=1))))


def end_error(positions: npt.ArrayLike, target: npt.ArrayLike) -> float:
    """Return how far the last of the positions (T, d) lies from the target (d,)."""
    return float(np.linalg.norm(_curve(positions)[-1] - np.asarray(target, dtype=np.float64)))


def _pairwise_distances(first: npt.ArrayLike, second: npt.ArrayLike, count: int) -> FloatArray | None:
    """Return the distances between all points of the resampled curves; None if one diverged."""
    a, b = _curve(first), _curve(second)
    if a.shape[1] != b.shape[1]:
        raise UsageError(f"curves: {a.shape[1]} and {b.shape[1]} dimensions cannot be compared.")
    if not (np.abs(a).max() < DIVERGED and np.abs(b).max() < DIVERGED):  # false for NaN, too
        return None
    a, b = resample_by_arc_length(a, count), resample_by_arc_length(b, count)
    return np.asarray(np.linalg.norm(a[:, None] - b, axis=2))


def _alignment_table(costs: FloatArray) -> FloatArray:
    """Return the cost of the best matching up to every pair of points, by anti-diagonals.

    D(i, j) = C(i, j) + min(D(i−1, j−1), D(i−1, j), D(i, j−1)). The entries of one anti-diagonal i + j
    depend on the two before alone, so each anti-diagonal is one vector operation.

    Args:
        costs: C, shape (N, M).

    Returns:
        Shape (N + M, N + 1): entry [i + j + 1, i + 1] holds D(i, j); infinite outside the table.
    """
    rows, columns = costs.shape
    skewed = np.full((rows, rows + columns), np.inf)
    skewed[:, :columns] = costs
    # Read with rows one shorter than they are, each row starts one place further right than the last.
    diagonals = np.ascontiguousarray(skewed.ravel()[:-rows].reshape(rows, rows + columns - 1).T)
    table = np.full((rows + columns, rows + 1), np.inf)
    table[1, 1] = costs[0, 0]
    for k in range(1, rows + columns - 1):
        best = np.minimum(table[k, 1:], table[k, :-1])
        np.minimum(best, table[k - 1, :-1], out=best)
        np.add(best, diagonals[k], out=table[k + 1, 1:])
    return table


def _path_length(table: FloatArray) -> int:
    """Return the number of pairs on the best matching of one alignment table (N + M, N + 1).

    Of equally good predecessors the diagonal one is taken, then the one that stays on the second curve.
    """
    diagonal, row = table.shape[0] - 1, table.shape[1] - 1
    length = 1
    while diagonal > 1:
        both, first, second = (
            table[diagonal - 2, row - 1],
            table[diagonal - 1, row - 1],
            table[diagonal - 1, row],
        )
        if both <= first and both <= second:
            diagonal, row = diagonal - 2, row - 1
        elif first <= second:
            diagonal, row = diagonal - 1, row - 1
        else:
            diagonal -= 1
        length += 1
    return length


def _curve(positions: npt.ArrayLike) -> FloatArray:
    curve = np.asarray(positions, dtype=np.float64)
    if curve.ndim != 2 or not curve.size:
        raise UsageError(f"curve: expected positions of shape (T, d), got {curve.shape}.")
    return curve
