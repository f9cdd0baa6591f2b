"""The certified radius: within it one part acts alone, and in closed-form cases it is the border itself."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from skillctl.model.combined import CombinedSkill
from skillctl.model.coordinates.chain import Chain
from skillctl.model.mixture import GaussianMixture
from skillctl.model.rollout import rollout
from skillctl.stability.certificate import certify
from skillctl.stability.region import DensityBounds, certified_radius, selectable_parts


def two_parts(make_skill, rng, places, densities, priors=(0.5, 0.5), lyapunov=None):
    parts = tuple(
        replace(make_skill(rng, dimension=len(place), attractor=place, lyapunov=lyapunov), density=density)
        for place, density in zip(places, densities, strict=True)
    )
    return CombinedSkill(parts, priors, "instantaneous")


def scipy_scores(skill, x):
    """Return log βᵢ pᵢ by SciPy, shape (n, parts)."""
    scores = []
    for prior, part in zip(skill.part_priors, skill.parts, strict=True):
        density = part.density
        logs = [
            np.log(p) + multivariate_normal(m, c).logpdf(x)
            for p, m, c in zip(density.priors, density.means, density.covariances, strict=True)
        ]
        scores.append(np.log(prior) + logsumexp(np.stack(logs, axis=-1), axis=-1))
    return np.stack(scores, axis=-1)


def test_between_equal_spheres_the_radius_is_half_the_distance(make_skill):
    places = ([0.0, 0.0], [0.6, 0.8])
    spheres = [GaussianMixture([1.0], [place], [0.01 * np.eye(2)]) for place in places]
    skill = two_parts(make_skill, np.random.default_rng(0), places, spheres)
    for index in (0, 1):
        # Short of ½ by bisection and guard: less than 1e-6
        assert 0.5 - 1e-6 < certified_radius(skill, index) < 0.5


def test_regions_decide_and_not_position_densities(make_skill):
    places = ([0.0, 0.0], [0.6, 0.8])
    spheres = [GaussianMixture([1.0], [place], [0.01 * np.eye(2)]) for place in places]
    swapped = two_parts(make_skill, np.random.default_rng(0), places, spheres[::-1])
    skill = replace(swapped, regions=tuple(spheres))
    for index, place in enumerate(np.array(places)):
        assert certified_radius(swapped, index) is None
        assert 0.5 - 1e-6 < certified_radius(skill, index) < 0.5
        assert selectable_parts(swapped, place - 0.1, place + 0.1) == (1 - index,)
        assert selectable_parts(skill, place - 0.1, place + 0.1) == (index,)


def test_a_stretched_p_fits_its_ball_into_the_region(make_skill):
    places = ([0.0, 0.0], [0.6, 0.8])
    spheres = [GaussianMixture([1.0], [place], [0.01 * np.eye(2)]) for place in places]
    skill = two_parts(make_skill, np.random.default_rng(0), places, spheres, lyapunov=np.diag([1.0, 16.0]))
    # The long axis of {‖e‖_P ≤ ρ} reaches ρ / √λ_min = ½, the ball inside it has radius ρ / √λ_max.
    assert 0.125 - 1e-6 < certified_radius(skill, 0) < 0.125


@pytest.mark.parametrize("dimension", [1, 2, 3, 6])
def test_on_a_ball_of_no_size_both_bounds_are_the_density(make_skill, dimension):
    rng = np.random.default_rng(dimension)
    skill = make_skill(rng, dimension=dimension)
    bounds = DensityBounds.of(skill.density, 0.3, skill.attractor, np.eye(dimension))
    whole = CombinedSkill((skill, skill), (0.3, 0.7), "instantaneous")
    expected = float(scipy_scores(whole, skill.attractor)[0])
    # The guard on each side is 2^-32 of the largest term, here below a thousand.
    assert expected - 1e3 * 2.0**-32 < bounds.lowest(0.0) < expected < bounds.highest(0.0)
    assert bounds.highest(0.0) < expected + 1e3 * 2.0**-32


def test_a_larger_prior_moves_the_border_as_the_formula_says(make_skill):
    places, variance = ([0.0], [1.0]), 0.04
    lines = [GaussianMixture([1.0], [place], [[[variance]]]) for place in places]
    skill = two_parts(make_skill, np.random.default_rng(1), places, lines, priors=(0.9, 0.1))
    # log 9 − x²/2v + (1 − x)²/2v = 0
    border = 0.5 + variance * np.log(9)
    assert border - 1e-6 < certified_radius(skill, 0) < border
    assert 1 - border - 1e-6 < certified_radius(skill, 1) < 1 - border


def test_a_part_that_does_not_act_at_its_own_attractor_has_no_radius(make_skill):
    places = ([0.0, 0.0], [1.0, 0.0])
    swapped = [GaussianMixture([1.0], [place], [0.01 * np.eye(2)]) for place in places[::-1]]
    skill = two_parts(make_skill, np.random.default_rng(2), places, swapped)
    assert [certified_radius(skill, i) for i in (0, 1)] == [None, None]


def test_a_tie_at_the_attractor_gives_no_radius(make_skill):
    same = GaussianMixture([1.0], [[0.0, 0.0]], [np.eye(2)])
    skill = two_parts(make_skill, np.random.default_rng(3), ([0.0, 0.0], [0.0, 0.0]), [same, same])
    assert certified_radius(skill, 0) is None


@pytest.mark.parametrize("size", [1e-100, 1e-8, 1e100])
def test_the_size_of_p_changes_no_radius(make_skill, size):
    near = [GaussianMixture([1.0], [[x, 0.0]], [0.01 * np.eye(2)]) for x in (0.0, 1.0)]
    skill = two_parts(make_skill, np.random.default_rng(4), ([0.0, 0.0], [1.0, 0.0]), near)

    def with_p(p):
        return replace(skill, parts=tuple(replace(part, lyapunov=p) for part in skill.parts))

    expected = certified_radius(with_p(np.eye(2)), 0)
    assert expected is not None
    assert certified_radius(with_p(size * np.eye(2)), 0) == pytest.approx(expected, rel=1e-9)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), dimension=st.integers(1, 4))
def test_within_the_radius_the_part_wins_everywhere_and_motions_end(make_skill, seed, dimension):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(dimension, dimension))
    p = root @ root.T + 0.3 * np.eye(dimension)
    p = 0.5 * (p + p.T)
    places = rng.normal(0, 0.4, (3, dimension))
    parts = tuple(make_skill(rng, dimension=dimension, attractor=c, lyapunov=p) for c in places)
    skill = CombinedSkill(parts, rng.dirichlet([5.0, 5.0, 5.0]), "instantaneous")
    period = 0.5 * certify(replace(skill, gate="latched")).period
    radii = [certified_radius(skill, index) for index in range(3)]
    # Where a part clearly wins at its own attractor, it has a radius: the test below is not about nothing.
    scores = scipy_scores(skill, places)
    assert all(radii[i] for i in range(3) if scores[i, i] > np.delete(scores[i], i).max() + 1e-3)
    for index, part in enumerate(parts):
        radius = radii[index]
        if radius is None:
            continue
        directions = rng.normal(size=(300, dimension))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        # The whole P-ball around the Euclidean one belongs to the part: sample its surface, and the inside.
        stretch = 1 / np.sqrt(np.einsum("ni,ij,nj->n", directions, p, directions))
        rho = radius * np.sqrt(np.linalg.eigvalsh(p)[-1])
        shells = rng.uniform(0, 1, (300, 1)) ** 0.25
        x = part.attractor + rho * stretch[:, None] * shells * directions
        assert (np.argmax(scipy_scores(skill, x), axis=-1) == index).all()
        motions = rollout(
            skill, part.attractor + radius * directions[:5], duration=200 * period, period=period
        )
        assert (motions.parts == index).all()


def test_in_other_coordinates_the_part_wins_everywhere_within_the_radius(make_skill, make_shears):
    rng = np.random.default_rng(6)
    places = np.array([[0.0, 0.0], [0.4, 0.3]])
    link = Chain((make_shears(rng, 2, size=0.1),))
    near = [GaussianMixture([1.0], [place], [1e-2 * np.eye(2)]) for place in places]
    skill = two_parts(make_skill, rng, places, near)
    skill = replace(skill, parts=tuple(replace(part, coordinates=link) for part in skill.parts))
    certificate = certify(skill)
    assert certificate.scope == "local"
    for index, part in enumerate(certificate.parts):
        assert 0.02 < part.radius < 0.25  # half the distance of the two
        directions = rng.normal(size=(500, 2))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        starts = places[index] + part.radius * directions
        motions = rollout(skill, starts, duration=500 * part.period, period=part.period)
        # At no sample of these motions, from the border on, is the other part the nearer one.
        distances = np.linalg.norm(motions.positions[:, :, None] - places, axis=-1)
        assert (np.argmin(distances, axis=-1) == index).all()


def test_with_one_target_and_one_p_but_different_coordinates_switching_is_not_proved(make_skill, make_shears):
    rng = np.random.default_rng(7)
    parts = tuple(
        replace(make_skill(rng), coordinates=Chain((make_shears(rng, 2, size=0.05),))) for _ in range(2)
    )
    assert certify(CombinedSkill(parts, [0.5, 0.5], "instantaneous")).scope != "global"
    assert certify(CombinedSkill(parts, [0.5, 0.5], "latched")).scope == "global"
    shared = tuple(replace(part, coordinates=parts[0].coordinates) for part in parts)
    assert certify(CombinedSkill(shared, [0.5, 0.5], "instantaneous")).scope == "global"
