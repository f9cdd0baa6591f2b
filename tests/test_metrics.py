"""Distances between curves, against recursion, closed forms and invariances."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from skillctl import metrics, rotations
from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.geometry import resample_by_arc_length

EPS = np.finfo(np.float64).eps
# Half precision keeps drawn coordinates far from underflow, so relative bounds are enough.
coordinates = st.floats(-100, 100, width=16)


def curves(dimension: int, longest: int = 12) -> st.SearchStrategy[FloatArray]:
    shapes = st.tuples(st.integers(2, longest), st.just(dimension))
    return shapes.flatmap(lambda shape: hnp.arrays(np.float64, shape, elements=coordinates))


def best_matching(a: FloatArray, b: FloatArray) -> tuple[float, set[int]]:
    """The smallest sum over all monotone matchings, and the lengths of all that reach it: by recursion."""

    @cache
    def best(i: int, j: int) -> tuple[float, frozenset[int]]:
        here = float(np.sqrt(((a[i] - b[j]) ** 2).sum()))
        if i == j == 0:
            return here, frozenset({1})
        before = [best(*ij) for ij in ((i - 1, j - 1), (i - 1, j), (i, j - 1)) if min(ij) >= 0]
        least = min(total for total, _ in before)
        slack = 64 * EPS * (1 + least)  # sums of at most 23 terms, ordered differently
        lengths = {n + 1 for total, ns in before if total <= least + slack for n in ns}
        return here + least, frozenset(lengths)

    total, lengths = best(len(a) - 1, len(b) - 1)
    return total, set(lengths)


def rotation(dimension: int, seed: int) -> FloatArray:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(dimension, dimension)))
    return q


def path(dimension: int, seed: int, count: int = 80) -> FloatArray:
    """A random smooth path of some decimetres."""
    t = np.linspace(0, 1, count)[:, None]
    a = np.random.default_rng(seed).normal(size=(4, dimension)) * 0.2
    return a[0] + a[1] * t + a[2] * t**2 + 0.5 * a[3] * np.sin(5 * t)


# ------------------------------------------------------------------------------------- resampling


@given(st.data(), st.integers(1, 4), st.integers(2, 30))
def test_resampled_points_are_equally_spaced_along_the_curve(data: st.DataObject, d: int, count: int) -> None:
    curve = data.draw(curves(d))
    points = resample_by_arc_length(curve, count)

    corners = np.concatenate([[0.0], np.cumsum(np.sqrt((np.diff(curve, axis=0) ** 2).sum(1)))])
    # Each point lies at its arc length: on the segment whose ends bracket it, at the right fraction.
    for k, point in enumerate(points):
        s = corners[-1] * k / (count - 1)
        i = min(int(np.searchsorted(corners, s, side="right")), len(curve) - 1)
        length = corners[i] - corners[i - 1]
        fraction = (s - corners[i - 1]) / length if length else 0.0
        expected = curve[i - 1] + fraction * (curve[i] - curve[i - 1])
        # Arc lengths sum at most 11 segments of at most 400; a rounded s moves the point as far.
        assert np.abs(point - expected).max() <= 64 * EPS * (100 + corners[-1])


def test_resampling_ignores_timing_and_rests() -> None:
    corners = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0]])
    slow = np.repeat(corners, [4, 1, 3], axis=0)
    expected = [[0, 0], [1, 0], [2, 0], [3, 0], [3, 1]]
    assert resample_by_arc_length(slow, 5).tolist() == expected


def test_a_curve_that_rests_throughout_is_one_point_repeated() -> None:
    assert resample_by_arc_length(np.full((4, 3), 0.5), 3).tolist() == [[0.5] * 3] * 3


# ------------------------------------------------------------------------------------- DTW


@settings(max_examples=60)
@given(st.data(), st.integers(1, 3), st.integers(2, 12))
def test_dtw_is_the_mean_over_a_best_monotone_matching(data: st.DataObject, d: int, count: int) -> None:
    a, b = data.draw(curves(d)), data.draw(curves(d))
    distance = metrics.dtw(a, b, count)

    points = resample_by_arc_length(a, count), resample_by_arc_length(b, count)
    total, lengths = best_matching(*points)
    # Among matchings of (nearly) equal sum any may be taken; 64: sums of at most 23 terms.
    assert min(abs(distance * n - total) for n in lengths) <= 64 * EPS * (1 + total)


def test_parallel_lines_are_their_offset_apart() -> None:
    a = np.stack([np.linspace(0, 10, 300), np.zeros(300), np.zeros(300)], axis=1)
    b = a + np.array([0.0, 3.0, 4.0])
    assert metrics.dtw(a, b) == pytest.approx(5.0, rel=8 * 200 * EPS)  # a sum of 200 equal terms


def test_matching_is_a_path_of_its_own_length() -> None:
    # Resampled to 3 points: 0, 2, 4 and 0, 0, 0. The best matching visits (0,0), (0,1), (1,2), (2,2):
    # sum 6; all matchings reach 6 or more, the shortest with 6 has 3 pairs.
    a, b = np.array([[0.0], [4.0]]), np.zeros((2, 1))
    total, lengths = best_matching(np.array([[0.0], [2.0], [4.0]]), np.zeros((3, 1)))
    assert (total, lengths) == (6.0, {3, 4, 5})
    assert metrics.dtw(a, b, 3) == 2.0  # ties are broken towards the diagonal: three pairs


@pytest.mark.parametrize("dimension", [2, 3, 6])
def test_dtw_is_invariant_and_zero_for_equal_curves(dimension: int) -> None:
    a, b = path(dimension, 1), path(dimension, 2, count=60)
    distance = metrics.dtw(a, b)
    q, shift = rotation(dimension, 3), np.full(dimension, 0.4)
    rounding = 1e3 * EPS  # sums of up to 400 terms of one sign; rotated coordinates round once more
    assert distance > 0.01
    assert metrics.dtw(a, a) == 0.0
    # Ties between matchings of equal sum but unequal length do not occur in general position.
    assert metrics.dtw(b, a) == pytest.approx(metrics.dtw(a[::-1], b[::-1]), rel=rounding)
    assert metrics.dtw(a @ q + shift, b @ q + shift) == pytest.approx(distance, rel=rounding)
    assert metrics.dtw(1e3 * a, 1e3 * b) == pytest.approx(1e3 * distance, rel=rounding)
    assert metrics.dtw(b, a) == pytest.approx(distance, rel=rounding)


# ------------------------------------------------------------------------------------- velocities, ends


def test_velocity_error_counts_the_norm_of_each_sample() -> None:
    observed = np.array([[3.0, 4.0], [0.0, 0.0]])
    predicted = observed + np.array([[1.0, 0.0], [0.0, -1.0]])
    assert metrics.velocity_rmse(predicted, observed) == 1.0


def test_end_error_is_the_last_points_distance_to_the_target() -> None:
    assert metrics.end_error([[9.0, 9.0], [3.0, 4.0]], [0.0, 0.0]) == 5.0


# ------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e80])
def test_a_curve_that_diverged_is_infinitely_far(bad: float) -> None:
    a = path(2, 1)
    diverged = a.copy()
    diverged[-1, 0] = bad
    assert metrics.dtw(a, diverged) == metrics.dtw(diverged, a) == np.inf


def test_curves_that_cannot_be_compared_are_refused() -> None:
    with pytest.raises(UsageError, match="2 and 3 dimensions"):
        metrics.dtw(path(2, 1), path(3, 1))
    with pytest.raises(UsageError, match=r"shape \(T, d\)"):
        metrics.dtw(np.zeros(5), np.zeros(5))


def test_orientations_beside_each_other_are_that_angle_apart() -> None:
    """R_z(t) and R_z(t) R_x(0.1) are 0.1 rad apart, and R_z(s) R_x(0.1) is nowhere nearer to R_z(t)."""
    turns = np.outer(np.linspace(0, 5, 60), [0.0, 0.0, 1.0])  # more than half a turn
    tilted = rotations.product(rotations.quaternions(turns), rotations.quaternions(np.array([0.1, 0.0, 0.0])))
    wrapped = rotations.vectors(tilted)
    assert np.abs(np.diff(wrapped, axis=0)).max() > 1  # its vectors jump where the rotation does not
    # Between samples 0.085 rad apart a chord replaces the arc: relative error of its square over 8.
    assert metrics.dtw_angle(turns, wrapped) == pytest.approx(0.1, rel=0.085**2 / 8)
    assert metrics.dtw_angle(turns, rotations.vectors(rotations.quaternions(turns))) < 1e-6
    assert metrics.dtw_angle(np.full((3, 3), np.nan), turns) == np.inf
