"""Robust least squares against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from skillctl.learning.robust import soft_least_squares, soft_loss


@pytest.mark.parametrize("seed", range(5))
def test_the_search_ends_where_scipys_does(seed: int) -> None:
    generator = np.random.default_rng(seed)
    times, true = np.linspace(0, 3, 60), np.array([2.0, 0.7, 0.5])
    values = true[0] * np.exp(-true[1] * times) + true[2] + 0.01 * generator.standard_normal(60)
    values[::7] += generator.uniform(1, 5, 9)  # outliers

    def residuals(x: np.ndarray) -> np.ndarray:
        return x[0] * np.exp(-x[1] * times) + x[2] - values

    def linearise(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        decay = np.exp(-x[1] * times)
        return residuals(x), np.stack([decay, -x[0] * times * decay, np.ones(60)], axis=1)

    found = soft_least_squares(linearise, np.ones(3), 0.05, 100, longest=1.0)
    expected = least_squares(residuals, np.ones(3), loss="soft_l1", f_scale=0.05, xtol=1e-12, ftol=1e-12)
    assert found.converged
    assert found.cost == soft_loss(residuals(found.parameters), 0.05)
    assert found.cost == pytest.approx(expected.cost, rel=1e-6)  # both stop when steps gain 1e-8 of the cost
    assert np.abs(found.parameters - true).max() < 0.05  # the outliers are seen through


def test_no_step_is_longer_than_allowed_and_steps_are_counted() -> None:
    def linearise(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return x - 10.0, np.eye(1)

    found = soft_least_squares(linearise, np.zeros(1), 100.0, 4, longest=0.5)  # three steps
    assert (found.parameters[0], found.steps, found.converged) == (1.5, 4, False)
    there = soft_least_squares(linearise, np.full(1, 10.0), 100.0, 4, longest=0.5)
    assert (there.parameters[0], there.steps, there.converged) == (10.0, 1, True)
