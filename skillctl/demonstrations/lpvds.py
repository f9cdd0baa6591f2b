"""Demonstrations as LPV-DS and ds-opt keep them: positions above velocities, one matrix each."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skillctl.demonstrations.matlab import Variables, described, matrix
from skillctl.demonstrations.recording import Recording, uniform_times
from skillctl.errors import InputDataError


def recognises(content: Variables) -> bool:
    """Say whether the variables are laid out as in LPV-DS."""
    data = content.get("data")
    return isinstance(data, list) and bool(data)


def read(content: Variables, path: Path) -> list[Recording]:
    """Return the demonstrations in the cell array ``data``: one matrix (2d, T) each, rows [x; ẋ].

    A scalar ``dt`` [s] is their sampling period; without it, it follows from velocities and steps.

    Raises:
        InputDataError: Another layout.

    References:
        Figueroa & Billard 2018, the data that accompanies ds-opt.
    """
    data, dt = content.get("data"), matrix(content.get("dt"))
    if not isinstance(data, list) or not data:
        raise InputDataError(
            f"{path}: not laid out as LPV-DS demonstrations (found {described(content)}).",
            hint="Expected a cell array data of matrices (2d, T), positions above velocities.",
        )
    period = float(dt.item()) if dt is not None and dt.size == 1 else np.nan
    recordings = []
    for index, cell in enumerate(data):
        rows, part = matrix(cell), f"demonstration {index}"
        if rows is None or len(rows) % 2:
            raise InputDataError(
                f"{path}, {part}: not a matrix with as many rows of velocities as of positions.",
                hint="Expected matrices (2d, T), positions above velocities.",
            )
        d, samples = len(rows) // 2, rows.shape[1]
        times = uniform_times(period, samples) if period > 0 else None
        recordings.append(Recording(path, rows[:d].T, times=times, velocities=rows[d:].T, part=part))
    return recordings
