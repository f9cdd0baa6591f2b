from __future__ import annotations

import csv
import io

import numpy as np
import pytest

from skillctl.simulation import ARMS, Episode, Scenario, TimeSeries, encode_log
from skillctl.simulation.episode import measure
from skillctl.simulation.motion import Plan
from skillctl.simulation.placement import Placement


@pytest.fixture
def episode() -> Episode:
    """An episode of five rows of random numbers: what matters here is that they come back."""
    generator = np.random.default_rng(0)
    arm = ARMS["panda"]
    points, joints = generator.normal(size=(2, 5, 3)), generator.normal(size=(3, 5, arm.n_joints))
    series = TimeSeries(
        np.arange(5) / 240,
        *points,
        *joints,
        generator.random(5),
        np.array([0, 0, 1, 1, 1]),
        phases=np.array([0, 0, 1, 2, 3]),
        targets=generator.random((5, 3)),
        fingers=generator.random((5, 2)),
        cups=generator.random((5, 7)),
        contacts=np.array([0, 0, 0, 2, 1]),
        clearances=np.array([0.1, np.nan, np.nan, np.nan, -0.002]),
    )
    plan = Plan(points[0], points[0, -1], True)
    return Episode(
        scenario=Scenario(),
        outcome="timeout",
        detail="",
        arm=arm,
        hand="free",
        base_yaw=0.0,
        placement=Placement(np.eye(3), np.zeros(3), 1.0, None),
        target=plan.target,
        plan=plan,
        series=series,
        metrics=measure(series, plan, arm, 2e-3),
        wall_seconds=1.0,
    )


def test_every_number_of_the_log_reads_back_exactly(episode: Episode) -> None:
    rows = list(csv.DictReader(io.StringIO(encode_log(episode).decode())))

    def columns(*names: str) -> np.ndarray:
        return np.array([[float(row[name]) for name in names] for row in rows])

    series = episode.series
    assert (columns("t")[:, 0] == series.times).all()
    assert (columns("ref_x", "ref_y", "ref_z") == series.reference).all()
    assert (columns("hand_x", "hand_y", "hand_z") == series.hand).all()
    for prefix, values in (("q", series.joints), ("dq", series.velocities), ("tau", series.torques)):
        assert (columns(*(f"{prefix}{joint}" for joint in range(1, 8))) == values).all()
    assert (columns("ik_residual")[:, 0] == series.residuals).all()
    assert [row["part"] for row in rows] == ["0", "0", "1", "1", "1"]
    assert len(rows[0]) == 1 + 3 + 3 + 3 * 7 + 1 + 1
