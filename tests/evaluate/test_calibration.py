"""Calibrated priors stand in the middle between the two borders that decide, which SciPy computes."""

import numpy as np
from scipy.stats import norm

from skillctl.evaluate.coverage import BEYOND, best_priors

SPREAD = 0.2  # [m], standard deviation of both regions, at 0 and at 1
EVEN = np.array([0.5, 0.5])
EPS = np.finfo(float).eps


def scores(starts):
    """Return the log densities of both regions at places."""
    return norm.logpdf(np.array(starts)[:, None], [0.0, 1.0], SPREAD)


def border(start):
    """Return the log β₁ − log β₂ above which the first part acts at a place."""
    return norm.logpdf(start, 1.0, SPREAD) - norm.logpdf(start, 0.0, SPREAD)


def log_ratio(priors):
    return np.log(priors[0]) - np.log(priors[1])


# Logarithms of densities and priors here are below 64; a dozen of them is added up.
ROUNDING = 12 * 64 * EPS


def test_the_priors_lie_in_the_middle_between_the_borders_that_decide():
    # With equal priors the border is at 0.5, so one start of the first part is lost: at 0.62. With a border
    # between 0.62 and 0.7, where the second part was taught, none is lost.
    groups = [(0, scores([0.1, 0.3, 0.62])), (1, scores([0.7, 0.9]))]
    middle = 0.5 * (border(0.62) + border(0.7))
    assert abs(log_ratio(best_priors(groups, EVEN)) - middle) <= ROUNDING


def test_where_two_borders_coincide_the_next_one_decides():
    groups = [(0, scores([0.1, 0.6, 0.6])), (1, scores([0.8, 0.9, 0.9]))]
    middle = 0.5 * (border(0.6) + border(0.8))
    assert abs(log_ratio(best_priors(groups, EVEN)) - middle) <= ROUNDING


def test_beyond_the_last_border_the_priors_go_by_a_fixed_step():
    groups = [(0, scores([0.1, 0.6, 0.75]))]
    assert abs(log_ratio(best_priors(groups, EVEN)) - (border(0.75) + BEYOND)) <= ROUNDING


def selected(groups, priors):
    """Return the sum over parts of the share of starts that select them."""
    return sum(np.mean(np.argmax(logs + np.log(priors), axis=1) == part) for part, logs in groups)


def test_of_two_parts_no_priors_do_better():
    rng = np.random.default_rng(7)
    for _ in range(5):
        groups = [(part, rng.normal(0, 20, (9 - part, 2))) for part in (0, 1)]
        found = best_priors(groups, EVEN)
        best = max(selected(groups, np.array([1, t]) / (1 + t)) for t in np.exp(np.linspace(-60, 60, 241)))
        # A grid can miss an interval, never beat the best one.
        assert selected(groups, found) >= best
        assert found.min() > 0


def test_of_three_parts_none_loses():
    rng = np.random.default_rng(8)
    for _ in range(10):
        groups = [(part, rng.normal(0, 20, (5, 3))) for part in range(3)]
        even = np.full(3, 1 / 3)
        assert selected(groups, best_priors(groups, even)) >= selected(groups, even)
