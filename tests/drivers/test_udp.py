"""The line protocol: what comes is read, what does not belong is passed over, and a client in C follows."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import skillctl
from skillctl.drivers.driver import Setup
from skillctl.drivers.udp import UdpRobot
from skillctl.errors import UsageError

CLIENT = Path(skillctl.__file__).parent / "docs" / "udp_client.c"
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]


@pytest.fixture
def port():
    """A port that nobody uses."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


@pytest.fixture
def robot(positions, port):
    """The driver, and the robot's socket."""
    driver = UdpRobot(Setup(str(port), positions))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.connect(("127.0.0.1", port))
        client.settimeout(5.0)
        yield driver, client
    driver.close()


def heard(client):
    """Return the words of the next line."""
    return client.recv(512).decode().split()


def test_the_newest_state_is_answered(robot):
    driver, client = robot
    assert driver.state() is None
    driver.command((1.0, 2.0, 3.0))  # to nobody yet
    client.send(b"state 7 0 0.1 0.2 0.3\n")
    client.send(b"state 8 0 0.1 0.2 0.4\n")
    assert driver.state() == (8, (0.1, 0.2, 0.4))
    assert driver.state() == (8, (0.1, 0.2, 0.4))
    driver.command((0.1, -1e-17, 1 / 3))
    word, number, *numbers = heard(client)
    assert (word, number) == ("move", "8")
    assert tuple(map(float, numbers)) == (0.1, -1e-17, 1 / 3)  # to the last bit
    driver.close()
    assert heard(client) == ["stop"]


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"state",
        b"state 1 0 x y z",
        b"state one 0 1 2 3",
        b"stat 9 0 1 2 3",
        b"\xff\x00",
        b"move 1 2 3 4",
    ],
)
def test_other_lines_are_passed_over(robot, line):
    driver, client = robot
    client.send(b"state 1 0 0.1 0.2 0.3")
    client.send(line)
    assert driver.state() == (1, (0.1, 0.2, 0.3))


def test_other_senders_are_passed_over(robot, port):
    driver, client = robot
    client.send(b"state 1 0 0.1 0.2 0.3")
    assert driver.state().stamp == 1
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.sendto(b"state 2 0 9 9 9", ("127.0.0.1", port))
        assert driver.state().stamp == 1
    client.send(b"state 3 0 0.1 0.2 0.3")
    assert driver.state().stamp == 3


def test_an_event_is_asked_for_until_the_robot_has_done_it(robot):
    driver, client = robot
    client.send(b"state 1 4 0.1 0.2 0.3")  # four events have been done in earlier runs
    driver.state()
    assert driver.event("close")
    assert heard(client) == ["event", "5", "close"]
    assert driver.event("close")
    assert heard(client) == ["event", "5", "close"]
    client.send(b"state 2 5 0.1 0.2 0.3")
    driver.state()
    assert not driver.event("close")
    assert driver.event("open")
    heard(client)
    assert heard(client) == ["event", "6", "open"]


def test_a_place_that_cannot_be_used_is_said(robot, positions, port):
    for address in (str(port), f"127.0.0.1:{port}"):
        with pytest.raises(UsageError, match=f"udp cannot use 127.0.0.1:{port}: Address already in use"):
            UdpRobot(Setup(address, positions))
    for address in ("soon", "70000", "-1", "192.0.2.1:5005"):
        with pytest.raises(UsageError, match="udp cannot use"):
            UdpRobot(Setup(address, positions))


@pytest.mark.parametrize("compiler", COMPILERS)
def test_the_client_in_c_follows(compiler, library, tmp_path, port):
    program = tmp_path / "client"
    build = [compiler, "-O2", "-Wall", "-Wextra", "-Werror", "-o", program, CLIENT]
    subprocess.run(build, check=True)
    command = ["run", "reach", "--driver", f"udp:{port}", "--period", "0.002", "--stale", "2", "--json"]
    command += ["--tolerance", "0.003"]
    with subprocess.Popen(
        [sys.executable, "-m", "skillctl", *command, "--store", library], stdout=subprocess.PIPE, text=True
    ) as runner:
        start = ["0.35", "0.0", "0.5"]
        with subprocess.Popen([program, *start, str(port)], stdout=subprocess.PIPE, text=True) as client:
            report = json.loads(runner.communicate(timeout=120)[0])
            said = client.communicate(timeout=10)[0]
        assert (runner.returncode, client.returncode) == (0, 0)
    assert report["start"] == [0.35, 0.0, 0.5]
    assert report["outcome"] == "arrived"
    rests = np.array([float(word.strip(",")) for word in said.split("at ")[1].split()])
    np.testing.assert_allclose(
        rests, report["place"]["end"], atol=2e-3
    )  # what it went on while it was stopped


def test_the_client_in_c_is_short():
    assert len(CLIENT.read_text().splitlines()) <= 36
