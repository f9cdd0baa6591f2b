"""What a user may choose, declared once: dataclass fields that say how they are called, read and explained.

    @dataclass(frozen=True)
    class Reading:
        dt: float | None = option(None, metavar="S", help="Seconds between samples.")

The command line makes its options of these fields, a manifest its keys, and a skill its record of how it was
made. Only the standard library is imported here, because ``--help`` must not wait for anything heavier.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from functools import cache
from typing import Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

from skillctl.errors import UsageError

# Headings under which options of several commands stand.
MOTION = "The motion"
RESULT = "The result"

LENGTHS = {
    "mm": ("m", 1e-3),
    "cm": ("m", 1e-2),
    "deg": ("rad", math.pi / 180),
    "rad": ("rad", 1.0),
    "m": ("m", 1.0),
}
FARTHEST = 100.0  # [m]; coordinates from here on are not in metres


@dataclass(frozen=True, slots=True)
class Option:
    """How one choice is offered.

    Attributes:
        help: What it does.
        metavar: A word for its value, as in ``F.png``; completion uses it, too.
        group: Heading under which the help shows it.
        name: Its long name if the field's own, with dashes, is another.
        short: Its short name: ``-o``.
        choices: Texts that it can be. By default those of the field's ``Literal``.
        read: Turns one text into the value; a ValueError says what was expected.
        repeated: Given once for each entry of a tuple.
        environment: Variable that is read where the option is not given.
        required: It has to be given.
        named: Options of their own that together make one mapping from their names to numbers.
    """

    help: str = ""
    metavar: str | None = None
    group: str | None = None
    name: str | None = None
    short: str | None = None
    choices: tuple[str, ...] = ()
    read: Callable[[str], Any] | None = None
    repeated: bool = False
    environment: str | None = None
    required: bool = False
    named: tuple[Named, ...] = ()


@dataclass(frozen=True, slots=True)
class Named:
    """A number that has a name only at run time, such as a parameter of a gate."""

    name: str
    default: float
    help: str


@dataclass(frozen=True, slots=True)
class Declared:
    """A field that a user may choose: its name, its type, its default, and how it is offered."""

    field: str
    kind: Any
    default: Any
    option: Option

    @property
    def key(self) -> str:
        """The long name, without dashes in front: ``slowest-rate``."""
        return self.option.name or self.field.replace("_", "-")

    @property
    def choices(self) -> tuple[str, ...]:
        """Texts that it can be; none if anything goes."""
        return self.option.choices or (() if self.option.read else literals(self.kind))


def option(default: Any = None, **offered: Any) -> Any:
    """Return a dataclass field that users may choose; the keywords are those of ``Option``."""
    return field(default=default, metadata={Option: Option(**offered)})


@cache
def options_of(kind: Any) -> tuple[Declared, ...]:
    """Return what users may choose of a dataclass, in the order of its fields."""
    hints = get_type_hints(kind)
    return tuple(
        Declared(each.name, hints[each.name], each.default, each.metadata[Option])
        for each in fields(kind)
        if Option in each.metadata
    )


def changed(values: Any) -> Iterator[Declared]:
    """Yield the options of a dataclass instance that have another value than the default."""
    kind: Any = type(values)
    return (each for each in options_of(kind) if getattr(values, each.field) != each.default)


def require_choices(values: Any) -> None:
    """Raise UsageError if a field of a dataclass instance has choices and is none of them."""
    kind: Any = type(values)
    for each in options_of(kind):
        value = getattr(values, each.field)
        if each.choices and value not in (*each.choices, each.default):
            raise UsageError(f"{each.key}: must be one of {', '.join(each.choices)}, got {value!r}.")


def literals(kind: Any) -> tuple[str, ...]:
    """Return the texts of a ``Literal``, or of one that may also be None."""
    if get_origin(kind) is Literal:
        return get_args(kind)
    return next(filter(None, map(literals, get_args(kind))), ())


def read_numbers(text: str) -> tuple[float, ...]:
    """Read ``1,2.5,-3``, or raise ValueError."""
    return _listed(text, float, "numbers separated by commas, as in 0.4,0,0.5")


def read_ratio(text: str) -> float:
    """Read ``0.01`` or ``1/60``, or raise ValueError."""
    above, _, below = text.partition("/")
    try:
        return float(above) / float(below or 1)
    except (ValueError, ZeroDivisionError):
        raise ValueError(f"{text!r} is not a number, as in 0.01 or 1/60.") from None


def read_point(text: str) -> tuple[float, ...]:
    """Read coordinates in metres or radians, or raise ValueError; no arm reaches ``630,0,760``."""
    point = read_numbers(text)
    if any(FARTHEST <= abs(number) < math.inf for number in point):
        metres = ",".join(f"{number / 1000:g}" for number in point)
        raise ValueError(f"{text} are metres; did you mean millimetres, which are {metres}?")
    return point


class Length(NamedTuple):
    """A length or an angle.

    Attributes:
        value: In ``unit``.
        unit: ``m`` or ``rad``; empty if none was given.
    """

    value: float
    unit: str


def read_length(text: str) -> Length:
    """Read ``5mm``, ``0.5 cm``, ``2deg`` or a number without a unit, or raise ValueError."""
    number, name = re.split(rf"\s*({'|'.join(LENGTHS)})?$", text.strip(), maxsplit=1)[:2]
    unit, factor = LENGTHS.get(name, ("", 1.0))
    try:
        return Length(float(number) * factor, unit)
    except ValueError:
        raise ValueError(f"{text!r} is no length, as in 5mm, 1cm, 0.005 or 2deg.") from None


def read_words(text: str, known: Sequence[str] = ()) -> tuple[str, ...]:
    """Read ``x,y,z``, or raise ValueError; if words are known, no others."""
    words = _listed(text, str, "names separated by commas, as in x,y,z")
    if known and (others := [word for word in words if word not in known]):
        raise ValueError(f"{others[0]!r} is not one of {', '.join(known)}.")
    return words


def read_ranges(text: str) -> tuple[int, ...]:
    """Read ``0,2,5-9``, or raise ValueError."""
    numbers: list[int] = []
    for first, dash, last in (part.strip().partition("-") for part in text.split(",")):
        if not first.isdecimal() or (dash and not last.isdecimal()) or (dash and int(last) < int(first)):
            raise ValueError(f"{text!r} is not a list of numbers from 0 on, as in 0,2,5-9.")
        numbers.extend(range(int(first), int(last or first) + 1))
    return tuple(numbers)


def written_ranges(numbers: Sequence[int]) -> str:
    """Return increasing numbers as ``read_ranges`` reads them: ``0,2,5-9``."""
    parts: list[list[int]] = []
    for number in numbers:
        if parts and number == parts[-1][-1] + 1:
            parts[-1] = [parts[-1][0], number]
        else:
            parts.append([number])
    return ",".join("-".join(map(str, part)) for part in parts)


def _listed(text: str, read: Callable[[str], Any], expected: str) -> tuple[Any, ...]:
    try:
        parts = [part.strip() for part in text.split(",")]
        if "" in parts:
            raise ValueError
        return tuple(read(part) for part in parts)
    except ValueError:
        raise ValueError(f"{text!r} is not a list of {expected}.") from None
