from __future__ import annotations

import numpy as np

from skillctl.learning.representatives import representatives


def paths_at(*places: float) -> np.ndarray:
    """Straight motions to zero from places on a line."""
    return np.array(places)[:, None, None] * np.linspace(1, 0, 5)[:, None]


def test_few_demonstrations_stand_for_themselves() -> None:
    indices, shares = representatives(paths_at(1, 2, 4), 3)
    np.testing.assert_array_equal(indices, [0, 1, 2])
    np.testing.assert_array_equal(shares, [1 / 3, 1 / 3, 1 / 3])


def test_the_chosen_are_far_apart_and_stand_for_those_around_them() -> None:
    # Mean 4.7: 5 is nearest to it. As far from 5 as 10 is 0, which comes first. With 5: 3, 4 and 5.5.
    indices, shares = representatives(paths_at(0, 0.5, 3, 4, 5, 5.5, 9.5, 10), 3)
    np.testing.assert_array_equal(indices, [0, 4, 7])
    np.testing.assert_array_equal(shares, [2 / 8, 4 / 8, 2 / 8])


def test_equal_demonstrations_are_chosen_without_complaint() -> None:
    indices, shares = representatives(paths_at(2, 2, 2, 2), 2)
    assert shares.sum() == 1
    assert len(indices) == 2
