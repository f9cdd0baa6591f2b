"""The rules of a grasp, with a gripper and a cup that only exist as numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skillctl.simulation.grasp import Grasping
from skillctl.simulation.judge import Verdict
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.scene import Contact

PERIOD = 1 / 240
CUP = np.array([0.62, 0.0, 0.76, 0.0, 0.0, 0.0, 1.0])
FINGERS = ("left", "right")
BOTH = [Contact(finger, "cup") for finger in FINGERS]


class Fingers:
    """A gripper that remembers what it was told."""

    links = FINGERS

    def __init__(self) -> None:
        self.told: list[tuple[float, float]] = []

    def close(self, force: float, speed: float) -> None:
        self.told.append((force, speed))


def grasping(fingers: Fingers | None = None, lift: float = 0.10) -> Grasping:
    scenario = Scenario(scene={"kind": "shelf"}, target="cup")
    return Grasping(scenario, fingers or Fingers(), CUP, lambda: lift)


def closed(lift: float = 0.10) -> Grasping:
    """A grasp whose lift begins at 1.8 s."""
    task = grasping(lift=lift)
    task.proceed(1.0, 0.0)
    task.proceed(1.8, 0.0)
    assert task.phase == "lift"
    return task


def raised(height: float) -> np.ndarray:
    return CUP + np.array([0.0, 0.0, height, 0.0, 0.0, 0.0, 0.0])


def tilted(angle: float) -> np.ndarray:
    return np.array([*CUP[:3], 0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2)])


def outcome(verdict: Verdict | None) -> str | None:
    return None if verdict is None else verdict.outcome


def test_the_fingers_close_when_the_hand_is_near_and_only_then() -> None:
    fingers = Fingers()
    task = grasping(fingers)
    task.proceed(0.5, 0.0061)
    assert (task.phase, fingers.told) == ("approach", [])
    task.proceed(1.0, 0.0059)
    assert (task.phase, fingers.told) == ("close", [(20.0, 0.1)])
    assert task.velocity(1.1, CUP[:3]) is None  # the skill still moves the hand


def test_the_lift_is_smooth_goes_as_far_as_it_should_and_ends_at_rest() -> None:
    task, hand = closed(), CUP[:3].copy()
    heights, now = [hand[2]], 1.8
    while now < 1.8 + 1.2 - 0.5 * PERIOD:
        velocity = task.velocity(now, np.array([*hand[:2], hand[2]]))
        assert velocity is not None
        hand = hand + PERIOD * velocity
        now += PERIOD
        heights.append(hand[2])
    speeds = np.diff(heights) / PERIOD
    # Euler's method is behind the curve by at most half a period at full speed.
    assert hand[2] - CUP[2] == pytest.approx(0.10, abs=PERIOD * 0.157)
    assert speeds.max() == pytest.approx(1.875 * 0.10 / 1.2, rel=0.01)
    assert speeds[0] < 0.02
    assert speeds[-1] < 0.02
    assert task.velocity(5.0, raised(0.10)[:3]) == pytest.approx([0, 0, 0], abs=1e-12)


def test_a_hand_that_does_not_lag_gets_the_speed_of_the_curve_alone() -> None:
    task = closed()
    task.velocity(1.8, CUP[:3])
    velocity = task.velocity(2.4, raised(0.05)[:3])  # half the time, half the way
    assert velocity == pytest.approx([0, 0, 1.875 * 0.10 / 1.2], rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(("angle", "expected"), [(19.0, None), (21.0, "tipped")])
def test_a_cup_that_leans_has_not_fallen_yet(angle: float, expected: str | None) -> None:
    verdict = grasping().verdict(0.7, tilted(math.radians(angle)), [Contact("palm", "cup")])
    assert outcome(verdict) == expected
    if verdict is not None:
        assert verdict.detail == "the cup fell over 0.7 s into the approach, pushed by palm"


def test_a_cup_below_its_board_has_fallen_off() -> None:
    verdict = grasping().verdict(0.7, raised(-0.03), [])
    assert (verdict.outcome, verdict.detail) == (
        "tipped",
        "the cup fell off its board 0.7 s into the approach",
    )


@pytest.mark.parametrize(("touching", "expected"), [(BOTH, None), (BOTH[:1], "missed"), ([], "missed")])
def test_a_cup_between_both_fingers_is_had(touching: list[Contact], expected: str | None) -> None:
    task = grasping()
    task.proceed(1.0, 0.0)
    assert task.verdict(1.79, CUP, touching) is None
    assert outcome(task.verdict(1.8, CUP, touching)) == expected


def test_how_far_a_missed_cup_was_moved_does_not_count_where_it_was_put() -> None:
    task = grasping()
    task.cup_moved(np.array([0.0, 0.2, 0.0]))
    task.proceed(1.0, 0.0)
    verdict = task.verdict(1.8, CUP + np.array([0.0, 0.21, 0.0, 0, 0, 0, 0]), [])
    assert verdict is not None
    assert verdict.detail.endswith("the cup had been moved 10 mm")


def test_the_cup_must_stay_up_all_through_the_hold() -> None:
    task = closed()
    assert task.verdict(2.0, CUP, BOTH) is None  # the lift is not over
    task.proceed(3.0, 0.0)
    assert task.phase == "hold"
    assert task.verdict(3.5, raised(0.051), BOTH) is None
    assert outcome(task.verdict(3.6, raised(0.049), BOTH)) == "dropped"
    assert task.verdict(4.0, raised(0.051), BOTH) == Verdict("grasped")


def test_an_arm_that_cannot_lift_far_enough_says_so() -> None:
    verdict = closed(lift=0.04).verdict(1.9, CUP, BOTH)
    assert verdict is not None
    assert (verdict.outcome, verdict.detail) == ("unreachable", "the arm can lift the cup by 40 mm only")
