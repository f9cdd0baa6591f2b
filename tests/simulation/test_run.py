from __future__ import annotations

import dataclasses
import itertools
import math
import re
from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from skillctl.errors import GoalNotReachedError, UsageError
from skillctl.model.combined import CombinedSkill
from skillctl.model.seds import SedsSkill
from skillctl.simulation.arm import CONTROL_PERIOD, ArmBody
from skillctl.simulation.arms import ARMS
from skillctl.simulation.episode import Episode
from skillctl.simulation.ik import Kinematics
from skillctl.simulation.position import PositionArm
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import Scenario

MakeLinear = Callable[..., SedsSkill]
STARTS = {3: (0.42, -0.20, 0.45), 2: (-0.08, 0.05)}


@pytest.fixture(
    scope="module", params=list(itertools.product(ARMS, (3, 2))), ids=lambda pair: f"{pair[0]}-{pair[1]}D"
)
def episode(request: pytest.FixtureRequest, reach: SedsSkill, stroke: SedsSkill) -> Episode:
    """The episodes that most rules are checked on: both arms, a 3-D and a 2-D skill, from a given start."""
    arm, dimension = request.param
    skill = reach if dimension == 3 else stroke
    return simulate(skill, Scenario(arm=arm, start=STARTS[dimension]))


def test_the_target_is_reached_and_the_reference_followed(episode: Episode) -> None:
    figures = episode.metrics
    assert episode.success
    assert figures.final_error < 2e-3
    # Motors that lag or lead by one period would be off by 0.3 m/s / 240 = 1.25 mm on the fast half.
    assert figures.tracking_p95 < 0.5 * 0.3 / 240
    assert figures.plan_deviation < 3e-3
    assert figures.ik_failures == 0
    # The hand arrives when the plan, which ends a little nearer to the target, does.
    assert figures.time_to_target <= episode.setup.plan.duration


def test_the_real_arms_limits_hold_in_every_row(episode: Episode) -> None:
    arm, series = episode.setup.arm, episode.series
    assert (series.joints > arm.lower).all()
    assert (series.joints < arm.upper).all()
    assert (np.abs(series.velocities) <= arm.max_velocity).all()
    assert (np.abs(series.torques) <= arm.max_torque).all()


def test_the_hand_keeps_to_the_speed_cap(episode: Episode) -> None:
    speeds = np.linalg.norm(np.diff(episode.series.hand, axis=0), axis=1) / CONTROL_PERIOD
    tracking = np.linalg.norm(episode.series.hand - episode.series.reference, axis=1)
    # The reference obeys the cap; between two rows the hand may make up for what it was behind.
    slack = (tracking[:-1] + tracking[1:]) / CONTROL_PERIOD
    assert (speeds <= 0.3 + slack).all()


def test_rows_are_one_period_apart_from_a_start_at_rest(episode: Episode) -> None:
    series = episode.series
    assert series.times == pytest.approx(np.arange(len(series.times)) / 240, rel=1e-12)
    assert (series.velocities[0] == 0).all()
    assert (series.reference[0] == series.hand[0]).all()
    lengths = {len(getattr(series, field.name)) for field in dataclasses.fields(series)}
    assert lengths == {len(series.times)}


def test_the_episode_ends_after_the_hand_has_settled(episode: Episode) -> None:
    last = episode.metrics.simulated_time - episode.metrics.time_to_target
    assert last == pytest.approx(0.5, abs=1.5 * CONTROL_PERIOD)


@pytest.mark.parametrize("arm", ARMS)
def test_a_hand_faster_than_the_joints_is_slowed_down_on_its_path(arm: str, linear: MakeLinear) -> None:
    options = Scenario(arm=arm, start=(0.5, -0.3, 0.5), max_speed=3.0, max_acceleration=10.0)
    episode = simulate(linear((0.5, 0.3, 0.5), rate=20.0), options)
    assert episode.success
    assert 0.9 < episode.metrics.velocity_ratio <= 1
    assert episode.metrics.plan_deviation < 3e-3


def test_motors_give_no_more_torque_than_the_real_arm() -> None:
    arm = ARMS["panda"]
    with ArmBody(arm, 0.0, shapes="none") as twin, ArmBody(arm, 0.0) as body:
        kinematics = Kinematics(twin, "horizontal", 0.0)
        driven = PositionArm(body, kinematics.home, kinematics)
        joints = driven.state.joints
        driven.turn(joints, joints + 0.5)  # half a radian in 4 ms
        assert np.abs(driven.state.torques) == pytest.approx(arm.max_torque, rel=1e-12)


@pytest.mark.parametrize("arm", ARMS)
def test_without_a_start_the_motion_begins_at_the_ready_posture(arm: str, linear: MakeLinear) -> None:
    episode = simulate(linear((0.5, 0.2, 0.5)), Scenario(arm=arm))
    assert episode.success
    pitch = {"horizontal": 0.25, "down": math.pi / 2}[episode.setup.hand]
    assert episode.series.joints[0] == pytest.approx(ARMS[arm].home_joints(pitch), abs=1e-12)


def test_from_outside_its_plane_a_2d_skill_ends_in_it(stroke: SedsSkill) -> None:
    episode = simulate(stroke, Scenario(plane="yz", origin=(0.55, 0.0, 0.55), scale=4.0))
    assert episode.success
    assert abs(episode.series.hand[0, 0] - 0.55) > 0.05
    assert episode.series.hand[-1, 0] == pytest.approx(0.55, abs=2e-3)


def test_a_moved_target_is_where_the_hand_ends(linear: MakeLinear) -> None:
    target = (0.55, -0.25, 0.45)
    episode = simulate(linear((0.5, 0.2, 0.5)), Scenario(target=target))
    assert (episode.target == target).all()
    assert episode.success
    assert np.linalg.norm(episode.series.hand[-1] - target) < 2e-3


def test_the_base_turns_to_a_target_behind_it(linear: MakeLinear) -> None:
    episode = simulate(linear((-0.5, 0.1, 0.5)), Scenario())
    assert episode.setup.base_yaw == math.pi
    assert episode.success


def test_a_latched_skill_ends_where_its_start_says(linear: MakeLinear) -> None:
    left, right = linear((0.5, 0.3, 0.5), rate=20.0), linear((0.5, -0.3, 0.5), rate=20.0)
    skill = CombinedSkill((left, right), np.array([0.5, 0.5]), disturbance_distance=0.005)
    for sign, part in ((1, 0), (-1, 1)):
        episode = simulate(skill, Scenario(start=(0.45, sign * 0.02, 0.6)))
        assert episode.success
        assert (episode.series.parts == part).all()
        assert (episode.target == skill.parts[part].attractor).all()


@pytest.mark.parametrize("where", ["start", "target"])
def test_what_lies_outside_the_workspace_is_refused_before_the_run(where: str, linear: MakeLinear) -> None:
    with pytest.raises(
        GoalNotReachedError, match=rf"no posture .* for the {where} \(2\.000, 0\.000, 0\.500\)"
    ) as refusal:
        simulate(linear((0.5, 0.0, 0.5)), Scenario(**{where: (2.0, 0.0, 0.5)}))
    assert f"--{where}" in refusal.value.hint


def test_a_way_that_cannot_be_followed_ends_at_the_joint_in_the_way(linear: MakeLinear) -> None:
    skill = linear((-0.4, 0.0, 0.3))  # straight through the arm's own base
    episode = simulate(skill, Scenario(arm="iiwa", start=(0.5, 0.0, 0.3), base_yaw=0.0))
    assert episode.outcome == "joint_limit"
    assert re.fullmatch(r"joint \d would have to pass its limit for the hand at \(.*\) m", episode.detail)
    assert not episode.success
    assert math.isnan(episode.metrics.time_to_target)
    assert episode.metrics.ik_failures == 60  # a quarter of a second


def test_a_skill_that_is_not_stable_diverges(linear: MakeLinear) -> None:
    episode = simulate(linear((0.5, 0.05, 0.5), rate=-0.5), Scenario(start=(0.45, 0.0, 0.5)))
    assert episode.outcome == "diverged"


def test_the_horizon_ends_an_episode(linear: MakeLinear) -> None:
    episode = simulate(linear((0.5, 0.05, 0.5)), Scenario(max_duration=0.25))
    assert episode.outcome == "timeout"
    assert episode.metrics.simulated_time == pytest.approx(0.25, abs=CONTROL_PERIOD)


@pytest.mark.parametrize("name", ["start", "target"])
def test_a_point_of_another_dimension_is_refused(name: str, linear: MakeLinear) -> None:
    with pytest.raises(UsageError, match=f"{name}: expected 3"):
        simulate(linear((0.5, 0.0, 0.5)), Scenario(**{name: (0.5, 0.0)}))


def test_progress_is_told_ten_times_a_second(linear: MakeLinear) -> None:
    told: list[tuple[str, int, int]] = []
    simulate(
        linear((0.5, 0.05, 0.5)),
        Scenario(max_duration=0.45),
        progress=lambda *report: told.append(report),
    )
    assert told == [("moving", milliseconds, 450) for milliseconds in (0, 100, 200, 300, 400)]
