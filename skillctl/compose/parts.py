"""Checks of the parts of a merged or combined skill, and what both do with them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.model.retarget import retargeted
from skillctl.model.skill import ActingSkill, Skill


def require_compatible(parts: Sequence[Skill], operation: str) -> None:
    """Raise UsageError unless there are two or more parts, all in the same state space.

    Args:
        parts: The skills to put together.
        operation: Word for the message: ``merge`` or ``combine``.
    """
    if len(parts) < 2:
        raise UsageError(
            f"{operation}: needs at least two skills, got {len(parts)}.", hint="Name another skill."
        )
    first = parts[0]
    for number, part in enumerate(parts[1:], start=2):
        if part.dimension != first.dimension:
            raise UsageError(
                f"{operation}: skill {number} has {part.dimension} dimensions, skill 1 {first.dimension}.",
                hint="Only motions in the same space can be put together.",
            )
        for what in ("unit", "frame", "names", "kind"):
            found, expected = getattr(part.space, what), getattr(first.space, what)
            if found != expected:
                raise UsageError(
                    f"{operation}: {what} of skill {number}: {_text(found)}; of skill 1: {_text(expected)}.",
                    hint="Learn them again with the same columns, units and frame.",
                )


def normalised(name: str, weights: npt.ArrayLike | None, count: int) -> FloatArray:
    """Return positive weights divided by their sum, shape (count,); equal ones for None.

    Raises:
        UsageError: Wrong number, not finite, or not positive.
    """
    if weights is None:
        return np.full(count, 1 / count)
    values = np.array(weights, dtype=np.float64)
    if values.shape != (count,):
        raise UsageError(f"{name}: expected {count} numbers, one per skill, got {values.size}.")
    if not (np.isfinite(values).all() and (values > 0).all()):
        raise UsageError(
            f"{name}: must be positive, got {', '.join(f'{value:g}' for value in values)}.",
            hint="Leave a skill out instead of giving it no weight.",
        )
    shares = values / values.max()  # so that the sum of very large numbers stays finite
    return np.asarray(shares / shares.sum())


def on_one_attractor(
    parts: Sequence[ActingSkill], weights: FloatArray, target: npt.ArrayLike | None
) -> tuple[ActingSkill, ...]:
    """Return the parts moved to ``target`` (d,), or to the weighted mean of their attractors."""
    attractors = np.stack([part.attractor for part in parts])
    if target is None:
        # The mean of equal points may differ from them in its last bit, and would move the parts.
        together = bool((attractors == attractors[0]).all())
        target = attractors[0] if together else weights @ attractors
    return tuple(retargeted(part, target) for part in parts)


def notes_on(parts: Sequence[Skill]) -> tuple[str, ...]:
    """Return a sentence for every pair of parts that are the same motion: allowed, but rarely meant."""
    return tuple(
        f"skills {i + 1} and {j + 1} are the same motion."
        for (i, one), (j, other) in combinations(enumerate(parts), 2)
        if _same_motion(one, other)
    )


def _same_motion(one: Skill, other: Skill) -> bool:
    if len(one.leaves) != len(other.leaves) or one.speed != other.speed:
        return False
    fields = ("priors", "covariances", "system_matrices")
    return all(
        a.speed == b.speed and all(np.array_equal(getattr(a, name), getattr(b, name)) for name in fields)
        for a, b in zip(one.leaves, other.leaves, strict=True)
    )


def _text(value: object) -> str:
    return ", ".join(value) if isinstance(value, tuple) else str(value)
