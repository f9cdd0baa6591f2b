"""Demonstrations as LPV-DS and ds-opt keep them: positions above velocities, one matrix each."""

from __future__ import annotations

import numpy as np

from skillctl.demonstrations import matlab
from skillctl.demonstrations.files import File
from skillctl.demonstrations.matlab import matrix
from skillctl.demonstrations.recording import Recording, uniform_times
from skillctl.errors import InputDataError


def recognises(file: File) -> bool:
    """Say whether the content is a MATLAB file whose variables are laid out as in LPV-DS."""
    return matlab.recognises(file) and bool(_cells(file))


def read(file: File) -> list[Recording]:
    """Return the demonstrations in the cell array ``data``: one matrix (2d, T) each, rows [x; ẋ].

    A scalar ``dt`` [s] is their sampling period; without it, it follows from velocities and steps.

    Raises:
        InputDataError: Another layout.

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
    """Return the cells of ``data``; none if something else stands there."""
    data = matlab.variables(file).get("data")
    return data if isinstance(data, list) else []
