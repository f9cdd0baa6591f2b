from __future__ import annotations

import numpy as np
import pytest
import scipy.integrate

from skillctl.learning.field import Field, heun_rollouts
from skillctl.learning.sensitivity import RolloutSlopes


def random_field(d: int, k: int = 3, seed: int = 0) -> Field:
    generator = np.random.default_rng(seed)
    features = 1 + d + d * (d + 1) // 2
    matrices = 0.7 * generator.standard_normal((k, d, d)) - 1.5 * np.eye(d)
    return Field(matrices, generator.standard_normal((k, features)))


def direct_velocity(field: Field, x: np.ndarray) -> np.ndarray:
    """Written from the formula, with loops."""
    d = len(x)
    phi = np.array([1.0, *x, *(x[i] * x[j] for i in range(d) for j in range(i, d))])
    weights = np.exp(field.logits @ phi)
    weights = weights / weights.sum()
    return sum(w * a @ x for w, a in zip(weights, field.matrices, strict=True))


@pytest.mark.parametrize("d", [1, 2, 3, 7])
def test_velocities_follow_the_formula(d: int) -> None:
    field = random_field(d)
    points = np.random.default_rng(1).standard_normal((d, 9))
    expected = np.stack([direct_velocity(field, x) for x in points.T], axis=1)
    np.testing.assert_allclose(field.velocities(points), expected, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_derivatives_agree_with_finite_differences(d: int) -> None:
    field = random_field(d)
    points = np.random.default_rng(2).standard_normal((d, 5))
    at = field.linearised(points)
    by_state = field.by_state(at)
    forces = np.eye(5 * d).reshape(-1, d, 5)  # one for each coordinate of each point
    by_parameter = np.stack([at.pull_back(force) for force in forces]).reshape(d, 5, -1)

    step = 1e-6  # central differences: error step² plus eps/step, together below 1e-9 here
    for j in range(d):
        shift = step * np.eye(d)[:, [j]]
        numeric = (field.velocities(points + shift) - field.velocities(points - shift)) / (2 * step)
        np.testing.assert_allclose(by_state[:, :, j], numeric.T, atol=1e-8)
    for index in range(field.n_parameters):
        unit = np.zeros(field.n_parameters)
        unit[index] = step
        numeric = (field.stepped(unit).velocities(points) - field.stepped(-unit).velocities(points)) / (
            2 * step
        )
        np.testing.assert_allclose(by_parameter[:, :, index], numeric, atol=1e-8)


def test_rollouts_converge_to_the_solution_with_the_square_of_the_step() -> None:
    field = random_field(2)
    starts = np.array([[1.0, -0.5], [0.5, 1.0]])
    exact = np.stack(
        [
            scipy.integrate.solve_ivp(
                lambda _, x: direct_velocity(field, x), (0, 2.0), start, rtol=1e-10, atol=1e-12
            ).y[:, -1]
            for start in starts.T
        ],
        axis=1,
    )
    errors = []
    for count in (40, 80):
        states, _ = heun_rollouts(field, starts, np.full(2, 2.0 / count), count)
        errors.append(np.abs(states[-1] - exact).max())
    assert errors[1] < 1e-3
    assert 3.0 < errors[0] / errors[1] < 5.5  # second order: a factor of four


@pytest.mark.parametrize("d", [1, 2, 3])
def test_sensitivities_agree_with_finite_differences(d: int) -> None:
    field = random_field(d)
    starts = np.random.default_rng(3).standard_normal((d, 3))
    steps = np.array([0.05, 0.08, 0.1])
    slopes = RolloutSlopes(field, *heun_rollouts(field, starts, steps, 12), steps)
    pulls = np.random.default_rng(4).standard_normal((13, 3, d))
    gradient = slopes.gradient(pulls)
    every_step, every_fifth = slopes.at_nodes(1), slopes.at_nodes(5)

    step = 1e-6
    for index in range(field.n_parameters):
        unit = np.zeros(field.n_parameters)
        unit[index] = step
        ahead, _ = heun_rollouts(field.stepped(unit), starts, steps, 12)
        behind, _ = heun_rollouts(field.stepped(-unit), starts, steps, 12)
        numeric = ((ahead - behind) / (2 * step)).transpose(0, 2, 1)  # (time, trajectory, d)
        np.testing.assert_allclose(every_step[..., index], numeric[1:], atol=1e-8)
        np.testing.assert_allclose(every_fifth[..., index], numeric[[2, 7, 12]], atol=1e-8)
        assert gradient[index] == pytest.approx((pulls * numeric).sum(), abs=39 * d * 1e-8)
