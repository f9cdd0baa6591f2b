"""Lists of demonstrations as people write them."""

from __future__ import annotations


def read_ranges(text: str) -> tuple[int, ...]:
    """Return the numbers that ``0,2,5-9`` means.

    Raises:
        ValueError: It means none.
    """
    found: list[int] = []
    for first, dash, last in (part.strip().partition("-") for part in text.split(",")):
        if not first.isdecimal() or (dash and not last.isdecimal()) or (dash and int(last) < int(first)):
            raise ValueError(f"{text!r} is not a list of numbers from 0 on, as in 0,2,5-9.")
        found.extend(range(int(first), int(last or first) + 1))
    return tuple(found)
