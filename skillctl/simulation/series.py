"""Collects what happens in an episode, row by row, into a time series."""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.simulation.arm import CONTROL_PERIOD, LiveArm
from skillctl.simulation.episode import PHASES, Phase, TimeSeries
from skillctl.simulation.scene import Contact, SceneBodies

CLEARANCE_ROWS = 8  # the distance to the scene is measured every so many rows


class Recorder:
    """Keeps a row a control period; of faster control every row that begins a new such period."""

    def __init__(self, arm: LiveArm, scene: SceneBodies) -> None:
        """Args: the arm; the scene it is in."""
        self._arm, self._scene = arm, scene
        self._fingers = [joint for joint, _ in arm.body.model.fingers]
        self._rows: list[tuple[object, ...]] = []
        self._touched: dict[str, None] = {}
        self._last = -np.inf

    @property
    def touched(self) -> tuple[str, ...]:
        """What of the arm touched what of the scene or the cup, each pair once, in order of time."""
        return tuple(self._touched)

    def add(self, time: float, part: int, phase: Phase, target: FloatArray, contacts: list[Contact]) -> None:
        """Take note of a moment: the arguments are those of ``TimeSeries``."""
        for contact in contacts:
            self._touched.setdefault(f"{contact.link} - {contact.thing}")
        if time - self._last < CONTROL_PERIOD - 1e-9:
            return
        self._last = time
        state, tracking = self._arm.state(), self._arm.tracking
        clearance = self._scene.clearance() if len(self._rows) % CLEARANCE_ROWS == 0 else np.nan
        with_scene = sum(contact.thing != "cup" for contact in contacts)
        self._rows.append(
            (
                *(time, tracking.reference, state.hand, state.joints, state.velocities, state.torques),
                *(tracking.residual, part, PHASES.index(phase), target),
                *(self._openings(), self._scene.cup_pose(), with_scene, clearance),
            )
        )

    def _openings(self) -> FloatArray:
        if not self._fingers:
            return np.zeros(0)
        states = self._arm.body.bullet.getJointStates(self._arm.body.body, self._fingers)
        return np.array([state[0] for state in states])

    def series(self) -> TimeSeries:
        """Return all rows."""
        return TimeSeries(*(np.array(column) for column in zip(*self._rows, strict=True)))
