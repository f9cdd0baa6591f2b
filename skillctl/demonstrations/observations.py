"""The content of a robot data set. This module runs only in a child process, as it imports h5py."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any

import numpy as np

from skillctl.demonstrations import hdf5
from skillctl.demonstrations.robomimic import Layout
from skillctl.errors import InputDataError

WIDEST = 64  # columns of a robot state; pictures and point clouds have more
DEEPEST = 3  # groups in groups of observations


def overview(path: str, layouts: Sequence[Layout], keys: list[str]) -> dict[str, Any]:
    """Return what a data set holds, in types that a child can send.

    Args:
        path: The file.
        layouts: Layouts that it may have.
        keys: Observations that may be wanted: links in their places are refused, others are passed over.

    Returns:
        members: Of the root group.
        layout: Name of the layout, None if it is of none.
        names: Of the demonstrations, in the order of their numbers.
        widths: Observations of the first one that can be motions, and how many columns each has.
        shapes: Its other arrays of numbers.
        frequency: Samples per second, None if the file does not give it.
    """
    with hdf5.root_of(path) as root:
        for layout in layouts:
            if names := _demonstrations(root, layout):
                break
        widths: dict[str, int] = {}
        shapes: dict[str, list[int]] = {}
        for key, dataset in _observations(root, layout, names[0], keys) if names else ():
            if len(dataset.shape) == 2 and 0 < dataset.shape[1] <= WIDEST:
                widths[key] = int(dataset.shape[1])
            else:
                shapes[key] = list(dataset.shape)
        data = hdf5.subgroup(root, "data") if names and layout.parent == "data" else None
        return {
            "members": hdf5.members(root),
            "layout": layout.name if names else None,
            "names": names,
            "widths": widths,
            "shapes": shapes,
            "frequency": None if data is None else _frequency(hdf5.text(data, "env_args")),
        }


def matrices(path: str, layout: Layout, names: list[str], keys: list[str]) -> dict[str, Any]:
    """Return observations side by side, (T, d), of each of the demonstrations."""
    with hdf5.root_of(path) as root:
        found = {name: _matrices(root, layout, name, keys) for name in names}
        hdf5.require_small(chain(*found.values()))
        for name, parts in found.items():
            if len({part.shape[0] for part in parts}) > 1:
                raise InputDataError(
                    f"{name}: its observations differ in length.", hint="Leave it out of the file."
                )
        return {name: np.hstack(list(map(hdf5.numbers, parts))) for name, parts in found.items()}


def _demonstrations(root: Any, layout: Layout) -> list[str]:
    """Return the names of the demonstrations of a file; one without a name if it is one itself."""
    parent = hdf5.subgroup(root, layout.parent) if layout.parent else root
    if parent is None:
        return []
    if not layout.demonstration:
        return [""] if hdf5.subgroup(root, layout.observations) is not None else []
    found = [match for name in hdf5.members(parent) if (match := re.fullmatch(layout.demonstration, name))]
    return [match[0] for match in sorted(found, key=lambda match: (int(match[1]), match[0]))]


def _group(root: Any, layout: Layout, name: str) -> Any | None:
    """Return the group of the observations of a demonstration."""
    group = root
    for step in filter(None, (layout.parent, name, layout.observations)):
        group = None if group is None else hdf5.subgroup(group, step)
    return group


def _observations(root: Any, layout: Layout, name: str, keys: list[str]) -> Iterator[tuple[str, Any]]:
    """Yield the arrays of numbers among the observations of a demonstration, unread, by their names."""
    group = _group(root, layout, name)
    return iter(()) if group is None else _arrays(group, "", keys, DEEPEST)


def _arrays(group: Any, above: str, keys: list[str], depth: int) -> Iterator[tuple[str, Any]]:
    for name in hdf5.members(group):
        key = above + name
        try:
            dataset, below = hdf5.array(group, name), hdf5.subgroup(group, name)
        except InputDataError:
            if key in keys:
                raise
            continue
        if dataset is not None:
            yield key, dataset
        elif below is not None and depth > 1:
            yield from _arrays(below, f"{key}/", keys, depth - 1)


def _matrices(root: Any, layout: Layout, name: str, keys: list[str]) -> list[Any]:
    """Return the wanted observations of a demonstration, unread."""
    matrices: list[Any] = []
    for key in keys:
        group, (*above, last) = _group(root, layout, name), key.split("/")
        for step in above:
            group = None if group is None else hdf5.subgroup(group, step)
        matrix = None if group is None else hdf5.array(group, last)
        if matrix is None or len(matrix.shape) != 2:
            raise InputDataError(
                f"{name}: it lacks observations that others have.", hint="Leave it out of the file."
            )
        matrices.append(matrix)
    return matrices


def _frequency(env_args: str | None) -> float | None:
    """Return the control frequency in robomimic's description of an environment, [Hz]."""
    try:
        frequency = json.loads(env_args or "", parse_int=float)["env_kwargs"]["control_freq"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
    usable = isinstance(frequency, float) and math.isfinite(frequency) and frequency > 0
    return frequency if usable else None
