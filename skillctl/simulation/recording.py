"""What an episode leaves for others: a log of plain numbers, as CSV or HDF5."""

from __future__ import annotations

import io
from typing import Any, Literal, TypeAlias

import numpy as np

from skillctl.errors import UsageError
from skillctl.simulation.episode import PHASES, Episode

LogFormat: TypeAlias = Literal["csv", "h5"]
LOG_ENDINGS: dict[str, LogFormat] = {".csv": "csv", ".h5": "h5", ".hdf5": "h5"}


def log_format(name: str) -> LogFormat:
    """Return the format that a file's name asks for.

    Raises:
        UsageError: None of them.
    """
    for ending, kind in LOG_ENDINGS.items():
        if name.lower().endswith(ending):
            return kind
    raise UsageError(f"log: {name} must end in {', '.join(LOG_ENDINGS)}.")


def encode_log(episode: Episode, kind: LogFormat = "csv") -> bytes:
    """Return the time series as a file. Equal episodes give equal bytes; every number reads back exactly.

    Columns, n being the arm's joints and m its fingers: ``t`` [s]; ``ref_x ref_y ref_z`` where the hand was
    asked to be [m]; ``hand_x hand_y hand_z`` where it was [m]; ``q1 … qn`` [rad], ``dq1 … dqn`` [rad/s] and
    ``tau1 … taun`` [Nm], measured; ``ik_residual`` [m]; ``part``, the acting part of a combined skill, from
    0; ``phase``: approach, close, lift or hold; ``target_x target_y target_z`` [m]; ``finger1 … fingerm``
    [m]; with a cup ``cup_x cup_y cup_z`` [m] and ``cup_qx cup_qy cup_qz cup_qw``; with a scene ``contacts``,
    at how many points the arm touched it, and ``clearance`` [m], nan where it was not measured. Positions
    are in the frame in which the arm's base stands at the origin.

    An HDF5 log has one dataset a column, of the same name and content; phases are ASCII.
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
    if episode.scenario.scene is not None:
        columns["contacts"], columns["clearance"] = series.contacts, series.clearances
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
            log.create_dataset(name, data=values, track_times=False)  # no clock: equal logs are equal bytes
    return file.getvalue()
