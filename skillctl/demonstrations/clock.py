"""The times of a table: numbers in seconds or smaller units, dates, and times of day."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime, timedelta, timezone

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.demonstrations.units import UNITS, Unit

DATE = r"(?P<year>\d{4})[-/.](?P<month>\d\d?)[-/.](?P<day>\d\d?)"
CLOCK = r"(?P<hour>\d\d?):(?P<minute>\d\d)(:(?P<second>\d\d)(?P<fraction>[.,]\d+)?)?"
ZONE = r"\s*(?P<zone>Z|UTC|GMT|[-+]\d\d(:?\d\d)?)?"
STAMP = re.compile(rf"\s*({DATE}(\s+|\s*T\s*))?{CLOCK}{ZONE}\s*", re.IGNORECASE)
LOOKS_LIKE_ONE = re.compile(r".*\d[:/.-]\d+[:/.-]\d.*|\d{8}T\d{4}.*")
DAY = 86400.0  # [s]
KNOWN = "Dates are read as 2024-03-05T14:02:07.123+00:00, times of day as 14:02:07.123."
SINCE_1970 = ((1e18, "ns"), (1e15, "us"), (1e12, "ms"))  # stamps of this century are as large, in this unit


def is_stamp(cell: str) -> bool:
    """Return whether a cell holds a date with a time of day, or a time of day."""
    return STAMP.fullmatch(cell) is not None


def unit_of(first: float) -> Unit:
    """Return the unit in which a first time stamp counts from 1970, or seconds, from when ever."""
    return UNITS[next((unit for least, unit in SINCE_1970 if least <= abs(first) < 10 * least), "s")]


def seconds(cells: Sequence[str]) -> FloatArray:
    """Return the times of stamps after the first one, (T,), [s]; without dates, they may pass midnight.

    Raises:
        ValueError: One is no stamp; its argument is the index of it.
    """
    stamps = [_moment(cell, index) for index, cell in enumerate(cells)]
    first = stamps[0][0]
    times = np.array([(moment - first).total_seconds() + fraction for moment, fraction in stamps])
    back = np.diff(times) < -DAY / 2
    return times + DAY * np.concatenate([[0], np.cumsum(back)]) if back.any() else times


def _moment(cell: str, index: int) -> tuple[datetime, float]:
    """Return a stamp in whole seconds, and the fraction of a second, which has up to nine digits."""
    match = STAMP.fullmatch(cell)
    if match is None:
        raise ValueError(index)
    date = [int(match[part] or default) for part, default in (("year", 2000), ("month", 1), ("day", 1))]
    clock = [int(match[part] or 0) for part in ("hour", "minute", "second")]
    try:
        moment = datetime(*date, *clock, tzinfo=_zone(match["zone"] or ""))  # type: ignore[misc,arg-type]
    except ValueError:
        raise ValueError(index) from None
    return moment, float((match["fraction"] or "0").replace(",", "."))


def _zone(text: str) -> timezone:
    if text[:1] not in ("+", "-") or not text:
        return timezone.utc
    digits = text[1:].replace(":", "").ljust(4, "0")
    return timezone(int(f"{text[0]}1") * timedelta(hours=int(digits[:2]), minutes=int(digits[2:])))
