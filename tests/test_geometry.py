"""Polylines, boxes and norms, on figures whose measures are known."""

from __future__ import annotations

import numpy as np
import pytest

from skillctl import geometry

# Right angles with legs 3, 4 and 12; the second path rests at its corner and ends there.
PATHS = np.array([[[0.0, 0], [3, 0], [3, 4], [15, 4]], [[1.0, 1], [4, 1], [4, 1], [4, 5]]])


def test_lengths_along_polylines_are_sums_of_their_segments() -> None:
    assert geometry.segment_lengths(PATHS).tolist() == [[3, 4, 12], [3, 0, 4]]
    assert geometry.path_length(PATHS).tolist() == [19, 7]
    assert geometry.arc_lengths(PATHS).tolist() == [[0, 3, 7, 19], [0, 3, 3, 7]]
    assert geometry.arc_lengths(PATHS[0]).tolist() == [0, 3, 7, 19]
    assert geometry.path_length(PATHS[0]) == 19


def test_phases_are_shares_of_the_length() -> None:
    np.testing.assert_array_equal(
        geometry.phases(PATHS), np.array([[0, 3, 7, 19], [0, 3, 3, 7]]) / [[19], [7]]
    )
    assert geometry.phases(np.ones((4, 3))).tolist() == [0, 0, 0, 0]  # a path that rests has covered nothing


def test_resampled_points_are_equally_far_apart_along_the_path() -> None:
    points = geometry.resample_by_arc_length(PATHS[1], 8)
    assert points.tolist() == [[1, 1], [2, 1], [3, 1], [4, 1], [4, 2], [4, 3], [4, 4], [4, 5]]


def test_a_box_and_its_diagonal() -> None:
    low, high = geometry.box(PATHS[0])
    assert (low.tolist(), high.tolist()) == ([0, 0], [15, 4])
    assert geometry.extent(np.array([[6.0, 2, 2], [5, 0, 0], [5.5, 1, 2]])) == 3


@pytest.mark.parametrize("d", [1, 2, 5])
def test_a_norm_is_the_euclidean_one_after_a_change_of_coordinates(d: int) -> None:
    generator = np.random.default_rng(d)
    root = generator.standard_normal((d, d))
    offsets = generator.standard_normal((4, 6, d))
    expected = np.linalg.norm(offsets @ root.T, axis=-1)
    # Sums of d² products of numbers near one.
    np.testing.assert_allclose(geometry.norms(offsets, root.T @ root), expected, rtol=1e-12)
    np.testing.assert_allclose(geometry.squared_norms(offsets, root.T @ root), expected**2, rtol=1e-12)
    assert geometry.norms(np.zeros(d), np.eye(d)) == 0
