"""Shears: exactly invertible, with the differential and the proof that they promise."""

from dataclasses import replace
from pickle import dumps, loads

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation

from skillctl.errors import InvalidModelError
from skillctl.model.controller import Controller
from skillctl.model.coordinates.chain import Chain
from skillctl.model.coordinates.shears import SHEAR_ARRAYS, Shears
from skillctl.model.merged import MergedSkill
from skillctl.model.stepper import Stepper
from skillctl.stability.certificate import certify

EPS = np.finfo(float).eps


def shears_of(dimension, seed=0, *, size=0.3, unit=1.0, shears=6, bumps=13):
    """Shears with lengths in a unit: as bent as learned ones, in random directions."""
    rng = np.random.default_rng(seed)
    linear = np.triu(0.3 * rng.normal(size=(dimension, dimension)), 1)
    linear += np.diag(rng.uniform(0.5, 2, dimension))
    directions = rng.normal(size=(shears, dimension))
    first, spacing = np.full(shears, -2.6 * unit), np.full(shears, 0.43 * unit)
    return Shears(
        linear, directions, first, spacing, unit * size * rng.normal(size=(shears, bumps, dimension))
    )


@pytest.fixture(params=[2, 3, 6])
def shears(request):
    return shears_of(request.param)


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1.0, 1e3, 1e6])
def test_they_lead_there_and_back(shears, unit):
    there = shears.in_unit(unit)
    d = len(there.linear)
    states = np.random.default_rng(1).normal(0, 1.5 * unit, (1000, d))
    y = there.forward(states)
    # Each of the 6 shears rounds at the size of what it adds, and the way back multiplies that by at most
    # the product of the stretches: 1e4 of them for the steepest of these maps.
    size = np.abs(states).max() + np.abs(y).max()
    assert np.abs(there.back(y) - states).max() <= 1e4 * EPS * size
    assert np.abs(y - unit * shears.forward(states / unit)).max() <= 1e3 * EPS * size
    assert (there.forward(np.zeros((1, d))) == 0).all()
    assert (there.back(np.zeros((1, d))) == 0).all()


def test_far_away_they_are_linear_and_shifted(shears):
    d = len(shears.linear)
    far = 1e6 * np.random.default_rng(2).normal(size=(20, d))
    shift = shears.forward(far) - far @ shears.linear.T
    farther = shears.forward(3 * far) - 3 * far @ shears.linear.T
    assert np.abs(shift - farther).max() <= 64 * EPS * 1e8


def test_each_amount_is_the_spline_of_its_coefficients():
    """Against SciPy's B-splines, in the plane with one shear."""
    rng = np.random.default_rng(3)
    direction = np.array([0.6, 0.8])
    coefficients = rng.normal(size=(9, 2))
    shear = Shears(np.eye(2), direction[None], np.array([-1.0]), np.array([0.25]), coefficients[None])
    across = coefficients - np.outer(coefficients @ direction, direction)
    knots = -1.0 + 0.25 * np.arange(-2, 11)
    spline = BSpline(knots, across, 3, extrapolate=False)
    places = np.linspace(-0.7, 0.7, 301)  # within all knots of the basis
    states = places[:, None] * direction
    basis = [BSpline.basis_element(knots[j : j + 5], extrapolate=False) for j in range(9)]
    expected = sum(np.nan_to_num(b(places))[:, None] * c for b, c in zip(basis, across, strict=True))
    at_zero = sum(np.nan_to_num(b(0.0)) * c for b, c in zip(basis, across, strict=True))
    np.testing.assert_allclose(shear.forward(states) - states, expected - at_zero, atol=64 * EPS)
    inside = np.abs(places) < 0.24
    np.testing.assert_allclose(expected[inside], spline(places[inside]), atol=64 * EPS)


def test_velocities_are_led_back_by_the_inverse_of_the_differential(shears):
    d, step = len(shears.linear), 1e-6
    states = np.random.default_rng(4).normal(0, 1.2, (200, d))
    columns = [
        (shears.forward(states + e) - shears.forward(states - e)) / (2 * step) for e in step * np.eye(d)
    ]
    differential = np.stack(columns, axis=2)
    velocities = np.random.default_rng(5).normal(size=states.shape)
    y, pull = shears.tangent(states)
    assert (y == shears.forward(states)).all()
    led = np.einsum("nij,nj->ni", differential, pull(velocities))
    # Central differences err by step² times a third derivative, and by rounding over the step.
    assert np.abs(led - velocities).max() <= 1e-6 * np.abs(differential).max()
    np.testing.assert_allclose(np.linalg.det(differential), np.linalg.det(shears.linear), rtol=1e-6)


def test_one_state_goes_the_way_of_many(shears):
    states = np.random.default_rng(6).normal(0, 2.0, (300, len(shears.linear)))
    velocities = np.random.default_rng(7).normal(size=states.shape)
    y, pull = shears.tangent(states)
    led, size = pull(velocities), np.abs(y).max()
    for state, moved, velocity, expected in zip(states, y, velocities, led, strict=True):
        one, pull_one = shears.tangent_at(state)
        assert np.abs(one - moved).max() <= 1e3 * EPS * size
        assert (one == shears.forward_at(state)).all()
        assert np.abs(shears.back_at(one) - state).max() <= 1e4 * EPS * size
        assert np.abs(pull_one(velocity) - expected).max() <= 1e5 * EPS * np.abs(led).max()


def test_what_is_no_number_stays_none():
    shears = shears_of(2)
    states = np.array([[np.nan, 0.0], [np.inf, 0.0], [0.1, 0.2]])
    with np.errstate(invalid="ignore"):
        y, pull = shears.tangent(states)
    assert np.isfinite(y).all(axis=1).tolist() == [False, False, True]
    assert np.isfinite(pull(np.ones((3, 2)))[2]).all()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"linear": np.diag([1.0, 0.0])}, "upper triangular with a positive diagonal"),
        ({"linear": np.diag([1.0, -1.0])}, "upper triangular with a positive diagonal"),
        ({"linear": np.array([[1.0, 0], [1e-300, 1]])}, "upper triangular with a positive diagonal"),
        ({"directions": np.zeros((6, 2))}, "no direction may be zero"),
        ({"spacings": np.zeros(6)}, "spacings must be positive"),
        ({"spacings": np.full(6, -1.0)}, "spacings must be positive"),
        ({"coefficients": np.full((6, 13, 2), 1e40)}, r"stretches by more than 1e\+100"),
        ({"coefficients": np.full((6, 13, 2), 1e308)}, r"stretches by more than 1e\+100"),
        ({"linear": np.diag([1e-120, 1.0])}, r"stretches by more than 1e\+100"),
        ({"directions": np.full((6, 2), 1e-200)}, r"stretches by more than 1e\+100"),
        ({"spacings": np.full(6, 5e-324)}, r"stretches by more than 1e\+100"),
        ({"firsts": np.full(6, 1e300)}, r"stretches by more than 1e\+100"),
        ({"firsts": np.full(6, np.nan)}, "firsts: must be finite"),
        ({"directions": np.ones((5, 2))}, "expected shape"),
    ],
)
def test_what_is_no_invertible_map_is_refused(change, reason):
    shears = shears_of(2)
    given = {name: getattr(shears, name) for name in SHEAR_ARRAYS}
    with pytest.raises(InvalidModelError, match=reason):
        Shears(**{**given, **change})


def test_equal_numbers_are_equal_coordinates():
    one, same, other = shears_of(2), shears_of(2), shears_of(2, seed=1)
    assert Chain((one,)) == Chain((same,)) != Chain((other,))
    assert hash(one) == hash(same)
    assert loads(dumps(one)) == one  # as workers send them


@pytest.mark.parametrize("dimension", [2, 3])
def test_v_falls_at_every_step_up_to_the_proved_period(make_skill, dimension):
    rng = np.random.default_rng(8)
    skill = make_skill(rng, dimension=dimension, attractor=rng.normal(size=dimension))
    skill = replace(skill, coordinates=Chain((shears_of(dimension),)))
    certificate = certify(skill)
    assert certificate.verdict == "stable"
    states = skill.attractor + rng.normal(0, 2.0, (10_000, dimension))
    for share in (1.0, 0.1):
        ahead = Stepper(skill, share * certificate.period).step_many(states).states
        assert (skill.v_distance(ahead) < skill.v_distance(states)).all()


def test_v_falls_while_a_cap_is_kept(make_skill):
    rng = np.random.default_rng(9)
    skill = replace(make_skill(rng, attractor=[0.5, -0.5]), coordinates=Chain((shears_of(2),)))
    period = certify(skill).period
    controller = Controller(skill, period)
    for state in skill.attractor + rng.normal(0, 1.5, (300, 2)):
        controller.reset()
        command = controller.step(state, max_speed=0.05)
        assert np.linalg.norm(command) <= 0.05
        ahead = state + period * command
        assert skill.v_distance(ahead[None]) < skill.v_distance(state[None])


def test_the_motion_moves_with_its_target(make_skill):
    rng = np.random.default_rng(10)
    skill = replace(make_skill(rng, attractor=[0.0, 0.0]), coordinates=Chain((shears_of(2),)))
    states, offset = rng.normal(size=(50, 2)), np.array([0.5, -3.0])
    moved = skill.translated(offset)
    np.testing.assert_allclose(moved.velocity(states + offset), skill.velocity(states), rtol=1e-9, atol=1e-12)
    assert moved.coordinates == skill.coordinates


def test_components_add_up_to_the_velocity(make_skill):
    rng = np.random.default_rng(11)
    parts = [replace(make_skill(rng, attractor=[0.3, 0.1]), coordinates=Chain((shears_of(2),))) for _ in "ab"]
    merged = MergedSkill(tuple(parts), np.array([0.4, 0.6]), speed=1.5)
    states = rng.normal(size=(40, 2))
    for skill in (parts[0], merged):
        found = skill.component_velocities(states)
        assert found.shape == (40, skill.n_components, 2)
        np.testing.assert_allclose(found.sum(axis=1), skill.velocity(states), rtol=1e-9, atol=1e-12)


def test_the_decay_of_v_is_that_of_finite_differences(make_skill):
    rng, step = np.random.default_rng(12), 1e-6
    skill = replace(make_skill(rng, attractor=[0.3, 0.1]), coordinates=Chain((shears_of(2),)))
    states = rng.normal(size=(200, 2))
    y = skill.lifted(states)
    ahead, behind = (skill.v_distance(skill.advanced(states, sign * step)) for sign in (1, -1))
    expected = -(ahead - behind) / (2 * step) / skill.form.distance(y - skill.attractor)
    np.testing.assert_allclose(skill.decay(states), expected, rtol=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_shears_turn_as_what_they_act_on(make_shears, seed):
    rng = np.random.default_rng(seed)
    shears, turn = make_shears(rng, 3), Rotation.random(random_state=seed).as_matrix()
    after, inner = shears.turned(turn)
    x = rng.normal(0, 2, (50, 3))
    # Products of three, and splines of slope about one.
    assert np.abs(after.forward(x @ turn.T) - shears.forward(x) @ inner.T).max() <= 1e3 * np.finfo(float).eps
    assert np.abs(inner @ inner.T - np.eye(3)).max() <= 16 * np.finfo(float).eps
    chained, same = Chain((shears,)).turned(turn)
    assert chained == Chain((after,))
    assert (same == inner).all()
