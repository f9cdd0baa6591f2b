"""What a run shows: how well it kept its time, where it ended, how it compares with an earlier one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.drivers.log import Recorded, Rows
from skillctl.model.skill import Skill

ROUNDING = 1e-9  # of Δt_max: what sums of periods are off by


@dataclass(frozen=True, slots=True)
class Timing:
    """How well a run kept its time.

    Attributes:
        steps: Commands that were given.
        late: Steps that took longer than Δt_max: the proof does not cover them.
        late_share: Their share of the steps.
        longest_step: The longest time between two commands, [s].
        missed: Commands that were given more than a period after they were due.
        missed_share: Their share of the steps.
        worst_delay: How much after it was due a command was given at most, [s].
    """

    steps: int
    late: int
    late_share: float
    longest_step: float
    missed: int
    missed_share: float
    worst_delay: float


def timing_of(rows: Rows, period: float, longest: float | None) -> Timing:
    """Return how well a run kept its time.

    Args:
        rows: The run.
        period: What was intended, [s].
        longest: Δt_max, [s]; None: no period is proved.
    """
    steps = np.diff(rows.t)
    late = int((steps > (longest or 0.0) * (1 + ROUNDING)).sum())
    missed = int((rows.delay > period).sum())
    count = max(len(rows.t), 1)
    return Timing(
        steps=len(rows.t),
        late=late,
        late_share=late / count,
        longest_step=float(steps.max(initial=0.0)),
        missed=missed,
        missed_share=missed / count,
        worst_delay=float(rows.delay.max(initial=0.0)),
    )


def largest_difference(rows: Rows, recorded: Recorded) -> float | None:
    """Return how far commands are at most from those that a log has for the same states, per second.

    None if it has none.
    """
    if recorded.commands is None:
        return None
    commands = rows.command[rows.resting == 0]
    count = min(len(commands), len(recorded.commands))
    return float(np.abs(commands[:count] - recorded.commands[:count]).max(initial=0.0))


@dataclass(frozen=True, slots=True)
class Place:
    """Where the hand is, and how far that is from where it should be.

    Attributes:
        end: The last measured state, in numbers.
        target: The nearest attractor, likewise.
        distance: How far they are apart, in the unit of the space.
        turn: And how far turned, [rad], of poses.
    """

    end: tuple[float, ...]
    target: tuple[float, ...]
    distance: float
    turn: float | None


def place_of(skill: Skill, state: FloatArray) -> Place:
    """Return where a state (d,) is, seen from the nearest attractor of a skill."""
    space, attractors = skill.space, skill.attractors
    nearest = int(space.distance(attractors, state).argmin())
    moved, turned = space.apart(state, attractors[nearest])
    turn = None if turned is None else float(turned)
    return Place(space.given(state), space.given(attractors[nearest]), float(moved), turn)
