"""Chain: skills that act one after the other, each towards its own target (the paper's "sequencing")."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from skillctl.compose.combine import DISTURBANCE_SHARE
from skillctl.compose.parts import in_one_space, require_compatible
from skillctl.errors import UsageError
from skillctl.model.chained import EVENT, WAIT, ChainedSkill, OnJump
from skillctl.model.retarget import retargeted
from skillctl.model.skill import Skill, extent

WITHIN_SHARE = 0.01  # of what a stage was taught: 5 mm of half a metre


def staged(
    parts: Sequence[Skill], *, targets: Mapping[int, npt.ArrayLike] | None = None, turn: bool = False
) -> tuple[Skill, ...]:
    """Return skills as the stages of a chain: in one space, and each at its target.

    Args:
        parts: Two or more learned, merged or latched combined skills, in their order.
        targets: Of some stages, by their numbers from 1, as of ``retargeted``; the others keep their own.
        turn: Whether motions of poses turn with the targets given.

    Raises:
        UsageError: Fewer than two skills, different spaces, a skill that cannot be a stage, a stage or a
            target that there is not, or nothing to turn.
    """
    require_compatible(parts, "chain")
    for number, part in enumerate(parts, start=1):
        if part.reselects:
            raise UsageError(
                f"chain: skill {number} is combined with the instantaneous gate, which may never arrive.",
                hint="Combine its parts with --gate latched.",
            )
    stages = list(in_one_space(parts))
    given = targets or {}
    if turn and not given:
        raise UsageError("turn: no stage has a new target.", hint="Add --target STAGE=X,Y,Z,QX,QY,QZ,QW.")
    for number, target in given.items():
        index = stage_index("target", number, len(stages))
        try:
            stages[index] = retargeted(stages[index], target, turn=turn)
        except UsageError as error:
            raise UsageError(f"stage {number}: {error}", hint=error.hint) from None
    return tuple(stages)


def chained(
    stages: Sequence[Skill],
    levels: Sequence[float],
    *,
    events: Sequence[tuple[int, str]] = (),
    on_jump: OnJump = "stay",
    disturbance_distance: float | None = None,
) -> ChainedSkill:
    """Return the chain of some stages.

    Args:
        stages: From ``staged``.
        levels: V at which each is over.
        events: After which stage, counted from 1, comes what: ``(2, "close")``, ``(2, "wait 0.5")``; those of
            one stage in this order.
        on_jump: See ``ChainedSkill``.
        disturbance_distance: How far the state has to jump for that, in the unit of the space; by default
            ``DISTURBANCE_SHARE`` of the smallest stage's extent.

    Raises:
        UsageError: An event of a stage that there is not, or that is no word and no wait; a distance that is
            not positive.
    """
    happens: list[tuple[str, ...]] = [()] * len(stages)
    for number, event in events:
        if not EVENT.fullmatch(event) or event == WAIT.strip():
            raise UsageError(
                f"event: {event!r} is neither a word in small letters nor a time to wait.",
                hint="As in --event 2:close, or --event '2:wait 0.5'.",
            )
        happens[stage_index("event", number, len(stages))] += (event,)
    if disturbance_distance is None:
        disturbance_distance = DISTURBANCE_SHARE * min(extent(stage.density) for stage in stages)
    elif not (math.isfinite(disturbance_distance) and disturbance_distance > 0):
        raise UsageError(f"disturbance distance: must be positive, got {disturbance_distance:g}.")
    return ChainedSkill(tuple(stages), np.array(levels), tuple(happens), on_jump, disturbance_distance)


def usual_distance(stage: Skill) -> float:
    """Return how near to its target a stage is over unless said: ``WITHIN_SHARE`` of its extent."""
    return WITHIN_SHARE * extent(stage.density)


def stage_index(name: str, number: int, count: int) -> int:
    """Return the index of a stage by its number, or raise UsageError for the option of a name."""
    if not 1 <= number <= count:
        raise UsageError(f"{name}: there is no stage {number}; the chain has {count}, counted from 1.")
    return number - 1
