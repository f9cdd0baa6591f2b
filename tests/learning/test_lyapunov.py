from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from skillctl.learning.lyapunov import forced_deviation, learn_lyapunov, rising_share
from skillctl.learning.preprocess import align, training_data
from skillctl.model import DemonstrationSet


def test_a_straight_approach_forces_nothing() -> None:
    path = np.linspace(1, 0, 20)[:, None] * np.array([3.0, -4.0])
    assert forced_deviation(np.diag([5.0, 1.0]), path[None]).max() == 0.0
    assert rising_share(np.eye(2), path[None]) == 0.0


def test_a_detour_outwards_forces_half_of_it() -> None:
    # The distance falls to 1, rises to 3, falls to 0: whoever obeys V is off by at least 1 somewhere.
    distances = np.concatenate([np.linspace(2, 1, 50), np.linspace(1, 3, 50), np.linspace(3, 0, 50)])
    path = distances[:, None] * np.array([[0.6, 0.8]])
    forced = forced_deviation(np.eye(2), path[None])
    assert forced.max() == pytest.approx(1.0, abs=1e-12)
    # It rises on 2 of 6 units of path; segments of the two joints belong to one side or the other.
    assert rising_share(np.eye(2), path[None]) == pytest.approx(2 / 6, abs=2 / 150)


def test_forced_deviation_is_a_distance_to_the_level_sets() -> None:
    # On the x axis V = 4x²: √V has slope 2, so a rise of √V by 2 is a distance of 1 in x.
    path = np.array([[2.0, 0], [1.0, 0], [3.0, 0], [0.0, 0]])
    forced = forced_deviation(np.diag([4.0, 1.0]), path[None])[0]
    np.testing.assert_allclose(forced[:3], [0.5, 1.0, 1.0], atol=1e-12)


def test_no_monotone_curve_comes_closer_than_the_bound() -> None:
    # Independent oracle: the best monotone fit of √V in the largest difference, by a linear programme.
    from scipy.optimize import linprog

    generator = np.random.default_rng(0)
    s = np.abs(np.cumsum(generator.standard_normal(30)))[::-1] + 0.1
    n = len(s)
    # minimise t subject to |u_i − s_i| ≤ t and u_i ≥ u_{i+1}
    eye, ones = np.eye(n), np.ones((n, 1))
    fall = np.eye(n)[1:] - np.eye(n)[:-1]
    rows = np.vstack(
        [np.hstack([eye, -ones]), np.hstack([-eye, -ones]), np.hstack([fall, np.zeros((n - 1, 1))])]
    )
    right = np.concatenate([s, -s, np.zeros(n - 1)])
    best = linprog(np.append(np.zeros(n), 1.0), A_ub=rows, b_ub=right, bounds=(None, None)).fun

    path = s[:, None] * np.array([[1.0, 0.0]])
    assert forced_deviation(np.eye(2), path[None]).max() == pytest.approx(best, abs=1e-7)  # the solver's own


def test_a_stretched_motion_is_seen_through() -> None:
    # In stretched coordinates this spiral falls; in the given ones the distance rises for a while.
    t = np.linspace(0, 6, 200)[:, None]
    spiral = np.exp(-0.4 * t) * np.hstack([np.cos(t), np.sin(t)])
    path = (spiral @ np.diag([3.0, 1.0]))[None]
    path = path / np.sqrt((path**2).sum(axis=2).mean())
    assert forced_deviation(np.eye(2), path).mean() > 0.02

    learned = learn_lyapunov([path])
    assert forced_deviation(learned, path).mean() < 0.002
    assert np.trace(learned) == pytest.approx(2.0)
    assert np.linalg.eigvalsh(learned).min() > 0


def test_one_dimension_has_one_metric() -> None:
    np.testing.assert_array_equal(learn_lyapunov([np.linspace(1, 0, 9).reshape(1, 9, 1)]), np.eye(1))


@pytest.mark.parametrize("name", ["Angle", "Sshape", "GShape"])
def test_the_learned_metric_forces_less_than_the_euclidean(
    lasa: Callable[[str], DemonstrationSet], name: str
) -> None:
    data = training_data(*align(lasa(name)), samples=50)
    learned = learn_lyapunov([data.positions])
    euclidean = forced_deviation(np.eye(2), data.positions).mean()
    assert forced_deviation(learned, data.positions).mean() < 0.9 * euclidean
