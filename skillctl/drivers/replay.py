"""The driver of a dry run: states from a log, and nothing that moves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skillctl.drivers.driver import Driver, Measured, Setup
from skillctl.drivers.log import Recorded


class Replay(Driver):
    """Shows the states of a log one after the other, at their times."""

    grips = True

    def __init__(self, setup: Setup, recorded: Recorded) -> None:
        """Args: setup; the log."""
        super().__init__(setup)
        self.period = setup.period or float(f"{np.median(np.diff(recorded.times)):.6g}")
        self._times, self._states = recorded.times.tolist(), recorded.states
        self._row = 0

    @property
    def over(self) -> bool:
        """Whether the states are used up."""
        return self._row >= len(self._times)

    def now(self) -> float:
        """Return the time in the log."""
        return self._times[min(self._row, len(self._times) - 1)]  # type: ignore[no-any-return]

    def wait(self, until: float) -> None:
        """Go on to the next state."""
        self._row += 1

    def state(self) -> Measured | None:
        """Return the state of now."""
        return None if self.over else Measured(self._row, self._states[self._row].tolist())

    def command(self, velocity: Sequence[float]) -> None:
        """Move nothing."""
