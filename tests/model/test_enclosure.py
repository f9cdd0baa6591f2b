"""Enclosures hold every image of a box, by sampling and by fractions, and are hardly larger than needed."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from skillctl.model.coordinates.chain import IDENTITY, Chain
from skillctl.model.coordinates.enclosure import Enclosure, inverse_with_error
from skillctl.model.coordinates.shears import Shears


def random_boxes(rng: np.random.Generator, d: int, side: float, n: int = 200) -> Any:
    low = rng.normal(0, 1, (n, d))
    return low, low + rng.uniform(0, side, (n, d))


def samples(rng: np.random.Generator, low: Any, high: Any, n: int = 200) -> Any:
    """Return points of each box, its corners at both ends among them. Shape (boxes, n, d)."""
    shares = rng.uniform(0, 1, (len(low), n, low.shape[1]))
    shares[:, 0], shares[:, 1] = 0, 1
    return low[:, None] + shares * (high - low)[:, None]


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("d", [2, 3])
def test_a_chain_of_shears_and_its_inverse_keep_all_points_of_a_box(make_shears, d, scale):
    rng = np.random.default_rng(d)
    link = make_shears(rng, d, scale=scale)
    for side in (0.0, 1e-6, 0.05, 3.0):
        low, high = (scale * corner for corner in random_boxes(rng, d, side))
        for image, bounds in ((link.forward, link.bounds_forward), (link.back, link.bounds_back)):
            points = samples(rng, low, high)
            images = image(points.reshape(-1, d)).reshape(points.shape)
            least, most = bounds(low, high)
            assert (least[:, None] <= images).all()
            assert (images <= most[:, None]).all()


def test_the_overestimation_vanishes_with_the_square_of_the_size(make_shears):
    rng = np.random.default_rng(0)
    link = make_shears(rng, 2)
    centres = rng.normal(0, 0.5, (100, 2))
    excess = []
    for side in (4e-3, 2e-3, 1e-3):
        low, high = centres - side / 2, centres + side / 2
        corners = np.stack([low, high, np.c_[low[:, 0], high[:, 1]], np.c_[high[:, 0], low[:, 1]]], axis=1)
        images = link.forward(corners.reshape(-1, 2)).reshape(corners.shape)
        least, most = link.bounds_forward(low, high)
        excess.append(((most - least) - np.ptp(images, axis=1)).max())  # of a linear map: zero
    # Halving the side quarters the excess; the rest is of third order.
    assert excess[0] / excess[1] == pytest.approx(4, rel=0.1)
    assert excess[1] / excess[2] == pytest.approx(4, rel=0.1)


def test_a_matrix_is_enclosed_as_its_fractions_are():
    rng = np.random.default_rng(1)
    matrix = rng.normal(size=(3, 3))
    low, high = random_boxes(rng, 3, 1e-15, 50)
    least, most = Enclosure.of(low, high).multiplied(matrix).box()
    rows = [[Fraction(entry) for entry in row] for row in matrix.tolist()]
    for corner in (low, high):
        for point, below, above in zip(corner.tolist(), least.tolist(), most.tolist(), strict=True):
            image = [sum(a * Fraction(x) for a, x in zip(row, point, strict=True)) for row in rows]
            assert all(l <= v <= h for l, v, h in zip(below, image, above, strict=True))  # noqa: E741


@pytest.mark.parametrize("small", [1.0, 1e-3, 1e-6])
def test_the_error_of_an_inverse_is_bounded_as_its_fractions_say(small):
    rng = np.random.default_rng(2)
    for _ in range(50):
        matrix = rng.normal(size=(2, 2)) @ np.diag([1.0, small])
        (a, b), (c, d) = [[Fraction(v) for v in row] for row in matrix.tolist()]
        determinant = a * d - b * c
        exact = [d / determinant, -b / determinant, -c / determinant, a / determinant]
        inverse, error = inverse_with_error(matrix)
        for value, found, bound in zip(exact, inverse.ravel(), error.ravel(), strict=True):
            assert abs(value - Fraction(float(found))) <= bound
        assert error.max() <= 1e-3 * np.abs(inverse).max()


def test_of_a_matrix_that_may_be_singular_nothing_is_known():
    matrix = np.array([[1.0, 1.0], [1.0, 1.0 + 2.0**-50]])
    with np.errstate(all="ignore"):
        unknown = Enclosure.of(np.zeros((1, 2)), np.ones((1, 2))).multiplied(*inverse_with_error(matrix))
        low, high = unknown.box()
    assert np.isneginf(low).all()
    assert np.isposinf(high).all()


def test_numbers_beyond_float64_give_the_whole_space():
    low = np.full((1, 2), -np.inf)
    with np.errstate(all="ignore"):
        for box in ((low, -low), (np.zeros((1, 2)), np.full((1, 2), 1e308))):
            below, above = Enclosure.of(*box).multiplied(np.full((2, 2), 1e200)).box()
            assert np.isneginf(below).all()
            assert np.isposinf(above).all()


def test_chains_put_links_one_after_the_other(make_shears):
    rng = np.random.default_rng(3)
    one, two = make_shears(rng, 2), make_shears(rng, 2)
    low, high = random_boxes(rng, 2, 0.1)
    points = samples(rng, low, high)
    for image, bounds in (
        (Chain((one, two)).forward, Chain((one, two)).bounds_forward),
        (Chain((one, two)).back, Chain((one, two)).bounds_back),
    ):
        images = image(points.reshape(-1, 2)).reshape(points.shape)
        least, most = bounds(low, high)
        assert ((least[:, None] <= images) & (images <= most[:, None])).all()
    assert IDENTITY.bounds_forward(low, high) == (low, high)
    assert IDENTITY.bounds_back(low, high) == (low, high)


def test_slopes_are_bounded_over_any_stretch_and_exactly_over_a_long_one(make_shears):
    """The slopes of a shear across the first axis, by differences of what it adds."""
    rng = np.random.default_rng(4)
    coefficients = np.stack([np.zeros(5), rng.normal(size=5)], axis=1)[None]
    link = Shears(np.eye(2), [[2.0, 0.0]], [-1.0], [0.5], coefficients)
    t = np.linspace(-3, 3, 20_001)  # of x; w·x is twice that, and the bumps span −2 to 2 of it
    added = link.forward(np.c_[t, 0 * t])[:, 1]
    slopes = np.diff(added) / np.diff(2 * t)
    (shear,) = link.shears
    for middle, reach in ((0.0, 6.0), (0.3, 0.2), (-1.0, 0.5), (1.9, 0.01), (4.0, 0.5), (-2.1, 0.3)):
        inside = slopes[np.abs(t[1:] + t[:-1] - middle) <= reach]
        least, most = (bound[0, 1] for bound in shear.slope_bounds(np.array([middle]), np.array([reach])))
        assert least <= inside.min()
        assert most >= inside.max()
        if reach == 6.0:  # a difference is a slope somewhere between: it misses by the grid times |a″|
            assert least == pytest.approx(inside.min(), abs=1e-3)
            assert most == pytest.approx(inside.max(), abs=1e-3)


@pytest.mark.parametrize("side", [0.01, 0.05, 0.2])
def test_where_shears_across_two_axes_alternate_no_image_is_lost(side):
    rng = np.random.default_rng(5)
    for _ in range(10):
        directions, coefficients = np.tile(np.eye(2), (2, 1)), rng.normal(0, 0.5, (4, 5, 2))
        link = Shears(np.eye(2), directions, np.full(4, -1.0), np.full(4, 0.5), coefficients)
        centres = rng.uniform(-1, 1, (200, 2))
        shares = rng.choice([-0.5, -0.25, 0.0, 0.25, 0.5], size=(1, 300, 2))
        images = link.forward((centres[:, None] + side * shares).reshape(-1, 2)).reshape(200, 300, 2)
        least, most = link.bounds_forward(centres - side / 2, centres + side / 2)
        assert ((least[:, None] <= images) & (images <= most[:, None])).all()
