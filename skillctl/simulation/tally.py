"""What many episodes say together: how often it worked, how sure that is, and why it did not."""

from __future__ import annotations

import math
from statistics import NormalDist

CONFIDENCE = 0.95


def wilson_interval(successes: int, trials: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the score interval of a probability of which ``successes`` of ``trials`` were seen.

    (p̂ + z²/2n ± z √(p̂(1−p̂)/n + z²/4n²)) / (1 + z²/n): all probabilities under which what was seen is
    within z standard deviations. It never leaves [0, 1] and means something at 0 of n and n of n, where
    p̂ ± z·SE has no width. It assumes independent trials of equal probability: drawn episodes, not chosen.

    Returns:
        Lower and upper end. (0, 1) for no trials.

    References:
        E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209–212; recommended for all n by L. D. Brown et al.,
        Statistical Science 16 (2001) 101–133.
    """
    if trials == 0:
        return 0.0, 1.0
    z = NormalDist().inv_cdf(0.5 + confidence / 2)
    share, weight = successes / trials, z**2 / trials
    middle = share + weight / 2
    half = math.sqrt(weight * share * (1 - share) + weight**2 / 4)
    low, high = (middle - half) / (1 + weight), (middle + half) / (1 + weight)
    # At the ends one limit is exactly 0 or 1; rounding must not put it a digit beside.
    return (low if successes else 0.0), (high if successes < trials else 1.0)
