"""Geometry that many rooms need: polylines, boxes and quadratic norms.

A polyline is an array of points (..., T, d): T points in d dimensions, in the order of the path.
"""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray

SHORTEST = 1e-12  # a shorter path counts as this long where its length is divided by


def segment_lengths(path: FloatArray) -> FloatArray:
    """Return the distances between neighbouring points of polylines (..., T, d). Shape (..., T − 1)."""
    return np.asarray(np.linalg.norm(np.diff(path, axis=-2), axis=-1))


def path_length(path: FloatArray) -> FloatArray:
    """Return the lengths of polylines (..., T, d). Shape (...)."""
    return np.asarray(segment_lengths(path).sum(axis=-1))


def arc_lengths(path: FloatArray) -> FloatArray:
    """Return the length covered up to each point of polylines (..., T, d). Shape (..., T)."""
    covered = np.cumsum(segment_lengths(path), axis=-1)
    return np.concatenate([np.zeros((*covered.shape[:-1], 1)), covered], axis=-1)


def phases(path: FloatArray) -> FloatArray:
    """Return the share of its length that each polyline (..., T, d) has covered at each point.

    Returns:
        Shape (..., T), from 0 at the first point to 1 at the last; zero throughout for a path that rests.
    """
    covered = arc_lengths(path)
    return np.asarray(covered / np.maximum(covered[..., -1:], SHORTEST))


def resample_by_arc_length(path: FloatArray, count: int) -> FloatArray:
    """Return points equally spaced in arc length along one polyline.

    Timing drops out: two runs along one path at different speeds give the same points.

    Args:
        path: Shape (T, d). Rests (repeated points) are passed over.
        count: Number of points, at least 2.

    Returns:
        Shape (count, d); first and last point are those of the path.
    """
    moved = np.concatenate([[True], segment_lengths(path) > 0])
    corners = path[moved]
    arc = arc_lengths(corners)
    wanted = np.linspace(0.0, arc[-1], count)
    return np.stack([np.interp(wanted, arc, column) for column in corners.T], axis=1)


def box(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest coordinates of points (n, d), each of shape (d,)."""
    return points.min(axis=0), points.max(axis=0)


def extent(points: FloatArray) -> float:
    """Return the length of the diagonal of the box around points (n, d), in their unit."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def squared_norms(offsets: FloatArray, matrix: FloatArray) -> FloatArray:
    """Return eᵀPe for offsets e (..., d) and a symmetric positive definite matrix P (d, d). Shape (...)."""
    return np.asarray(np.einsum("...i,ij,...j->...", offsets, matrix, offsets))


def norms(offsets: FloatArray, matrix: FloatArray) -> FloatArray:
    """Return ‖e‖_P = √(eᵀPe), as ``squared_norms``; zero where rounding makes the square negative."""
    return np.asarray(np.sqrt(np.maximum(squared_norms(offsets, matrix), 0.0)))
