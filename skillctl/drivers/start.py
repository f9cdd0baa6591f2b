"""Where a simulated robot starts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.evaluate.coverage import demonstrated_starts
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.skill import Skill


def start_of(
    skill: Skill, demonstrations: Sequence[DemonstrationSet | None], given: tuple[float, ...] | None
) -> FloatArray | None:
    """Return a start (d,): as it is given, or that of the first demonstration; None if there is neither.

    A position that is given for a pose is turned as that demonstration starts.

    Args:
        skill: What will be run.
        demonstrations: Those of each of its leaves.
        given: A state in numbers; None: none.

    Raises:
        UsageError: Another number of coordinates, or a position without an orientation.
    """
    space = skill.space
    starts = demonstrated_starts(skill, demonstrations)
    first = starts[0] if len(starts) else None
    if given is None:
        return first
    if len(given) == space.positions < space.dimension and first is not None:
        return np.concatenate([given, first[space.positions :]])
    if len(given) not in space.sizes or len(given) < space.dimension:
        wanted = " or ".join(str(size) for size in space.sizes if size >= space.dimension)
        raise UsageError(f"start: expected {wanted} numbers, got {len(given)}.")
    return space.measured(given)
