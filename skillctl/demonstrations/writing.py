"""Write a demonstration as a table for any tool: CSV with a header, metres and seconds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skillctl.errors import StoreError
from skillctl.model.demonstration import Demonstration
from skillctl.model.space import Space, default_names
from skillctl.rotations import quaternions

DECIMALS = 5  # 10 µm, 10 µs: finer than any recording


def write_csv(demonstration: Demonstration, path: Path, space: Space | None = None) -> None:
    """Write times and positions to ``path``: columns t, x, y, z, rounded to 10 µs and 10 µm.

    The bytes depend on the numbers alone: UTF-8, line feeds, no negative zero.

    Args:
        demonstration: Positions or poses.
        path: The file.
        space: Of poses, whose orientations are written as quaternions, in the columns qx, qy, qz, qw.

    Raises:
        StoreError: The file cannot be written.
    """
    states = demonstration.positions
    names = default_names(demonstration.dimension)
    if space is not None and space.positions < space.dimension:
        names = (*default_names(space.positions), "qx", "qy", "qz", "qw")
        positions, turns = np.split(states, [space.positions], axis=1)
        states = np.concatenate([positions, quaternions(turns)], axis=1)
    table = np.column_stack([demonstration.times, states])
    table = np.round(table, DECIMALS) + 0.0  # + 0.0 turns −0.0 into 0.0
    lines = [",".join(("t", *names))]
    lines += [",".join(f"{value:.{DECIMALS}f}" for value in row) for row in table.tolist()]
    try:
        path.write_bytes(("\n".join(lines) + "\n").encode())
    except OSError as error:
        raise StoreError(
            f"{path}: cannot be written ({error.strerror}).", hint="Choose a folder you may write to."
        ) from error
