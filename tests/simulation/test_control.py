"""The rules of one control period, on an arm whose three joints are the hand's coordinates."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from skillctl.model.seds import SedsSkill
from skillctl.model.space import Euclidean
from skillctl.simulation.arm import CONTROL_PERIOD, Tracking
from skillctl.simulation.disturbances import MoveTarget
from skillctl.simulation.ik import Solution
from skillctl.simulation.judge import Judge, Verdict
from skillctl.simulation.motion import Motion, Plan
from skillctl.simulation.placement import Placement
from skillctl.simulation.position import Follower
from skillctl.simulation.scenario import Scenario

MakeLinear = Callable[..., SedsSkill]
FORWARD = np.array([0.24, 0.0, 0.0])  # [m/s]: 1 mm per period
STEP = FORWARD * CONTROL_PERIOD
EPS = np.finfo(np.float64).eps


class Gantry:
    """Moves along x, y, z at up to 1 m/s and cannot be where 0.0105 < x < 0.0145."""

    model = SimpleNamespace(max_velocity=np.ones(3))
    space = Euclidean.cartesian(3)
    lower, upper = np.full(3, -1.0), np.full(3, 1.0)

    def forward(self, joints: np.ndarray) -> np.ndarray:
        return joints

    def follow(self, point: np.ndarray, joints: np.ndarray) -> Solution:
        blocked = 0.0105 < point[0] < 0.0145
        return Solution(joints if blocked else point, 0.004 if blocked else 0.0, not blocked)


@pytest.fixture
def follower() -> Follower:
    return Follower(Gantry(), np.zeros(3))


def test_reference_and_joints_move_on_together(follower: Follower) -> None:
    for _ in range(10):
        assert follower.advance(FORWARD, follower.tracking.reference) == 1
    assert follower.tracking.reference == pytest.approx(10 * STEP, abs=16 * EPS)
    assert (follower.joints == follower.tracking.reference).all()


def test_joints_at_their_limit_slow_the_reference_down(follower: Follower) -> None:
    share = follower.advance(10 * FORWARD, np.zeros(3))  # 2.4 m/s
    assert share == pytest.approx(0.95 / 2.4, rel=4 * EPS)
    assert (follower.joints == follower.tracking.reference).all()
    assert follower.joints[0] == pytest.approx(0.95 * CONTROL_PERIOD, rel=4 * EPS)


def test_over_a_gap_the_arm_waits_and_then_catches_up(follower: Follower) -> None:
    refusals, stops = [], []
    for _ in range(16):
        follower.advance(FORWARD, follower.tracking.reference)
        refusals.append(follower.tracking.refusals)
        stops.append(follower.joints[0])
    assert refusals == [0] * 10 + [1, 2, 3, 4] + [0, 0]
    assert stops[9:14] == [stops[9]] * 5
    # The way missed is 5 mm; at 0.95 m/s the joints make 3.96 mm of it in the first period.
    assert stops[14] - stops[13] == pytest.approx(0.95 * CONTROL_PERIOD, rel=64 * EPS)


def test_a_joint_at_its_limit_is_remembered(follower: Follower) -> None:
    follower.advance(np.array([0.012, 0.0, 0.0]) / CONTROL_PERIOD, np.zeros(3))
    assert (follower.tracking.refusals, follower.tracking.at_limit) == (1, None)  # blocked, and no limit near
    follower.restart(np.array([0.010, 1.0, 0.0]))
    assert follower.tracking.refusals == 0
    follower.advance(FORWARD, follower.tracking.reference)
    assert (follower.tracking.refusals, follower.tracking.at_limit) == (1, 1)


def test_the_reference_yields_to_a_hand_that_was_pushed(follower: Follower) -> None:
    follower.advance(FORWARD, np.array([0.0, 0.009, 0.0]))
    assert follower.tracking.reference[1] == 0  # less than 10 mm: not a push
    follower.advance(FORWARD, np.array([follower.tracking.reference[0], 0.02, 0.0]))
    assert follower.tracking.reference[1] == pytest.approx(3.0 * 0.02 * CONTROL_PERIOD, rel=4 * EPS)


@pytest.fixture
def motion(linear: MakeLinear) -> Motion:
    skill = linear((0.0, 0.0, 0.0))
    return Motion(skill, Placement(np.eye(3), np.zeros(3), 1.0, None), Scenario())


@pytest.fixture
def judge() -> Judge:
    plan = Plan(np.array([[0.3, 0.0, 0.0], [0.4, 0.0, 0.0], [0.0, 0.0, 0.0]]), np.zeros(3), True)
    return Judge(plan, Scenario(settle_time=3 * CONTROL_PERIOD))


NEAR, FAR = np.array([0.0, 0.0019, 0.0]), np.array([0.0, 0.0021, 0.0])
REST = np.zeros(3)


def tracking(refusals: int = 0, at_limit: int | None = None) -> Tracking:
    return Tracking(FAR, refusals=refusals, at_limit=at_limit)


def test_passing_through_the_target_is_not_reaching_it(judge: Judge, motion: Motion) -> None:
    hands = [NEAR, NEAR, NEAR, FAR, NEAR, NEAR, NEAR, NEAR]
    assert [judge.settled(motion, hand, np.zeros(3)) for hand in hands] == [None] * 7 + [Verdict("reached")]


def test_a_hand_that_stays_where_it_perceives_the_target_has_missed_it(judge: Judge, motion: Motion) -> None:
    off = np.array([0.0, 0.0, 0.003])  # more than the tolerance
    verdicts = [judge.settled(motion, NEAR, off) for _ in range(5)]
    assert verdicts[:3] == [None] * 3
    assert verdicts[4].outcome == "missed"


def test_a_quarter_of_a_second_without_joints_ends_the_episode(judge: Judge, motion: Motion) -> None:
    assert judge.failure(motion, FAR, REST, tracking(59)) is None
    assert outcome(judge.failure(motion, FAR, REST, tracking(60))) == "unreachable"


def test_a_limit_in_the_way_is_named(judge: Judge, motion: Motion) -> None:
    verdict = judge.failure(motion, FAR, REST, tracking(60, at_limit=3))
    assert verdict is not None
    assert verdict.outcome == "joint_limit"
    assert "joint 4" in verdict.detail


def test_leaving_the_plan_far_behind_is_diverging(judge: Judge, motion: Motion) -> None:
    limit = 1.5 * 0.4 + 0.05
    assert judge.failure(motion, np.array([0.99 * limit, 0.0, 0.0]), REST, tracking()) is None
    assert outcome(judge.failure(motion, np.array([1.01 * limit, 0.0, 0.0]), REST, tracking())) == "diverged"


def test_a_target_that_jumps_may_be_farther_away(motion: Motion) -> None:
    plan = Plan(np.array([[0.3, 0.0, 0.0], [0.0, 0.0, 0.0]]), np.zeros(3), True)
    scenario = Scenario(disturbances=(MoveTarget(time=1.0, offset=(0.0, 3.0, 4.0)),))
    limit = 1.5 * 0.3 + 0.05 + 5.0
    assert Judge(plan, scenario).farthest == pytest.approx(limit, rel=4 * EPS)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_velocity_that_is_no_number_is_diverging(judge: Judge, motion: Motion, bad: float) -> None:
    assert outcome(judge.failure(motion, FAR, np.array([0.0, bad, 0.0]), tracking())) == "diverged"


def outcome(verdict: Verdict | None) -> str | None:
    return None if verdict is None else verdict.outcome
