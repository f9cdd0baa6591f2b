"""How two chains differ, stage by stage: which motion, where to, to what level, and what happens then."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from skillctl.arrays import FloatArray
from skillctl.compose.parts import same_motion
from skillctl.model.chained import ChainedSkill
from skillctl.model.skill import Skill


@dataclass(frozen=True)
class StageDifference:
    """A stage of a, and what has become of it in b; one of both is None where there is no other.

    Attributes:
        a, b: Number of the stage in each, counted from 1.
        same_motion: Whether both move alike relative to their targets, number for number.
        target: Distance of their first targets, [unit].
        target_angle: Angle between these, [rad]; None without orientation.
        levels: V at which each is over.
        events: What happens then in each.
    """

    a: int | None
    b: int | None
    same_motion: bool = False
    target: float | None = None
    target_angle: float | None = None
    levels: tuple[float | None, float | None] = (None, None)
    events: tuple[tuple[str, ...] | None, tuple[str, ...] | None] = (None, None)


def stage_differences(a: Skill, b: Skill) -> tuple[StageDifference, ...]:
    """Return what has become of each stage of a, and the stages of b that are new.

    A stage of b with the same motion is the stage of a, wherever it is; else the stage in the same place.

    Returns:
        Nothing unless both are chains of one space.
    """
    if not (isinstance(a, ChainedSkill) and isinstance(b, ChainedSkill)) or a.space != b.space:
        return ()
    pairs = _pairs(a.parts, b.parts)
    new = [index for index in range(len(b.parts)) if index not in pairs.values()]
    return (
        *(_difference(a, b, index, pairs.get(index)) for index in range(len(a.parts))),
        *(_difference(a, b, None, index) for index in new),
    )


def _pairs(a: Sequence[Skill], b: Sequence[Skill]) -> dict[int, int]:
    """Return the stage of b that each stage of a has become, where there is one."""
    pairs: dict[int, int] = {}
    alike = [(i, j) for i, one in enumerate(a) for j, other in enumerate(b) if same_motion(one, other)]
    in_place = [(i, i) for i in range(min(len(a), len(b)))]
    for i, j in (*sorted(alike, key=lambda pair: (abs(pair[0] - pair[1]), pair)), *in_place):
        if i not in pairs and j not in pairs.values():
            pairs[i] = j
    return pairs


def _difference(a: ChainedSkill, b: ChainedSkill, i: int | None, j: int | None) -> StageDifference:
    levels = _at(a.levels, i), _at(b.levels, j)
    events = None if i is None else a.events[i], None if j is None else b.events[j]
    numbers = None if i is None else i + 1, None if j is None else j + 1
    if i is None or j is None:
        return StageDifference(*numbers, levels=levels, events=events)
    one, other = a.parts[i], b.parts[j]
    distance, angle = a.space.apart(one.attractors[0], other.attractors[0])
    turned = None if angle is None else float(angle)
    return StageDifference(*numbers, same_motion(one, other), float(distance), turned, levels, events)


def _at(levels: FloatArray, index: int | None) -> float | None:
    return None if index is None else float(levels[index])


def same_course(a: Skill, b: Skill, atol: float, rtol: float) -> bool:
    """Return whether two skills are no chains, or chains whose stages are over alike and jumps change alike.

    Args:
        a: One skill.
        b: The other.
        atol: Distances may differ by this much, in their unit,
        rtol: plus this share of those of a; levels by this share alone.
    """
    if not (isinstance(a, ChainedSkill) and isinstance(b, ChainedSkill)):
        return a.kind == b.kind or "chain" not in (a.kind, b.kind)
    jumps = abs(a.disturbance_distance - b.disturbance_distance) <= atol + rtol * a.disturbance_distance
    return (
        (a.events, a.on_jump) == (b.events, b.on_jump)
        and jumps
        and bool((abs(a.levels - b.levels) <= rtol * a.levels).all())
    )
