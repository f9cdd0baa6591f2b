"""Skeleton tables, with columns x, y and z of many joints; a motion uses one or two joints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from skillctl.demonstrations.recording import column_indices, listed
from skillctl.errors import InputDataError, printable
from skillctl.model.space import AXIS_NAMES

SEPARATORS = " _.:/-"  # optional, between a joint and its axis
MOST = 7  # positions in a table without --columns: at most the joints of an arm


def joints(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return the columns x, y (and z) of each joint, by its name.

    ``HandRight_X``, ``HandRight.x`` or ``HandRightX`` is a column of the joint HandRight if there is such a
    column for y, too. The q of qx, qy, qz is not a joint: names of joints have two letters or more.
    """
    columns: dict[str, dict[str, str]] = {}
    for name in names:
        columns.setdefault(name[:-1], {}).setdefault(name[-1:].lower(), name)
    skeleton: dict[str, tuple[str, ...]] = {}
    for stem, by_axis in columns.items():
        axes = AXIS_NAMES if "z" in by_axis else AXIS_NAMES[:2]
        joint = stem.rstrip(SEPARATORS)
        if len(joint) > 1 and set(axes) <= set(by_axis):
            skeleton[joint] = tuple(by_axis[axis] for axis in axes)
    return skeleton


def chosen(wanted: Sequence[str], names: Sequence[str], path: Path) -> tuple[int, ...]:
    """Return the indices of the wanted columns in ``names``; a joint means all of its columns.

    Raises:
        UsageError: A column is named twice, or none is.
        InputDataError: A name is neither a column nor a joint; the message suggests the nearest one.
    """
    known = {joint: columns for joint, columns in joints(names).items() if joint not in names}
    column_indices(wanted, [*known, *names], path)  # refuses
    return column_indices([c for name in wanted for c in known.get(name, (name,))], names, path)


def require_few(candidates: Sequence[str], path: Path) -> None:
    """Raise InputDataError if there are more columns than a motion has dimensions: the user must choose."""
    if len(candidates) <= MOST:
        return
    skeleton = tuple(joints(candidates))
    what = f"joints are: {listed(skeleton, 40)}" if skeleton else f"columns are: {listed(candidates, 40)}"
    example = next(iter(skeleton), "a,b,c")
    raise InputDataError(
        f"{path}: {len(candidates)} columns could be positions; which are?",
        hint=f"Choose with --columns, as in --columns {printable(example)}. The {what}.",
    )
