from __future__ import annotations

import csv
import io
from dataclasses import replace

import h5py
import numpy as np
import pytest

from skillctl.errors import UsageError
from skillctl.model.seds import SedsSkill
from skillctl.simulation.arms import ARMS
from skillctl.simulation.episode import Episode, Setup, TimeSeries, measure
from skillctl.simulation.motion import Plan
from skillctl.simulation.placement import Placement
from skillctl.simulation.recording import encode_log, log_format
from skillctl.simulation.scenario import Scenario


@pytest.fixture
def episode(reach: SedsSkill) -> Episode:
    """An episode of five rows of random numbers: what matters here is that they come back."""
    generator = np.random.default_rng(0)
    arm = ARMS["panda"]
    points, joints = generator.normal(size=(2, 5, 3)), generator.normal(size=(3, 5, arm.n_joints))
    reference, hand = points
    positions, velocities, torques = joints
    series = TimeSeries(
        np.arange(5) / 240,
        reference,
        hand,
        positions,
        velocities,
        torques,
        generator.random(5),
        np.array([0, 0, 1, 1, 1]),
        phases=np.array([0, 0, 1, 2, 3]),
        targets=generator.random((5, 3)),
        fingers=generator.random((5, 2)),
        cups=generator.random((5, 7)),
        contacts=np.array([0, 0, 0, 2, 1]),
        clearances=np.array([0.1, np.nan, np.nan, np.nan, -0.002]),
        manipulability=np.array([0.1, np.nan, np.nan, np.nan, np.nan]),
        hand_turns=generator.random((5, 4)),
        reference_turns=generator.random((5, 4)),
        target_turns=generator.random((5, 4)),
    )
    plan = Plan(points[0], points[0, -1], True)
    placement = Placement(np.eye(3), np.zeros(3), 1.0, None)
    return Episode(
        scenario=Scenario(),
        setup=Setup(reach, arm, placement, "free", 0.0, joints[0, 0], plan, True, 1.0),
        outcome="timeout",
        detail="",
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
    assert [row["phase"] for row in rows] == ["approach", "approach", "close", "lift", "hold"]
    assert (columns("target_x", "target_y", "target_z") == series.targets).all()
    assert (columns("finger1", "finger2") == series.fingers).all()
    assert len(rows[0]) == 1 + 3 + 3 + 3 * 7 + 1 + 1 + 1 + 3 + 2


def test_scene_and_cup_have_columns_if_there_are_any(episode: Episode) -> None:
    with_cup = replace(episode, scenario=Scenario(scene={"kind": "shelf"}, target="cup"))
    rows = list(csv.DictReader(io.StringIO(encode_log(with_cup).decode())))
    names = ("cup_x", "cup_y", "cup_z", "cup_qx", "cup_qy", "cup_qz", "cup_qw")
    assert (np.array([[float(row[name]) for name in names] for row in rows]) == episode.series.cups).all()
    assert [row["contacts"] for row in rows] == ["0", "0", "0", "2", "1"]
    assert [row["clearance"] for row in rows] == ["0.1", "nan", "nan", "nan", "-0.002"]


def test_an_hdf5_log_holds_what_the_csv_log_holds(episode: Episode) -> None:
    with_cup = replace(episode, scenario=Scenario(scene={"kind": "shelf"}, target="cup"))
    rows = list(csv.DictReader(io.StringIO(encode_log(with_cup).decode())))
    data = encode_log(with_cup, "h5")
    with h5py.File(io.BytesIO(data)) as log:
        assert set(log) == set(rows[0])
        for name in log:
            texts = [row[name] for row in rows]
            found = log[name][()].tolist()
            if name == "phase":
                assert [value.decode() for value in found] == texts
            else:
                assert [repr(value) for value in found] == texts
    assert encode_log(with_cup, "h5") == data


def test_the_name_of_a_log_says_its_format() -> None:
    assert [log_format(name) for name in ("a.csv", "b.H5", "c.hdf5")] == ["csv", "h5", "h5"]
    with pytest.raises(UsageError, match=r"log: a\.txt must end in \.csv"):
        log_format("a.txt")
