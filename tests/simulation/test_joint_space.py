"""Skills of joint angles drive the joints: errors are of the joints, in radians."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from skillctl.errors import GoalNotReachedError, UsageError
from skillctl.model.seds import SedsSkill
from skillctl.model.space import Euclidean
from skillctl.simulation.arm import CONTROL_PERIOD, ArmBody
from skillctl.simulation.arms import ARMS
from skillctl.simulation.check import check
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import Scenario

MakeLinear = Callable[..., SedsSkill]
TARGET = (0.6, -0.2, 0.1, -1.9, -0.2, 1.9, 1.0)
START = (0.0, -0.6, 0.0, -2.2, 0.0, 1.7, 0.7)


@pytest.fixture
def turning(linear: MakeLinear) -> Callable[..., SedsSkill]:
    def make(target: tuple[float, ...] = TARGET, **options: object) -> SedsSkill:
        names = tuple(f"q{i + 1}" for i in range(len(target)))
        return linear(target, space=Euclidean(names, "rad"), **options)

    return make


def off_line(joints: np.ndarray, start: tuple[float, ...], end: tuple[float, ...]) -> float:
    """Return the largest distance of joints (T, n) to the line through two postures, [rad]."""
    line = np.array(end) - start
    line /= np.linalg.norm(line)
    off = joints - start
    return float(np.linalg.norm(off - np.outer(off @ line, line), axis=1).max())


def test_the_joints_go_to_the_target_as_the_skill_says(turning: Callable[..., SedsSkill]) -> None:
    episode = simulate(turning(), Scenario(start=START))
    joints, target = episode.series.joints, np.array(TARGET)
    assert episode.outcome == "reached"
    assert episode.setup.unit == "rad"
    assert joints[0] == pytest.approx(START, abs=1e-6)
    assert np.linalg.norm(joints[-1] - target) < 2e-3  # the tolerance
    assert episode.metrics.final_error == pytest.approx(np.linalg.norm(joints[-1] - target), rel=1e-12)
    # ẋ = −2 (x − x*) is straight: the joints stay on the line from start to target, within what motors lag.
    assert off_line(joints, START, TARGET) < 1e-3
    # Where neither acceleration nor joints limit it, it decays with rate 2.
    distances = np.linalg.norm(joints - target, axis=1)
    middle = (distances < 0.2) & (distances > 0.02)
    rates = -np.diff(np.log(distances[middle])) / CONTROL_PERIOD
    assert np.median(rates) == pytest.approx(2.0, rel=0.02)


def test_pictures_and_logs_show_the_hand_of_these_joints(turning: Callable[..., SedsSkill]) -> None:
    episode = simulate(turning(), Scenario(start=START))
    with ArmBody(ARMS["panda"], 0.0, shapes="none") as body:
        for joints, place in ((TARGET, episode.target), (START, episode.setup.plan.positions[0])):
            body.pose(np.array(joints))
            assert body.hand()[0] == pytest.approx(place, abs=1e-9)
    assert episode.metrics.plan_deviation < 2e-3


def test_what_the_check_tells_is_what_happens(turning: Callable[..., SedsSkill]) -> None:
    scenario = Scenario(start=START)
    told, happened = check(turning(), scenario), simulate(turning(), scenario)
    assert told.reachable
    assert (told.unit, told.start, told.target) == ("rad", START, TARGET)
    assert told.joint_margin == pytest.approx(happened.metrics.joint_margin, abs=0.01)
    assert told.velocity_ratio == pytest.approx(happened.metrics.velocity_ratio, rel=0.1)


def test_a_target_is_moved_in_joint_angles(turning: Callable[..., SedsSkill]) -> None:
    target = (0.3, *TARGET[1:])
    episode = simulate(turning(), Scenario(start=START, target=target))
    assert episode.series.joints[-1] == pytest.approx(target, abs=2e-3)


def test_coordinates_with_the_names_of_joints_move_these(linear: MakeLinear) -> None:
    names = tuple(f"panda_joint{i}" for i in (7, 6, 5, 4, 3, 2, 1))
    skill = linear(TARGET[::-1], space=Euclidean(names, "rad"))
    episode = simulate(skill, Scenario(start=START[::-1]))
    assert episode.series.joints[0] == pytest.approx(START, abs=1e-6)
    assert episode.series.joints[-1] == pytest.approx(TARGET, abs=2e-3)
    assert check(skill, Scenario(start=START[::-1])).reachable


def test_the_names_of_joints_are_those_of_the_models() -> None:
    for arm in ARMS.values():
        with ArmBody(arm, 0.0, shapes="none") as body:
            found = [body.bullet.getJointInfo(body.body, i) for i in range(len(body.link_names()))]
        assert tuple(found[i][1].decode() for i in arm.indices) == arm.joints
        assert found[arm.tip][12].decode() == arm.tip_link


def test_joints_keep_their_speed_limits(turning: Callable[..., SedsSkill]) -> None:
    fast = simulate(turning((2.5, *TARGET[1:]), rate=20.0), Scenario(start=(-2.5, *START[1:])))
    assert fast.success
    assert 0.9 < fast.metrics.velocity_ratio <= 1.0
    assert off_line(fast.series.joints, (-2.5, *START[1:]), (2.5, *TARGET[1:])) < 0.02  # slower, on its path


@pytest.mark.parametrize("where", ["start", "target"])
def test_joints_beyond_their_limits_are_refused(turning: Callable[..., SedsSkill], where: str) -> None:
    beyond = (0.0, 0.0, 0.0, 0.5, 0.0, 1.0, 0.0)  # joint 4 of a Panda ends at −0.07
    scenario = Scenario(**{"start": START, where: beyond})
    with pytest.raises(GoalNotReachedError, match=rf"the {where} has joint 4 at 0\.500 rad"):
        simulate(turning(), scenario)
    assert not check(turning(), scenario).reachable


def test_a_way_beyond_a_limit_ends_there(turning: Callable[..., SedsSkill]) -> None:
    # A spiral in the plane of joints 4 and 6 takes joint 4 beyond its upper limit.
    matrix = -0.5 * np.eye(7)
    matrix[3, 5], matrix[5, 3] = 4.0, -4.0
    skill = turning((0.0, 0.0, 0.0, -0.2, 0.0, 1.8, 0.0), matrix=matrix)
    scenario = Scenario(start=(0.0, 0.0, 0.0, -0.2, 0.0, 2.8, 0.0))
    told, happened = check(skill, scenario), simulate(skill, scenario)
    assert not told.reachable
    assert "a joint would have to pass its limit" in told.reason
    assert happened.outcome == "joint_limit"
    assert "joint 4 would have to pass its limit" in happened.detail


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"arm": "xarm6"}, "moves 7 joints; the xarm6 arm has 6"),
        ({"start": (0.0, 0.0)}, "start: expected 7 numbers, got 2"),
        ({"control": "torque"}, "control"),
        ({"scale": 2.0}, "scale: is about a hand"),
        ({"noise": 0.01}, "noise: is about a hand"),
        (
            {"disturbances": [{"kind": "displace", "time": 1, "offset": (0, 0, 0.1)}]},
            "displace: is about a hand",
        ),
        ({"scene": {"kind": "table"}, "cup": {}}, "cup: is about a hand"),
    ],
)
def test_what_is_about_hands_is_refused(
    turning: Callable[..., SedsSkill], options: dict[str, object], said: str
) -> None:
    with pytest.raises(UsageError, match=said):
        simulate(turning(), Scenario(**options))


def test_a_push_is_held_against_and_obstacles_count(turning: Callable[..., SedsSkill]) -> None:
    push = {"kind": "push", "time": 0.3, "duration": 0.2, "force": (0, 20, 0)}
    assert simulate(turning(), Scenario(start=START, disturbances=[push])).success
    post = {"kind": "cylinder", "name": "post", "position": (0.45, 0.25, 0.5), "radius": 0.08, "height": 1.0}
    scenario = Scenario(start=START, obstacles=[post])
    assert "would touch the post" in check(turning(), scenario).reason
    assert simulate(turning(), scenario).outcome == "shelf_contact"
