"""Where learning starts: partitions of the data into components."""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray, IntArray
from skillctl.geometry import phases
from skillctl.learning.preprocess import TrainingData


def partitions(data: TrainingData, n_components: int, count: int, seed: int) -> list[IntArray]:
    """Return ``count`` ways to split the data into components: by time, by path, then by k-means++.

    Args:
        data: Training data of D demonstrations with T samples.
        n_components: K.
        count: Number of partitions.
        seed: Seed of k-means++.

    Returns:
        Labels 0 … K − 1 of all points, each of shape (D·T,). Partitions in which some label does not occur
        are left out, so there may be fewer than ``count``, or none.
    """
    trajectories, samples, _ = data.positions.shape
    time = np.tile(np.linspace(0, 1, samples), (trajectories, 1))
    # Both run from 0 to 1 along each demonstration and are cut into K equal parts.
    sliced = [
        np.minimum((phase * n_components).astype(np.int64), n_components - 1).ravel()
        for phase in (time, phases(data.positions))
    ]
    generator = np.random.default_rng(seed)
    points = np.hstack(data.points)
    clustered = [kmeans(points, n_components, generator) for _ in range(count - len(sliced))]
    return [labels for labels in (sliced + clustered)[:count] if len(np.unique(labels)) == n_components]


def kmeans(
    points: FloatArray, n_clusters: int, generator: np.random.Generator, iterations: int = 15
) -> IntArray:
    """Return the labels of Lloyd's iterations from k-means++ seeds, for points (N, m). Shape (N,).

    References:
        Arthur & Vassilvitskii 2007 for the seeds. A cluster that loses all its points keeps its centre.
    """
    chosen = [int(generator.integers(len(points)))]
    squared = ((points - points[chosen[0]]) ** 2).sum(axis=1)
    for _ in range(n_clusters - 1):
        total = squared.sum()
        weights = squared / total if total > 0 else np.full(len(points), 1 / len(points))
        chosen.append(int(generator.choice(len(points), p=weights)))
        squared = np.minimum(squared, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
    centres = points[chosen]
    for _ in range(iterations):
        # ‖p − c‖² without ‖p‖², which is the same for every centre.
        distances = (centres**2).sum(axis=1) - 2 * points @ centres.T
        labels = distances.argmin(axis=1)
        members = np.eye(n_clusters)[labels]
        counts = members.sum(axis=0)
        updated = np.where(counts[:, None] > 0, members.T @ points / np.maximum(counts, 1)[:, None], centres)
        if np.array_equal(updated, centres):
            break
        centres = updated
    return np.asarray(labels, dtype=np.int64)
