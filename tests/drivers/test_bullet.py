"""The simulated arm as a driver: it follows its commands, and its fingers do what they are told."""

from __future__ import annotations

import importlib.util
from contextlib import closing

import numpy as np
import pytest

from skillctl.drivers.driver import Setup
from skillctl.errors import UsageError

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("pybullet") is None, reason="PyBullet has no wheel for this Python"
)


@pytest.fixture
def arm(monkeypatch, positions):
    """The panda with its hand at the start, without a window."""
    from skillctl.drivers.pybullet import BulletArm

    monkeypatch.delenv("DISPLAY", raising=False)
    with closing(BulletArm(Setup("", positions, start=np.array([0.4, 0.1, 0.5])))) as arm:
        yield arm


def passed(arm, seconds):
    """Let time pass, simulated at once."""
    arm._began -= seconds  # the real time is there already
    arm.wait(arm._simulated + seconds)


def test_the_hand_moves_as_it_is_told(arm):
    before = np.array(arm.state().numbers)
    np.testing.assert_allclose(before, [0.4, 0.1, 0.5], atol=1e-3)
    arm.command((0.05, -0.02, 0.03))
    passed(arm, 1.0)
    moved = np.array(arm.state().numbers) - before
    np.testing.assert_allclose(moved, [0.05, -0.02, 0.03], atol=2e-3)  # of the lag of the motors
    arm.command((0.0, 0.0, 0.0))
    passed(arm, 0.2)
    rested = arm.state().numbers
    passed(arm, 0.2)
    np.testing.assert_allclose(arm.state().numbers, rested, atol=1e-4)


def test_the_fingers_close_and_open(arm):
    def opening():
        body = arm._arm.body
        joints = [joint for joint, _ in body.model.fingers]
        return sum(state[0] for state in body.bullet.getJointStates(body.body, joints))

    assert arm.grips
    assert arm.event("ring") is False
    assert opening() > 0.05
    assert arm.event("close")
    passed(arm, 0.1)
    assert arm.event("close")
    passed(arm, 2.0)
    assert not arm.event("close")
    assert opening() < 0.002
    assert arm.event("open")
    passed(arm, 2.0)
    assert not arm.event("open")
    assert opening() > 0.05


def test_an_arm_without_fingers_says_so(monkeypatch, positions):
    from skillctl.drivers.pybullet import BulletArm

    monkeypatch.delenv("DISPLAY", raising=False)
    with closing(BulletArm(Setup("iiwa", positions, start=np.array([0.4, 0.1, 0.5])))) as arm:
        assert not arm.grips
        assert arm.event("close") is False


def test_a_plane_is_refused(make_skill):
    from skillctl.drivers.pybullet import BulletArm

    with pytest.raises(UsageError, match="this driver moves a hand in three dimensions"):
        BulletArm(Setup("", make_skill(np.random.default_rng(0))))
