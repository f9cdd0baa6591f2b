"""Demonstrations of LPV-DS and ds-opt: one matrix each, positions above velocities."""

from __future__ import annotations

import numpy as np

from skillctl.demonstrations import matlab
from skillctl.demonstrations.files import File
from skillctl.demonstrations.matlab import matrix
from skillctl.demonstrations.recording import Recording, uniform_times
from skillctl.errors import InputDataError


def recognises(file: File) -> bool:
    """Return whether the content is a MATLAB file whose variables are laid out as in LPV-DS."""
    return matlab.recognises(file) and bool(_cells(file))


def read(file: File) -> list[Recording]:
    """Return the demonstrations in the cell array ``data``: one matrix (2d, T) each, rows [x; ẋ].

    A scalar ``dt`` [s] is their sampling period; without it, the period is estimated from the velocities.

    Raises:
        InputDataError: The file has another layout.

    References:
        Figueroa & Billard 2018, the data that accompanies ds-opt.
    """
    cells, dt = _cells(file), matrix(matlab.variables(file).get("dt"))
    if not cells:
        expected = "a cell array data of matrices (2d, T), positions above velocities"
        raise matlab.other_layout(file, "not laid out as LPV-DS demonstrations", expected)
    period = float(dt.item()) if dt is not None and dt.size == 1 else np.nan
    recordings = []
    for index, cell in enumerate(cells):
        rows, part = matrix(cell), f"demonstration {index}"
        if rows is None or len(rows) % 2:
            raise InputDataError(
                f"{file.path}, {part}: not a matrix with as many rows of velocities as of positions.",
                hint="Expected matrices (2d, T), positions above velocities.",
            )
        d, samples = len(rows) // 2, rows.shape[1]
        times = uniform_times(period, samples) if period > 0 else None
        recordings.append(Recording(file.path, rows[:d].T, times=times, velocities=rows[d:].T, part=part))
    return recordings


def _cells(file: File) -> list[matlab.Value]:
    """Return the cells of ``data``; an empty list if it is not a cell array."""
    data = matlab.variables(file).get("data")
    return data if isinstance(data, list) else []
