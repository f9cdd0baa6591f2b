"""The record of an episode, row by row, and its log as CSV or HDF5."""

from __future__ import annotations

import io
from typing import Any, Literal, TypeAlias

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.rotations import quaternions
from skillctl.simulation.arm import CONTROL_PERIOD, LiveArm
from skillctl.simulation.episode import PHASES, Episode, Phase, TimeSeries
from skillctl.simulation.scene import Contact, SceneBodies

LogFormat: TypeAlias = Literal["csv", "h5"]
MEASURED_ROWS = 8  # the distance to the scene and the manipulability are measured every so many rows
LOG_ENDINGS: dict[str, LogFormat] = {".csv": "csv", ".h5": "h5", ".hdf5": "h5"}


class Recorder:
    """Keeps one row per control period of 1/240 s, also where the arm is controlled faster."""

    def __init__(self, arm: LiveArm, scene: SceneBodies) -> None:
        """Args: the arm; the scene it is in."""
        self._arm, self._scene = arm, scene
        self._fingers = [joint for joint, _ in arm.body.model.fingers]
        self._rows: list[tuple[object, ...]] = []
        self._touched: dict[str, None] = {}
        self._last = -np.inf

    @property
    def touched(self) -> tuple[str, ...]:
        """Each pair of an arm's link and a thing that it touched, once, in order of time."""
        return tuple(self._touched)

    def add(self, time: float, part: int, phase: Phase, target: FloatArray, contacts: list[Contact]) -> None:
        """Add a moment; the arguments are those of ``TimeSeries``, the target as a place of the hand."""
        for contact in contacts:
            self._touched.setdefault(f"{contact.link} - {contact.thing}")
        if time - self._last < CONTROL_PERIOD - 1e-9:
            return
        self._last = time
        state, tracking = self._arm.state, self._arm.tracking
        clearance, manipulability = np.nan, np.nan
        if len(self._rows) % MEASURED_ROWS == 0:
            clearance = self._scene.clearance()
            manipulability = self._arm.body.manipulability(state.joints)
        with_scene = sum(contact.thing != "cup" for contact in contacts)
        self._rows.append(
            (
                *(time, tracking.reference[:3], state.hand, state.joints, state.velocities, state.torques),
                *(tracking.residual, part, PHASES.index(phase), target[:3]),
                *(self._openings(), self._scene.cup_pose(), with_scene, clearance, manipulability),
                *(np.array(self._arm.orientation), turn_of(tracking.reference), turn_of(target)),
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


def turn_of(place: FloatArray) -> FloatArray:
    """Return the orientation q_xyzw (4,) at a place of the hand; NaN if it is a position only."""
    return quaternions(place[3:]) if len(place) > 3 else np.full(4, np.nan)


def log_format(name: str) -> LogFormat:
    """Return the format of a log, which the ending of its name decides.

    Raises:
        UsageError: Another ending.
    """
    for ending, kind in LOG_ENDINGS.items():
        if name.lower().endswith(ending):
            return kind
    raise UsageError(f"log: {name} must end in {', '.join(LOG_ENDINGS)}.")


def encode_log(episode: Episode, kind: LogFormat = "csv") -> bytes:
    """Return the time series as a file. Equal episodes give equal bytes; every number reads back exactly.

    Columns, for n joints and m fingers of the arm: ``t`` [s]; ``ref_x ref_y ref_z``, the reference of the
    hand [m]; ``hand_x hand_y hand_z``, its measured position [m]; ``q1 … qn`` [rad], ``dq1 … dqn`` [rad/s]
    and ``tau1 … taun`` [Nm], measured; ``ik_residual`` [m]; ``part``, the acting part of a combined skill,
    from 0; ``phase``: approach, close, lift or hold; ``target_x target_y target_z`` [m]; ``finger1 …
    fingerm`` [m]; with a cup ``cup_x cup_y cup_z`` [m] and ``cup_qx cup_qy cup_qz cup_qw``; with a scene
    ``contacts``, the number of points at which the arm touched it, and ``clearance`` [m], nan where it was
    not measured; for a skill of poses the orientations of reference, hand and target, ``ref_qx … ref_qw``,
    ``hand_qx …`` and ``target_qx …``. Positions are in the frame whose origin is the arm's base.

    An HDF5 log has one dataset per column, of the same name and content; phases are ASCII.
    """
    columns = _columns(episode)
    return _csv(columns) if kind == "csv" else _hdf5(columns)


def _columns(episode: Episode) -> dict[str, np.ndarray[Any, Any]]:
    """Return the columns, each of shape (T,), in their order."""
    series = episode.series
    columns: dict[str, np.ndarray[Any, Any]] = {"t": series.times}

    def add(names: list[str], values: np.ndarray[Any, Any]) -> None:
        columns.update(zip(names, values.T, strict=True))

    joints = range(1, series.joints.shape[1] + 1)
    add(["ref_x", "ref_y", "ref_z"], series.reference)
    add(["hand_x", "hand_y", "hand_z"], series.hand)
    add([f"q{joint}" for joint in joints], series.joints)
    add([f"dq{joint}" for joint in joints], series.velocities)
    add([f"tau{joint}" for joint in joints], series.torques)
    columns["ik_residual"], columns["part"] = series.residuals, series.parts
    columns["phase"] = np.array(PHASES, dtype="S")[series.phases]
    add(["target_x", "target_y", "target_z"], series.targets)
    add([f"finger{finger}" for finger in range(1, series.fingers.shape[1] + 1)], series.fingers)
    if episode.scenario.cup is not None:
        add(["cup_x", "cup_y", "cup_z", "cup_qx", "cup_qy", "cup_qz", "cup_qw"], series.cups)
    if episode.scenario.furnished:
        columns["contacts"], columns["clearance"] = series.contacts, series.clearances
    if episode.setup.turns:
        for name in ("reference", "hand", "target"):
            short = "ref" if name == "reference" else name
            add([f"{short}_q{axis}" for axis in "xyzw"], getattr(series, f"{name}_turns"))
    return columns


def _csv(columns: dict[str, np.ndarray[Any, Any]]) -> bytes:
    texts = [
        [value.decode() if isinstance(value, bytes) else repr(value) for value in values.tolist()]
        for values in columns.values()
    ]
    lines = [",".join(columns), *map(",".join, zip(*texts, strict=True))]
    return ("\n".join(lines) + "\n").encode()


def _hdf5(columns: dict[str, np.ndarray[Any, Any]]) -> bytes:
    import h5py

    file = io.BytesIO()
    with h5py.File(file, "w", libver="earliest") as log:
        for name, values in columns.items():
            log.create_dataset(name, data=values, track_times=False)  # a time would change the bytes
    return file.getvalue()
