"""The content of a robomimic dataset. This module runs only in a child process, as it imports h5py."""

from __future__ import annotations

import json
import math
import re
from itertools import chain
from typing import Any

import numpy as np

from skillctl.demonstrations import hdf5
from skillctl.errors import InputDataError

DEMONSTRATION = re.compile(r"demo_(\d{1,9})")
WIDEST = 64  # columns of a robot state; pictures and point clouds have more


def contents(content: bytes, keys: list[str]) -> dict[str, Any]:
    """Return the demonstrations in a dataset and an overview of it, in types that a child can send.

    Args:
        content: The bytes of the file.
        keys: Observations that make up a position, side by side.

    Returns:
        members: Of the root group.
        count: Number of demonstrations.
        others: Shapes, as text, of the wanted observations that are no matrices.
        widths: Observations of the first one that can be motions, and how many columns each has.
        demonstrations: Positions by name, (T, d) each; empty if one of the observations is missing.
        frequency: Samples per second, None if the file does not give it.
    """
    with hdf5.root_of(content) as root:
        data = hdf5.subgroup(root, "data")
        names = [] if data is None else list(filter(DEMONSTRATION.fullmatch, hdf5.members(data)))
        names.sort(key=lambda name: (int(name.removeprefix("demo_")), name))
        widths = _widths(data, names[0], keys) if names else {}
        others = _shapes(data, names[0], keys) if names else {}
        chosen = names if set(keys) <= set(widths) else []
        matrices = {name: _matrices(data, name, keys) for name in chosen}
        hdf5.require_small(chain(*matrices.values()))
        return {
            "members": hdf5.members(root),
            "count": len(names),
            "others": others,
            "widths": widths,
            "demonstrations": {
                name: np.hstack([hdf5.numbers(matrix) for matrix in parts])
                for name, parts in matrices.items()
            },
            "frequency": None if data is None else _frequency(hdf5.text(data, "env_args")),
        }


def _widths(data: Any, name: str, keys: list[str]) -> dict[str, int]:
    """Return the width of each observation of a demonstration that can be a motion."""
    observations, widths = _observations(data, name), {}
    for key in [] if observations is None else hdf5.members(observations):
        try:
            matrix = hdf5.matrix(observations, key)
        except InputDataError:
            if key in keys:
                raise
            continue
        if matrix is not None and 0 < matrix.shape[1] <= WIDEST:
            widths[key] = int(matrix.shape[1])
    return widths


def _shapes(data: Any, name: str, keys: list[str]) -> dict[str, str]:
    """Return the shapes of those observations of a demonstration that are there, but are no matrices."""
    observations = _observations(data, name)
    shapes = {} if observations is None else {key: hdf5.shape(observations, key) for key in keys}
    return {key: str(shape) for key, shape in shapes.items() if shape is not None and len(shape) != 2}


def _matrices(data: Any, name: str, keys: list[str]) -> list[Any]:
    """Return the wanted observations of a demonstration, unread."""
    observations = _observations(data, name)
    matrices = [None if observations is None else hdf5.matrix(observations, key) for key in keys]
    if any(matrix is None for matrix in matrices):
        raise InputDataError(
            f"{name}: it lacks observations that others have.", hint="Leave it out of the file."
        )
    return matrices


def _observations(data: Any, name: str) -> Any | None:
    demonstration = hdf5.subgroup(data, name)
    return None if demonstration is None else hdf5.subgroup(demonstration, "obs")


def _frequency(env_args: str | None) -> float | None:
    """Return the control frequency in robomimic's description of an environment, [Hz]."""
    try:
        frequency = json.loads(env_args or "", parse_int=float)["env_kwargs"]["control_freq"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
    usable = isinstance(frequency, float) and math.isfinite(frequency) and frequency > 0
    return frequency if usable else None
