from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from skillctl.model.combined import CombinedSkill
from skillctl.model.seds import SedsSkill
from skillctl.simulation.disturbances import (
    Displace,
    Knock,
    MoveTarget,
    Push,
    Schedule,
    jumped,
    last_end,
)
from skillctl.simulation.motion import Motion
from skillctl.simulation.perception import Perception
from skillctl.simulation.placement import Placement
from skillctl.simulation.scenario import Scenario

MakeLinear = Callable[..., SedsSkill]
HERE = Placement(np.eye(3), np.zeros(3), 1.0, None)
EPS = np.finfo(np.float64).eps
EVENTS = (
    Displace(time=2.0, offset=(0.0, 0.3, 0.4)),
    Push(time=1.0, duration=0.5, force=(1.0, 2.0, 3.0)),
    MoveTarget(time=0.5, offset=(0.0, 0.0, 0.25)),
    Push(time=1.25, duration=2.0, force=(10.0, 0.0, 0.0)),
)


def test_pushes_act_from_their_time_on_as_long_as_they_last() -> None:
    schedule = Schedule(EVENTS)
    assert schedule.push(0.999) is None
    assert schedule.push(1.0) == pytest.approx([1, 2, 3], abs=0)
    assert schedule.push(1.25) == pytest.approx([11, 2, 3], abs=0)  # both
    assert schedule.push(1.5) == pytest.approx([10, 0, 0], abs=0)
    assert schedule.push(3.25) is None


def test_each_jump_is_due_once_and_in_order_of_time() -> None:
    schedule = Schedule(EVENTS)
    assert list(schedule.due(0.49)) == []
    assert [type(event) for event in schedule.due(2.5)] == [MoveTarget, Displace]
    assert list(schedule.due(9.0)) == []


def test_ends_and_ways_of_all_disturbances() -> None:
    assert last_end(EVENTS) == 3.25
    assert jumped(EVENTS) == pytest.approx(0.75, rel=4 * EPS)
    assert (last_end(()), jumped(())) == (0.0, 0.0)


def test_noise_has_the_standard_deviation_asked_for_and_target_errors_stay_level() -> None:
    seen = Perception(Scenario(noise=0.003, target_error=0.01, seed=5))
    hands = np.array([seen.hand(np.ones(3)) for _ in range(4000)]) - 1
    targets = np.array([seen.read_target() for _ in range(4000)])
    # The standard deviation of a standard deviation from n draws is σ/√(2n); five of those.
    spread = 5 / np.sqrt(2 * 4000)
    assert hands.std(axis=0) == pytest.approx([0.003] * 3, rel=spread)
    assert targets[:, :2].std(axis=0) == pytest.approx([0.01] * 2, rel=spread)
    assert (targets[:, 2] == 0).all()


def test_noise_and_target_error_are_drawn_apart() -> None:
    quiet, noisy = (Perception(Scenario(noise=noise, target_error=0.01)) for noise in (0.0, 0.003))
    noisy.hand(np.zeros(3))
    assert (quiet.read_target() == noisy.read_target()).all()


def test_without_noise_the_truth_is_seen() -> None:
    seen, position = Perception(Scenario()), np.array([0.1, 0.2, 0.3])
    assert (seen.hand(position) == position).all()
    assert (seen.read_target() == 0).all()


def test_a_moved_motion_is_the_same_motion_elsewhere(reach: object) -> None:
    offset, position = np.array([0.1, -0.2, 0.05]), np.array([0.42, -0.2, 0.45])
    still, moved = (Motion(reach, HERE, Scenario()) for _ in range(2))
    moved.move(offset)
    # Sums of magnitude 1 round by EPS; the skill is steeper than 10 /s nowhere.
    assert moved.velocity(position + offset) == pytest.approx(still.velocity(position), abs=32 * EPS)
    assert moved.target(position) == pytest.approx(still.target(position) + offset, abs=2 * EPS)


def test_when_the_target_jumps_a_latched_skill_may_choose_again(linear: MakeLinear) -> None:
    left, right = (linear((0.5, y, 0.5), spread=0.1) for y in (0.2, -0.2))
    skill = CombinedSkill((left, right), np.array([0.5, 0.5]), disturbance_distance=0.02)
    motion, position = Motion(skill, HERE, Scenario()), np.array([0.4, 0.02, 0.5])
    motion.velocity(position)
    assert motion.part == 0
    motion.move(np.array([0.0, 0.01, 0.0]))  # the hand is now on the other side, but has not jumped far
    motion.velocity(position - (0.0, 0.02, 0.0))
    motion.move(np.array([0.0, 0.06, 0.0]))
    motion.velocity(position)
    assert motion.part == 1


def test_a_knock_is_due_once_as_long_after_the_cup_was_taken_as_it_says() -> None:
    schedule = Schedule((Knock(time=0.5, offset=(0.1, 0.0, 0.0)), Knock(time=1.5, offset=(0.0, 0.2, 0.0))))
    assert list(schedule.due(9.0)) == []  # it is none of the jumps at a time of the episode
    assert schedule.knocked(0.499) is None
    assert schedule.knocked(0.5) == pytest.approx([0.1, 0, 0], abs=0)
    assert schedule.knocked(1.499) is None
    assert schedule.knocked(1.5) == pytest.approx([0, 0.2, 0], abs=0)
    assert schedule.knocked(9.0) is None
