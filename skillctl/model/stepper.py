"""The one place where time passes: a skill, stepped by a controller's period."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray, IntArray
from skillctl.errors import UsageError
from skillctl.model.skill import ActingSkill, Skill
from skillctl.model.space import Space

SHARES = 40  # tried for the share of a step that keeps a speed cap, in coordinates that bend it
SHORTENED = 0.9  # tried next of a share of a step that is too long
CLOSE = 1e-10  # a command that is below the cap by at most this share of it is fast enough


@dataclass(frozen=True, eq=False, slots=True)
class Step:
    """What one period brings.

    Attributes:
        states: Where the command leads, in the shape of the states it began from.
        command: The velocity to command for the period, in the same shape, per second.
        parts: Which part acts: a number for one state, shape (n,) for many.
        offset: Of the state that is led to, from the attractor of the part that acts; for the next step, see
            ``Space.offset_at``. None in plain coordinates.
    """

    states: FloatArray
    command: FloatArray
    parts: IntArray | int
    offset: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Caps:
    """Limits of a command.

    Attributes:
        speed: [m/s], or per second in the unit of the space.
        turn: [rad/s], of a space with orientations.
    """

    speed: float = math.inf
    turn: float = math.inf

    def within(self, others: Caps) -> Caps:
        """Return the caps that keep both these and others."""
        return Caps(min(self.speed, others.speed), min(self.turn, others.turn))

    def allow(self, space: Space, command: FloatArray) -> float:
        """Return the largest factor by which a command (d,) keeps both caps: below one if it breaks one."""
        moving, turning = space.speeds(command)
        factor = self.speed / moving if moving > 0 else math.inf
        return min(factor, self.turn / turning) if turning > 0 else factor


UNCAPPED = Caps()


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
        self._plain = all(part.plain for part in skill.acting_parts)

    def step(
        self,
        state: FloatArray,
        part: int | None = None,
        caps: Caps = UNCAPPED,
        near: FloatArray | None = None,
    ) -> Step:
        """Step one state (d,), which is taken as it is.

        Args:
            state: ξ, shape (d,).
            part: The acting part; None: the part of the state's region.
            caps: What the command keeps.
            near: ``offset`` of the last step, if the same part acts.
        """
        skill = self.skill
        if not self._selects:
            part = 0
        elif part is None or skill.reselects:
            part = skill.selected(state)
        if not self._plain:
            return self._bent(state, part, caps, near)
        command = skill.velocity_at(state, part)
        if caps is not UNCAPPED and (factor := caps.allow(skill.space, command)) < 1:
            command = command * factor
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
            ahead[mask] = self._ahead(skill.acting_parts[index], states[mask])
        return Step(ahead, skill.space.difference(ahead, states) / self.period, parts)

    def _ahead(self, part: ActingSkill, states: FloatArray) -> FloatArray:
        """Return where a step leads from states (n, d): full ones, or as long as coordinates allow."""
        space, durations = self.skill.space, np.full((len(states), 1), self.period * self.skill.outer_speed)
        ahead = part.advanced(states, durations)
        longest = part.coordinates.longest(space.offsets(states, part.attractor))
        for _ in range(SHARES):
            taken = space.apart(ahead, states)[0] / longest
            far = taken > 1
            if not far.any():
                break
            durations[far] *= np.minimum(SHORTENED / taken[far], SHORTENED)[:, None]
            ahead[far] = part.advanced(states[far], durations[far])
        return ahead

    def _bent(self, state: FloatArray, part: int, caps: Caps, near: FloatArray | None) -> Step:
        """Step one state in a chart, or in coordinates, that are not the identity."""
        space, duration = self.skill.space, self.period * self.skill.outer_speed
        acting = self.skill.acting_parts[part]
        ahead = acting.advanced_at(state, near)
        longest = acting.coordinates.longest_at(space.offset_at(state, acting.attractor, near))
        if longest < math.inf:
            caps = Caps(min(caps.speed, longest / self.period), caps.turn)

        def command_of(share: float) -> FloatArray:
            """Return the constant velocity that leads to where a share of the full step ends."""
            return space.difference_at(ahead(share * duration).state, state) / self.period

        reached = ahead(duration)
        command = space.difference_at(reached.state, state) / self.period
        if caps is not UNCAPPED and caps.allow(space, command) < 1:
            share = _within(lambda share: 1 / caps.allow(space, command_of(share)))
            reached = ahead(share * duration)
            command = space.difference_at(reached.state, state) / self.period
            if share == 0 and (factor := caps.allow(space, command)) < 1:
                # The state is inside a body, and led out of it straight: no longer step is known to be safe.
                command = command * factor
                return Step(moved(space, state, command, self.period), command, part)
        return Step(reached.state, command, part, reached.offset)


def _within(taken: Callable[[float], float]) -> float:
    """Return about the largest share in [0, 1] of a step that takes no more than all of a cap.

    What a step takes is nearly proportional to its share, so the Illinois method (regula falsi that halves
    the end which stays twice) needs a handful of trials where bisection needs forty. It aims at the middle of
    what is close enough, so that rounding does not decide how it ends.

    Args:
        taken: How much of the cap a share takes; more than one for the full step.
    """
    aim, last = 1 - 0.5 * CLOSE, 0
    low, high, below, above = 0.0, 1.0, -aim, taken(1.0) - aim
    for _ in range(SHARES):
        share = (low * above - high * below) / (above - below)
        takes = taken(share)
        if 1 - CLOSE <= takes <= 1:
            return share
        if takes > 1:
            high, above, below, last = share, takes - aim, below * (0.5 if last > 0 else 1.0), 1
        else:
            low, below, above, last = share, takes - aim, above * (0.5 if last < 0 else 1.0), -1
    return low
