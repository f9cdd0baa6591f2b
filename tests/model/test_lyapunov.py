"""Decay rates and longest periods against closed forms, general eigenvalue solvers and what they promise."""

import numpy as np
import pytest
from scipy.linalg import eigh, expm

from skillctl.model.lyapunov import QuadraticForm

EPS = np.finfo(float).eps


def random_pair(rng, d):
    root = rng.normal(size=(d, d))
    p = root @ root.T + 0.5 * np.eye(d)
    loss, turn = rng.normal(size=(2, d, d))
    a = np.linalg.solve(p, -loss @ loss.T - 0.3 * p + turn - turn.T)
    return 0.5 * (p + p.T), a


def test_rates_and_periods_of_a_diagonal_system_are_read_off():
    a = np.diag([-1.0, -4.0])[None]
    assert QuadraticForm(np.eye(2)).rates(a).tolist() == [1.0]
    assert QuadraticForm(np.eye(2)).periods(a).tolist() == [0.5]  # |1 − 4 Δt| ≤ 1


def test_a_rotation_with_damping_has_the_period_of_its_complex_number():
    # |1 + Δt (−σ + iω)| ≤ 1 exactly when Δt ≤ 2σ / (σ² + ω²); every number here is a short binary fraction
    a = np.array([[[-0.5, 2.0], [-2.0, -0.5]]])
    assert QuadraticForm(np.eye(2)).rates(a)[0] == pytest.approx(0.5, rel=8 * EPS)
    assert QuadraticForm(np.eye(2)).periods(a)[0] == pytest.approx(1 / 4.25, rel=8 * EPS)


@pytest.mark.parametrize("d", [1, 2, 3, 7, 10])
def test_both_are_the_generalised_eigenvalues_of_the_conditions(d):
    rng = np.random.default_rng(d)
    for _ in range(10):
        p, a = random_pair(rng, d)
        loss = -(p @ a + a.T @ p)
        # LAPACK's generalised solver loses up to the condition of the right-hand matrix.
        tolerance = 64 * d * EPS * np.linalg.cond(p) * np.linalg.cond(a) ** 2
        rate = eigh(0.5 * loss, p, eigvals_only=True)[0]
        assert QuadraticForm(p).rates(a[None])[0] == pytest.approx(rate, rel=tolerance)
        period = eigh(loss, a.T @ p @ a, eigvals_only=True)[0]
        assert QuadraticForm(p).periods(a[None])[0] == pytest.approx(period, rel=tolerance)


def test_a_growing_component_has_no_period():
    a = np.stack([-np.eye(2), np.diag([-1.0, 0.5]), np.zeros((2, 2))])
    assert QuadraticForm(np.eye(2)).rates(a).tolist() == [1.0, -0.5, 0.0]
    assert QuadraticForm(np.eye(2)).periods(a).tolist() == [2.0, 0.0, 0.0]


def test_the_flow_shrinks_by_the_rate_and_can_do_no_better_at_first():
    rng = np.random.default_rng(5)
    p, a = random_pair(rng, 3)
    rate = QuadraticForm(p).rates(a[None])[0]
    root = np.linalg.cholesky(p).T
    for t in (1e-3, 0.1, 1.0):
        gain = np.linalg.norm(root @ expm(t * a) @ np.linalg.inv(root), 2)
        assert gain <= np.exp(-rate * t) * (1 + 1e-12)
    gain = np.linalg.norm(root @ expm(1e-4 * a) @ np.linalg.inv(root), 2)
    # −log(gain)/t → rate with an error of O(t ‖A‖²)
    assert -np.log(gain) / 1e-4 == pytest.approx(rate, abs=1e-4 * np.linalg.norm(root @ a, 2) ** 2 * 4)


def test_what_a_period_leaves_of_a_rate_is_read_off_a_diagonal_and_vanishes_at_the_longest_period():
    a = np.diag([-1.0, -4.0])[None]
    # −½ (2 a + Δt a²): 1 − Δt/2 and 4 − 8 Δt
    assert QuadraticForm(np.eye(2)).rates(a, 0.25).tolist() == [0.875]
    assert QuadraticForm(np.eye(2)).rates(a, 0.5).tolist() == [0.0]
