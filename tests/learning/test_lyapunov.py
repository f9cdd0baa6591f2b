from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from skillctl.learning import lyapunov as lyapunov_module
from skillctl.learning.lyapunov import (
    deviation_bound,
    falling_fit,
    learn_lyapunov,
    rise,
    rising_share,
    stretched,
)
from skillctl.learning.outcome import Result
from skillctl.learning.preprocess import align, training_data
from skillctl.model.demonstration import DemonstrationSet


def test_a_straight_approach_forces_nothing() -> None:
    path = np.linspace(1, 0, 20)[:, None] * np.array([3.0, -4.0])
    assert rise(np.diag([5.0, 1.0]), path[None]).max() == 0.0
    assert rising_share(np.eye(2), path[None]) == 0.0


def test_a_detour_outwards_costs_half_of_it() -> None:
    # The distance falls to 1, rises to 3, falls to 0: whoever obeys V is off by at least 1 somewhere.
    distances = np.concatenate([np.linspace(2, 1, 50), np.linspace(1, 3, 50), np.linspace(3, 0, 50)])
    path = distances[:, None] * np.array([[0.6, 0.8]])
    assert rise(np.eye(2), path[None]).max() == pytest.approx(1.0, abs=1e-12)
    # It rises on 2 of 6 units of path; segments of the two joints belong to one side or the other.
    assert rising_share(np.eye(2), path[None]) == pytest.approx(2 / 6, abs=2 / 150)


def test_a_rise_is_a_distance_to_the_level_sets() -> None:
    # On the x axis V = 4x²: √V has slope 2, so a rise of √V by 2 is a distance of 1 in x.
    path = np.array([[2.0, 0], [1.0, 0], [3.0, 0], [0.0, 0]])
    np.testing.assert_allclose(rise(np.diag([4.0, 1.0]), path[None])[0, :3], [0.5, 1.0, 1.0], atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_no_falling_sequence_fits_better(seed: int) -> None:
    # Independent oracle: the same least absolute deviations as a linear programme.
    from scipy.optimize import linprog

    generator = np.random.default_rng(seed)
    values, weights = generator.standard_normal(25).cumsum(), generator.uniform(0.1, 1, 25)
    n = len(values)
    eye, zero = np.eye(n), np.zeros((n - 1, n))
    fall = eye[1:] - eye[:-1]
    rows = np.vstack([np.hstack([eye, -eye]), np.hstack([-eye, -eye]), np.hstack([fall, zero])])
    right = np.concatenate([values, -values, np.zeros(n - 1)])
    best = linprog(np.append(np.zeros(n), weights), A_ub=rows, b_ub=right, bounds=(None, None)).fun

    fit = falling_fit(values, weights)
    assert (np.diff(fit) <= 0).all()
    assert weights @ np.abs(values - fit) == pytest.approx(best, abs=1e-7)  # the solver's own tolerance


def test_the_bound_is_exact_for_a_radial_detour_and_no_motion_beats_it() -> None:
    # Down to 1, out to 2, in to 0, at one pace: the best falling fit rests at a level over the detour.
    distances = np.concatenate(
        [np.linspace(3, 1, 201), np.linspace(1, 2, 101)[1:], np.linspace(2, 0, 201)[1:]]
    )
    path = (distances[:, None] * np.array([[1.0, 0.0]]))[None]
    # At level 1.5: two triangles of height ½ on each side of the crossing: 3 of base 0.5 below and above,
    # areas ½·½·½ each; below on the way in and out of the dip, above on both sides of the peak: 4 · ⅛ of 5.
    assert deviation_bound(np.eye(2), path) == pytest.approx(4 / 8 / 5, abs=2e-3)  # sampled at 0.01
    assert deviation_bound(4 * np.eye(2), path) == pytest.approx(deviation_bound(np.eye(2), path))
    for level in np.linspace(0.5, 2.5, 21):  # falling motions that pass straight through at any level
        motion = np.where(
            np.arange(501) < 350, np.minimum(np.maximum(distances, level), distances[0]), distances
        )
        motion = np.minimum.accumulate(motion)
        assert np.abs(motion - distances).mean() >= deviation_bound(np.eye(2), path) - 2e-3


def test_a_stretched_motion_is_seen_through() -> None:
    # In stretched coordinates this spiral falls; in the given ones the distance rises for a while.
    t = np.linspace(0, 6, 200)[:, None]
    spiral = np.exp(-0.4 * t) * np.hstack([np.cos(t), np.sin(t)])
    path = (spiral @ np.diag([3.0, 1.0]))[None]
    path = path / np.sqrt((path**2).sum(axis=2).mean())
    assert rise(np.eye(2), path).mean() > 0.02

    learned, _ = learn_lyapunov([path])
    assert rise(learned, path).mean() < 0.002
    assert np.trace(learned) == pytest.approx(2.0)
    assert np.linalg.eigvalsh(learned).min() > 0


@pytest.mark.parametrize("d", [2, 3])
def test_the_slopes_of_the_rise_are_those_of_finite_differences(d: int) -> None:
    generator = np.random.default_rng(d)
    paths = np.cumsum(generator.standard_normal((2, 15, d)), axis=1)
    paths[:, -1] = 0.0
    parameters = 0.5 * generator.standard_normal(d * (d + 1) // 2 - 1)
    lyapunov, by_parameter = lyapunov_module._exponential(parameters, d)
    assert np.linalg.det(lyapunov) == pytest.approx(1.0)  # its logarithm has no trace
    rises, by_entry = lyapunov_module._rise_slopes(lyapunov, paths)
    np.testing.assert_allclose(rises, rise(lyapunov, paths).ravel(), rtol=1e-12, atol=1e-15)
    slopes = by_entry @ by_parameter.T

    step = 1e-6  # smooth where neither the lowest nor the highest point changes, as here
    for index, unit in enumerate(step * np.eye(parameters.size)):
        ahead, behind = (lyapunov_module._exponential(parameters + s * unit, d)[0] for s in (1, -1))
        numeric = (rise(ahead, paths) - rise(behind, paths)).ravel() / (2 * step)
        np.testing.assert_allclose(slopes[:, index], numeric, atol=1e-7)


def test_the_start_that_forces_least_gives_the_metric(monkeypatch: pytest.MonkeyPatch) -> None:
    # One evaluation a start leaves each where it is: P must be the one under which the path rises least.
    t = np.linspace(0, 6, 100)[:, None]
    path = (np.exp(-0.4 * t) * np.hstack([3 * np.cos(t), np.sin(t)]))[None] / 2
    monkeypatch.setattr(lyapunov_module, "EVALUATIONS", 1)
    metric, outcome = learn_lyapunov([path])
    assert (outcome.stage, outcome.result, outcome.steps) == ("metric", Result.OUT_OF_STEPS, 1)
    across, longer = np.exp(-0.5), np.exp(0.5)  # of diag(1, 0), the part without trace is diag(½, −½)
    expected = 2 * np.diag([across, longer]) / (across + longer)
    np.testing.assert_allclose(metric, expected, rtol=1e-12)


def test_a_path_that_contradicts_no_metric_has_a_round_one_at_once() -> None:
    metric, outcome = learn_lyapunov([np.linspace(1, 0, 20)[:, None] * np.array([[0.6, 0.8]])[None]])
    np.testing.assert_allclose(metric, np.eye(2), atol=1e-12)
    assert (outcome.result, outcome.steps) == (Result.CONVERGED, 1)


def test_a_stretched_metric_keeps_axes_and_trace_and_doubles_the_condition() -> None:
    metric = np.array([[1.5, 0.4], [0.4, 0.5]])
    longer = stretched(metric)
    values, vectors = np.linalg.eigh(metric)
    turned = vectors.T @ longer @ vectors
    np.testing.assert_allclose(turned, np.diag(np.diag(turned)), atol=1e-12)
    assert np.trace(longer) == pytest.approx(2.0)
    assert np.linalg.cond(longer) == pytest.approx(2 * values[1] / values[0])
    np.testing.assert_array_equal(stretched(np.eye(3)), np.eye(3))


def test_one_dimension_has_one_metric() -> None:
    metric, _ = learn_lyapunov([np.linspace(1, 0, 9).reshape(1, 9, 1)])
    np.testing.assert_array_equal(metric, np.eye(1))


@pytest.mark.parametrize("name", ["Angle", "Sshape", "GShape"])
def test_the_learned_metric_forces_less_than_the_euclidean(
    lasa: Callable[[str], DemonstrationSet], name: str
) -> None:
    data = training_data(*align(lasa(name)), samples=50)
    learned, _ = learn_lyapunov([data.positions])
    euclidean = rise(np.eye(2), data.positions).mean()
    assert rise(learned, data.positions).mean() < 0.9 * euclidean
