"""Skills of poses as skills of their charted states, six numbers in metres that least squares can fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from skillctl.arrays import FloatArray
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.skill import ActingSkill, AnySkill
from skillctl.model.space import Euclidean, Space


def charted(
    parts: Sequence[ActingSkill], task: DemonstrationSet
) -> tuple[tuple[ActingSkill, ...], DemonstrationSet]:
    """Return parts with one attractor, and motions as seen from their own ends, in charted states.

    What was flat is returned as it is. Numbers of a skill are said of charted states anyway; only what a
    state is changes.
    """
    space, anchor = parts[0].space, parts[0].anchor
    if space.flat:
        return tuple(parts), task
    flat = Euclidean(space.names, space.unit, space.frame)
    motions = tuple(
        Demonstration.from_positions(
            each.times, anchor + space.offsets(each.positions, each.positions[-1]), each.source
        )
        for each in task
    )
    return tuple(_as_in(part, flat, anchor) for part in parts), DemonstrationSet(motions, flat)


def uncharted(skill: AnySkill, space: Space, attractor: FloatArray) -> AnySkill:
    """Return a skill of charted states as the skill of states that it is, with its attractor (d,)."""
    return skill if space.flat else _as_in(skill, space, attractor)


def _as_in(skill: AnySkill, space: Space, attractor: FloatArray) -> AnySkill:
    return skill.with_leaves(lambda leaf: replace(leaf, space=space, attractor=attractor))
