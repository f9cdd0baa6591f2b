"""`skillctl run` as it is typed: exit codes, sentences, Ctrl-C, and two of them at a time."""

from __future__ import annotations

import importlib.util
import json
import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest


@pytest.fixture
def reach(library):
    """A skill file."""
    return library / "reach" / "1.h5"


def test_a_run_on_the_fake_arm_arrives(run, reach, tmp_path):
    result = run("run", reach, "--log", tmp_path / "a.h5")
    assert (result.exit_code, result.stderr) == (0, "")
    for word in ("fake", "arrived", "0 (0.00%) longer than proved", "a.h5"):
        assert word in result.stdout
    report = json.loads(run("run", reach, "--json").stdout)
    assert report["success"]
    assert report["place"]["distance"] < 0.002
    assert report["timing"]["late"] == 0
    assert report["timing"]["steps"] == len(h5py.File(tmp_path / "a.h5")["t"])


def test_not_to_arrive_is_a_negative_answer(run, reach):
    result = run("run", reach, "--timeout", "0.2")
    assert (result.exit_code, result.stderr) == (1, "")
    assert "timeout: not there after 0.2 s" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--driver", "kuka"], 4, "no driver is called 'kuka'"),
        (["--driver", "fake:soon"], 2, "it is fake or fake:real, not fake:soon"),
        (["--driver", "udp:x"], 2, "udp cannot use 127.0.0.1:x"),
        (["--period", "5"], 2, "period: 5 s is too long: at most "),
        (["--period", "0"], 2, "period: must be a positive number, got 0"),
        (["--timeout", "nan"], 2, "timeout: must be a positive number, got nan"),
        (["--box", "0:1"], 2, "box: expected a range for each of x, y, z, got 1"),
        (["--box", "1:0,0:1,0:1"], 2, "box: a range must end after it starts"),
        (["--box", "5:6,5:6,5:6"], 1, "the start is outside the box; nothing moves"),
        (["--start", "0.1,0.2"], 2, "start: expected 3 numbers, got 2"),
        (["--start", "nan,0,0"], 5, "state: must be finite"),
        (["--log", "nowhere/a.h5"], 8, "there is no such directory"),
        (["--dry-run", "nowhere.h5"], 4, "there is no such file"),
    ],
)
def test_what_cannot_be_run_is_said_in_one_sentence(run, reach, arguments, code, said):
    result = run("run", reach, *arguments)
    assert (result.exit_code, result.stdout) == (code, "")
    assert said in result.stderr
    assert "hint:" in result.stderr


def test_a_library_that_is_missing_is_named(run, reach, monkeypatch):
    from skillctl.drivers import registry

    monkeypatch.setitem(registry.OWN, "franky", "skillctl.drivers.franky:FrankaArm")
    monkeypatch.setitem(sys.modules, "franky", None)
    result = run("run", reach, "--driver", "franky:10.0.0.2")
    assert result.exit_code == 4
    assert "hint: Install it: pip install franky-control." in result.stderr


def test_what_is_not_proved_does_not_move(run, save_with_matrix, tmp_path):
    matrix = np.diag([0.1, -1.0, -1.0])
    bad = save_with_matrix("reach", 0, matrix, tmp_path / "bad.h5")
    start = ["--start", "0.4,0,0.5"]
    refused = run("run", bad, *start)
    assert (refused.exit_code, refused.stdout) == (1, "")
    assert "is not proved stable, so nothing moves" in refused.stderr
    assert "--allow-unproved" in refused.stderr
    allowed = run("run", bad, *start, "--allow-unproved", "--timeout", "0.5")
    assert allowed.exit_code == 1
    assert "none is proved" in allowed.stdout


def test_a_longer_period_can_be_allowed(run, reach):
    longest = json.loads(run("run", reach, "--json").stdout)["longest"]
    too_long = f"{1.01 * longest:.6g}"
    assert run("run", reach, "--period", too_long).exit_code == 2
    allowed = json.loads(run("run", reach, "--period", too_long, "--allow-unproved", "--json").stdout)
    assert allowed["timing"]["late"] == allowed["timing"]["steps"] - 1


def started(*arguments):
    """Start the command in a process of its own."""
    command = [sys.executable, "-m", "skillctl", "run", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize(
    ("number", "code", "outcome"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
def test_a_signal_ends_it_smoothly_and_the_log_is_whole(reach, tmp_path, number, code, outcome):
    # Real time, and so slow that it lasts for as long as the start of the process may take.
    log = tmp_path / "a.h5"
    slow = ["--driver", "fake:real", "--speed", "0.001", "--timeout", "600", "--log", log, "--json", "-v"]
    process = started(reach, *slow)
    time.sleep(6.0)
    process.send_signal(number)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == code, errors
    report = json.loads(output)
    assert (report["outcome"], report["success"]) == (outcome, False)
    with h5py.File(log) as rows:
        assert len(rows["t"]) == report["timing"]["steps"] > 0
        assert (rows["command"][-1] == 0).all()
        assert json.loads(rows["about"][()])["outcome"] == outcome


def test_an_absent_client_is_said_and_a_port_has_one_user(reach):
    first = started(reach, "--driver", "udp:0")
    output, errors = first.communicate(timeout=60)
    assert (first.returncode, output) == (4, "")
    assert "no state came from 127.0.0.1:" in errors
    assert errors.count("\n") == 2  # the sentence and the hint


def test_two_runs_cannot_share_a_port_but_can_share_a_log(reach, tmp_path):
    import socket

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as used:
        used.bind(("127.0.0.1", 0))
        port = used.getsockname()[1]
        second = started(reach, "--driver", f"udp:{port}")
        assert second.wait(60) == 2
        assert "another run may have this one" in second.stderr.read()
        second.communicate()
    log = tmp_path / "a.h5"
    for process in [started(reach, "--log", log, "--speed", speed) for speed in ("0.1", "0.2")]:
        process.communicate(timeout=60)
        assert process.returncode == 0
    with h5py.File(log) as rows:
        assert json.loads(rows["about"][()])["outcome"] == "arrived"
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]


@pytest.mark.skipif(importlib.util.find_spec("pybullet") is None, reason="PyBullet has no wheel")
def test_the_simulated_arm_arrives_in_real_time(run, reach, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    result = run("run", reach, "--driver", "pybullet", "--tolerance", "0.005", "--json")
    report = json.loads(result.stdout)
    assert (result.exit_code, result.stderr) == (0, "")
    assert report["period"] == pytest.approx(1 / 240)
    assert report["place"]["distance"] < 0.005
