"""Combine: several skills, one of which acts at any time, each in its own region (Section 3.2)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy.typing as npt

from skillctl.arrays import FloatArray
from skillctl.compose.lyapunov import with_lyapunov
from skillctl.compose.parts import in_one_space, normalised, on_one_attractor, require_compatible
from skillctl.errors import UsageError
from skillctl.model.combined import CombinedSkill
from skillctl.model.gates import combine_gate
from skillctl.model.skill import ActingSkill, Skill, extent

DISTURBANCE_SHARE = 0.05  # of the smallest part's extent: more than tracking errors, less than a push


def combine(
    parts: Sequence[Skill],
    *,
    part_priors: npt.ArrayLike | None = None,
    gate: str = "latched",
    align: bool = False,
    target: npt.ArrayLike | None = None,
    turn: bool = False,
    disturbance_distance: float | None = None,
    lyapunov: FloatArray | None = None,
) -> CombinedSkill:
    """Return one skill with a region of influence per part: where βᵢ pᵢ(ξ) is largest, part i acts.

    A combined skill among the parts is replaced by its own parts: their priors are multiplied by its prior,
    their speeds by its speed, and the new gate holds for all.

    Args:
        parts: Two or more skills in one state space.
        part_priors: βᵢ > 0 up to a common factor, one per given part; equal by default.
        gate: ``latched``: chosen at the start and after a disturbance. ``instantaneous``: at every instant;
            with several attractors nothing global is proved of it.
        align: Move all parts to one attractor; then the start relative to it decides which part acts. Latched
            parts that move poses keep their own orientation there, unless the target has one.
        target: That attractor, as of ``retargeted``; by default the mean of the parts', weighted by β.
        turn: Whether motions of poses turn with their target.
        disturbance_distance: How far the state has to jump for a new choice, in the unit of the space; by
            default ``DISTURBANCE_SHARE`` of the smallest part's extent.
        lyapunov: Common P (d, d) for all parts, which proves an instantaneous gate with one attractor.

    Raises:
        UsageError: Fewer than two parts, different spaces, or options out of range or without effect.

    References:
        Section 3.2 of the paper; A. Shukla & A. Billard, Robotics and Autonomous Systems 60(3) (2012)
        for distinct attractors. The latched gate and its guarantee are ours.
    """
    require_compatible(parts, "combine")
    outer = normalised("part priors", part_priors, len(parts))
    members, priors = _flattened(in_one_space(parts), outer)
    combine_gate(gate)
    for what, given in (("target", target is not None), ("turn", turn)):
        if given and not align:
            raise UsageError(f"{what}: the skills keep their own attractors.", hint="Add --align.")
    if align:
        keep = not combine_gate(gate).reselects
        members = on_one_attractor(members, priors, target, turn=turn, keep=keep)
    if lyapunov is not None:
        members = tuple(with_lyapunov(part, lyapunov) for part in members)
    if disturbance_distance is None:
        disturbance_distance = DISTURBANCE_SHARE * min(extent(part.density) for part in members)
    elif not (math.isfinite(disturbance_distance) and disturbance_distance > 0):
        raise UsageError(f"disturbance distance: must be positive, got {disturbance_distance:g}.")
    return CombinedSkill(members, priors, gate, disturbance_distance)


def _flattened(parts: Sequence[Skill], priors: FloatArray) -> tuple[tuple[ActingSkill, ...], FloatArray]:
    """Return the parts with combined skills replaced by their own parts, and the priors to go with them."""
    members: list[ActingSkill] = []
    weights: list[float] = []
    for part, prior in zip(parts, priors.tolist(), strict=True):
        members += [inner.accelerated(part.outer_speed) for inner in part.acting_parts]
        weights += (prior * part.part_priors).tolist() if isinstance(part, CombinedSkill) else [prior]
    return tuple(members), normalised("part priors", weights, len(weights))
