"""Units of positions and times: how headers spell them, and how many make a metre, a radian or a second."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit.

    Attributes:
        name: Its short name, as in ``--units``.
        base: Unit that it is converted to: m, rad or s; px for pixels, whose size is unknown.
        per_base: How many of it make one of the base.
        words: Other spellings, in small letters.
    """

    name: str
    base: str
    per_base: float
    words: str

    @property
    def spellings(self) -> tuple[str, ...]:
        """All spellings, in small letters."""
        return (self.name, *self.words.split())


UNITS = {
    unit.name: unit
    for unit in (
        Unit("m", "m", 1.0, "metre metres meter meters"),
        Unit("cm", "m", 100.0, "centimetre centimetres centimeter centimeters"),
        Unit("mm", "m", 1000.0, "millimetre millimetres millimeter millimeters"),
        Unit("um", "m", 1e6, "µm μm micrometre micrometres micrometer micrometers"),
        Unit("in", "m", 1 / 0.0254, "inch inches"),
        Unit("ft", "m", 1 / 0.3048, "foot feet"),
        Unit("px", "px", 1.0, "pixel pixels"),
        Unit("rad", "rad", 1.0, "rads radian radians"),
        Unit("deg", "rad", 180 / math.pi, "° degs degree degrees"),
        Unit("s", "s", 1.0, "sec secs second seconds"),
        Unit("ms", "s", 1e3, "msec msecs millis millisec millisecond milliseconds"),
        Unit("us", "s", 1e6, "µs μs usec usecs micros microsec microsecs microsecond microseconds"),
        Unit("ns", "s", 1e9, "nsec nsecs nanos nanosec nanosecs nanosecond nanoseconds"),
    )
}
SPELLED = {word: unit for unit in UNITS.values() for word in unit.spellings}
WORDS = ("in", "ft", "foot", "feet")  # of names, too: units in brackets only
BARE = "|".join(re.escape(spelling) for spelling in SPELLED if spelling not in WORDS)
IN_BRACKETS = re.compile(r"(?P<stem>.*?)[\s_]*[\[({](?P<unit>[^\[\](){}]*)[\])}]\s*")
AT_THE_END = re.compile(rf"(?:(?P<stem>.*?)(?:[\s_.,:/-]|\s+in\s+))??(?P<unit>{BARE})", re.IGNORECASE)
CAPITAL = re.compile(r"(?<=[a-z])(?=([MUN]s|[MUN]secs?|Secs?|Mm|Cm|Deg|Rad)$)")  # of a unit: timestampNs
RATES = re.compile(r".*(/\s*s|s\s*\^?\s*-\s*[12])", re.IGNORECASE)
FORCES = re.compile(r"N|N[\s.*·]?m", re.IGNORECASE)


def split_unit(name: str) -> tuple[str, Unit | None]:
    """Return a column's name without its unit, and the unit: ``X (mm)``, ``x_mm`` and ``j1 [deg]`` say one.

    A unit of speed or force becomes a word of the name: ``x [m/s]`` is a velocity.
    """
    if match := IN_BRACKETS.fullmatch(name):
        stem, spelled = match["stem"], match["unit"].strip()
        if unit := SPELLED.get(spelled.lower()):
            return stem, unit
        if RATES.fullmatch(spelled):
            return f"{stem} velocity", None
        if FORCES.fullmatch(spelled):
            return f"{stem} force", None
        return (name if spelled else stem), None
    match = AT_THE_END.fullmatch(CAPITAL.sub("_", name))
    unit = SPELLED[match["unit"].lower()] if match else None
    if match is None or unit is None or not (match["stem"] or unit.base == "s" != name.lower()):
        return name, None  # a column named m or s is no unit
    return (match["stem"] or "").rstrip(" _.,:/-"), unit
