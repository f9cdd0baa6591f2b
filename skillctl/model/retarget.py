"""Motions moved to another target: what is proved of them stays, since they are relative to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from skillctl import rotations
from skillctl.arrays import FloatArray
from skillctl.errors import StateError, UsageError
from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.mixture import congruent
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import AnySkill, Skill
from skillctl.model.space import Space

UNIT = 0.01  # a quaternion may be typed with two digits: (0, 0.71, 0, 0.71) has length 1.004


def retargeted(skill: AnySkill, target: npt.ArrayLike, *, turn: bool = False) -> AnySkill:
    """Return the same motion towards ``target`` (d,); all guarantees stay (theory: the motion is relative).

    The last target of a chain is moved there, and its other stages with it. For one stage alone, give
    ``chain.with_stage(i, retargeted(chain.parts[i], target))``.

    Args:
        skill: With attractors in one place.
        target: Shape (d,). Of poses also (x, y, z, qx, qy, qz, qw), or (x, y, z): orientations stay then,
            even those of several attractors in one place.
        turn: Of poses: whether the whole motion turns with its target, as if base and target were one body.
            Otherwise it goes the same way to the new target, and ends in another orientation.

    Raises:
        UsageError: Wrong number of coordinates, not finite, no unit quaternion, a skill with several
            attractors, or one without orientation that is to turn.
    """
    attractors, space, c = skill.attractors, skill.space, skill.space.positions
    goal = goal_of(space, target, attractors[0])
    together = np.size(target) == c < space.dimension and (attractors[:, :c] == attractors[0, :c]).all()
    if len(attractors) > 1 and not together:
        raise UsageError(
            f"this skill has {len(attractors)} attractors; it cannot be moved to one target.",
            hint="Combine its parts with --align to give them one target.",
        )
    if turn and c == space.dimension:
        raise UsageError("turn: this skill moves positions; its target has no orientation to turn with.")
    if isinstance(skill, ChainedSkill):
        *before, last = skill.parts
        carried = [_carried_stage(stage, attractors[0], goal, turn=turn) for stage in before]
        return replace(skill, parts=(*carried, retargeted(last, target, turn=turn)))
    # ξ* + (target − ξ*) may differ from the target in its last bit, so attractors are set once more.
    ends = iter([np.r_[goal[:c], leaf.attractor[c:]] if together else goal for leaf in skill.leaves])
    moved = skill.carried(attractors[0], goal).with_leaves(lambda leaf: replace(leaf, attractor=next(ends)))
    before, after = attractors[0][c:], goal[c:]
    if not turn or (before == after).all():
        return moved
    return turned(moved, rotations.matrices(after) @ rotations.matrices(before).T)


def _carried_stage(stage: Skill, target: FloatArray, goal: FloatArray, *, turn: bool) -> Skill:
    """Return a stage of a chain, moved as the last target is to a goal; with ``turn`` as one body with it."""
    if not turn:
        return stage.carried(target, goal)
    end = stage.space.carried(stage.attractors[0], target, goal, turn=True)
    return retargeted(stage, end, turn=True)


def goal_of(space: Space, target: npt.ArrayLike, current: FloatArray) -> FloatArray:
    """Return a target as a state (d,): given as such, as a pose with a quaternion, or as a position only.

    Args:
        space: Of the target.
        target: As of ``retargeted``.
        current: State (d,) whose orientation a target without one gets.

    Raises:
        UsageError: Wrong number of coordinates, not finite, or no unit quaternion.
    """
    given = np.asarray(target, dtype=np.float64)
    if given.shape == (space.positions,):
        given = np.concatenate([given, current[space.positions :]])
    try:
        goal = space.measured(given)
    except StateError:
        numbers = " or ".join(str(n) for n in space.sizes)
        raise UsageError(f"target: expected {numbers} finite numbers, got {np.size(given)}.") from None
    norm = float(np.linalg.norm(given[space.positions :]))
    if given.size > space.dimension and abs(norm - 1) > UNIT:
        raise UsageError(
            f"target: the quaternion has length {norm:.3g}, not 1.",
            hint="Give the orientation as QX,QY,QZ,QW behind the position, the real part last.",
        )
    if given.size == space.dimension and not space.flat and norm > np.pi:
        return space.displace(goal, np.zeros_like(goal))  # the same rotation, by half a turn at most
    return goal


def turned(skill: AnySkill, rotation: FloatArray) -> AnySkill:
    """Return the same motion of positions, turned about the target; orientations relative to it stay.

    Rounding changes A and P by a few units in the last place, so the result has its own proof.

    Args:
        skill: With one attractor; of positions in R³, or of poses.
        rotation: Q of x ↦ Q x for offsets x of the position, shape (3, 3).
    """
    whole = np.eye(skill.dimension)
    whole[:3, :3] = rotation
    anchor = skill.space.anchor(skill.attractors[0])
    if isinstance(skill, CombinedSkill):
        regions = tuple(region.mapped(whole, anchor) for region in skill.regions)
        skill = replace(skill, regions=regions)
    return skill.with_leaves(lambda leaf: _turned(leaf, whole))


def _turned(leaf: SedsSkill, whole: FloatArray) -> SedsSkill:
    coordinates, moved = leaf.coordinates.turned(whole)
    return replace(
        leaf,
        means=leaf.anchor + (leaf.means - leaf.anchor) @ moved.T,
        covariances=congruent(leaf.covariances, moved),
        system_matrices=moved @ leaf.system_matrices @ moved.T,
        residual_covariances=congruent(leaf.residual_covariances, moved),
        lyapunov=congruent(leaf.lyapunov, moved),
        density=leaf.density.mapped(whole, leaf.anchor),
        coordinates=coordinates,
    )
