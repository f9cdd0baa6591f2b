"""The search for shears: its slope, what it finds, and what a skill in them is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.interpolate import BSpline

from skillctl.learning.fit import Distance, fit, learned_distance
from skillctl.learning.lyapunov import deviation_bound, learn_lyapunov
from skillctl.learning.options import LearnOptions
from skillctl.learning.preprocess import align, training_data
from skillctl.learning.shears import _bending, _Search, bump_values, directions, learn_shears, samples_of
from skillctl.model.coordinates.chain import Chain
from skillctl.model.coordinates.shears import Shears
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.rollout import rollout
from skillctl.model.seds import SedsSkill
from skillctl.stability.certificate import certify

Curved = Callable[..., DemonstrationSet]
FAST = LearnOptions(preset="fast")


def hooks(count: int = 4, samples: int = 60) -> np.ndarray:
    """Motions that swing far out before they come back: V = ‖x‖² rises on a good part of them."""
    t = np.linspace(0, 1, samples)
    rng = np.random.default_rng(0)
    angle = 2.6 * (1 - t) ** 1.5
    radius = 1.2 * np.sin(np.pi * (1 - t) ** 0.7) + 0.3 * (1 - t)
    path = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return path * rng.uniform(0.9, 1.1, (count, 1, 2))


def test_bumps_and_their_products_are_those_of_splines() -> None:
    places = np.linspace(-2.5, 2.5, 501)
    spline = BSpline.basis_element(np.arange(-2, 3), extrapolate=False)
    values, slopes = bump_values(places)
    np.testing.assert_allclose(values, np.nan_to_num(spline(places)), atol=1e-14)
    np.testing.assert_allclose(slopes, np.nan_to_num(spline.derivative()(places)), atol=1e-14)
    fine = np.linspace(-3, 9, 240_001)
    slopes = np.stack([bump_values(fine - centre)[1] for centre in range(7)])
    np.testing.assert_allclose(_bending(7), slopes @ slopes.T * (fine[1] - fine[0]), atol=1e-9)


@pytest.mark.parametrize(("dimension", "count"), [(2, 6), (3, 6), (4, 4), (7, 7)])
def test_directions_are_unit_vectors_apart_from_each_other(dimension: int, count: int) -> None:
    found = directions(dimension)
    assert found.shape == (count, dimension)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, rtol=1e-15)
    cosines = np.abs(found @ found.T - np.eye(count)).max()
    assert cosines <= np.cos(np.deg2rad(30)) + 1e-12  # space: 63 degrees; more dimensions: 90


@pytest.mark.parametrize("dimension", [2, 3, 5])
def test_the_slope_is_that_of_finite_differences(dimension: int) -> None:
    rng = np.random.default_rng(dimension)
    motion = np.cumsum(rng.normal(0, 0.1, (2, 20, dimension)), axis=1)
    motion -= motion[:, -1:]
    search = _Search([motion, 1.1 * motion[:1]], 0.05)
    parameters, step = 0.1 * rng.normal(size=search.size), 1e-6
    _, slope = search.cost_and_slope(parameters)
    for index in rng.choice(search.size, 25, replace=False):
        change = step * np.eye(1, search.size, index)[0]
        above, below = (search.cost_and_slope(parameters + sign * change)[0] for sign in (1, -1))
        assert slope[index] == pytest.approx((above - below) / (2 * step), abs=1e-8)


def test_the_search_computes_what_the_shears_do() -> None:
    search = _Search([hooks()], 0.05)
    parameters = 0.1 * np.random.default_rng(1).normal(size=search.size)
    y, _ = search.forward(parameters)
    found = search.shears(parameters).forward(search.points)
    scale = np.sqrt(np.mean((y * y).sum(axis=1)))
    np.testing.assert_allclose(found, y / scale, atol=1e-13)
    assert np.mean((found * found).sum(axis=1)) == pytest.approx(1, rel=1e-12)


def test_in_the_coordinates_found_motions_come_nearer() -> None:
    motion = hooks()
    motion = motion / np.sqrt(np.mean((motion**2).sum(axis=2)))
    plain = deviation_bound(learn_lyapunov([motion])[0], motion)
    shears, ended = learn_shears([motion])
    bent = shears.forward(motion.reshape(-1, 2)).reshape(motion.shape)
    assert plain > 0.02  # in rms distances: no ellipse suits
    assert deviation_bound(learn_lyapunov([bent])[0], bent) < 0.25 * plain
    assert ended.stage == "coordinates"
    again, _ = learn_shears([motion])
    assert again == shears


@pytest.mark.parametrize(("count", "samples"), [(1, 60), (7, 60), (14, 30), (100, 15)])
def test_many_demonstrations_are_looked_at_more_coarsely(count: int, samples: int) -> None:
    assert samples_of(count) == samples


def test_shears_are_learned_where_no_ellipse_suits(lasa: Callable[[str], DemonstrationSet]) -> None:
    bent, straight = fit(lasa("GShape"), FAST), fit(lasa("Line"), FAST)
    assert [type(link) for link in bent.skill.coordinates.links] == [Shears]
    assert straight.skill.coordinates.links == ()
    assert [result.stage for result in bent.results][:2] == ["coordinates", "metric"]
    plain = fit(lasa("GShape"), LearnOptions(preset="fast", coordinates="identity"))
    assert plain.skill.coordinates.links == ()
    assert fit(lasa("Line"), LearnOptions(preset="fast", coordinates="shears")).skill.coordinates.links
    assert bent.deviation_bound < 0.1 * plain.deviation_bound
    assert certify(bent.skill).verdict == "stable"
    starts = np.stack([each.positions[0] for each in lasa("GShape")])
    assert rollout(bent.skill, starts, duration=30.0, period=0.01).arrived.all()


def test_one_dimension_has_no_shears(curved: Curved) -> None:
    line = curved(dimension=1)
    assert fit(line, LearnOptions(preset="fast", coordinates="shears")).skill.coordinates.links == ()


def test_the_same_motion_in_another_unit_has_the_same_coordinates(curved: Curved) -> None:
    options = LearnOptions(preset="fast", coordinates="shears")
    metres, other = fit(curved(), options).skill, fit(curved(scale=1024.0), options).skill
    (one,), (two,) = metres.coordinates.links, other.coordinates.links
    assert isinstance(one, Shears)
    assert isinstance(two, Shears)
    np.testing.assert_allclose(two.coefficients, 1024 * one.coefficients, rtol=1e-6, atol=1e-9)


def test_motions_that_want_different_ellipses_are_put_under_one_distance(
    lasa: Callable[[str], DemonstrationSet],
) -> None:
    sets = [lasa("Sshape"), lasa("Angle")]
    distance = learned_distance(sets)
    assert distance.coordinates.links
    assert learned_distance(sets, "identity").coordinates.links == ()
    for motions in sets:
        skill: SedsSkill = fit(motions, FAST, distance=distance).skill
        assert skill.coordinates == distance.coordinates
        assert (skill.lyapunov == distance.lyapunov).all()
        assert certify(skill).verdict == "stable"


def test_given_coordinates_are_in_the_unit_of_the_space(curved: Curved) -> None:
    data = training_data(*align(curved()), samples=30)
    shears, _ = learn_shears([data.positions])
    given = Distance(np.eye(2), Chain((shears.in_unit(data.length_scale),)))
    found = fit(curved(), FAST, distance=given).skill.coordinates
    states = np.random.default_rng(0).normal(0, data.length_scale, (20, 2))
    np.testing.assert_allclose(found.forward(states), given.coordinates.forward(states), rtol=1e-12)
