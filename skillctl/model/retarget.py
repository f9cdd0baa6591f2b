"""Motions moved to another target: what is proved of them stays, since they are relative to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray
from skillctl.errors import StateError, UsageError
from skillctl.model.skill import AnySkill, Skill


def retargeted(skill: AnySkill, target: npt.ArrayLike) -> AnySkill:
    """Return the same motion towards ``target`` (d,); all guarantees stay (theory: the motion is relative).

    Args:
        skill: With one attractor.
        target: Shape (d,). Of poses also (x, y, z, qx, qy, qz, qw), or (x, y, z): the orientation stays then.

    Raises:
        UsageError: Wrong number of coordinates, not finite, or a skill with several attractors.
    """
    attractors = skill.attractors
    goal = _goal(skill, np.asarray(target, dtype=np.float64))
    if len(attractors) > 1:
        raise UsageError(
            f"this skill has {len(attractors)} attractors; it cannot be moved to one target.",
            hint="Combine its parts with --align to give them one target.",
        )
    # ξ* + (target − ξ*) may differ from the target in its last bit, so the attractor is set once more.
    return skill.carried(attractors[0], goal).with_leaves(lambda leaf: replace(leaf, attractor=goal))


def _goal(skill: Skill, target: FloatArray) -> FloatArray:
    """Return a target as a state (d,): given as such, as a pose with a quaternion, or as a position only."""
    space = skill.space
    if target.shape == (space.positions,):
        target = np.concatenate([target, skill.attractors[0][space.positions :]])
    try:
        return space.measured(target)
    except StateError:
        numbers = " or ".join(str(n) for n in space.sizes)
        raise UsageError(f"target: expected {numbers} finite numbers, got {np.size(target)}.") from None
