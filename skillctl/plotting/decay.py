"""How fast V shrinks, place by place: numbers for pictures, never a proof."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.model.skill import Skill
from skillctl.plotting.portrait import Motion


@dataclass(frozen=True, eq=False)
class Bounds:
    """What a certificate says, as far as a figure shows it.

    Attributes:
        verdict: In words, for the title.
        rate: Proved decay rate of the whole, from everywhere, [1/s]; None where there is none.
        radii: For each part, the distance from its attractor within which it is proved to end there; or None.
        witness: Start of a motion that was found to reach no attractor, (d,); or None.
    """

    verdict: str
    rate: float | None
    radii: tuple[float | None, ...]
    witness: tuple[float, ...] | None


def decay(skill: Skill, positions: FloatArray) -> FloatArray:
    r"""Return −V̇ / (2 V) at positions (n, d), shape (n,), [1/s]: the rate at which √V shrinks there.

    V = (ξ − ξ*)ᵀ P (ξ − ξ*) with P and ξ* of the part that a start there selects. Zero exactly where V̇ is,
    negative where V grows; NaN at the attractor, where neither moves.
    """
    rates = np.empty(len(positions))
    acting = skill.part_at(positions)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        velocities = skill.velocity(positions)
        for index, part in enumerate(skill.acting_parts):
            mask = acting == index
            offsets = positions[mask] - part.attractor
            pulled = offsets @ part.lyapunov
            rates[mask] = -(pulled * velocities[mask]).sum(axis=1) / (pulled * offsets).sum(axis=1)
    rates[~np.isfinite(rates)] = np.nan
    return rates


def distances(skill: Skill, motion: Motion) -> FloatArray:
    """Return ‖ξ − ξ*‖_P along a motion, in the norm of the part that acted at its end. Shape (T,)."""
    return skill.acting_parts[motion.part].v_distance(motion.positions)
