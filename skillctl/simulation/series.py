"""Collects what happens in an episode, row by row, into a time series."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.simulation.arm import CONTROL_PERIOD, ArmBody, ArmState
from skillctl.simulation.episode import PHASES, Phase, TimeSeries
from skillctl.simulation.scene import Contact, SceneBodies

CLEARANCE_ROWS = 8  # the distance to the scene is measured every so many rows


@dataclass(frozen=True, eq=False, slots=True)
class Row:
    """What is noted of one moment besides the scene: see ``TimeSeries``."""

    state: ArmState
    reference: FloatArray
    residual: float
    part: int
    phase: Phase
    target: FloatArray
    contacts: list[Contact]


class Recorder:
    """Keeps a row a control period; of faster control every row that begins a new such period."""

    def __init__(self, arm: ArmBody, scene: SceneBodies) -> None:
        """Args: the arm, for its fingers; the scene it is in."""
        self._arm, self._scene = arm, scene
        self._fingers = [joint for joint, _ in arm.model.fingers]
        self._times: list[float] = []
        self._rows: list[Row] = []
        self._extra: list[tuple[FloatArray, FloatArray, float]] = []
        self._touched: dict[str, None] = {}
        self._last: tuple[float, Row] | None = None

    @property
    def touched(self) -> tuple[str, ...]:
        """What of the arm touched what of the scene or the cup, each pair once, in order of time."""
        return tuple(self._touched)

    def add(self, time: float, row: Row) -> None:
        """Take note of a moment."""
        for contact in row.contacts:
            self._touched.setdefault(f"{contact.link} - {contact.thing}")
        if self._times and time - self._times[-1] < CONTROL_PERIOD - 1e-9:
            return
        clearance = self._scene.clearance() if len(self._rows) % CLEARANCE_ROWS == 0 else np.nan
        self._times.append(time)
        self._rows.append(row)
        self._extra.append((self._openings(), self._scene.cup_pose(), clearance))

    def _openings(self) -> FloatArray:
        if not self._fingers:
            return np.zeros(0)
        states = self._arm.bullet.getJointStates(
            self._arm.body, self._fingers, physicsClientId=self._arm.client
        )
        return np.array([state[0] for state in states])

    def series(self) -> TimeSeries:
        """Return all rows."""
        rows = self._rows
        fingers, cups, clearances = zip(*self._extra, strict=True)
        return TimeSeries(
            times=np.array(self._times),
            reference=np.stack([row.reference for row in rows]),
            hand=np.stack([row.state.hand for row in rows]),
            joints=np.stack([row.state.joints for row in rows]),
            velocities=np.stack([row.state.velocities for row in rows]),
            torques=np.stack([row.state.torques for row in rows]),
            residuals=np.array([row.residual for row in rows]),
            parts=np.array([row.part for row in rows], dtype=np.int64),
            phases=np.array([PHASES.index(row.phase) for row in rows], dtype=np.int64),
            targets=np.stack([row.target for row in rows]),
            fingers=np.stack(fingers),
            cups=np.stack(cups),
            contacts=np.array([_with_scene(row.contacts) for row in rows], dtype=np.int64),
            clearances=np.array(clearances),
        )


def _with_scene(contacts: list[Contact]) -> int:
    return sum(contact.thing != "cup" for contact in contacts)
