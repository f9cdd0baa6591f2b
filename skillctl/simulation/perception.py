"""What is seen of hand and target: where they are, with errors."""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.simulation.scenario import Scenario


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
