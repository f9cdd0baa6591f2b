"""Calibrated priors stand in the middle between the two borders that decide, which SciPy computes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from skillctl.compose.combine import combine
from skillctl.evaluate.coverage import BEYOND, calibrated_priors
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.mixture import GaussianMixture

SPREAD = 0.2  # [m], standard deviation of both densities, at 0 and at 1
EPS = np.finfo(float).eps


@pytest.fixture
def pair(make_skill):
    """Two skills of one dimension, taught around 0 and around 1, combined with equal priors."""
    parts = []
    for centre in (0.0, 1.0):
        density = GaussianMixture([1.0], [[centre]], [[[SPREAD**2]]])
        skill = make_skill(np.random.default_rng(0), dimension=1, attractor=np.zeros(1))
        parts.append(replace(skill, density=density))
    return combine(parts)


def taught(skill, starts):
    """Return demonstrations from these places to the origin, where both parts have their attractor."""
    times, share = np.linspace(0, 1, 20), np.linspace(1, 0, 20)[:, None]
    motions = [Demonstration.from_positions(times, share * start) for start in starts]
    return DemonstrationSet(tuple(motions), skill.space)


def border(start):
    """Return the log β₁ − log β₂ above which the first part acts at a place."""
    return norm.logpdf(start, 1.0, SPREAD) - norm.logpdf(start, 0.0, SPREAD)


def log_ratio(priors):
    return np.log(priors[0]) - np.log(priors[1])


# Logarithms of densities and priors here are below 64; a dozen of them is added up.
ROUNDING = 12 * 64 * EPS


def test_the_priors_lie_in_the_middle_between_the_borders_that_decide(pair):
    # With equal priors the border is at 0.5, so one start of the first part is lost: at 0.62. With a border
    # between 0.62 and 0.7, where the second part was taught, none is lost.
    sets = [taught(pair, [0.1, 0.3, 0.62]), taught(pair, [0.7, 0.9])]
    middle = 0.5 * (border(0.62) + border(0.7))
    assert abs(log_ratio(calibrated_priors(pair, sets)) - middle) <= ROUNDING


def test_where_two_borders_coincide_the_next_one_decides(pair):
    sets = [taught(pair, [0.1, 0.6, 0.6]), taught(pair, [0.8, 0.9, 0.9])]
    middle = 0.5 * (border(0.6) + border(0.8))
    assert abs(log_ratio(calibrated_priors(pair, sets)) - middle) <= ROUNDING


def test_beyond_the_last_border_the_priors_go_by_a_fixed_step(pair):
    sets = [taught(pair, [0.1, 0.6, 0.75]), None]
    assert abs(log_ratio(calibrated_priors(pair, sets)) - (border(0.75) + BEYOND)) <= ROUNDING
