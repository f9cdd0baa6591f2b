from __future__ import annotations

from dataclasses import fields

import pytest
from scipy import stats

from skillctl.simulation.batch import Row
from skillctl.simulation.episode import Metrics
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.tally import LostCups, lost_cups, wilson_interval


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_the_interval_is_the_published_one(successes: int, trials: int, low: float, high: float) -> None:
    """R. G. Newcombe, Statistics in Medicine 17 (1998) 857-872, table I, method 3, to its four digits."""
    assert wilson_interval(successes, trials) == pytest.approx((low, high), abs=0.5e-4)


@pytest.mark.parametrize("trials", [1, 2, 7, 50, 1000])
@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.999])
def test_the_interval_is_scipys(trials: int, confidence: float) -> None:
    for successes in {0, 1, trials // 3, trials - 1, trials}:
        theirs = stats.binomtest(successes, trials).proportion_ci(confidence, method="wilson")
        # Both are a dozen roundings of numbers of order one.
        assert wilson_interval(successes, trials, confidence) == pytest.approx(theirs, abs=1e-14)


def test_the_ends_are_exact_and_nothing_says_nothing() -> None:
    assert wilson_interval(0, 7)[0] == 0.0
    assert wilson_interval(7, 7)[1] == 1.0
    assert wilson_interval(0, 0) == (0.0, 1.0)


def test_lost_cups_are_counted_once_an_episode() -> None:
    def row(success: bool, lost: int, stood: int, tries: int) -> Row:
        measured = {each.name: 0.0 for each in fields(Metrics)}
        metrics = Metrics(**{**measured, "cup_lost": lost, "cup_stood": stood, "cup_tries": tries})
        return Row(0, Scenario(), "placed" if success else "dropped", "", metrics, None)

    nothing_lost, fell, twice = row(True, 0, 0, 1), row(False, 1, 0, 1), row(True, 2, 2, 3)
    never_again, in_vain = row(False, 1, 1, 1), row(False, 2, 1, 2)
    refused = Row(0, Scenario(), "unreachable", "", None, None)
    rows = (nothing_lost, fell, twice, never_again, in_vain, refused)
    assert lost_cups(rows) == LostCups(episodes=4, stood=3, again=2, succeeded=1)
