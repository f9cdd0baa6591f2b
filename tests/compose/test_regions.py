"""Regions of parts: their formula and width by SciPy, and what they are for, at places solved by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from skillctl.compose.combine import combine
from skillctl.compose.regions import MOST_STARTS, USUAL_WIDTH, regions, start_width
from skillctl.errors import InvalidModelError
from skillctl.model.mixture import GaussianMixture

EPS = np.finfo(float).eps


def gaussian(mean, *deviations):
    return GaussianMixture([1.0], [mean], [np.diag(deviations) ** 2])


def likelihood(width, starts, usual):
    """Return the log-likelihood of each start given the others of its part, and of the imagined one."""
    d = starts[0].shape[1]
    total = multivariate_normal.logpdf(np.full(d, usual), np.zeros(d), width**2)
    for places in starts:
        for i, place in enumerate(places):
            others = np.delete(places, i, axis=0)
            logs = [multivariate_normal.logpdf(place, other, width**2) for other in others]
            total += logsumexp(logs)
    return total


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_the_width_makes_left_out_starts_most_likely(dimension):
    rng = np.random.default_rng(dimension)
    starts = [rng.normal(0, spread, (n, dimension)) for spread, n in ((0.02, 7), (0.08, 4))]
    found = start_width(starts, 0.01)
    best = minimize_scalar(
        lambda log_width: -likelihood(np.exp(log_width), starts, 0.01), bracket=(-5, -3), tol=1e-10
    )
    # The search ends when the variance changes by less than a millionth a step, some steps too early.
    assert found == pytest.approx(np.exp(best.x), rel=1e-4)


def test_without_pairs_of_starts_the_width_is_the_usual_one_and_equal_starts_leave_some():
    assert start_width([], 0.01) == pytest.approx(0.01, rel=4 * EPS)
    # n starts at one place and the imagined one: the variance is that of the latter over n + 1.
    assert start_width([np.zeros((8, 3))], 0.03) == pytest.approx(0.01, rel=1e-6)


def test_a_region_is_path_starts_and_far_surroundings():
    densities = [gaussian([0.0, 0.0], 0.1, 0.3), gaussian([2.0, 0.0], 0.2, 0.1)]
    starts = [np.array([[-0.5, 0.0], [-0.5, 0.1]]), None]
    near = start_width([starts[0]], USUAL_WIDTH * 4 * np.hypot(0.2, 0.1))
    x = np.random.default_rng(0).uniform(-1, 3, (50, 2))

    def around(centres, width):
        return np.mean([multivariate_normal.pdf(x, centre, width**2) for centre in centres], axis=0)

    for region, density, centres in zip(
        regions(densities, starts), densities, (starts[0], [[2.0, 0.0]]), strict=True
    ):
        path = multivariate_normal.pdf(x, density.means[0], density.covariances[0])
        far = 0.09 * around(centres, 0.3) + 0.01 * around(density.means, 0.3)
        expected = 0.5 * path + 0.4 * around(centres, near) + far
        assert np.exp(region.log_density(x)) == pytest.approx(expected, rel=1e-9)


def test_far_from_the_data_the_nearest_start_wins_not_the_widest_gaussian(make_skill):
    narrow, wide = gaussian([0.0, 0.0], 0.005, 0.005), gaussian([0.84, 0.0], 0.04, 0.04)
    parts = [replace(make_skill(np.random.default_rng(k)), density=p) for k, p in enumerate((narrow, wide))]
    starts = [np.array([[0.0, 0.004], [0.0, -0.004]]), np.array([[0.9, 0.02], [0.9, -0.02]])]
    place = [[0.24, 0.0]]  # 0.24 m from the one start, 0.66 m from the other
    plain = combine(parts)
    assert plain.part_at(place) == [1]
    assert replace(plain, regions=regions([narrow, wide], starts)).part_at(place) == [0]


def test_where_one_motion_ends_and_another_begins_the_latter_acts(make_skill):
    ends, begins = gaussian([0.0, 0.0], 0.01, 0.01), gaussian([1.0, 0.0], 0.3, 0.05)
    parts = [replace(make_skill(np.random.default_rng(k)), density=p) for k, p in enumerate((ends, begins))]
    starts = [np.array([[-1.0, 0.0], [-1.0, 0.1]]), np.array([[0.0, 0.03], [0.02, -0.03], [-0.02, 0.0]])]
    place = [[0.03, 0.0]]
    plain = combine(parts)
    assert plain.part_at(place) == [0]
    assert replace(plain, regions=regions([ends, begins], starts)).part_at(place) == [1]


def test_of_many_starts_some_stand_for_all():
    starts = np.column_stack([np.linspace(0, 1, 500), np.zeros(500)])
    region, _ = regions([gaussian([0.0, 0.0], 0.1, 0.1)] * 2, [starts, starts[:2]])
    assert region.n_components == 1 + 2 * MOST_STARTS + 1
    assert (region.means[1] == starts[0]).all()
    assert (region.means[MOST_STARTS] == starts[-1]).all()


def test_regions_move_with_the_skill_and_scale_with_its_unit(make_skill):
    densities = [gaussian([0.0, 0.0], 0.1, 0.3), gaussian([0.6, 0.0], 0.2, 0.1)]
    starts = [np.array([[-0.5, 0.0], [-0.5, 0.1]]), np.array([[1.0, 0.2]])]
    parts = [replace(make_skill(np.random.default_rng(k)), density=p) for k, p in enumerate(densities)]
    skill = replace(combine(parts), regions=regions(densities, starts))
    x, offset = np.random.default_rng(1).uniform(-1, 2, (200, 2)), np.array([3.0, -2.0])
    assert (skill.translated(offset).part_at(x + offset) == skill.part_at(x)).all()
    assert 0 < skill.part_at(x).mean() < 1
    larger = [GaussianMixture(p.priors, 1e3 * p.means, 1e6 * p.covariances) for p in densities]
    scaled = replace(skill, regions=regions(larger, [1e3 * places for places in starts]))
    assert (scaled.part_at(1e3 * x) == skill.part_at(x)).all()


def test_one_state_and_many_select_alike(make_skill):
    densities = [gaussian([0.0, 0.0], 0.1, 0.3), gaussian([0.6, 0.0], 0.2, 0.1)]
    parts = [replace(make_skill(np.random.default_rng(k)), density=p) for k, p in enumerate(densities)]
    skill = replace(combine(parts), regions=regions(densities, [np.array([[-0.5, 0.0]]), None]))
    x = np.random.default_rng(1).uniform(-3, 3, (200, 2))
    assert [skill.selected(state) for state in x] == skill.part_at(x).tolist()


@pytest.mark.parametrize("given", [[gaussian([0.0, 0.0], 1, 1)], [gaussian([0.0], 1)] * 2])
def test_a_skill_has_one_region_a_part_in_its_space(make_skill, given):
    skill = combine([make_skill(np.random.default_rng(k)) for k in range(2)])
    with pytest.raises(InvalidModelError, match="regions: expected one a part, of 2 dimensions"):
        replace(skill, regions=tuple(given))
