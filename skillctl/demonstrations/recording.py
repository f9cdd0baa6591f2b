"""What a reader returns: the numbers of one demonstration, unchanged from its file."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skillctl.arrays import FloatArray, IntArray
from skillctl.demonstrations.units import UNITS
from skillctl.errors import InputDataError, UsageError, printable
from skillctl.model.space import default_names

GAPS = "Fill or remove gaps in the recording, or leave this demonstration out."  # hint
EVEN = 0.2  # steps that differ less from their median, in units of it, are even
EVEN_SAMPLES = 11


@dataclass(frozen=True, eq=False, slots=True)
class Orientation:
    """The orientation of the hand during a recording, as the file writes it.

    Attributes:
        numbers: Shape (T, n).
        convention: What they mean, one of ``orientation.CONVENTIONS``.
        names: Of the columns or vectors in the file, as in ``Recording.unused``.
    """

    numbers: FloatArray
    convention: str
    names: tuple[str, ...] = ()

    def at(self, samples: IntArray) -> Orientation:
        """Return the orientation at some of the samples."""
        return Orientation(self.numbers[samples], self.convention, self.names)


@dataclass(frozen=True, eq=False, slots=True)
class Recording:
    """One demonstration before anything is checked, converted or left out.

    Attributes:
        path: File it comes from.
        positions: Shape (T, d), in ``unit``.
        times: Shape (T,), [s]; None if the file has none.
        velocities: Shape (T, d), per second; None if the file has none.
        names: One per dimension, None for formats that do not name them.
        lines: Line of each sample in a text file, shape (T,); None for binary formats.
        part: Which demonstration of its file, empty if it is the only one.
        unit: Of the positions, one of ``UNITS`` of lengths and angles; of joint angles if its base is rad.
        unit_said: Whether the file says the unit.
        taken: Columns of the file that are the positions, if they have names.
        unused: Columns of the file that are no position, although the user did not choose columns.
        orientation: Of the hand, if the file has it; then there are three positions.
        frame: In which the positions are, if the file says it.
        notes: Sentences for the user on how the file was read.
    """

    path: Path
    positions: FloatArray
    times: FloatArray | None = None
    velocities: FloatArray | None = None
    names: tuple[str, ...] | None = None
    lines: IntArray | None = None
    part: str = ""
    unit: str = "m"
    unit_said: bool = False
    taken: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()
    orientation: Orientation | None = None
    frame: str = ""
    notes: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """The file as the user named it, and which part of it: for messages."""
        return f"{self.path}, {self.part}" if self.part else str(self.path)

    @property
    def source(self) -> str:
        """The file without its folder, and which part of it: for reports."""
        return f"{self.path.name}, {self.part}" if self.part else self.path.name

    @property
    def base(self) -> str:
        """Unit that the positions are converted to: m or rad."""
        return UNITS[self.unit].base

    def where(self, sample: int) -> str:
        """Return the place of a sample in the file, for messages."""
        return f"sample {sample}" if self.lines is None else f"line {self.lines[sample]}"

    def column(self, dimension: int) -> str:
        """Return the name of a dimension for messages."""
        names = self.names or default_names(self.positions.shape[1], self.base)
        return f"column '{printable(names[dimension])}'"


def uniform_times(period: float, samples: int) -> FloatArray:
    """Return 0, Δt, 2 Δt …, [s]. Shape (samples,)."""
    return period * np.arange(samples, dtype=np.float64)


def is_even(values: FloatArray) -> bool:
    """Return whether numbers (T,) rise in even steps, as a clock or a counter does.

    A motion from rest to rest does not, and of few samples nothing is said.
    """
    steps = np.diff(values)
    if len(values) < EVEN_SAMPLES or not np.isfinite(values).all():
        return False
    middle = float(np.median(steps))
    return middle > 0 and bool((np.abs(steps - middle) < EVEN * middle).all())


def column_indices(
    wanted: Sequence[str], names: Sequence[str], path: Path, *, what: str = "column"
) -> tuple[int, ...]:
    """Return the indices of the wanted columns in ``names``; messages call a column ``what``.

    Raises:
        UsageError: A column is named twice, or none is.
        InputDataError: There is no such column; the message suggests the nearest and lists all.
    """
    if not wanted or len(set(wanted)) < len(wanted):
        raise UsageError("columns: name at least one, and each once.")
    for name in wanted:
        if name not in names:
            close = difflib.get_close_matches(name, names, n=1)
            raise InputDataError(
                f"{path}: there is no {what} '{printable(name)}'"
                + (f"; did you mean '{printable(close[0])}'?" if close else "."),
                hint=f"The {what}s are: {listed(names)}.",
            )
    return tuple(names.index(name) for name in wanted)


def listed(names: Sequence[str], most: int = 20) -> str:
    """Return names from a file as text that is safe and short enough to print."""
    text = ", ".join(printable(name)[:40] for name in names[:most])
    return f"{text} and {len(names) - most} more" if len(names) > most else text
