"""Skills that are made of parts: what they take over from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from skillctl.arrays import FloatArray, IntArray
from skillctl.errors import InvalidModelError
from skillctl.model.mixture import GaussianMixture, joined
from skillctl.model.skill import ActingSkill, AnySkill, Skill, require_speed
from skillctl.model.space import Space

if TYPE_CHECKING:
    from skillctl.model.seds import SedsSkill


class Composite(Skill):
    """A skill made of parts: what it takes over from them."""

    __slots__ = ()

    @property
    def space(self) -> Space:
        """Names, unit and frame of the state."""
        return self.parts[0].space

    @property
    def leaves(self) -> tuple[SedsSkill, ...]:
        """The learned skills this one is made of, from left to right."""
        return tuple(leaf for part in self.parts for leaf in part.leaves)

    def carried(self: AnySkill, target: FloatArray, goal: FloatArray) -> AnySkill:
        """Return the same motions, moved as a target is to a goal: all attractors move together."""
        return replace(self, parts=tuple(part.carried(target, goal) for part in self.parts))  # type: ignore[type-var]

    def with_leaves(self: AnySkill, change: Callable[[SedsSkill], SedsSkill]) -> AnySkill:
        """Return the same tree of changed leaves."""
        return replace(self, parts=tuple(part.with_leaves(change) for part in self.parts))  # type: ignore[type-var]


class Switched(Composite):
    """A skill of whose acting parts one alone acts at any time."""

    __slots__ = ()

    @property
    def density(self) -> GaussianMixture:
        """Position density of all that the parts were taught."""
        return joined([part.density for part in self.parts], self.shares)

    def velocity_at(self, state: FloatArray, part: int | None = None) -> FloatArray:
        """Return ξ̇ for one state (d,), which is not checked; ``part`` acts, else that of its region."""
        if part is None:
            part = self.selected(state)
        velocity = self.acting_parts[part].velocity_at(state)
        return velocity if self.outer_speed == 1.0 else self.outer_speed * velocity

    def _velocities(self, states: FloatArray, parts: IntArray | None) -> FloatArray:
        chosen = self.part_at(states) if parts is None else parts
        velocities = np.empty_like(states)
        for index in np.unique(chosen):
            mask = chosen == index
            velocities[mask] = self.outer_speed * self.acting_parts[index].velocity(states[mask])
        return velocities


def require_parts(parts: tuple[ActingSkill, ...], speed: float) -> None:
    """Raise InvalidModelError unless there are parts, each with one attractor, all in one space."""
    if not parts:
        raise InvalidModelError("parts: at least one is needed.")
    for part in parts:
        if not isinstance(part, ActingSkill):
            what = "a chain" if part.kind == "chain" else f"a {part.kind} skill"
            raise InvalidModelError(f"parts: {what} cannot be a part of another skill.")
        if part.space != parts[0].space:
            raise InvalidModelError(f"parts: state spaces differ ({part.space} and {parts[0].space}).")
        require_speed(speed, part.component_matrices)
