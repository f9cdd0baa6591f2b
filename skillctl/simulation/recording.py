"""What an episode leaves for others: a log of plain numbers."""

from __future__ import annotations

import numpy as np

from skillctl.simulation.episode import Episode


def encode_log(episode: Episode) -> bytes:
    """Return the time series as a CSV file. Equal episodes give equal bytes; every number reads back exactly.

    Columns, n being the arm's joints: ``t`` [s]; ``ref_x ref_y ref_z`` where the hand was asked to be
    [m]; ``hand_x hand_y hand_z`` where it was [m]; ``q1 … qn`` [rad], ``dq1 … dqn`` [rad/s] and
    ``tau1 … taun`` [Nm], measured; ``ik_residual`` [m]; ``part``, the acting part of a combined skill,
    from 0. Positions are in the frame in which the arm's base stands at the origin.
    """
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
