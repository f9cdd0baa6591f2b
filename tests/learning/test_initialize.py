"""Where learning starts: partitions by time, by path and by clusters, on motions cut by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.cluster.vq import vq

from skillctl.learning.initialize import kmeans, partitions
from skillctl.learning.preprocess import TrainingData


def motion(*paths: list[float]) -> TrainingData:
    """Motions along one axis, one unit of time a sample."""
    positions = np.array(paths)[..., None]
    velocities = np.gradient(positions, axis=1)
    return TrainingData(positions, velocities, np.ones(len(paths)), 1.0, 1.0, np.zeros(1))


def test_the_first_partition_cuts_the_time_and_the_second_the_path_into_equal_parts() -> None:
    # Four units of path in the first two steps, then four steps of one unit.
    data = motion([8, 6, 4, 3, 2, 1, 0], [80, 60, 40, 30, 20, 10, 0])
    by_time, by_path = partitions(data, 2, 2, seed=0)
    assert by_time.tolist() == [0, 0, 0, 1, 1, 1, 1] * 2  # half of the time is at the fourth sample
    assert by_path.tolist() == [0, 0, 1, 1, 1, 1, 1] * 2  # half of the path is at the third


def test_a_motion_without_length_lies_in_the_first_part_of_the_path() -> None:
    _, by_path = partitions(motion([3, 2, 1, 0], [0, 0, 0, 0]), 3, 2, seed=0)
    assert by_path.tolist() == [0, 1, 2, 2, 0, 0, 0, 0]


def test_partitions_that_leave_a_label_out_are_dropped() -> None:
    assert partitions(motion([2, 1, 0]), 4, 5, seed=0) == []
    assert len(partitions(motion([4, 3, 2, 1, 0]), 3, 2, seed=0)) == 2


@pytest.mark.parametrize("seed", range(3))
def test_kmeans_ends_where_every_point_has_the_nearest_mean(seed: int) -> None:
    generator = np.random.default_rng(seed)
    points = np.vstack(
        [centre + 0.3 * generator.standard_normal((40, 2)) for centre in ([0, 0], [2, 0], [0, 3])]
    )
    labels = kmeans(points, 3, np.random.default_rng(seed), iterations=100)
    means = np.stack([points[labels == label].mean(axis=0) for label in range(3)])
    np.testing.assert_array_equal(vq(points, means)[0], labels)


def test_seeds_of_kmeans_are_drawn_by_their_squared_distances() -> None:
    # Two points a hundred times as far as the two clumps are wide: each gets a seed of its own, always.
    points = np.vstack([np.random.default_rng(0).standard_normal((50, 2)), [[1e3, 0], [0, 1e3]]])
    for seed in range(20):
        labels = kmeans(points, 3, np.random.default_rng(seed), iterations=1)
        assert len(set(labels[-2:].tolist()) | {int(labels[0])}) == 3
        assert (labels[:50] == labels[0]).all()
