"""Where motions that start in a box can go, and by when they have arrived: bounds from sublevel sets of V."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.model.chained import ChainedSkill
from skillctl.model.coordinates.enclosure import GUARD
from skillctl.model.pose import Pose
from skillctl.model.rollout import arrival_distance_of
from skillctl.model.skill import Skill
from skillctl.model.space import Space
from skillctl.stability.blocks import Block, blocks_of
from skillctl.stability.parts import proved_rate
from skillctl.stability.region import selectable_parts
from skillctl.stability.report import Certificate, Motions, at_least, at_most
from skillctl.stability.sampling import follow_box
from skillctl.stability.stages import Starts, begun_stages, follow_stages
from skillctl.stability.sublevels import MOST_COORDINATES, sublevels_of


@dataclass(frozen=True, slots=True)
class PartReach:
    """Where motions from the start box can go while one part acts, from the start to the end.

    Attributes:
        part: Counted from 1.
        level: c: nowhere in the start box is V larger, of poses that of the position.
        low: No motion goes below this, one number for each coordinate, in the unit of the space.
        high: No motion goes above this.
        arrival: By then every motion is within the arrival distance of the attractor, and stays there, [s];
            None if there is no bound. Of a part of a chain, from when it begins, if no other follows.
    """

    part: int
    level: float
    low: tuple[float, ...]
    high: tuple[float, ...]
    arrival: float | None


@dataclass(frozen=True, slots=True)
class Reach:
    """Bounds of all motions that start in a box and are not disturbed; proved, and rounded to the safe side.

    Of poses, boxes are of positions, and motions start in any orientation but 180° from a target's.

    Attributes:
        names: Of the coordinates of a position.
        unit: Of the space.
        start_low: Corner of the start box.
        start_high: The opposite corner.
        low: No motion goes below this, whichever part acts.
        high: No motion goes above this.
        period: The arrival holds at every controller period up to this, the box at every proved one, [s].
        exact: Whether {V ≤ c} reaches as far as the box says; otherwise it may end before.
        arrival_distance: Within this distance of its attractor a motion has arrived.
        arrival: By then every motion has arrived, if no cap slows it, [s]; None if there is no bound.
        parts: The bounds of each part that acts, or that may be selected somewhere in the start box.
        measured: What sampled motions from the box do.
        proof: What is proved, in sentences.
    """

    names: tuple[str, ...]
    unit: str
    start_low: tuple[float, ...]
    start_high: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    period: float
    exact: bool
    arrival_distance: float
    arrival: float | None
    parts: tuple[PartReach, ...]
    measured: Motions
    proof: tuple[str, ...]


def bound_reach(
    skill: Skill,
    certificate: Certificate,
    low: npt.ArrayLike,
    high: npt.ArrayLike,
    *,
    period: float | None = None,
    seed: int = 0,
) -> Reach | None:
    r"""Return where motions that start between ``low`` and ``high`` can go, and by when they have arrived.

    V falls at every step, so a motion never leaves {V ≤ c}, c the largest V in the start box. In plain
    coordinates c is reached at a vertex, since V is convex, and {V ≤ c} reaches ξᵢ* ± √(c (P⁻¹)ᵢᵢ): exact
    arithmetic. In others, interval arithmetic encloses c and c⁻¹({yᵀPy ≤ c}). The result is a box, hence
    convex: the straight way between two samples stays in it, too. Of poses V is that of the position, which
    falls by itself; by the arrival the orientation, from at most half a turn, is near enough as well. Of a
    chain the stages follow each other, each from where the one before is over; events count as in a `Course`.

    What it does not show: where the hand goes after a disturbance, or how far the rest of the arm reaches.

    Args:
        skill: Any skill.
        certificate: What is proved of it.
        low: Corner of the start box, shape (d,), of poses (3,).
        high: The opposite corner.
        period: Of the controller, [s]; by default half of what is proved.
        seed: Of the sampled starts.

    Returns:
        None if there is no global proof, or none for a period as long as this.

    Raises:
        UsageError: More coordinates than ``MOST_COORDINATES``.

    References:
        Theory page, bounds of a motion; ours.
    """
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    if len(low) > MOST_COORDINATES:
        raise UsageError(f"start-box: bounds need {MOST_COORDINATES} coordinates or fewer, not {len(low)}.")
    period = 0.5 * (certificate.period or 0.0) if period is None else period
    if certificate.scope != "global" or certificate.period is None or period > certificate.period:
        return None
    near = arrival_distance_of(skill)
    if isinstance(skill, ChainedSkill):
        parts, arrival = _chain_reach(
            skill, certificate, Starts.turned_anyhow(low, high, skill), near, period
        )
    else:
        chosen = range(len(skill.acting_parts)) if skill.reselects else selectable_parts(skill, low, high)
        parts = tuple(_part_reach(skill, index, low, high, near, period) for index in chosen)
        arrival = _latest([part.arrival for part in parts])
    least = tuple(map(min, zip(*(part.low for part in parts), strict=True)))
    most = tuple(map(max, zip(*(part.high for part in parts), strict=True)))
    return Reach(
        names=skill.space.names[: len(low)],
        unit=skill.space.unit,
        start_low=tuple(low.tolist()),
        start_high=tuple(high.tolist()),
        low=least,
        high=most,
        period=period,
        exact=not any(part.coordinates.links for part in skill.acting_parts),
        arrival_distance=near,
        arrival=arrival,
        parts=parts,
        measured=follow_box(skill, low, high, period, arrival, seed),
        proof=_proof(skill.space, least, most, near, arrival, period),
    )


def _part_reach(
    skill: Skill, index: int, low: FloatArray, high: FloatArray, near: float, period: float
) -> PartReach:
    part = skill.acting_parts[index]
    position, *others = blocks_of(part)
    sublevels = sublevels_of(position)
    level = sublevels.level(low, high)
    least, most = sublevels.extent(level)
    if others:
        near *= (1 - GUARD) / math.sqrt(1 + len(others))  # each of n blocks within near / √n: all within near
    levels = [(position, level), *((block, _half_turn(part.space, block)) for block in others)]
    times = [
        _arrival(
            highest,
            sublevels_of(block).radius(near),
            proved_rate(part, skill.outer_speed, period, block),
            period,
        )
        for block, highest in levels
    ]
    return PartReach(index + 1, level, tuple(least.tolist()), tuple(most.tolist()), _latest(times))


def _chain_reach(
    chain: ChainedSkill, certificate: Certificate, first: Starts, near: float, period: float
) -> tuple[tuple[PartReach, ...], float | None]:
    """Return the bounds of all parts of a chain, each from where it begins, and of the whole's arrival."""
    course, _ = follow_stages(chain, certificate.parts, period, first)
    parts = [
        (index, _part_reach(chain, index, start.low, start.high, near, period))
        for begun, _ in begun_stages(chain, first)
        for index, starts in begun.items()
        for start in starts
    ]
    end = _latest([reach.arrival for index, reach in parts if index in chain.stages[-1]])
    arrival = None
    if course is not None and course.steps is not None and end is not None:
        arrival = (course.steps - (course.stages[-1].steps or 0)) * period + end
    return tuple(reach for _, reach in parts), arrival


def _latest(times: Sequence[float | None]) -> float | None:
    """Return the last of some times; None if one is not known."""
    known = [time for time in times if time is not None]
    return max(known) if len(known) == len(times) else None


def _half_turn(space: Space, block: Block) -> float:
    """Return the V of an orientation half a turn from the target, the largest there is; rounded up."""
    length = space.length if isinstance(space, Pose) else math.inf
    return float(block.lyapunov[0, 0]) * (math.pi * length) ** 2 * (1 + GUARD)


def _proof(
    space: Space,
    low: tuple[float, ...],
    high: tuple[float, ...],
    near: float,
    arrival: float | None,
    period: float,
) -> tuple[str, ...]:
    """Say what is proved of undisturbed motions from the start box."""
    ranges = ", ".join(
        f"{name} from {at_least(least)} to {at_most(most)}"
        for name, least, most in zip(space.names, low, high, strict=False)
    )
    stays = (
        f"Every undisturbed motion from the start box stays in {ranges} {space.unit}, between samples, too."
    )
    if arrival is None:
        return (stays,)
    return (
        stays,
        f"It is within {near:g} {space.unit} of its attractor after at most {at_most(arrival)} s, and stays "
        f"there, at every controller period up to {at_least(period)} s, unless a speed cap slows it.",
    )


def _arrival(level: float, radius: float | None, rate: float | None, period: float) -> float | None:
    """Return when √V, which shrinks by e^(−rΔt) a step, has come from √c down to ``radius``; rounded up."""
    if radius is None or rate is None or math.isinf(level):
        return None
    factor = (1 + GUARD) * math.sqrt(level) / radius
    return (1 + GUARD) * (math.log(factor) / rate + period) if factor > 1 else 0.0
