"""What a user may choose about skills that are made, whatever they are made of."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from skillctl.options import RESULT, option


@dataclass(frozen=True)
class Result:
    """Where a new skill goes, and what is written with it.

    Attributes:
        output, name: A file, or a skill of the store to publish the next version of: one of them.
        message: Kept in the skill.
        plot: Picture to draw.
    """

    output: Path | None = option(short="-o", metavar="FILE.h5", group=RESULT, help="Write this file.")
    name: str | None = option(
        metavar="NAME", group=RESULT, help="Publish it in the store as the next version of NAME."
    )
    message: str | None = option(
        short="-m", metavar="TEXT", group=RESULT, help="A note to keep in the skill; `log` shows it."
    )
    plot: Path | None = option(
        metavar="F.png|svg|pdf", group=RESULT, help="Draw it; the suffix decides the format."
    )


@dataclass(frozen=True)
class Validation:
    """Whether a new skill is also judged by demonstrations that it was not learned from.

    Attributes:
        validate: Learn with each demonstration left out, and report the error on it.
    """

    validate: bool = option(
        False,
        group="Learning",
        help="Also learn with each demonstration left out, and report the error on it.",
    )
