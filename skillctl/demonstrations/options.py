"""Options for reading demonstrations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

from skillctl.demonstrations.formats import FORMATS
from skillctl.options import option, read_ranges, read_ratio, read_words

if TYPE_CHECKING:
    from skillctl.demonstrations.arm import RecordedArm
    from skillctl.demonstrations.reader import ReadResult

READING = "Reading the demonstrations"
Convention: TypeAlias = Literal["xyzw", "wxyz", "rotvec", "rotvec-deg", "rpy", "rpy-deg", "matrix"]
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
        metavar="X,Y,Z|NEW=OLD,…",
        group=READING,
        help="Columns that hold the position, a joint of a skeleton such as HandRight, or vectors and "
        "numbers of a dataset, as in ee_pos or 'left_*'; x=hand_x renames one, t=clock says which is the "
        "time. Default: x, y, z of the one thing that moves, else joint angles, else columns of other names.",
    )
    topic: str | None = option(
        metavar="TOPIC",
        group=READING,
        help="Topic of a bag; of transforms with the frame that moves: /tf:tool0. Default: the only one.",
    )
    dt: float | None = option(
        read=read_ratio,
        metavar="S",
        group=READING,
        help="Seconds between samples, if the file has no time: 0.01, or 1/60.",
    )
    units: Literal["mm", "cm", "m", "deg", "rad"] | None = option(
        group=READING,
        help="Unit of the positions, or of joint angles. Default: what the header says, as in x_mm or "
        "j1 (deg), else the format's own, else m.",
    )
    scale: float = option(1.0, metavar="F", group=READING, help="Multiply all positions.")
    demos: tuple[int, ...] | None = option(
        read=read_ranges,
        metavar="0,2,5-9",
        group=READING,
        help="Use these demonstrations only, counted from 0 over all files.",
    )
    axes: tuple[str, ...] | None = option(
        read=read_words,
        metavar="demo,time,dim",
        group=READING,
        help="What the axes of NPY and NPZ arrays are, in their order. Default: demo,time,dim or time,dim, "
        "unless the sizes tell that it is another order.",
    )
    max_dimension: int = option(
        7, metavar="N", group=READING, help="Refuse motions of more dimensions; an arm has seven joints."
    )
    accept: tuple[Fault, ...] | None = option(
        read=lambda text: read_words(text, get_args(Fault)),
        metavar="KIND,…",
        group=READING,
        help=f"Learn from recordings with large faults of these kinds, too: {', '.join(get_args(Fault))}. "
        "Small ones are warnings.",
    )
    orientation: Convention | None = option(
        group=READING,
        help="What the numbers of the orientation are, where no header tells: a quaternion (xyzw, wxyz), a "
        "rotation vector, roll, pitch and yaw about fixed axes, or a matrix. Of arrays: the columns behind "
        "the position.",
    )
    position_only: bool = option(
        False, group=READING, help="Leave orientations aside, which are read where the header names them."
    )
    reverse: bool = option(
        False,
        group=READING,
        help="Run the recordings backwards: the motion ends where they began, as a retreat does.",
    )
    frame: str = option(
        "base", metavar="FRAME", group=READING, help="Frame in which the positions are given."
    )

    def recorded(self) -> dict[str, Any]:
        """Return the choices that decide what is read, by their names.

        A bound only refuses; and skills made before there were some of these choices stay up to date without
        them.
        """
        later = ("axes", "topic", "accept", "orientation", "position_only", "reverse")
        chosen = {name: value for name, value in vars(self).items() if value or name not in later}
        del chosen["max_dimension"]
        return chosen

    def read(self, paths: Sequence[Path], *, arm: RecordedArm | None = None) -> ReadResult:
        """Return the demonstrations in the files, of the hand if they are joints of an arm.

        Raises:
            InputDataError: Large faults that are not accepted; and what ``read_demonstrations`` raises.
        """
        from skillctl.demonstrations.faults import require_accepted  # late: both import NumPy
        from skillctl.demonstrations.reader import read_demonstrations

        choices = dict(vars(self))
        accepted = choices.pop("accept")
        result = read_demonstrations(paths, arm=arm, **choices)
        require_accepted(result.faults, accepted or (), result.chosen)
        return result
