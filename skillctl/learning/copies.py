"""Copies of demonstrations that start beside them: what a field should do where nothing was shown."""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.learning.preprocess import TrainingData

DAWDLING = 0.3  # rms speeds


def displaced(paths: FloatArray, distance: float, share: float) -> tuple[FloatArray, FloatArray]:
    """Return the demonstrations and displaced copies of them, with the weight of each, summing to one.

    A copy starts behind and beside the demonstration, on either side, and closes in on it as the share of
    path left. (Ahead of a start the demonstration itself shows the way.) Without such copies a fit may
    hold its trajectories on a knife's edge: right from the recorded start, lost a millimetre beside it.

    Args:
        paths: Demonstrations, shape (D, T, d).
        distance: How far beside the recorded starts copies start, in rms distances; 0 makes no copies.
        share: Of the weight, that all copies together have.

    Returns:
        Paths, shape (D or 3 D, T, d), and their weights.
    """
    count, _, d = paths.shape
    if distance == 0:
        return paths, np.full(count, 1 / count)
    initial = _directions(paths[:, paths.shape[1] // 10] - paths[:, 0])
    across = np.random.default_rng(0).standard_normal((count, d))
    across = _directions(across - (across * initial).sum(axis=1, keepdims=True) * initial)
    left = (1.0 - phases(paths))[..., None]
    shifts = [distance * (sign * across - initial)[:, None] * left for sign in (1.0, -1.0)]
    copies = np.concatenate([paths, *(paths + shift for shift in shifts)])
    return copies, np.repeat([(1 - share) / count, share / (2 * count)], [count, 2 * count])


def copies_beyond(data: TrainingData, distances: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities on copies of the demonstrations that start far beside them.

    A copy closes in on its demonstration as the square of the share of path left: the last stretch, where a
    hand comes to what it grasps, is all but the demonstrated one. Each demonstration has two on opposite
    sides for every distance, in a random direction of its own; where there are few demonstrations, in
    several, so that at least d directions are taken. Where a demonstration dawdles, as at its start, its
    copies do not count: whatever begins far away has far to go.

    Args:
        data: Demonstrations.
        distances: How far from their starts copies start, in rms distances.

    Returns:
        Both of shape (n, d).
    """
    paths, velocities = data.positions, data.velocities
    count, _, d = paths.shape
    speeds = np.linalg.norm(velocities, axis=2, keepdims=True)
    moving = speeds[..., 0] >= DAWDLING
    lengths = np.linalg.norm(np.diff(paths, axis=1), axis=2).sum(axis=1)
    left = (1.0 - phases(paths))[..., None]
    closing = 2 * left * speeds / np.maximum(lengths, 1e-12)[:, None, None]
    copies = [(np.empty((0, d)), np.empty((0, d)))]
    for distance in distances:
        generator = np.random.default_rng(1)
        for _ in range(-(-d // count)):
            aside = distance * _directions(generator.standard_normal((count, d)))[:, None]
            for shift in (aside, -aside):
                copies.append(((paths + shift * left**2)[moving], (velocities - shift * closing)[moving]))
    positions, shown = zip(*copies, strict=True)
    return np.concatenate(positions), np.concatenate(shown)


def _directions(vectors: FloatArray) -> FloatArray:
    """Return vectors (n, d) at length one; those of no length stay."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))


def phases(paths: FloatArray) -> FloatArray:
    """Return the share of the path length covered at each point of paths (D, T, d). Shape (D, T)."""
    lengths = np.linalg.norm(np.diff(paths, axis=1), axis=2)
    covered = np.concatenate([np.zeros((len(paths), 1)), np.cumsum(lengths, axis=1)], axis=1)
    return np.asarray(covered / np.maximum(covered[:, -1:], 1e-12))
