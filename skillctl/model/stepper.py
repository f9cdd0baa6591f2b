"""The one place where time passes: a skill, stepped by a controller's period."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray, IntArray, length
from skillctl.errors import UsageError
from skillctl.model.skill import Skill
from skillctl.model.space import Space

SHARES = 40  # tried for the share of a step that keeps a speed cap, in coordinates that bend it
CLOSE = 1e-10  # a command that is below the cap by at most this share of it is fast enough


@dataclass(frozen=True, eq=False, slots=True)
class Step:
    """What one period brings.

    Attributes:
        states: Where the command leads, in the shape of the states it began from.
        command: The velocity to command for the period, in the same shape, per second.
        parts: Which part acts: a number for one state, shape (n,) for many.
    """

    states: FloatArray
    command: FloatArray
    parts: IntArray | int


def moved(space: Space, states: FloatArray, velocities: FloatArray, period: float) -> FloatArray:
    """Return where constant velocities lead from states (..., d) within a period [s]."""
    return space.displace(states, period * velocities)


class Stepper:
    """Steps states of a skill: y⁺ = y + α Δt ẏ, s⁺ = c⁻¹(y⁺); the command leads from s to s⁺ in Δt.

    In plain coordinates that is ξ⁺ = ξ + α Δt f(ξ). α = 1, unless a speed cap asks for less: then it is the
    largest α whose command keeps the cap. V falls at each such step whose period is proved, since shorter
    steps contract, too; a command shortened after it was mapped back would have no proof.

    Attributes:
        skill: What is stepped.
        period: Δt, [s].
    """

    def __init__(self, skill: Skill, period: float) -> None:
        """Args: skill; period: Δt, [s].

        Raises:
            UsageError: A period that is not positive and finite.
        """
        if not 0 < period < np.inf:
            raise UsageError(f"period: must be a positive number of seconds, got {period!r}.")
        self.skill = skill
        self.period = period
        self._selects = len(skill.acting_parts) > 1
        self._plain = not any(part.coordinates.links for part in skill.acting_parts)

    def step(self, state: FloatArray, part: int | None = None, max_speed: float | None = None) -> Step:
        """Step one state (d,), which is taken as it is.

        Args:
            state: ξ, shape (d,).
            part: The acting part; None: the part of the state's region.
            max_speed: The command's speed at most, per second.
        """
        skill = self.skill
        if not self._selects:
            part = 0
        elif part is None or skill.reselects:
            part = skill.selected(state)
        if not self._plain:
            return self._bent(state, part, max_speed)
        command = skill.velocity_at(state, part)
        if max_speed is not None and (speed := length(command)) > max_speed:
            command = command * (max_speed / speed)
        return Step(moved(skill.space, state, command, self.period), command, part)

    def step_many(self, states: FloatArray, parts: IntArray | None = None) -> Step:
        """Step many states (n, d), without a cap.

        Args:
            states: ξ, shape (n, d).
            parts: The acting part of each, shape (n,); None: the parts of the states' regions.
        """
        skill = self.skill
        if parts is None or skill.reselects:
            parts = skill.part_at(states)
        if self._plain:
            command = skill.velocity(states, parts)
            return Step(moved(skill.space, states, command, self.period), command, parts)
        ahead = np.empty_like(states)
        for index in np.unique(parts):
            mask = parts == index
            ahead[mask] = skill.acting_parts[index].advanced(states[mask], self.period * skill.outer_speed)
        return Step(ahead, skill.space.difference(ahead, states) / self.period, parts)

    def _bent(self, state: FloatArray, part: int, max_speed: float | None) -> Step:
        """Step one state in coordinates that are not the identity."""
        skill, duration = self.skill, self.period * self.skill.outer_speed
        ahead = skill.acting_parts[part].advanced_at(state)

        def command_of(share: float) -> FloatArray:
            """Return the constant velocity that leads to where a share of the full step ends."""
            return skill.space.difference(ahead(share * duration), state) / self.period

        command = command_of(1.0)
        if max_speed is not None and length(command) > max_speed:
            command = _within(command_of, max_speed)
        return Step(moved(skill.space, state, command, self.period), command, part)


def _within(command_of: Callable[[float], FloatArray], cap: float) -> FloatArray:
    """Return the command of about the largest share in [0, 1] that keeps a cap which that of 1 exceeds.

    The length of a command is nearly proportional to the share, so the Illinois method (regula falsi that
    halves the end which stays) needs a handful of trials where bisection needs forty.
    """
    low, high, below, above = 0.0, 1.0, -cap, length(command_of(1.0)) - cap
    best = command_of(0.0)
    for _ in range(SHARES):
        share = (low * above - high * below) / (above - below)
        command = command_of(share)
        excess = length(command) - cap
        if excess > 0:
            high, above, below = share, excess, 0.5 * below
            continue
        best = command
        if excess >= -CLOSE * cap:
            break
        low, below, above = share, excess, 0.5 * above
    return best
