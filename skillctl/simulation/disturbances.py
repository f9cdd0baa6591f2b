"""Disturbances of an episode: pushes, moved targets, displaced hands, and cups knocked out of a hand."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field

from skillctl.arrays import FloatArray
from skillctl.simulation.values import Duration, Part, Point, Time


class Push(Part):
    """A force on the hand, [N]. Position motors hold against some 100 N; torque control yields."""

    kind: Literal["push"] = "push"
    time: Time
    duration: Duration
    force: Point


class MoveTarget(Part):
    """A jump of the target, and of the cup if there is one, by ``offset`` [m]."""

    kind: Literal["move-target"] = "move-target"
    time: Time
    offset: Point


class Displace(Part):
    """A jump of the hand by ``offset`` [m]; a hand that is taught turns by the vector ``turn`` [rad], too."""

    kind: Literal["displace"] = "displace"
    time: Time
    offset: Point
    turn: Point = (0.0, 0.0, 0.0)


class Knock(Part):
    """A jump of the cup out of the hand by ``offset`` [m], ``time`` [s] after a chain has first taken it.

    From there it falls, upright and at rest. A cup that is not in the hand then is left in peace.
    """

    kind: Literal["knock"] = "knock"
    time: Time
    offset: Point


Disturbance: TypeAlias = Annotated[Push | MoveTarget | Displace | Knock, Field(discriminator="kind")]


class Schedule:
    """The disturbances of one episode, each at its time."""

    def __init__(self, disturbances: Sequence[Disturbance]) -> None:
        """Args: the disturbances, in any order."""
        self._pushes = [event for event in disturbances if isinstance(event, Push)]
        self._knocks = [event for event in disturbances if isinstance(event, Knock)]
        jumps = [event for event in disturbances if isinstance(event, MoveTarget | Displace)]
        self._jumps = sorted(jumps, key=lambda event: event.time)  # stable: equal times as they are listed

    def push(self, time: float) -> FloatArray | None:
        """Return the force on the hand in the period that begins at ``time``, shape (3,), [N]; or None."""
        acting = [push.force for push in self._pushes if push.time <= time < push.time + push.duration]
        return np.sum(acting, axis=0) if acting else None

    def due(self, time: float) -> Iterator[MoveTarget | Displace]:
        """Yield the jumps that are due at ``time``, each of them once."""
        while self._jumps and self._jumps[0].time <= time:
            yield self._jumps.pop(0)

    def knocked(self, carried: float) -> FloatArray | None:
        """Return the offset (3,) [m] of a knock that is due, once; None if none is.

        Args:
            carried: How long ago the cup was first taken, [s].
        """
        due = next((knock for knock in self._knocks if knock.time <= carried), None)
        if due is None:
            return None
        self._knocks.remove(due)
        return np.array(due.offset)


def last_end(disturbances: Sequence[Disturbance]) -> float:
    """Return when the last disturbance is over, [s]; 0 without any."""
    ends = [event.time + (event.duration if isinstance(event, Push) else 0.0) for event in disturbances]
    return max(ends, default=0.0)


def jumped(disturbances: Sequence[Disturbance]) -> float:
    """Return the total length of all jumps of target and hand, [m]."""
    offsets = [event.offset for event in disturbances if not isinstance(event, Push)]
    return float(sum(np.linalg.norm(offset) for offset in offsets))
