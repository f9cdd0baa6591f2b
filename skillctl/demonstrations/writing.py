"""Write a demonstration as a table for any tool: CSV with a header, metres and seconds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skillctl.errors import StoreError
from skillctl.model.demonstration import Demonstration
from skillctl.model.space import default_names

DECIMALS = 5  # 10 µm, 10 µs: finer than any recording


def write_csv(demonstration: Demonstration, path: Path) -> None:
    """Write times and positions to ``path``: columns t, x, y, z, rounded to 10 µs and 10 µm.

    The bytes depend on the numbers alone: UTF-8, line feeds, no negative zero.

    Raises:
        StoreError: The file cannot be written.
    """
    names = default_names(demonstration.dimension)
    table = np.column_stack([demonstration.times, demonstration.positions])
    table = np.round(table, DECIMALS) + 0.0  # + 0.0 turns −0.0 into 0.0
    lines = [",".join(("t", *names))]
    lines += [",".join(f"{value:.{DECIMALS}f}" for value in row) for row in table.tolist()]
    try:
        path.write_bytes(("\n".join(lines) + "\n").encode())
    except OSError as error:
        raise StoreError(
            f"{path}: cannot be written ({error.strerror}).", hint="Choose a folder you may write to."
        ) from error
