"""What an episode leaves on disk: a log of plain numbers, and a picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skillctl.simulation.episode import Episode
from skillctl.simulation.files import write_atomically


def write_log(episode: Episode, path: Path) -> None:
    """Write the time series as CSV. Equal episodes give equal bytes; every number reads back exactly.

    Columns, n being the arm's joints: ``t`` [s]; ``ref_x ref_y ref_z`` where the hand was asked to be
    [m]; ``hand_x hand_y hand_z`` where it was [m]; ``q1 … qn`` [rad], ``dq1 … dqn`` [rad/s] and
    ``tau1 … taun`` [Nm], measured; ``ik_residual`` [m]; ``part``, the acting part of a combined skill,
    from 0. Positions are in the frame in which the arm's base stands at the origin.

    Raises:
        StoreError: The disk refused.
    """
    write_atomically(path, encode_log(episode))


def write_picture(episode: Episode, path: Path, *, title: str = "") -> None:
    """Write six moments of the motion as one PNG (see ``encode_picture``); ``title`` stands above them.

    Raises:
        NotFoundError: PyBullet, which draws the arm, is not installed.
        StoreError: The disk refused.
    """
    from skillctl.simulation.picture import encode_picture  # late: a log needs no Pillow

    write_atomically(path, encode_picture(episode, title=title))


def encode_log(episode: Episode) -> bytes:
    """Return the CSV file of ``write_log``."""
    series = episode.series
    joints = range(1, series.joints.shape[1] + 1)
    header = [
        "t",
        *(f"{point}_{axis}" for point in ("ref", "hand") for axis in "xyz"),
        *(f"{quantity}{joint}" for quantity in ("q", "dq", "tau") for joint in joints),
        "ik_residual",
        "part",
    ]
    numbers = np.column_stack(
        [
            series.times,
            series.reference,
            series.hand,
            series.joints,
            series.velocities,
            series.torques,
            series.residuals,
        ]
    )
    lines = [",".join(header)]
    for row, part in zip(numbers.tolist(), series.parts.tolist(), strict=True):
        lines.append(",".join([*map(repr, row), str(part)]))
    return ("\n".join(lines) + "\n").encode()
