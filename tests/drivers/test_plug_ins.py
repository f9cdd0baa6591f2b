"""Drivers of other people's robots: found by entry points, and what they say to their libraries."""

from __future__ import annotations

import importlib
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from skillctl.drivers import franky, registry
from skillctl.drivers.driver import Driver, Setup
from skillctl.drivers.franky import FrankaArm
from skillctl.drivers.registry import driver_class, known
from skillctl.drivers.ros2 import LEASH, RosPose, RosTwist
from skillctl.drivers.ur_rtde import UniversalRobot
from skillctl.errors import NotFoundError, UsageError
from skillctl.toml_files import parse_toml

PYPROJECT = Path(__file__).parents[2] / "pyproject.toml"
OURS = parse_toml(PYPROJECT.read_bytes())["project"]["entry-points"][registry.GROUP]
POSE = (0.4, 0.1, 0.3, 0.0, 0.0, 0.0, 1.0)
TWIST = [0.1, 0.0, -0.2, 0.0, 0.0, 0.3]


@pytest.fixture
def library(monkeypatch):
    """The stand-ins, in the place of the libraries."""
    sys.path.insert(0, str(Path(__file__).parent))
    stand_ins = importlib.import_module("stand_ins")
    sys.path.pop(0)
    stand_ins.CALLS.clear()
    for name, module in stand_ins.MODULES.items():
        monkeypatch.setitem(sys.modules, name, module)
    return stand_ins


def setup(skill, address="10.0.0.2", **options):
    return Setup(address, skill, **options)


def test_ours_lead_to_drivers_that_say_what_they_were_tried_on():
    assert set(OURS) == {"franky", "ur_rtde", "ros2-twist", "ros2-pose"}
    for name, place in OURS.items():
        found = EntryPoint(name, place, registry.GROUP).load()
        assert issubclass(found, Driver)
        assert found.untried
    for name in registry.OWN:
        assert not driver_class(name).untried
    for each in Path(registry.__file__).parent.glob("*.py"):
        if each.stem in {"fake", "pybullet", "udp", "franky", "ur_rtde"}:
            assert len(each.read_text().splitlines()) <= 90  # a screen


def test_a_package_adds_a_driver(monkeypatch, tmp_path, positions):
    (tmp_path / "mine.py").write_text(
        "from skillctl.drivers.driver import Driver\n"
        "class Mine(Driver):\n    def state(self): return None\n    def command(self, velocity): pass\n"
    )
    (info := tmp_path / "mine-1.dist-info").mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1\n")
    (info / "entry_points.txt").write_text(
        "[skillctl.drivers]\nmine = mine:Mine\nbroken = mine:Other\ngone = nowhere:Other\nfake = mine:Mine\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert driver_class("mine")(setup(positions)).period == 0.01
    assert "mine" in known()
    assert driver_class("fake").__name__ == "FakeArm"  # nobody takes the place of ours
    for name in ("broken", "gone"):
        with pytest.raises(NotFoundError, match=f"the driver {name} cannot be loaded") as refused:
            driver_class(name)
        assert "Other" in refused.value.hint


def test_a_driver_that_is_not_there_is_named_with_the_nearest():
    with pytest.raises(NotFoundError, match="no driver is called 'udb'") as refused:
        driver_class("udb")
    assert refused.value.hint == "Did you mean udp?"
    with pytest.raises(NotFoundError) as refused:
        driver_class("kuka")
    assert {"fake,", "pybullet,", "udp,"} <= set(refused.value.hint.split())


@pytest.mark.parametrize(
    ("driver", "module", "hint"),
    [
        (FrankaArm, "franky", "pip install franky-control"),
        (UniversalRobot, "rtde_control", "pip install ur_rtde"),
        (RosTwist, "rclpy", "/opt/ros/"),
    ],
)
def test_a_library_that_is_not_installed_is_named(monkeypatch, positions, driver, module, hint):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(NotFoundError, match=f"{module}, which this driver needs, ") as refused:
        driver(setup(positions))
    assert hint in refused.value.hint


@pytest.mark.parametrize("driver", [FrankaArm, UniversalRobot, RosTwist, RosPose])
def test_joints_and_planes_are_refused(library, make_skill, driver):
    flat = make_skill(np.random.default_rng(0), dimension=2)
    with pytest.raises(
        UsageError, match="this driver moves a hand in three dimensions; the skill moves x, y"
    ):
        driver(setup(flat))
    assert not library.CALLS


@pytest.mark.parametrize("driver", [FrankaArm, UniversalRobot])
def test_an_arm_without_an_address_is_refused(library, positions, driver):
    with pytest.raises(UsageError, match="address of the arm is missing"):
        driver(setup(positions, ""))


def test_franky_is_given_twists_that_end_by_themselves(library, monkeypatch, tmp_path, positions):
    monkeypatch.setattr(franky, "REALTIME", tmp_path / "no")
    arm = FrankaArm(setup(positions))
    assert arm.state().numbers == (0.4, 0.1, 0.3, 1.0, 0.0, 0.0, 0.0)
    assert arm.state().stamp != arm.state().stamp
    arm.command(TWIST)
    arm.command(TWIST[:3])
    arm.close()
    called = list(library.CALLS)
    assert called == [
        ("Robot", "10.0.0.2", "ignore"),
        ("move", "velocity", (TWIST[:3], TWIST[3:]), 100),
        ("move", "velocity", (TWIST[:3], [0.0, 0.0, 0.0]), 100),
        ("move", "stop"),
        ("join_motion",),
    ]


def test_slow_commands_hold_for_longer(library, positions):
    FrankaArm(setup(positions, period=0.06)).command(TWIST)
    assert library.CALLS[-1] == ("move", "velocity", (TWIST[:3], TWIST[3:]), 180)
    UniversalRobot(setup(positions, period=0.06))
    assert library.CALLS[-1] == ("setWatchdog", pytest.approx(1 / 0.18))


def test_franky_is_urgent_where_the_kernel_can_be(library, monkeypatch, tmp_path, positions):
    monkeypatch.setattr(franky, "REALTIME", tmp_path)
    FrankaArm(setup(positions))
    assert library.CALLS == [("Robot", "10.0.0.2", "enforce")]


def test_franky_closes_and_opens_its_fingers(library, positions):
    arm = FrankaArm(setup(positions))
    assert [arm.event("close") for _ in range(3)] == [True, True, False]
    assert [arm.event("open") for _ in range(3)] == [True, True, False]
    assert arm.event("ring") is False
    assert library.CALLS[1:] == [
        ("Gripper", "10.0.0.2"),
        ("grasp_async", 0.0, 0.05, 20.0, 0.0, 0.1),
        ("open_async", 0.1),
    ]


def test_franky_that_does_not_answer_is_no_robot(library, monkeypatch, positions):
    module = library.MODULES["franky"]

    def refuse(*_, **__):
        raise module.NetworkException("connection timed out")

    monkeypatch.setattr(module, "Robot", refuse)
    with pytest.raises(NotFoundError, match=r"no Franka arm answers at 10\.0\.0\.2: connection timed out"):
        FrankaArm(setup(positions))


def test_ur_is_given_twists_and_watches_for_them(library, positions):
    arm = UniversalRobot(setup(positions, max_acceleration=0.7))
    assert list(arm.state().numbers) == [0.4, 0.1, 0.3, 0.0, 3.1, 0.1]
    arm.command(TWIST)
    assert (arm.event("close"), arm.event("open"), arm.event("ring")) == (False, False, False)
    arm.close()
    called = list(library.CALLS)
    assert called == [
        ("control", "10.0.0.2"),
        ("setWatchdog", 10.0),
        ("kickWatchdog",),
        ("speedL", TWIST, 0.7, 0.0),
        ("setToolDigitalOut", 0, True),
        ("setToolDigitalOut", 0, False),
        ("speedStop", 2.0),
        ("stopScript",),
        *[("disconnect",)] * 3,
    ]


def test_ur_that_takes_no_commands_is_a_fault(library, monkeypatch, positions):
    arm = UniversalRobot(setup(positions))
    monkeypatch.setattr(library.RTDEControlInterface, "taken", False)
    with pytest.raises(arm.faults, match="protective stop"):
        arm.command(TWIST)


def test_ros_takes_poses_and_gives_twists_in_their_frame(library, positions):
    robot = RosTwist(setup(positions, "/left"))
    messages = library.MODULES["geometry_msgs.msg"]
    assert robot.state() is None
    library.NODES[-1].waiting += [library.pose_message(POSE), library.pose_message(POSE)]
    first, second, third = robot.state(), robot.state(), robot.state()
    assert first.numbers == POSE
    assert first.stamp != second.stamp
    assert second.stamp == third.stamp  # nothing new came
    robot.command(TWIST)
    robot.event("close")
    robot.close()
    names = [call[0] for call in library.CALLS]
    made = ["init", "create_node", "subscribe", "publisher", "publisher"]
    assert names == [*made, "twist", "event", "destroy_node", "shutdown"]
    assert library.CALLS[0] == ("init", [], "no")  # arguments and Ctrl-C are ours
    assert library.CALLS[1] == ("create_node", "skillctl", "/left")
    assert library.CALLS[2] == ("subscribe", messages.PoseStamped, "pose", 1)
    assert library.CALLS[3] == ("publisher", messages.TwistStamped, "twist", 1)
    sent = library.CALLS[5][1]
    linear, angular = sent.twist.linear, sent.twist.angular
    assert [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z] == TWIST
    assert (sent.header.frame_id, sent.header.stamp) == ("base_link", "now")
    assert library.CALLS[6][1].data == "close"


def test_ros_poses_move_with_the_command_from_where_the_hand_is(library, positions):
    robot = RosPose(setup(positions, period=0.1))
    robot.command(TWIST)  # nothing is measured yet
    library.NODES[-1].waiting.append(library.pose_message(POSE))
    robot.state()
    for _ in range(5):
        robot.command(TWIST)
    sent = [call[1] for call in library.CALLS if call[0] == "target"]
    assert len(sent) == 5
    places = np.array([[p.x, p.y, p.z] for p in (each.pose.position for each in sent)])
    way = np.linalg.norm(TWIST[:3]) * 0.1
    expected = np.minimum(way * np.arange(1, 6), LEASH)  # it does not follow, and is not pulled from far
    np.testing.assert_allclose(np.linalg.norm(places - POSE[:3], axis=1), expected, atol=1e-12)
    turned = [2 * np.arctan2(each.pose.orientation.z, each.pose.orientation.w) for each in sent]
    np.testing.assert_allclose(turned, 0.03 * np.arange(1, 6), atol=1e-12)


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("franky", "Robot"),
        ("franky", "Gripper"),
        ("rtde_control", "RTDEControlInterface"),
        ("rtde_receive", "RTDEReceiveInterface"),
        ("rtde_io", "RTDEIOInterface"),
    ],
)
def test_the_stand_ins_have_nothing_that_the_libraries_lack(request, module, name):
    real = getattr(pytest.importorskip(module), name)
    stand_in = getattr(request.getfixturevalue("library").MODULES[module], name)
    assert {each for each in vars(stand_in) if not each.startswith("_")} - {"taken"} <= set(dir(real))
