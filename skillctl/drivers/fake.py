"""A simulated arm of first order: its hand takes some time to get as fast as it is told to be."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from skillctl.drivers.driver import Driver, Measured, Setup
from skillctl.errors import UsageError

LAG = 0.02  # [s]: v' = (command − v) / LAG


class FakeArm(Driver):
    """Moves in a time of its own, which passes at once; ``fake:real`` in real time."""

    grips = True

    def __init__(self, setup: Setup) -> None:
        """Args: setup.

        Raises:
            UsageError: No start is known, or another address than ``real``.
        """
        super().__init__(setup)
        if setup.address not in ("", "real"):
            raise UsageError(f"driver: it is fake or fake:real, not fake:{setup.address}.")
        if setup.start is None:
            raise UsageError("start: the skill carries no demonstrations to start as.", hint="Add --start.")
        self._real, self._time = setup.address == "real", 0.0
        self._space, self._state = setup.skill.space, setup.start
        self._velocity = self._told = np.zeros(setup.skill.dimension)
        self._last = self.now()

    def now(self) -> float:
        """Return the arm's own time, or the real one."""
        return super().now() if self._real else self._time

    def wait(self, until: float) -> None:
        """Let time pass."""
        if self._real:
            super().wait(until)
        else:
            self._time = max(self._time, until)

    def state(self) -> Measured:
        """Return where the hand is now."""
        now = self.now()
        passed, self._last = now - self._last, now
        decay, difference = math.exp(-passed / LAG), self._velocity - self._told
        moved = passed * self._told + LAG * (1 - decay) * difference  # ∫ told + difference e^(−t/LAG) dt
        self._velocity = self._told + decay * difference
        self._state = self._space.displace_at(self._state, moved)
        return Measured(now, self._space.given(self._state))

    def command(self, velocity: Sequence[float]) -> None:
        """Take a command; the hand moves as told before up to now."""
        self.state()
        self._told = np.array(velocity)
