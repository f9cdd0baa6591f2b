"""Checks of the parts of a merged or combined skill, and what both do with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.model.combined import CombinedSkill
from skillctl.model.mixture import congruent
from skillctl.model.pose import Pose
from skillctl.model.retarget import goal_of, retargeted
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import ActingSkill, AnySkill, Skill
from skillctl.model.space import Space


def require_compatible(parts: Sequence[Skill], operation: str) -> None:
    """Raise UsageError unless there are two or more parts, no chains, all in the same state space.

    Args:
        parts: The skills to put together.
        operation: Word for the message: ``merge``, ``combine``, ``chain`` or ``adapt``.
    """
    require_no_chains(parts, operation)
    if len(parts) < 2:
        raise UsageError(
            f"{operation}: needs at least two skills, got {len(parts)}.", hint="Name another skill."
        )
    first = parts[0]
    for number, part in enumerate(parts[1:], start=2):
        if part.space.kind != first.space.kind:
            moves = {"euclidean": "positions", "pose": "poses"}
            here, there = moves[part.space.kind], moves[first.space.kind]
            raise UsageError(
                f"{operation}: skill {number} moves {here}, skill 1 {there}.",
                hint="Learn the one that moves poses again with --position-only.",
            )
        if part.dimension != first.dimension:
            raise UsageError(
                f"{operation}: skill {number} has {part.dimension} dimensions, skill 1 {first.dimension}.",
                hint="Only motions in the same space can be put together.",
            )
        for what in ("unit", "frame", "names"):
            found, expected = getattr(part.space, what), getattr(first.space, what)
            if found != expected:
                raise UsageError(
                    f"{operation}: {what} of skill {number}: {_text(found)}; of skill 1: {_text(expected)}.",
                    hint="Learn them again with the same columns, units and frame.",
                )


def require_no_chains(parts: Sequence[Skill], operation: str) -> None:
    """Raise UsageError if a chain is among the parts: its stages act one after the other, not together."""
    for number, part in enumerate(parts, start=1):
        if part.kind == "chain":
            raise UsageError(
                f"{operation}: skill {number} is a chain; its stages have targets of their own.",
                hint="Name its stages instead, and chain what comes of them.",
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


def in_one_space(parts: Sequence[AnySkill]) -> tuple[AnySkill, ...]:
    """Return the parts with one characteristic length ℓ, of poses: the geometric mean of theirs.

    The motions stay exactly as they are: ℓ is the unit in which a skill counts angles, so that only means and
    covariances of the last three charted coordinates change, those of regions included.
    """
    lengths = [part.space.length for part in parts if isinstance(part.space, Pose)]
    if len(set(lengths)) < 2:
        return tuple(parts)
    length = float(np.exp(np.mean(np.log(lengths))))
    return tuple(_in_length(part, length) for part in parts)


def _in_length(skill: AnySkill, length: float) -> AnySkill:
    stretched = skill.with_leaves(lambda leaf: _leaf_in_length(leaf, length))
    if not isinstance(skill, CombinedSkill) or not skill.regions:
        return stretched
    by = np.diag(_scale(skill.space, length))
    places = zip(skill.regions, skill.parts, strict=True)
    regions = tuple(region.mapped(by, part.anchor) for region, part in places)
    return replace(stretched, regions=regions)  # type: ignore[type-var]


def prepared(
    parts: Sequence[Skill], weights: npt.ArrayLike | None, target: npt.ArrayLike | None, *, turn: bool
) -> tuple[Skill, ...]:
    """Return the parts as they have to be before one P is looked for: in one space, and turned if they turn.

    P is the same wherever a target is, so that parts which do not turn need not be moved.

    Raises:
        UsageError: A combined skill is to turn.
    """
    parts = in_one_space(parts)
    if not turn:
        return parts
    acting = [part for part in parts if isinstance(part, ActingSkill)]
    if len(acting) < len(parts):
        raise UsageError("turn: combined skills do not turn here.", hint="Name their parts instead.")
    return on_one_attractor(acting, normalised("weights", weights, len(parts)), target, turn=True)


def _scale(space: Space, length: float) -> FloatArray:
    """Return by how much charted coordinates (d,) of poses grow with another characteristic length."""
    before = space.length if isinstance(space, Pose) else length
    return np.where(np.arange(space.dimension) < space.positions, 1.0, length / before)


def _leaf_in_length(leaf: SedsSkill, length: float) -> SedsSkill:
    space = leaf.space
    if not isinstance(space, Pose) or space.length == length:
        return leaf
    scale = _scale(space, length)
    stretched, anchor = np.diag(scale), leaf.anchor
    return replace(
        leaf,
        space=replace(space, length=length),
        means=anchor + (leaf.means - anchor) * scale,
        covariances=congruent(leaf.covariances, stretched),
        residual_covariances=congruent(leaf.residual_covariances, stretched),
        system_matrices=leaf.system_matrices * (scale[:, None] / scale),  # one within each block
        density=leaf.density.mapped(stretched, anchor),
    )


def on_one_attractor(
    parts: Sequence[ActingSkill],
    weights: FloatArray,
    target: npt.ArrayLike | None,
    *,
    turn: bool = False,
    keep: bool = False,
) -> tuple[ActingSkill, ...]:
    """Return the parts moved to ``target`` (d,), or to the weighted mean of their attractors.

    Args:
        parts: In one space.
        weights: Shape (parts,).
        target: As of ``retargeted``; a target without orientation gets the mean orientation.
        turn: Whether motions of poses turn with their target.
        keep: Whether each part keeps its own orientation instead, unless the target has one.
    """
    attractors = np.stack([part.attractor for part in parts])
    space = parts[0].space
    # The mean of equal points may differ from them in its last bit, and would move the parts.
    together = bool((attractors == attractors[0]).all())
    goal = attractors[0] if together else space.mean(attractors, weights)
    if target is not None:
        goal = goal_of(space, target, goal)
    if keep and (target is None or np.size(target) == space.positions):
        goal = goal[: space.positions]
    return tuple(retargeted(part, goal, turn=turn) for part in parts)


def notes_on(parts: Sequence[Skill]) -> tuple[str, ...]:
    """Return a sentence for every pair of parts that are the same motion: allowed, but rarely meant."""
    return tuple(
        f"skills {i + 1} and {j + 1} are the same motion."
        for (i, one), (j, other) in combinations(enumerate(parts), 2)
        if same_motion(one, other)
    )


def same_motion(one: Skill, other: Skill) -> bool:
    """Return whether two skills move alike relative to their targets, number for number."""
    if (len(one.leaves), one.speed, one.gate) != (len(other.leaves), other.speed, other.gate):
        return False
    if not np.array_equal(one.shares, other.shares):
        return False
    fields = ("priors", "covariances", "system_matrices")
    return all(
        a.speed == b.speed and all(np.array_equal(getattr(a, name), getattr(b, name)) for name in fields)
        for a, b in zip(one.leaves, other.leaves, strict=True)
    )


def _text(value: object) -> str:
    return ", ".join(value) if isinstance(value, tuple) else str(value)
