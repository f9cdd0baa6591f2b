"""From the learner's units to the user's, against densities and least squares written out by others."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats

from skillctl.errors import FitError
from skillctl.learning.em import VELOCITY_FLOOR, JointMixture
from skillctl.learning.parameters import field_of, gate_mixture, skill_of
from skillctl.learning.preprocess import TrainingData
from skillctl.model.space import Euclidean

LENGTH, SPEED = 0.25, 2.0  # [m] and [m/s] of one unit of the learner
ATTRACTOR = np.array([0.4, -0.3])


def spd(generator: np.random.Generator, k: int) -> np.ndarray:
    roots = generator.standard_normal((k, 2, 2))
    return roots @ roots.swapaxes(1, 2) + 0.3 * np.eye(2)


def random_mixture(k: int = 3) -> JointMixture:
    generator = np.random.default_rng(k)
    return JointMixture(
        priors=generator.dirichlet(np.ones(k)),
        means=generator.standard_normal((k, 2)),
        covariances=spd(generator, k),
        matrices=generator.standard_normal((k, 2, 2)) - 2 * np.eye(2),
        residual_covariances=spd(generator, k),
    )


def bayes(priors: np.ndarray, means: np.ndarray, covariances: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Responsibilities (n, K) by SciPy's densities."""
    densities = [
        scipy.stats.multivariate_normal(m, c).pdf(points) for m, c in zip(means, covariances, strict=True)
    ]
    weights = priors * np.stack(densities, axis=1)
    return weights / weights.sum(axis=1, keepdims=True)


@pytest.fixture
def data() -> TrainingData:
    generator = np.random.default_rng(9)
    positions, velocities = generator.standard_normal((2, 5, 40, 2))
    return TrainingData(positions, velocities, np.full(5, 0.1), LENGTH, SPEED, ATTRACTOR)


def test_the_gates_of_a_field_are_the_responsibilities_of_its_mixture(data: TrainingData) -> None:
    mixture = random_mixture()
    points = data.points[0]
    weights = bayes(mixture.priors, mixture.means, mixture.covariances, points)
    expected = np.einsum("nk,kij,nj->ni", weights, mixture.matrices, points)
    # Responsibilities are good to the logits' rounding, some hundred times eps.
    np.testing.assert_allclose(field_of(mixture).velocities(points.T).T, expected, rtol=1e-10, atol=1e-11)


def test_gates_that_no_gaussians_can_have_are_refused() -> None:
    logits = np.array([[0.0, 0, 0, 0, 0, 0], [-1e4, 0, 0, 0, 0, 0]])  # everywhere exp(−10⁴) : 1
    with pytest.raises(FitError, match="priors underflow"):
        gate_mixture(logits, np.random.default_rng(0).standard_normal((30, 2)))


def test_a_skill_is_the_field_in_the_users_units(data: TrainingData) -> None:
    mixture = random_mixture()
    field = field_of(mixture)
    density = mixture.priors, mixture.means, mixture.covariances
    lyapunov = np.array([[1.5, 0.2], [0.2, 0.5]])
    skill = skill_of(field, density, data, lyapunov, Euclidean.cartesian(2))

    points = data.points[0]
    places = ATTRACTOR + LENGTH * points
    # A gauge of up to some hundred times the data's curvature is added to the gates and taken off again.
    np.testing.assert_allclose(
        skill.velocity(places), SPEED * field.velocities(points.T).T, rtol=1e-9, atol=1e-9
    )
    np.testing.assert_array_equal(skill.attractor, ATTRACTOR)
    # A density per unit of area: an area of one square unit of the learner is LENGTH² square metres.
    logs = [
        np.log(p) + scipy.stats.multivariate_normal(m, c).logpdf(points)
        for p, m, c in zip(*density, strict=True)
    ]
    expected = np.logaddexp.reduce(logs) - 2 * np.log(LENGTH)
    np.testing.assert_allclose(skill.density.log_density(places), expected, atol=1e-10)


def test_residual_covariances_are_those_of_the_velocities_in_the_users_units(data: TrainingData) -> None:
    mixture = random_mixture(2)
    density = mixture.priors, mixture.means, mixture.covariances
    skill = skill_of(field_of(mixture), density, data, np.eye(2), Euclidean.cartesian(2))

    places, speeds = ATTRACTOR + LENGTH * data.points[0], SPEED * data.points[1]  # [m], [m/s]
    shares = bayes(*density, data.points[0])
    for k in range(2):
        residuals = speeds - (places - ATTRACTOR) @ (SPEED / LENGTH * mixture.matrices[k]).T
        scatter = sum(h * np.outer(r, r) for h, r in zip(shares[:, k], residuals, strict=True))
        expected = scatter / shares[:, k].sum() + SPEED**2 * VELOCITY_FLOOR * np.eye(2)
        # 1e-9 is added to the sum of the shares, which is at least some hundredths.
        np.testing.assert_allclose(skill.residual_covariances[k], expected, rtol=1e-6)
