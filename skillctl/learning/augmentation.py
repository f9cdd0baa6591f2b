"""Augmentation: copies of demonstrations that start beside them, where nothing was recorded."""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.geometry import SHORTEST, path_length, phases
from skillctl.learning.preprocess import TrainingData

SLOW = 0.3  # in rms speeds: slower samples have no distant copies; tuned on the 30 LASA motions


def displaced_paths(paths: FloatArray, distance: float, share: float) -> tuple[FloatArray, FloatArray]:
    """Return the demonstrations and displaced copies of them, with the weight of each, summing to one.

    A copy starts behind and beside the demonstration, on either side, and its offset falls in proportion to
    the share of path left. (Ahead of a start there is the demonstration itself.) Without such copies a fit
    may repeat the motion from the recorded start, and go astray from a start one millimetre beside it. There
    are two copies in up to three dimensions, and two more for every two further ones: with two alone, poses
    that were left out were missed by half as much again.

    Args:
        paths: Demonstrations, shape (D, T, d).
        distance: How far beside the recorded starts copies start, in rms distances; 0 makes no copies.
        share: Share of the total weight that all copies together have.

    Returns:
        Paths, shape (D, T, d) or, with n pairs of copies, ((1 + 2n) D, T, d), and their weights.
    """
    count, _, d = paths.shape
    if distance == 0:
        return paths, np.full(count, 1 / count)
    initial = _directions(paths[:, paths.shape[1] // 10] - paths[:, 0])
    left = (1.0 - phases(paths))[..., None]
    generator, taken, shifts = np.random.default_rng(0), [initial], []
    for _ in range(max(1, d // 2)):
        # A random direction of fixed seed, perpendicular to the first tenth of the path and to the others.
        across = generator.standard_normal((count, d))
        for direction in taken:
            across = across - (across * direction).sum(axis=1, keepdims=True) * direction
        taken.append(across := _directions(across))
        shifts += [distance * (sign * across - initial)[:, None] * left for sign in (1.0, -1.0)]
    copies, number = np.concatenate([paths, *(paths + shift for shift in shifts)]), len(shifts) * count
    return copies, np.repeat([(1 - share) / count, share / number], [count, number])


def distant_samples(data: TrainingData, distances: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities on copies of the demonstrations that start far beside them.

    The offset of a copy falls as the square of the share of path left, so that its last stretch, where a
    grasp needs accuracy, nearly equals the demonstrated one. Each demonstration has two copies on opposite
    sides for every distance, in a random direction of its own, or in several if there are fewer than d
    demonstrations. Samples of a slow stretch, as at the start of a motion, have no copies: a motion that
    begins far away should not begin slowly.

    Args:
        data: Demonstrations.
        distances: How far from their starts copies start, in rms distances.

    Returns:
        Both of shape (n, d).
    """
    paths, velocities = data.positions, data.velocities
    count, _, d = paths.shape
    speeds = np.linalg.norm(velocities, axis=2, keepdims=True)
    moving = speeds[..., 0] >= SLOW
    left = (1.0 - phases(paths))[..., None]
    # d(left²)/dt = −2 left · speed / length: what the closing in adds to the velocity of a copy.
    closing = 2 * left * speeds / np.maximum(path_length(paths), SHORTEST)[:, None, None]
    copies = [(np.empty((0, d)), np.empty((0, d)))]
    for distance in distances:
        generator = np.random.default_rng(1)
        for _ in range(-(-d // count)):
            aside = distance * _directions(generator.standard_normal((count, d)))[:, None]
            for shift in (aside, -aside):
                copies.append(((paths + shift * left**2)[moving], (velocities - shift * closing)[moving]))
    positions, targets = zip(*copies, strict=True)
    return np.concatenate(positions), np.concatenate(targets)


def _directions(vectors: FloatArray) -> FloatArray:
    """Return the unit vectors of vectors (n, d); zero vectors stay zero."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), SHORTEST))
