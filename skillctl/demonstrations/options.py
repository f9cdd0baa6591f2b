"""Options for reading demonstrations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

from skillctl.demonstrations.formats import FORMATS
from skillctl.options import option, read_ranges, read_words

if TYPE_CHECKING:
    from skillctl.demonstrations.reader import ReadResult

READING = "Reading the demonstrations"
Fault: TypeAlias = Literal["dropouts", "jumps", "clock", "directions", "ends", "crossings"]


@dataclass(frozen=True)
class Reading:
    """How the files are read; see ``skillctl.demonstrations.reader.read_demonstrations``."""

    input_format: str | None = option(
        choices=tuple(form.name for form in FORMATS),
        group=READING,
        help="Default: recognised by the content.",
    )
    columns: tuple[str, ...] | None = option(
        read=read_words,
        metavar="X,Y,Z",
        group=READING,
        help="Columns that hold the position, a joint of a skeleton such as HandRight, or an observation "
        "of a robomimic dataset. Default: x, y, z, else all columns but the time; of robomimic, "
        "robot0_eef_pos.",
    )
    dt: float | None = option(
        metavar="S", group=READING, help="Seconds between samples, if the file has no time."
    )
    units: Literal["m", "mm", "rad"] | None = option(
        group=READING, help="Unit of the positions. Default: the format's own, else m."
    )
    scale: float = option(1.0, metavar="F", group=READING, help="Multiply all positions.")
    demos: tuple[int, ...] | None = option(
        read=read_ranges,
        metavar="0,2,5-9",
        group=READING,
        help="Use these demonstrations only, counted from 0 over all files.",
    )
    accept: tuple[Fault, ...] | None = option(
        read=lambda text: read_words(text, get_args(Fault)),
        metavar="KIND,…",
        group=READING,
        help=f"Learn from recordings with large faults of these kinds, too: {', '.join(get_args(Fault))}. "
        "Small ones are warnings.",
    )
    frame: str = option(
        "base", metavar="FRAME", group=READING, help="Frame in which the positions are given."
    )

    def read(self, paths: Sequence[Path]) -> ReadResult:
        """Return the demonstrations in the files.

        Raises:
            InputDataError: Large faults that are not accepted; and what ``read_demonstrations`` raises.
        """
        from skillctl.demonstrations.faults import require_accepted  # late: both import NumPy
        from skillctl.demonstrations.reader import read_demonstrations

        choices = dict(vars(self))
        accepted = choices.pop("accept")
        result = read_demonstrations(paths, **choices)
        require_accepted(result.faults, accepted or (), result.chosen)
        return result
