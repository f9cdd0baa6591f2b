"""Statistics of many episodes: how often they succeed, how certain that is, and why others fail."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields
from statistics import NormalDist

import numpy as np

from skillctl.simulation.batch import BATCH_OUTCOMES, BatchOutcome, Row
from skillctl.simulation.episode import SUCCESSES, Metrics

CONFIDENCE = 0.95
CUP_COLUMNS = ("cup_x", "cup_y", "cup_radius", "cup_mass", "cup_friction")


def wilson_interval(successes: int, trials: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return Wilson's score interval of a probability, for ``successes`` in ``trials``.

    (p̂ + z²/2n ± z √(p̂(1−p̂)/n + z²/4n²)) / (1 + z²/n): all probabilities for which p̂ is within z standard
    deviations. It stays in [0, 1] and has a width also at 0 of n and n of n, where p̂ ± z·SE has none. It
    assumes independent trials of equal probability, such as drawn episodes.

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
    # At 0 of n and n of n one end is exactly 0 or 1, which rounding would miss.
    return (low if successes else 0.0), (high if successes < trials else 1.0)


def failures(rows: Sequence[Row]) -> dict[BatchOutcome, int]:
    """Return the number of failed episodes by class, without zeros, in the order of ``BATCH_OUTCOMES``."""
    counts = Counter(row.outcome for row in rows)
    return {kind: counts[kind] for kind in BATCH_OUTCOMES if counts[kind] and kind not in SUCCESSES}


@dataclass(frozen=True)
class LostCups:
    """Episodes in which a chain lost the cup.

    Attributes:
        episodes: How many.
        stood: In how many of them it then stood in reach, at least once.
        again: In how many of these the fingers closed again.
        succeeded: How many of these succeeded.
    """

    episodes: int
    stood: int
    again: int
    succeeded: int


def lost_cups(rows: Sequence[Row]) -> LostCups:
    """Return what became of the cups that were lost."""
    lost = [(row.success, row.metrics) for row in rows if row.metrics is not None and row.metrics.cup_lost]
    stood = [(success, metrics.cup_tries > 1) for success, metrics in lost if metrics.cup_stood]
    return LostCups(
        len(lost), len(stood), sum(again for _, again in stood), sum(success for success, _ in stood)
    )


def medians(rows: Sequence[Row]) -> dict[str, float]:
    """Return the median of each figure over the episodes that have it; NaN if none has."""
    measured = [row.metrics for row in rows if row.metrics is not None]
    middles: dict[str, float] = {}
    for field in fields(Metrics):
        if field.name == "contacts":  # words
            continue
        values = np.array([getattr(metrics, field.name) for metrics in measured], dtype=np.float64)
        values = values[~np.isnan(values)]
        middles[field.name] = float(np.median(values)) if len(values) else math.nan
    return middles


def encode_rows(rows: Sequence[Row]) -> bytes:
    """Return episodes as a CSV file. Equal batches give equal bytes; every number reads back exactly.

    Columns: ``episode``, from 0; ``outcome``; ``success``, 0 or 1; ``seed``; ``start`` and ``target`` of the
    scenario, in the skill's own coordinates; ``cup_x cup_y cup_radius cup_mass cup_friction``; ``part``, the
    acting part of a combined skill, from 0; ``hand``, its orientation; the metrics of an episode under their
    names, in SI units; ``detail``. A value that does not exist is empty; spaces separate several numbers.
    """
    names = [field.name for field in fields(Metrics)]
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(
        [
            "episode",
            "outcome",
            "success",
            "seed",
            "start",
            "target",
            *CUP_COLUMNS,
            "part",
            "hand",
            *names,
            "detail",
        ]
    )
    for row in rows:
        scenario, cup = row.scenario, row.scenario.cup
        cells = [
            *(row.index, row.outcome, int(row.success), scenario.seed, scenario.start, scenario.target),
            *([None] * 5 if cup is None else (*cup.place, cup.radius, cup.mass, cup.friction)),
            None if row.trace is None else row.trace.part,
            None if row.trace is None else row.trace.hand,
            *(None if row.metrics is None else getattr(row.metrics, name) for name in names),
            row.detail,
        ]
        writer.writerow(map(_cell, cells))
    return file.getvalue().encode()


def _cell(value: object) -> object:
    if isinstance(value, float) and math.isnan(value):
        return None
    if isinstance(value, tuple):
        return ("; " if any(isinstance(item, str) for item in value) else " ").join(map(str, value))
    return value
