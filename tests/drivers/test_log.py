"""Logs: what a run writes can be read, and replayed to the same commands."""

from __future__ import annotations

import importlib.util
import json

import h5py
import numpy as np
import pytest

from skillctl.drivers.log import encode, read_log
from skillctl.drivers.options import RunOptions
from skillctl.errors import InputDataError, NotFoundError
from skillctl.usecases.files import load
from skillctl.usecases.run import run
from skillctl.usecases.simulate import simulate


@pytest.fixture(scope="module")
def logged(library, tmp_path_factory):
    """A run of the skill reach: its report, and its log."""
    path = tmp_path_factory.mktemp("log") / "a.h5"
    return run("reach", RunOptions(log=path), store=library), path


def test_a_log_has_every_step_and_what_it_was_made_of(logged):
    report, path = logged
    with h5py.File(path) as log:
        rows = {
            name: log[name][()] for name in ("t", "delay", "stage", "part", "resting", "state", "command")
        }
        about = json.loads(log["about"][()])
    assert {len(values) for values in rows.values()} == {report.timing.steps}
    np.testing.assert_allclose(rows["t"], 0.01 * np.arange(report.timing.steps), atol=1e-9)
    assert rows["state"].shape == rows["command"].shape == (report.timing.steps, 3)
    assert rows["state"][0].tolist() == list(report.start)
    assert (about["digest"], about["outcome"]) == (report.digest, "arrived")
    assert about["certificate"]["verdict"] == "stable"
    assert about["names"] == ["x", "y", "z"]
    assert about["options"]["speed"] == "0.25"
    assert set(about["versions"]) == {"skillctl", "python", "numpy", "h5py"}


def test_a_dry_run_repeats_the_commands_to_the_last_bit(logged, library, tmp_path):
    _, path = logged
    replayed = run("reach", RunOptions(dry_run=path, log=tmp_path / "b.h5"), store=library)
    assert (replayed.outcome, replayed.difference) == ("arrived", 0.0)
    assert replayed.driver == "dry run"
    assert replayed.period == 0.01
    slower = run("reach", RunOptions(dry_run=path, max_speed=0.05), store=library)
    assert slower.difference > 0.05
    with h5py.File(path) as first, h5py.File(tmp_path / "b.h5") as second:
        led = first["resting"][()] == 0
        np.testing.assert_array_equal(second["command"][()][: led.sum()], first["command"][()][led])


def test_a_dry_run_ends_with_its_log(logged, library, tmp_path):
    _, path = logged
    with h5py.File(path) as log, h5py.File(tmp_path / "half.h5", "w") as half:
        for name in ("t", "resting", "state", "command"):
            half[name] = log[name][:50]
    report = run("reach", RunOptions(dry_run=tmp_path / "half.h5"), store=library)
    assert (report.outcome, report.success) == ("log ended", False)


@pytest.mark.skipif(importlib.util.find_spec("pybullet") is None, reason="PyBullet has no wheel")
def test_a_log_of_the_simulator_can_be_replayed(library, tmp_path):
    episode = simulate("reach", demo=0, log=tmp_path / "s.h5", store=library)
    report = run("reach", RunOptions(dry_run=tmp_path / "s.h5", tolerance=0.005), store=library)
    assert (episode.success, report.outcome) == (True, "arrived")
    assert report.difference is None
    assert report.period == pytest.approx(1 / 240, rel=1e-5)


def test_a_simulated_pose_is_read_with_its_orientation(tmp_path, make_grasp):
    space = make_grasp().space
    poses = space.displace(np.zeros(6), np.random.default_rng(2).normal(0, 0.4, (5, 6)))
    with h5py.File(tmp_path / "s.h5", "w") as log:
        log["t"] = np.arange(5) / 240
        given = np.array([space.given(pose) for pose in poses])
        for name, column in zip(("x", "y", "z", "qx", "qy", "qz", "qw"), given.T, strict=True):
            log[f"hand_{name}"] = column
    recorded = read_log(tmp_path / "s.h5", space)
    np.testing.assert_allclose(recorded.states, poses, atol=1e-14)
    assert recorded.commands is None


def damaged(path, how):
    """Spoil a log."""
    if how == "cut":
        path.write_bytes(path.read_bytes()[:1000])
        return
    with h5py.File(path, "a") as log:
        if how == "without states":
            del log["state"]
        elif how == "text":
            del log["t"]
            log["t"] = "soon"
        elif how == "shorter":
            states = log["state"][:, :2]
            del log["state"]
            log["state"] = states
        elif how == "backwards":
            log["t"][:] = log["t"][()][::-1]
        elif how == "group":
            del log["t"]
            log.create_group("t")
        elif how == "scalar":
            del log["t"]
            log["t"] = 1.0
        else:
            rest = log[how][1:]
            del log[how]
            log[how] = rest


@pytest.mark.parametrize(
    "how",
    [
        "cut",
        "without states",
        "text",
        "shorter",
        "backwards",
        "group",
        "scalar",
        "t",
        "state",
        "command",
        "resting",
    ],
)
def test_a_damaged_log_is_refused_in_words(logged, library, tmp_path, how):
    (path := tmp_path / "bad.h5").write_bytes(logged[1].read_bytes())
    damaged(path, how)
    with pytest.raises(InputDataError, match=r"bad\.h5"):
        read_log(path, load("reach", store=library).space)


def test_a_log_that_is_not_there_is_named(library, tmp_path):
    space = load("reach", store=library).space
    with pytest.raises(NotFoundError, match="there is no such file"):
        read_log(tmp_path / "a.h5", space)
    with pytest.raises(InputDataError, match="is a folder; a log is one file"):
        read_log(tmp_path, space)


def test_equal_runs_give_equal_logs(logged, library, tmp_path):
    _, path = logged
    again = tmp_path / path.name
    run("reach", RunOptions(log=again), store=library)
    with h5py.File(path) as one, h5py.File(again) as other:
        for name in set(one) - {"about"}:
            np.testing.assert_array_equal(one[name][()], other[name][()])


def test_a_log_of_nothing_is_a_log(lead, positions, tmp_path):
    rows = lead(positions, positions.attractor).rows
    (path := tmp_path / "a.h5").write_bytes(encode(rows, {"outcome": "arrived"}))
    with pytest.raises(InputDataError, match="at least two states"):
        read_log(path, positions.space)
