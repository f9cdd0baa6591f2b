"""The numbers behind a certified radius are rounded to the safe side, and by no more than they say."""

from fractions import Fraction

import numpy as np
import pytest

from skillctl.model.mixture import GaussianMixture
from skillctl.stability.region import GUARD, DensityBounds


def slope_of(covariance, lyapunov):
    density = GaussianMixture([1.0], [np.zeros(len(lyapunov))], [covariance])
    (slope,) = DensityBounds.of(density, 1.0, np.zeros(len(lyapunov)), lyapunov).slopes.tolist()
    return slope


def spd(rng, d, scale):
    root = rng.normal(size=(d, d))
    return scale * (0.5 * (root @ root.T + (root @ root.T).T) + 0.1 * np.eye(d))


def bounds_mahalanobis(slope, covariance, lyapunov):
    """Decide slope² P ≻ Σ⁻¹ for two dimensions in fractions, by trace and determinant of slope² P − Σ⁻¹."""
    (a, b), (_, c) = [[Fraction(v) for v in row] for row in covariance.tolist()]
    p = [[Fraction(v) for v in row] for row in lyapunov.tolist()]
    determinant, squared = a * c - b * b, Fraction(slope) ** 2
    left, off, right = (
        squared * p[0][0] - c / determinant,
        squared * p[0][1] + b / determinant,
        squared * p[1][1] - a / determinant,
    )
    return left + right > 0 and left * right - off * off > 0


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e4])
def test_the_slope_bounds_the_distance_exactly_and_hardly_more_in_one_dimension(scale):
    rng = np.random.default_rng(0)
    for _ in range(300):
        covariance, lyapunov = scale * rng.uniform(0.1, 9), rng.uniform(0.1, 9)
        slope = Fraction(slope_of(np.array([[covariance]]), np.array([[lyapunov]])))
        smallest = 1 / (Fraction(covariance) * Fraction(lyapunov))  # of slope²
        # At most GUARD on the root is 2 GUARD on the square; 2^-39 for the search of s and all rounding.
        assert smallest < slope**2 < smallest * (1 + Fraction(2 * GUARD + GUARD**2 + 2.0**-39))


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e4])
def test_the_slope_bounds_the_distance_exactly_in_the_plane(scale):
    rng = np.random.default_rng(1)
    for _ in range(300):
        covariance, lyapunov = spd(rng, 2, scale), spd(rng, 2, 1.0)
        slope = slope_of(covariance, lyapunov)
        assert bounds_mahalanobis(slope, covariance, lyapunov)
        # And no larger than that: without what is added for safety, twice, it bounds the distance no more.
        assert not bounds_mahalanobis(slope * (1 - 2 * GUARD), covariance, lyapunov)


def test_the_slope_bounds_the_distance_where_eigenvalues_alone_fail():
    # Covariances so near singular that rounding moves their inverse by more than is added for safety.
    rng = np.random.default_rng(2)
    failures = 0
    for _ in range(300):
        turn = np.linalg.qr(rng.normal(size=(2, 2)))[0]
        product = turn @ np.diag([1.0, 1e-9]) @ turn.T
        covariance, lyapunov = 0.5 * (product + product.T), spd(rng, 2, 1.0)
        assert bounds_mahalanobis(slope_of(covariance, lyapunov), covariance, lyapunov)
        whitener = np.linalg.inv(np.linalg.cholesky(lyapunov))
        largest = np.linalg.eigvalsh(whitener @ np.linalg.inv(covariance) @ whitener.T)[-1]
        failures += not bounds_mahalanobis(np.sqrt(largest) * (1 + GUARD), covariance, lyapunov)
    assert failures > 30
