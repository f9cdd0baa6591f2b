"""Mixtures agree with SciPy's Gaussians near the data and stay finite at any distance."""

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from skillctl.errors import InvalidModelError
from skillctl.model.mixture import GaussianMixture

EPS = np.finfo(float).eps


def random_mixture(rng, k=4, d=3, spread=0.05):
    factors = rng.normal(0, spread, (k, d, d))
    squares = factors @ factors.swapaxes(1, 2)
    covariances = 0.5 * (squares + squares.swapaxes(1, 2)) + 0.5 * spread**2 * np.eye(d)
    return GaussianMixture(rng.dirichlet(np.full(k, 3.0)), rng.normal(0, 0.2, (k, d)), covariances)


def oracle(mixture, x):
    """Return log π_k N(x; μ_k, Σ_k), shape (n, K), by SciPy."""
    columns = zip(mixture.priors, mixture.means, mixture.covariances, strict=True)
    return np.stack([np.log(p) + multivariate_normal(m, c).logpdf(x) for p, m, c in columns], axis=1)


def rounding(mixture, x):
    """Bound what rounding can do to a log-density.

    Its quadratic is a sum of F = 1 + d + d(d+1)/2 products, each at most ‖Λ‖ (|x − o| + |μ − o|)² in size
    and right to a few ulps; inverting Σ multiplies those by its condition number.
    """
    d = mixture.dimension
    origin = mixture.priors @ mixture.means
    reach = np.linalg.norm(x - origin, axis=1).max() + np.linalg.norm(mixture.means - origin, axis=1).max()
    eigenvalues = np.linalg.eigvalsh(mixture.covariances)
    condition = (eigenvalues[:, -1] / eigenvalues[:, 0]).max()
    terms = 1 + d + d * (d + 1) // 2
    return 4 * terms * EPS * condition * (10 + reach**2 / eigenvalues.min())


@pytest.mark.parametrize("dimension", [1, 2, 3, 7])
def test_density_and_responsibilities_are_those_of_scipy(dimension):
    rng = np.random.default_rng(dimension)
    mixture = random_mixture(rng, d=dimension)
    x = rng.normal(0, 0.3, (200, dimension))
    expected = oracle(mixture, x).reshape(200, -1)
    tolerance = rounding(mixture, x)
    assert np.abs(mixture.log_joint(x).T - expected).max() <= tolerance
    assert np.abs(mixture.log_density(x) - logsumexp(expected, axis=1)).max() <= tolerance
    # |d softmax| ≤ ½ · 2 · the largest change of a logit
    weights = np.exp(expected - logsumexp(expected, axis=1)[:, None])
    assert np.abs(mixture.responsibilities(x) - weights).max() <= tolerance


@pytest.mark.parametrize("distance", [1e1, 1e4, 1e8, 1e99, 1e101, 1e155, 1e200, 1e300])
def test_weights_are_finite_and_sum_to_one_at_any_distance(distance):
    rng = np.random.default_rng(0)
    mixture = random_mixture(rng)
    x = distance * rng.normal(size=(50, 3))
    weights = mixture.responsibilities(x)
    assert (weights >= 0).all()
    assert np.abs(weights.sum(axis=1) - 1).max() <= 4 * mixture.n_components * EPS
    assert np.isfinite(mixture.log_density(x)).all()


@pytest.mark.parametrize("distance", [1e3, 1e80, 1e120, 1e250])
def test_far_away_the_widest_component_wins(distance):
    # −½ ξᵀ Λ ξ decides there: the smallest Λ along the direction
    directions = np.array([[1.0, 0.0], [0.0, 1.0]])
    mixture = GaussianMixture([0.9, 0.1], np.zeros((2, 2)), [np.diag([4.0, 1.0]), np.diag([1.0, 4.0])])
    assert mixture.responsibilities(distance * directions).tolist() == [[1.0, 0.0], [0.0, 1.0]]


def test_an_empty_batch_has_empty_answers():
    mixture = random_mixture(np.random.default_rng(0))
    assert mixture.responsibilities(np.zeros((0, 3))).shape == (0, 4)


def test_the_density_integrates_to_one():
    mixture = random_mixture(np.random.default_rng(2), k=3, d=2)
    axis, step = np.linspace(-2, 2, 801, retstep=True)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    # The trapezoidal sum of a smooth function that vanishes at the border converges faster than any power
    # of the step; with 5 steps a standard deviation, what is left is far below 1e-9.
    assert np.sqrt(np.linalg.eigvalsh(mixture.covariances).min()) > 5 * step
    assert abs(np.exp(mixture.log_density(grid)).sum() * step**2 - 1) < 1e-9


def test_moving_a_mixture_moves_its_density():
    rng = np.random.default_rng(3)
    mixture, offset = random_mixture(rng), rng.normal(size=3)
    x = rng.normal(0, 0.2, (40, 3))
    moved = mixture.translated(offset)
    tolerance = rounding(moved, x + offset) + rounding(mixture, x)
    assert np.abs(moved.log_density(x + offset) - mixture.log_density(x)).max() <= tolerance


def test_its_arrays_are_read_only():
    mixture = random_mixture(np.random.default_rng(0))
    for name in ("priors", "means", "covariances"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(mixture, name)[0] = 0.0


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"priors": [0.5, 0.6]}, "priors: must be positive and sum to one"),
        ({"means": [[0.0, np.inf], [0.0, 0.0]]}, "means: must be finite"),
        ({"covariances": [np.eye(2), -np.eye(2)]}, "covariances: must be positive definite"),
        ({"covariances": [np.eye(2), [[1.0, 0.1], [0.2, 1.0]]]}, "covariances: must be symmetric"),
        ({"covariances": [np.eye(2)]}, "covariances: expected shape"),
    ],
)
def test_a_mixture_is_valid_or_does_not_exist(changed, words):
    fields = {"priors": [0.5, 0.5], "means": np.zeros((2, 2)), "covariances": [np.eye(2), np.eye(2)]}
    with pytest.raises(InvalidModelError, match=words):
        GaussianMixture(**{**fields, **changed})


@pytest.mark.parametrize("size", [1e-320, 1e-310, 1e-300, 1e-105, 1e308])
def test_covariances_that_are_definite_but_useless_are_refused(size):
    with pytest.raises(InvalidModelError, match="covariances: too large or too small to compute with"):
        GaussianMixture([1.0], [[0.0, 0.0]], [size * np.eye(2)])


@pytest.mark.parametrize("size", [1e-103, 1e-60, 1e60, 1e300])
def test_covariances_near_the_limits_give_numbers_at_any_distance(size):
    mixture = GaussianMixture([0.5, 0.5], [[0.0, 0.0], [1.0, 0.0]], [size * np.eye(2)] * 2)
    states = np.outer([0.0, 1e-50, 1.0, 1e50, 1e99, 1e101, 1e250], [1.0, -1.0])
    assert np.isfinite(mixture.log_density(states)).all()
    assert np.abs(mixture.responsibilities(states).sum(axis=1) - 1).max() <= 4 * EPS
