"""What was measured and commanded in a run, and its log as HDF5."""

from __future__ import annotations

import io
import json
from array import array
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import InputDataError, NotFoundError, printable
from skillctl.model.space import Space

FORMAT = "skillctl run 1"
NUMBERS = 5  # of a row, before state and command
WHOLE = ("stage", "part", "resting")  # of these
LONGEST = 100_000_000  # numbers of one dataset that is read


@dataclass(frozen=True, eq=False, slots=True)
class Rows:
    """A run, one row a command.

    Attributes:
        t: When the command was given, from the first one, shape (n,), [s].
        delay: How much later it was given than it was due, shape (n,), [s].
        stage: Stage of a chain that acts, from 0. Shape (n,).
        part: Part of the skill that acts, from 0. Shape (n,).
        resting: 1 where the hand is brought to rest, after the skill has led it. Shape (n,).
        state: What was measured last, shape (n, d).
        command: The velocity commanded, shape (n, d), per second.
    """

    t: FloatArray
    delay: FloatArray
    stage: FloatArray
    part: FloatArray
    resting: FloatArray
    state: FloatArray
    command: FloatArray


class Recorder:
    """Keeps rows as plain numbers, which costs a loop next to nothing."""

    def __init__(self, dimension: int) -> None:
        """Args: dimension: d, of states and commands."""
        self._dimension = dimension
        self._numbers = array("d")

    def add(
        self,
        numbers: tuple[float, float, int, int, bool],
        state: FloatArray,
        command: FloatArray,
    ) -> None:
        """Add a row: t, delay, stage, part, resting; state (d,); command (d,)."""
        self._numbers.extend(numbers)
        self._numbers.extend(state.tolist())
        self._numbers.extend(command.tolist())

    def rows(self) -> Rows:
        """Return all rows."""
        d = self._dimension
        table = np.array(self._numbers).reshape(-1, NUMBERS + 2 * d)
        t, delay, stage, part, resting = table[:, :NUMBERS].T
        return Rows(t, delay, stage, part, resting, table[:, NUMBERS : NUMBERS + d], table[:, NUMBERS + d :])


def encode(rows: Rows, about: Mapping[str, Any]) -> bytes:
    """Return a log as HDF5: a dataset for each field of ``Rows``, and ``about``, a text in JSON."""
    import h5py

    file = io.BytesIO()
    with h5py.File(file, "w", libver="earliest") as log:
        for field in fields(rows):
            kind = np.int32 if field.name in WHOLE else np.float64
            log.create_dataset(field.name, data=getattr(rows, field.name).astype(kind), track_times=False)
        text = json.dumps({"format": FORMAT, **about}, indent=1)
        log.create_dataset("about", data=np.bytes_(text.encode()), track_times=False)
    return file.getvalue()


@dataclass(frozen=True, eq=False, slots=True)
class Recorded:
    """States of an earlier motion.

    Attributes:
        times: Shape (n,), [s], increasing.
        states: Shape (n, d).
        commands: What was commanded at the first of them, before the hand was brought to rest, shape (m, d);
            None if the log does not say.
    """

    times: FloatArray
    states: FloatArray
    commands: FloatArray | None


def read_log(path: Path, space: Space) -> Recorded:
    """Return the states in a log of ``run``, or in an HDF5 log of ``simulate``, whose hand is in its frame.

    Raises:
        NotFoundError: There is no such file.
        InputDataError: It is no such log, or one of another kind of states.
    """
    import h5py

    name = printable(str(path))
    if not path.is_file():
        raise NotFoundError(f"{name}: there is no such file.", hint="Name a log that `run --log` wrote.")
    try:
        with h5py.File(path, "r") as log:
            if "state" in log:
                times, states = _array(log, "t"), _array(log, "state", axes=2)
                commands = _array(log, "command", axes=2)[_array(log, "resting") == 0]
            else:
                names = [f"hand_{axis}" for axis in ("x", "y", "z", "qx", "qy", "qz", "qw")]
                turns = space.positions < space.dimension
                columns = [_array(log, each) for each in names[: 7 if turns else 3]]
                states = np.array([space.measured(row) for row in np.column_stack(columns)])
                times, commands = _array(log, "t"), None
    except (OSError, LookupError, ValueError, RuntimeError) as error:
        raise InputDataError(
            f"{name} is no log of states: {printable(str(error))}.",
            hint="A log is written by `run --log F.h5`, or by `simulate --log F.h5`.",
        ) from None
    fits = states.shape == (len(times), space.dimension)
    if not fits or len(times) < 2 or not (np.diff(times) > 0).all():
        raise InputDataError(
            f"{name}: expected at least two states of {', '.join(space.names)} at increasing times."
        )
    return Recorded(times, states, commands)


def _array(log: Any, name: str, axes: int = 1) -> FloatArray:
    """Return a dataset of numbers, or raise LookupError or ValueError."""
    data = log[name]
    numbers = getattr(data, "dtype", None) is not None and data.dtype.kind in "fi"
    if not numbers or data.ndim != axes or data.size > LONGEST:
        raise ValueError(f"{name} is no array of numbers with {axes} axes")
    return np.asarray(data[()], dtype=np.float64)
