"""Disturbances of an episode: pushes, moved targets, displaced hands, and errors of perception."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.simulation.scenario import Displace, Disturbance, MoveTarget, Push, Scenario


class Schedule:
    """The disturbances of one episode, each at its time."""

    def __init__(self, disturbances: Sequence[Disturbance]) -> None:
        """Args: the disturbances, in any order."""
        self._pushes = [event for event in disturbances if isinstance(event, Push)]
        jumps = [event for event in disturbances if not isinstance(event, Push)]
        self._jumps = sorted(jumps, key=lambda event: event.time)  # stable: equal times as they are listed

    def push(self, time: float) -> FloatArray | None:
        """Return the force on the hand in the period that begins at ``time``, shape (3,), [N]; or None."""
        acting = [push.force for push in self._pushes if push.time <= time < push.time + push.duration]
        return np.sum(acting, axis=0) if acting else None

    def due(self, time: float) -> Iterator[MoveTarget | Displace]:
        """Yield the jumps that are due at ``time``, each of them once."""
        while self._jumps and self._jumps[0].time <= time:
            yield self._jumps.pop(0)


def last_end(disturbances: Sequence[Disturbance]) -> float:
    """Return when the last disturbance is over, [s]; 0 without any."""
    ends = [event.time + (event.duration if isinstance(event, Push) else 0.0) for event in disturbances]
    return max(ends, default=0.0)


def jumped(disturbances: Sequence[Disturbance]) -> float:
    """Return the total length of all jumps of target and hand, [m]."""
    offsets = [event.offset for event in disturbances if not isinstance(event, Push)]
    return float(sum(np.linalg.norm(offset) for offset in offsets))


class Perception:
    """Measurements of hand and target: their true positions plus Gaussian errors.

    Hand and target have generators of their own, so that the errors of one do not change the other's.
    """

    def __init__(self, scenario: Scenario) -> None:
        """Args: scenario, for noise, target error and seed."""
        self._noise, self._target_error = scenario.noise, scenario.target_error
        sequences = np.random.SeedSequence(scenario.seed).spawn(2)
        self._hand_errors, self._target_errors = map(np.random.default_rng, sequences)

    def hand(self, place: FloatArray) -> FloatArray:
        """Return the perceived place of the hand; its orientation has no error."""
        if not self._noise:
            return place
        seen = place.copy()
        seen[:3] += self._hand_errors.normal(0.0, self._noise, 3)
        return seen

    def read_target(self) -> FloatArray:
        """Return a new error of the perceived target, shape (3,), [m]; its height has none."""
        if not self._target_error:
            return np.zeros(3)
        return np.array([*self._target_errors.normal(0.0, self._target_error, 2), 0.0])
