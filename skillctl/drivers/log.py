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
from skillctl.demonstrations.files import LIMITS, NO_PLUGINS, File, read_bytes
from skillctl.errors import InputDataError, printable
from skillctl.model.space import Space
from skillctl.workers.child import Child

FORMAT = "skillctl run 1"
NUMBERS = 5  # of a row, before state and command
WHOLE = ("stage", "part", "resting")  # of these
HAND = ("hand_x", "hand_y", "hand_z", "hand_qx", "hand_qy", "hand_qz", "hand_qw")  # of `simulate`
HINT = "A log is written by `run --log F.h5`, or by `simulate --log F.h5`."


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
    if not (content := read_bytes(path)):
        raise InputDataError(f"{printable(str(path))} is a folder; a log is one file.", hint=HINT)
    with Child(LIMITS, NO_PLUGINS) as child:
        found = File(path, content, None, child).opened(columns_of, "log")
    try:
        if "state" in found:
            times, states = found["t"], found["state"]
            commands = found["command"][found["resting"] == 0]
        else:
            turns = space.positions < space.dimension
            rows = np.column_stack([found[name] for name in HAND[: 7 if turns else 3]])
            times, states, commands = found["t"], np.array([space.measured(row) for row in rows]), None
    except (LookupError, ValueError):
        raise InputDataError(f"{printable(str(path))} is no log of states.", hint=HINT) from None
    fits = times.ndim == 1 and states.shape == (times.size, space.dimension)
    if not fits or times.size < 2 or not (np.diff(times) > 0).all():
        wanted = f"at least two states of {', '.join(space.names)} at increasing times"
        raise InputDataError(f"{printable(str(path))}: expected {wanted}.", hint=HINT)
    return Recorded(times, states, commands)


def columns_of(path: str) -> dict[str, FloatArray]:
    """Return what a log has of what is replayed; called in a child process, see ``File.opened``."""
    from skillctl.demonstrations import hdf5

    with hdf5.root_of(path) as root:
        found = {name: hdf5.array(root, name) for name in ("t", "state", "command", "resting", *HAND)}
        there = {name: dataset for name, dataset in found.items() if dataset is not None}
        hdf5.require_small(there.values())
        return {name: hdf5.numbers(dataset) for name, dataset in there.items()}
