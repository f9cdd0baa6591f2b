"""A chain: skills that act one after the other, each with its own target, and what happens between them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import ClassVar, Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from skillctl.arrays import BoolArray, FloatArray, Frozen, IntArray, frozen_array, require_positive
from skillctl.errors import InvalidModelError
from skillctl.model.composite import Switched, require_parts
from skillctl.model.mixture import GaussianMixture
from skillctl.model.skill import ActingSkill, Kind, Skill

OnJump: TypeAlias = Literal["stay", "back"]
EVENT = re.compile(r"[a-z][a-z0-9_-]{0,63}( [0-9]{1,6}(\.[0-9]{1,9})?)?")
WAIT = "wait "


@dataclass(frozen=True, eq=False, slots=True)
class ChainedSkill(Frozen, Switched):
    """Skills that act one after the other (design: "sequencing"; the levels, events and jumps are ours).

    Stage i moves to its own target. It is over where V of its part that acts falls to its level; then come
    its events, and stage i + 1. Each stage arrives in finite time, so the motion ends at the last target.
    One number is the memory of all that, as of a latched skill: the index of the acting part.

    Attributes:
        parts: The stages in their order: learned, merged or latched combined skills of one space.
        levels: V at which each stage is over, > 0; the chain is done when the last one is. Shape (stages,).
        events: What happens once a stage is over, one tuple of texts a stage: ``close``, ``wait 0.5`` [s].
        on_jump: What a jump of the state by more than ``disturbance_distance`` changes. ``stay``: the stage
            goes on from there. ``back``: of the stages begun so far that one goes on whose density is largest
            there, the latest of equal ones.
        disturbance_distance: In the unit of the space.
        stages: The acting parts of each stage, as a range of their indices.
    """

    kind: ClassVar[Kind] = "chain"
    gate: ClassVar[str] = "sequence"
    parameters: ClassVar[Mapping[str, float]] = MappingProxyType({})
    speed: ClassVar[float] = 1.0
    outer_speed: ClassVar[float] = 1.0
    reselects: ClassVar[bool] = False

    parts: tuple[Skill, ...]
    levels: FloatArray
    events: tuple[tuple[str, ...], ...]
    on_jump: OnJump = "stay"
    disturbance_distance: float = 0.02
    acting_parts: tuple[ActingSkill, ...] = field(init=False, repr=False)
    stages: tuple[range, ...] = field(init=False, repr=False)
    _stage_of: tuple[int, ...] = field(init=False, repr=False)
    _roots: tuple[float, ...] = field(init=False, repr=False)  # √level of the stage of each acting part

    def __post_init__(self) -> None:
        levels = frozen_array("levels", self.levels, (len(self.parts),))
        for value in levels.tolist():
            require_positive("levels", value)
        object.__setattr__(self, "events", tuple(map(tuple, self.events)))
        if len(self.events) != len(self.parts):
            raise InvalidModelError("events: expected one tuple for each part.")
        for event in (event for events in self.events for event in events):
            if not EVENT.fullmatch(event) or (event.split()[0] == WAIT.strip()) != event.startswith(WAIT):
                raise InvalidModelError(f"events: {event!r} is no word, and no `wait` with its seconds.")
        if self.on_jump not in get_args(OnJump):
            raise InvalidModelError(f"on_jump: one of {', '.join(get_args(OnJump))}, not {self.on_jump!r}.")
        require_positive("disturbance_distance", self.disturbance_distance)
        for stage in self.parts:
            if isinstance(stage, ChainedSkill) or stage.reselects:
                what = "a chain" if isinstance(stage, ChainedSkill) else "an instantaneous combined skill"
                raise InvalidModelError(f"parts: {what} cannot be a stage of a chain.")
        acting = tuple(
            part if stage.outer_speed == 1.0 else part.accelerated(stage.outer_speed)
            for stage in self.parts
            for part in stage.acting_parts
        )
        require_parts(acting, self.outer_speed)
        counts = [len(stage.acting_parts) for stage in self.parts]
        ends = np.cumsum(counts).tolist()
        owners = np.repeat(np.arange(len(counts)), counts).tolist()
        object.__setattr__(self, "levels", levels)
        object.__setattr__(self, "acting_parts", acting)
        object.__setattr__(self, "stages", tuple(map(range, [0, *ends[:-1]], ends)))
        object.__setattr__(self, "_stage_of", tuple(owners))
        object.__setattr__(self, "_roots", tuple(math.sqrt(levels[owner]) for owner in owners))

    @property
    def shares(self) -> FloatArray:
        """The same for each stage: none is weighted against another. Shape (stages,)."""
        return np.full(len(self.parts), 1 / len(self.parts))

    @property
    def influences(self) -> tuple[GaussianMixture, ...]:
        """The mixture of each acting part that decides, within its stage, which one acts."""
        return tuple(influence for stage in self.parts for influence in stage.influences)

    @property
    def attractors(self) -> FloatArray:
        """Where the last stage ends, the only place to rest. Shape (n, d)."""
        return self.parts[-1].attractors

    def stage_of(self, part: int) -> int:
        """Return the stage of an acting part; both are counted from 0."""
        return self._stage_of[part]

    def waits(self, stage: int) -> float:
        """Return how long the events of a stage wait in all, [s]."""
        return sum(float(event.removeprefix(WAIT)) for event in self.events[stage] if event.startswith(WAIT))

    def with_stage(self, index: int, stage: Skill) -> ChainedSkill:
        """Return the chain with another skill for one stage, as one with another target.

        The level stays: it is of V, which is relative to the target.
        """
        return replace(self, parts=(*self.parts[:index], stage, *self.parts[index + 1 :]))

    def over_at(self, state: FloatArray, part: int) -> bool:
        """Return whether the stage of a part is over at one state (d,): V is at its level or below."""
        return self.acting_parts[part].v_distance_at(state) <= self._roots[part]

    def begun_at(self, stage: int, state: FloatArray) -> int:
        """Return the acting part with which a stage begins at one state (d,)."""
        return self.stages[stage].start + self.parts[stage].selected(state)

    def resumed_at(self, state: FloatArray, part: int) -> int:
        """Return the part that acts after a jump to one state (d,); before it, ``part`` did."""
        stage = self.stage_of(part)
        if self.on_jump == "back":
            stage = max(range(stage, -1, -1), key=lambda each: self._familiarity(each, state))
        return self.begun_at(stage, state)

    def _familiarity(self, stage: int, state: FloatArray) -> float:
        parts = self.parts[stage].acting_parts
        return max(float(part.density.log_density(part.charted(state[None]))[0]) for part in parts)

    def onward_at(self, state: FloatArray, part: int) -> int:
        """Return the part that acts next at one state (d,): of the first stage from here that is not over."""
        last = len(self.parts) - 1
        while (stage := self.stage_of(part)) < last and self.over_at(state, part):
            part = self.begun_at(stage + 1, state)
        return part

    def onward(self, states: FloatArray, parts: IntArray) -> IntArray:
        """Return the part that acts next at each state (n, d). Shape (n,)."""
        parts = parts.copy()
        for index, part in enumerate(self.acting_parts):
            following = self.stage_of(index) + 1
            if following == len(self.parts):
                break
            here = np.flatnonzero(parts == index)
            over = here[part.v_distance(states[here]) <= self._roots[index]]
            if len(over):
                parts[over] = self.stages[following].start + self.parts[following].part_at(states[over])
        return parts

    def arrived(self, states: FloatArray, parts: IntArray, distance: float) -> BoolArray:
        """Return whether states (n, d), at which parts (n,) act, are in the last stage and at its end."""
        return (parts >= self.stages[-1].start) & self.parts[-1].arrived(states, parts, distance)

    def part_at(self, states: npt.ArrayLike) -> IntArray:
        """Return the part of the first stage whose region each state (n, d) lies in. Shape (n,)."""
        return self.parts[0].part_at(states)

    def selected(self, state: FloatArray) -> int:
        """Return the part of the first stage whose region one state (d,) lies in."""
        return self.parts[0].selected(state)

    def part_weights_at(self, states: FloatArray) -> FloatArray:
        """Return one for the first stage, zero for the others, as at a start. Shape (n, stages)."""
        weights = np.zeros((len(states), len(self.parts)))
        weights[:, 0] = 1.0
        return weights
