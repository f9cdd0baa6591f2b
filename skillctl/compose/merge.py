"""Merge: several skills act together on one attractor (Section 3.1)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray
from skillctl.compose.lyapunov import conflicting_parts, with_lyapunov
from skillctl.compose.parts import in_one_space, normalised, on_one_attractor, require_compatible
from skillctl.errors import FitError, UsageError
from skillctl.model.gates import gate_parameters, merge_gate
from skillctl.model.merged import MergedSkill
from skillctl.model.skill import ActingSkill, Skill


class NoCommonLyapunovError(FitError):
    """No common P is known for the parts, so that nothing would be proved of their mixture.

    Attributes:
        parts: Indices of parts that have no common P; empty if all have one that was not given, or measure
            distance in different coordinates.
    """

    def __init__(self, parts: tuple[int, ...], *, bent: bool = False) -> None:
        self.parts = parts
        names = " and ".join(str(i + 1) for i in parts)
        if bent:
            reason = "the skills were learned in different coordinates"
        elif parts:
            reason = f"skill{'s' if len(parts) > 1 else ''} {names} admit no common Lyapunov matrix"
        else:
            reason = "the skills were learned with different Lyapunov matrices"
        super().__init__(
            f"merge: {reason}; nothing would be proved of the result.",
            hint="Refit them under one common metric, or learn all of them with --metric euclidean "
            "--coordinates identity.",
        )


def merge(
    parts: Sequence[Skill],
    *,
    part_weights: npt.ArrayLike | None = None,
    gate: str = "superposition",
    parameters: Mapping[str, float] | None = None,
    speed: float = 1.0,
    target: npt.ArrayLike | None = None,
    turn: bool = False,
    lyapunov: FloatArray | None = None,
) -> MergedSkill:
    """Return one skill in which all parts act together; every convex mixture of them stays stable.

    Each gate mixes the parts' components with weights h̃ ≥ 0 that sum to one (``MergedSkill`` has the
    formulas), so a P under which every component contracts proves the whole, for any weights (ours). The
    paper's plain averaging of parameters guarantees nothing and is not offered.

    Args:
        parts: Two or more SEDS or merged skills in one state space.
        part_weights: αᵢ > 0 up to a common factor, one per part; equal by default.
        gate: ``superposition`` (Eq. 7 and 8), ``density`` (Eq. 8 on densities) or ``experts`` (Eq. 9).
        parameters: Of the gate, by name: γ ≥ 1, the ``sharpness`` of ``experts``; defaults where not given.
        speed: Factor on the velocity.
        target: Common attractor, as of ``retargeted``; by default the weighted mean of the parts' attractors.
        turn: Whether motions of poses turn with their target.
        lyapunov: Common P (d, d) for all parts; may be omitted where they share one already.

    Raises:
        UsageError: Fewer than two parts, a combined skill, different spaces, or options out of range.
        NoCommonLyapunovError: No P is given and the parts have different ones, or different coordinates.

    References:
        Section 3.1 of the paper; theory page, merge.
    """
    require_compatible(parts, "merge")
    members = in_one_space([_mergeable(number, part) for number, part in enumerate(parts, start=1)])
    weights = normalised("part weights", part_weights, len(parts))
    chosen = gate_parameters(merge_gate(gate), parameters or {})
    if not 0 < speed < math.inf:
        raise UsageError(f"speed: must be a positive number, got {speed:g}.")
    placed = on_one_attractor(members, weights, target, turn=turn)  # what turns has another P
    return MergedSkill(common_members(placed, lyapunov), weights, gate, speed, chosen)


def with_weights(skill: MergedSkill, weights: npt.ArrayLike) -> MergedSkill:
    """Return a merged skill with other weights of its parts, at the same speed.

    Whatever they are, h̃ ≥ 0 sums to one over components that all contract under the one P: the proof of a
    merged skill is one for the whole simplex of weights, and so are its rate and its period. So weights may
    be chosen at run time, for each target anew.

    Args:
        skill: A merged skill.
        weights: αᵢ ≥ 0 up to a common factor, one per part; parts of weight zero are left out.

    Raises:
        UsageError: Wrong number, not finite, negative, or all zero.
    """
    values = np.array(weights, dtype=np.float64)
    used = np.flatnonzero(values)
    if values.shape != (len(skill.parts),) or not used.size:
        raise UsageError(
            f"weights: expected {len(skill.parts)} numbers, not all zero, got {np.size(values)}.",
            hint="Give one per part of the merged skill.",
        )
    kept = tuple(skill.parts[i] for i in used.tolist())
    return replace(skill, parts=kept, part_weights=normalised("weights", values[used], used.size))


def common_members(parts: Sequence[Skill], lyapunov: FloatArray | None) -> tuple[ActingSkill, ...]:
    """Return the parts of a merger under one P: the given one (d, d), else the one they share.

    Raises:
        UsageError: Fewer than two parts, a combined skill, or different spaces.
        NoCommonLyapunovError: No P is given and the parts have different ones, or different coordinates.
    """
    require_compatible(parts, "merge")
    members = tuple(_mergeable(number, part) for number, part in enumerate(parts, start=1))
    if any(part.coordinates != members[0].coordinates for part in members):
        raise NoCommonLyapunovError((), bent=True)
    if lyapunov is not None:
        return tuple(with_lyapunov(part, lyapunov) for part in members)
    if any(part.form != members[0].form for part in members):
        raise NoCommonLyapunovError(conflicting_parts(members))
    return members


def _mergeable(number: int, part: Skill) -> ActingSkill:
    if not isinstance(part, ActingSkill):
        raise UsageError(
            f"merge: skill {number} is a combined skill; only one of its parts acts at a time.",
            hint="Merge its parts first, then combine the results.",
        )
    return part
