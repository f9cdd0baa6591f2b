"""A SEDS skill is the formula of Eq. 3, wherever it is evaluated and wherever it is moved."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from skillctl.errors import InvalidModelError, UsageError
from skillctl.model.mixture import GaussianMixture
from skillctl.model.retarget import retargeted
from skillctl.model.space import Euclidean

EPS = np.finfo(float).eps
# What rounding may do to a velocity computed in another order: the weights' logits reach a few thousand
# here (means a few standard deviations apart) and are right to a few ulps, and the weights inherit that.
RELATIVE = 1e5 * EPS


def direct_velocity(skill, x):
    """Eq. 3 and 4, one state, one component at a time, by SciPy's densities."""
    densities = [
        p * multivariate_normal(m, c).pdf(x)
        for p, m, c in zip(skill.priors, skill.means, skill.covariances, strict=True)
    ]
    velocity = np.zeros_like(x)
    for density, matrix in zip(densities, skill.system_matrices, strict=True):
        velocity += density / sum(densities) * (matrix @ (x - skill.attractor))
    return skill.speed * velocity


def scale_of(skill, x):
    """A bound of the velocity: what errors are relative to."""
    sizes = np.linalg.norm(skill.component_matrices, 2, axis=(1, 2)).max()
    return sizes * np.abs(x - skill.attractors[0]).max() * skill.dimension


@pytest.mark.parametrize("dimension", [1, 2, 3, 7])
def test_velocity_is_the_weighted_sum_of_linear_systems(make_skill, dimension):
    rng = np.random.default_rng(dimension)
    skill = make_skill(rng, dimension=dimension, attractor=rng.normal(0, 0.2, dimension), speed=1.7)
    x = skill.means[rng.integers(0, 3, 50)] + rng.normal(0, 0.05, (50, dimension))
    expected = np.stack([direct_velocity(skill, row) for row in x])
    assert np.abs(skill.velocity(x) - expected).max() <= RELATIVE * scale_of(skill, x)


def test_one_state_and_many_states_give_the_same_velocity(make_skill):
    rng = np.random.default_rng(1)
    skill = make_skill(rng, dimension=3, n_components=5)
    x = rng.normal(0, 0.2, (9000, 3))  # more than two blocks
    many = skill.velocity(x)
    assert many.shape == x.shape
    for index in (0, 4095, 4096, 8999):
        one = skill.velocity(x[index])
        assert one.shape == (3,)
        assert np.abs(one - many[index]).max() <= RELATIVE * scale_of(skill, x[index])


def test_the_attractor_is_at_rest(make_skill):
    skill = make_skill(np.random.default_rng(2), attractor=[0.3, -0.1])
    assert (skill.velocity(skill.attractor) == 0).all()


@pytest.mark.parametrize("distance", [1e3, 1e50, 1e120, 1e200, 1e300])
def test_far_away_the_velocity_is_finite_and_points_inwards(make_skill, distance):
    rng = np.random.default_rng(3)
    skill = make_skill(rng, dimension=3)
    directions = rng.normal(size=(20, 3))
    velocity = skill.velocity(distance * directions)
    # P = I: ξᵀ ξ̇ ≤ −r ‖ξ‖², scaled down so that the product stays finite
    assert (np.einsum("ni,ni->n", velocity / distance, directions) < 0).all()
    one = skill.velocity(distance * directions[0])
    assert np.abs(one - velocity[0]).max() <= RELATIVE * scale_of(skill, distance * directions[:1])


def test_weights_sum_to_one(make_skill):
    skill = make_skill(np.random.default_rng(4), n_components=6)
    weights = skill.responsibilities(np.random.default_rng(5).normal(0, 10, (500, 2)))
    assert weights.shape == (500, 6)
    assert (weights >= 0).all()
    assert np.abs(weights.sum(axis=1) - 1).max() <= 8 * EPS


def test_the_order_of_the_components_does_not_matter(make_skill):
    rng = np.random.default_rng(6)
    skill = make_skill(rng, n_components=5)
    order = rng.permutation(5)
    names = ("priors", "means", "covariances", "system_matrices", "residual_covariances")
    permuted = replace(skill, **{name: getattr(skill, name)[order] for name in names})
    x = rng.normal(0, 0.2, (100, 2))
    assert np.abs(permuted.velocity(x) - skill.velocity(x)).max() <= RELATIVE * scale_of(skill, x)


def test_a_moved_skill_moves_the_same_way_elsewhere(make_skill):
    rng = np.random.default_rng(7)
    skill, offset = make_skill(rng), np.array([0.7, -0.4])
    x = rng.normal(0, 0.2, (100, 2))
    moved = skill.translated(offset)
    assert np.abs(moved.velocity(x + offset) - skill.velocity(x)).max() <= RELATIVE * scale_of(skill, x)
    assert (moved.density.means == skill.density.means + offset).all()


def test_retargeting_puts_the_attractor_exactly_there(make_skill):
    rng = np.random.default_rng(8)
    for _ in range(50):  # ξ* + (target − ξ*) rounds away from the target now and then
        skill = make_skill(rng, attractor=rng.normal(size=2))
        target = rng.normal(size=2)
        moved = retargeted(skill, target)
        assert (moved.attractor == target).all()
        x = rng.normal(0, 0.1, (5, 2))
        difference = moved.velocity(x + target) - skill.velocity(x + skill.attractor)
        assert np.abs(difference).max() <= RELATIVE * scale_of(skill, x + skill.attractor)


@pytest.mark.parametrize("target", [[0.0], [0.0, 0.0, 0.0], [np.nan, 0.0], [[0.0, 0.0]]])
def test_a_target_needs_as_many_finite_numbers_as_the_state(make_skill, target):
    with pytest.raises(UsageError, match="target: expected 2 finite numbers"):
        retargeted(make_skill(np.random.default_rng(0)), target)


def test_speed_multiplies_velocities(make_skill):
    skill = make_skill(np.random.default_rng(9))
    x = np.random.default_rng(0).normal(0, 0.2, (10, 2))
    faster = replace(skill, speed=4.0)  # a power of two: exact
    assert (faster.velocity(x) == 4 * skill.velocity(x)).all()
    assert (faster.component_matrices == 4 * skill.system_matrices).all()


def test_a_leaf_is_its_own_leaf_and_knows_its_density(make_skill):
    skill = make_skill(np.random.default_rng(0))
    assert skill.leaves == (skill,)
    assert skill.density is skill.density


def test_its_arrays_are_read_only(make_skill):
    skill = make_skill(np.random.default_rng(0))
    for name in ("priors", "means", "covariances", "system_matrices", "attractor", "lyapunov"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(skill, name)[0] = 0.0


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"priors": [0.5, 0.25, 0.5]}, "priors"),
        ({"system_matrices": np.zeros((2, 2, 2))}, "system_matrices: expected shape"),
        ({"residual_covariances": np.zeros((3, 2, 2))}, "residual_covariances: must be positive definite"),
        ({"lyapunov": np.diag([1.0, -1.0])}, "lyapunov: must be positive definite"),
        ({"attractor": [0.0, np.nan]}, "attractor: must be finite"),
        ({"speed": 0.0}, "speed: must be a positive number"),
        ({"speed": np.inf}, "speed: must be a positive number"),
        ({"speed": 1e308}, "speed: must be zero or of a size from 1e-100 to 1e[+]100"),
        (
            {"speed": 1e-100, "system_matrices": np.full((3, 2, 2), -0.1)},
            "speed times the system matrices: must",
        ),
        ({"system_matrices": np.full((3, 2, 2), -1e-101)}, "system_matrices: must be zero or of a size"),
        ({"lyapunov": 1e101 * np.eye(2)}, "lyapunov: must be zero or of a size"),
        ({"lyapunov": np.array([[1.0, 1.0], [1.0, 1.0]])}, "lyapunov: must be positive definite, and not"),
        ({"space": Euclidean.cartesian(3)}, "space"),
        ({"density": GaussianMixture([1.0], [[0.0]], [[[1.0]]])}, "density"),
    ],
)
def test_a_skill_is_valid_or_does_not_exist(make_skill, changed, words):
    with pytest.raises(InvalidModelError, match=words):
        replace(make_skill(np.random.default_rng(0)), **changed)
