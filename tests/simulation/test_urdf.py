"""Arms by path: what the file says counts, and a file that crashes its reader crashes no more than that."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

import pybullet_data

from skillctl.errors import InputDataError, NotFoundError, UsageError
from skillctl.simulation.arm import ArmBody
from skillctl.simulation.arms import ARMS
from skillctl.simulation.ik import Kinematics
from skillctl.simulation.urdf import find_arm
from skillctl.workers.child import ChildDiedError

BUNDLED = Path(pybullet_data.getDataPath())
LIMIT = '<limit lower="-2" upper="1.5" effort="80" velocity="2.5"/>'
AXES = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")
Write = Callable[..., Path]


def robot(*, joints: int = 6, kind: str = "revolute", limit: str = LIMIT, shape: str = "") -> str:
    """Describe a chain of links, 0.2 m apart, ``shape`` on the last."""
    inertia = '<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/>'
    inertial = f'<inertial><mass value="1"/>{inertia}</inertial>'
    parts = [f'<link name="base">{inertial}</link>']
    for i in range(joints):
        parts.append(f'<link name="l{i}">{inertial}{shape if i == joints - 1 else ""}</link>')
        parts.append(
            f'<joint name="j{i}" type="{kind}"><parent link="{f"l{i - 1}" if i else "base"}"/>'
            f'<child link="l{i}"/><origin xyz="0 0 0.2"/><axis xyz="{AXES[i]}"/>{limit}</joint>'
        )
    return f'<robot name="r">{"".join(parts)}</robot>'


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def make(text: str) -> Path:
        path = tmp_path / "robot.urdf"
        path.write_text(text)
        return path

    return make


def mesh(kind: str, name: str) -> str:
    return f'<{kind}><geometry><mesh filename="{name}"/></geometry></{kind}>'


def test_limits_are_those_of_the_file(write: Write) -> None:
    arm = find_arm(str(write(robot())))
    assert set(arm.lower) == {-2}
    assert set(arm.upper) == {1.5}
    assert set(arm.max_velocity) == {2.5}
    assert set(arm.max_torque) == {80}
    assert arm.indices == tuple(range(6))
    assert set(arm.home) == {-0.25}  # mid-range


@pytest.mark.parametrize("ends", ["", 'lower="0" upper="0"', 'lower="-0.3" upper="0.3"'])
def test_a_joint_without_end_has_no_limits_whatever_is_written(write: Write, ends: str) -> None:
    arm = find_arm(str(write(robot(kind="continuous", limit=f'<limit {ends} effort="80" velocity="1"/>'))))
    assert set(arm.lower) == {-math.inf}
    assert set(arm.upper) == {math.inf}
    with ArmBody(arm, 0.0) as body:
        first, bullet = arm.indices[0], body.bullet
        bullet.setJointMotorControl2(body.body, first, bullet.POSITION_CONTROL, targetPosition=8.0, force=80)
        for _ in range(2000):
            bullet.stepSimulation()
        assert bullet.getJointState(body.body, first)[0] == pytest.approx(8.0, abs=1e-6)


def test_a_known_arm_by_path_has_its_hand_before_the_gripper() -> None:
    arm = find_arm(str(BUNDLED / "franka_panda/panda.urdf"))
    assert arm.indices == ARMS["panda"].indices
    assert arm.held == (("panda_finger_joint1", 0.0), ("panda_finger_joint2", 0.0))
    assert arm.max_torque == ARMS["panda"].max_torque
    named = find_arm(str(BUNDLED / "franka_panda/panda.urdf"), tip="panda_grasptarget")
    assert named.tip == ARMS["panda"].tip


def test_an_arm_by_path_is_ready_with_its_hand_as_asked() -> None:
    arm = find_arm(str(BUNDLED / "xarm/xarm6_robot.urdf"))
    assert (arm.indices, arm.tip) == (ARMS["xarm6"].indices, ARMS["xarm6"].tip)
    with ArmBody(arm, 0.0, shapes="none") as body:
        kinematics = Kinematics(body, "horizontal", 0.0)
        point = kinematics.forward(kinematics.home)
        assert point[0] > 0.1
        assert kinematics.search(point).joints == pytest.approx(kinematics.home, abs=1e-2)


def test_joints_beyond_the_tip_are_held(write: Write) -> None:
    arm = find_arm(str(write(robot())), tip="l3")
    assert arm.indices == (0, 1, 2, 3)
    assert arm.held == (("j4", 0.0), ("j5", 0.0))


def test_a_home_is_taken_as_given(write: Write) -> None:
    home = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    assert tuple(find_arm(str(write(robot())), home=home).home) == home


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is no XML"),
        (robot()[:-20], "is no XML"),
        ("<sdf/>", "holds <sdf>"),
        (robot(joints=0), "has no joint that moves"),
        (robot(joints=2), "2 moving joints; a hand needs at least 3"),
        (robot(limit=""), "gives joint j0 no lower and upper limit"),
        (robot(limit='<limit effort="8" velocity="1"/>'), "gives joint j0 no lower and upper limit"),
        (robot(limit='<limit lower="-1" upper="1" velocity="1"/>'), "joint j0 has no effort limit"),
        (robot(limit='<limit lower="-1" upper="1" effort="1"/>'), "joint j0 has no velocity limit"),
        (robot(limit='<limit lower="nan" upper="1" effort="1" velocity="1"/>'), "gives joint j0 no lower"),
        (robot(limit='<limit lower="1" upper="-1" effort="1" velocity="1"/>'), "joint j0 has no range"),
        (robot(kind="floating", limit=""), "a joint j0 of the type floating"),
        (robot(shape=mesh("collision", "absent.obj")), "refers to 'absent.obj'"),
    ],
)
def test_a_file_that_is_no_arm_is_refused_in_a_sentence(write: Write, text: str, said: str) -> None:
    path = write(text)
    with pytest.raises(InputDataError, match=said) as refusal:
        find_arm(str(path))
    assert str(refusal.value).startswith(f"{path}: ")
    assert refusal.value.hint
    assert "\n" not in str(refusal.value) + refusal.value.hint


@pytest.mark.parametrize("kind", ["visual", "collision"])
def test_a_mesh_that_crashes_its_reader_is_refused(write: Write, kind: str) -> None:
    path = write(robot(shape=mesh(kind, "bad.obj")))
    (path.parent / "bad.obj").write_text("v 0 0 0\nv 1 0 0\nf 1 2 99999999\n")  # vertices that are not there
    with pytest.raises(InputDataError, match="ends with SIGSEGV"):
        find_arm(str(path))


def test_what_does_not_fit_the_arm_is_refused(write: Write) -> None:
    path = str(write(robot()))
    with pytest.raises(NotFoundError, match="no such arm") as missing:
        find_arm(str(Path(path).with_name("absent.urdf")))
    assert "panda, iiwa, xarm6" in missing.value.hint
    with pytest.raises(UsageError, match="no link 'l33'") as wrong:
        find_arm(path, tip="l33")
    assert "Did you mean l3?" in wrong.value.hint
    with pytest.raises(UsageError, match="expected 6 numbers"):
        find_arm(path, home=(0.0, 0.0))
    with pytest.raises(UsageError, match=r"joint j5 can be between -2 and 1\.5, not 3"):
        find_arm(path, home=(0.0, 0.0, 0.0, 0.0, 0.0, 3.0))
    with pytest.raises(UsageError, match="tip: the arm panda has its own"):
        find_arm("panda", tip="panda_hand")


def test_a_changed_file_is_read_again(write: Write) -> None:
    path = write(robot())
    assert find_arm(str(path)) is find_arm(str(path))
    path.write_text(robot(limit=LIMIT.replace("80", "70")))
    assert (np.asarray(find_arm(str(path)).max_torque) == 70).all()


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (TimeoutError(), "takes longer than 60 s to load"),
        (
            ChildDiedError("ends with status 3"),
            r"cannot be loaded \(the process that tries ends with status 3\)",
        ),
        (MemoryError(), r"cannot be loaded \(no memory is left\)"),
        (ValueError("odd mesh"), r"cannot be loaded \(odd mesh\)"),
    ],
)
def test_a_file_that_ends_its_reader_is_refused(
    write: Write, monkeypatch: pytest.MonkeyPatch, error: Exception, words: str
) -> None:
    def call(*_: object) -> object:
        raise error

    path = write(robot())
    monkeypatch.setattr("skillctl.workers.child.Child.call", call)
    with pytest.raises(InputDataError, match=words):
        find_arm(str(path))
