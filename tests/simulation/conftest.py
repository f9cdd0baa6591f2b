"""Hand-made skills: their motions are known in closed form, so nothing depends on learning."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from skillctl.model.mixture import GaussianMixture
from skillctl.model.seds import SedsSkill
from skillctl.model.space import Euclidean

MakeLinear = Callable[..., SedsSkill]


@pytest.fixture(scope="session")
def linear() -> MakeLinear:
    """Return a maker of ẋ = A (x − target), one component around ``centre``."""

    def make(
        target: tuple[float, ...],
        *,
        rate: float = 2.0,
        matrix: object = None,
        centre: tuple[float, ...] | None = None,
        spread: float = 0.1,
        space: Euclidean | None = None,
    ) -> SedsSkill:
        d = len(target)
        middle = np.array([target if centre is None else centre])
        covariance = np.array([spread**2 * np.eye(d)])
        return SedsSkill(
            priors=np.ones(1),
            means=middle,
            covariances=covariance,
            system_matrices=np.array([-rate * np.eye(d) if matrix is None else matrix]),
            residual_covariances=np.array([1e-4 * np.eye(d)]),
            attractor=np.array(target),
            lyapunov=np.eye(d),
            density=GaussianMixture(np.ones(1), middle, covariance),
            space=Euclidean.cartesian(d) if space is None else space,
        )

    return make


@pytest.fixture(scope="session")
def reach() -> SedsSkill:
    """A curved reach in 3-D: sideways and up first, then into the target."""
    target = np.array([0.58, 0.18, 0.55])
    means = target + np.array([[-0.12, -0.30, -0.05], [-0.02, -0.05, 0.05]])
    covariances = np.array([np.diag([0.006, 0.02, 0.006]), np.diag([0.004, 0.006, 0.004])])
    turning = np.array([[0.0, 0.9, 0.0], [-0.9, 0.0, -0.6], [0.0, 0.6, 0.0]])
    return SedsSkill(
        priors=np.array([0.5, 0.5]),
        means=means,
        covariances=covariances,
        system_matrices=np.array([turning - 0.9 * np.eye(3), -2.5 * np.eye(3)]),
        residual_covariances=np.tile(1e-4 * np.eye(3), (2, 1, 1)),
        attractor=target,
        lyapunov=np.eye(3),
        density=GaussianMixture(np.array([0.5, 0.5]), means, covariances),
        space=Euclidean.cartesian(3),
    )


@pytest.fixture(scope="session")
def stroke() -> SedsSkill:
    """A curved stroke in 2-D, as small as handwriting: some 8 cm, to the origin."""
    means = np.array([[-0.06, 0.03], [-0.01, 0.01]])
    covariances = np.array([np.diag([2e-4, 1e-4]), np.diag([1e-4, 1e-4])])
    return SedsSkill(
        priors=np.array([0.5, 0.5]),
        means=means,
        covariances=covariances,
        system_matrices=np.array([[[-0.8, 1.5], [-1.5, -0.8]], [[-2.5, 0.0], [0.0, -2.5]]]),
        residual_covariances=np.tile(1e-6 * np.eye(2), (2, 1, 1)),
        attractor=np.zeros(2),
        lyapunov=np.eye(2),
        density=GaussianMixture(np.array([0.5, 0.5]), means, covariances),
        space=Euclidean.cartesian(2),
    )
