"""Golden motions: a few rollouts by which one implementation of a skill can be compared with another.

They are recorded where the skill is made. Another processor, another version of Python, or a program in C
that steps the skill from the same starts must come by the same states, but for rounding, which the steps of a
stable skill do not let grow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from skillctl.arrays import FloatArray, Frozen, frozen_array
from skillctl.errors import InvalidModelError
from skillctl.model.rollout import rollout
from skillctl.model.skill import Skill, contraction_period

MOTIONS = 6  # at most: they cover what acts, and stay small beside the demonstrations
RECORDS = 24  # states of each, besides the start
STRIDE = 4  # steps of the controller from one recorded state to the next
SHARE = 0.5  # of the longest period at which the skill contracts
BEYOND = 1.2  # distances of starts from the target, in those of components of the position density
EVEN = 1e-9  # of the last time: what steps in time may differ by
TOLERANCE = 1e-9  # of the distance of the farthest recorded state from a target; processors differ by 1e-13


@dataclass(frozen=True, eq=False, slots=True)
class GoldenMotions(Frozen):
    """Recorded rollouts of a skill.

    Attributes:
        times: Of the recorded states, the same of all motions, from zero on in equal steps of ``STRIDE``
            periods of the controller. Shape (T,), [s].
        states: The first ones are starts. Shape (n, T, d).
    """

    times: FloatArray
    states: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "times", frozen_array("golden times", self.times, (None,)))
        object.__setattr__(
            self, "states", frozen_array("golden states", self.states, (None, len(self.times), None))
        )
        last, even = float(self.times[-1]), np.linspace(0, self.times[-1], len(self.times))
        if not last > 0 or not np.allclose(self.times, even, rtol=0, atol=EVEN * last):
            raise InvalidModelError("golden times: must rise from zero in equal steps.")

    def compared(self, skill: Skill) -> GoldenComparison:
        """Return how far a skill, from the same starts, is from the recorded states."""
        period, records = float(self.times[1]) / STRIDE, len(self.times) - 1
        space = skill.space
        with np.errstate(all="ignore"):  # another skill may go anywhere
            apart = space.distance(_stepped(skill, self.states[:, 0], period, records), self.states)
        size = space.distance(self.states[:, :, None], skill.attractors).max()
        largest = float(apart.max()) if np.isfinite(apart).all() else math.inf
        return GoldenComparison(len(self.states), apart.size, space.unit, largest, TOLERANCE * float(size))


@dataclass(frozen=True)
class GoldenComparison:
    """How a skill agrees with its golden motions.

    Attributes:
        motions: How many there are.
        states: How many states they have.
        unit: Of the space.
        largest: The largest distance of a state from the recorded one, in the unit.
        allowed: What rounding may bring, in the unit.
        agrees: Whether the largest is no more than that.
    """

    motions: int
    states: int
    unit: str
    largest: float
    allowed: float
    agrees: bool = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "agrees", self.largest <= self.allowed)

    @property
    def said(self) -> str:
        """The numbers, in half a sentence."""
        return (
            f"the largest difference of {self.states} states of {self.motions} motions is "
            f"{self.largest:.2g} {self.unit}, where {self.allowed:.2g} {self.unit} is allowed"
        )


def golden_motions(skill: Skill) -> GoldenMotions | None:
    """Return golden motions of a skill; None where it is not known to contract at any period.

    They start a little beyond components of the position densities, seen from the targets; of a skill of many
    parts, each part has one start, or every second, third, …
    """
    period = SHARE * contraction_period(skill)
    if not 0 < period < np.inf:
        return None
    states = _stepped(skill, _starts(skill), period, RECORDS)
    if not np.isfinite(states).all():
        return None
    times = np.arange(RECORDS + 1, dtype=np.float64) * (STRIDE * period)
    return GoldenMotions(times, states)


def _starts(skill: Skill) -> FloatArray:
    parts = [skill.acting_parts[index] for index in _spread(len(skill.acting_parts), MOTIONS)]
    starts = []
    for part in parts:
        means = part.density.means[_spread(part.density.n_components, MOTIONS // len(parts))]
        starts.append(part.uncharted(part.anchor + BEYOND * (means - part.anchor)))
    return np.concatenate(starts)


def _spread(count: int, most: int) -> list[int]:
    """Return some of a number of indices, evenly: all, if they are no more than ``most``."""
    chosen = min(count, most)
    return [index * count // chosen for index in range(chosen)]


def _stepped(skill: Skill, starts: FloatArray, period: float, records: int) -> FloatArray:
    """Return states from starts (n, d) on, at every ``STRIDE``-th step. Shape (n, records + 1, d)."""
    duration = (records * STRIDE - 0.5) * period
    # Nothing is nearer than zero, so the motions go on to the end.
    return rollout(skill, starts, duration=duration, period=period, arrival_distance=0.0).positions[
        :, ::STRIDE
    ]
