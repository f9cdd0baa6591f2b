"""Arms by file simulate what the file says: masses, inertias, followers, the hand, the meshes."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from skillctl.errors import InputDataError, UsageError
from skillctl.model.seds import SedsSkill
from skillctl.simulation.arm import ArmBody
from skillctl.simulation.arms import ArmModel
from skillctl.simulation.check import check
from skillctl.simulation.hand import arm_ends, hand_frame
from skillctl.simulation.robot_file import read_robot
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.urdf import find_arm

Write = Callable[..., Path]
LIMIT = '<limit lower="-2" upper="1.5" effort="80" velocity="2.5"/>'
BODY = (
    '<inertial><origin xyz="0 0 .1"/><mass value="1"/>'
    '<inertia ixx=".02" iyy=".02" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def link(name: str, inside: str = BODY) -> str:
    return f'<link name="{name}">{inside}</link>'


def joint(
    name: str,
    parent: str,
    child: str,
    kind: str = "revolute",
    axis: str = "0 1 0",
    more: str = LIMIT,
    at: str = "0 0 .2",
) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}"/><axis xyz="{axis}"/>{more}</joint>'
    )


def chain(names: Sequence[str], *, start: str = "base") -> str:
    """Describe links l1, l2, … on joints with these names; every other axis is upright."""
    links = [start, *(f"l{i + 1}" for i in range(len(names)))]
    return "".join(
        link(child) + joint(name, parent, child, axis="0 0 1" if i % 3 == 0 else "0 1 0")
        for i, (name, parent, child) in enumerate(zip(names, links[:-1], links[1:], strict=True))
    )


ARM = link("base") + chain([f"j{i + 1}" for i in range(6)])


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def make(inside: str, name: str = "robot.urdf") -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'<robot name="r">{inside}</robot>')
        return path

    return make


def masses(arm: ArmModel) -> dict[str, tuple[float, tuple[float, ...]]]:
    with ArmBody(arm, 0.0, shapes="collision") as body:
        infos = [body.bullet.getDynamicsInfo(body.body, i) for i in range(len(body.link_names()))]
        return {name: (info[0], info[2]) for name, info in zip(body.link_names(), infos, strict=True)}


def test_a_link_without_inertial_weighs_nothing(write: Write) -> None:
    frames = link("tool0", "") + joint("f", "l6", "tool0", "fixed")
    assert masses(find_arm(str(write(ARM + frames))))["tool0"] == (0.0, (0.0, 0.0, 0.0))


def test_inertias_are_those_of_the_file_whatever_the_shapes(write: Write) -> None:
    shape = '<collision><geometry><box size="1 1 1"/></geometry></collision>'
    turned = BODY.replace('ixy="0"', 'ixy=".003"')
    path = write(ARM.replace(link("l6"), link("l6", BODY + shape)).replace(link("l5"), link("l5", turned)))
    found = masses(find_arm(str(path)))
    assert found["l6"] == (1.0, (0.02, 0.02, 0.01))
    # The principal moments of [[.02, .003], [.003, .02]] are .023 and .017.
    assert sorted(found["l5"][1]) == pytest.approx([0.01, 0.017, 0.023])


@pytest.mark.parametrize(
    ("inside", "mass", "moments", "said"),
    [
        ("", 0.01, [1.6e-6] * 3, "moves and has no mass"),  # a ball: 2/5 m r²
        ('<inertial><mass value="2"/></inertial>', 2.0, [3.2e-4] * 3, "gives no inertia"),
        (BODY.replace('ixx=".02"', 'ixx="-.02"'), 1.0, [1.6e-4] * 3, "impossible inertia"),
        (BODY.replace('izz=".01"', 'izz=".09"'), 1.0, [0.02, 0.02, 0.04], "a moment above the sum"),
    ],
)
def test_what_cannot_be_taken_from_the_file_is_said(
    write: Write, inside: str, mass: float, moments: list[float], said: str
) -> None:
    arm = find_arm(str(write(ARM.replace(link("l6"), link("l6", inside)))))
    assert [note for note in arm.notes if said in note and "l6" in note]
    found = masses(arm)["l6"]
    assert found[0] == mass
    assert sorted(found[1]) == pytest.approx(moments, rel=1e-5)  # a millionth inside of the inequality


def test_a_mass_below_zero_is_refused(write: Write) -> None:
    with pytest.raises(InputDataError, match="gives link l6 an impossible mass"):
        find_arm(str(write(ARM.replace(link("l6"), link("l6", BODY.replace('"1"', '"-1"'))))))


def test_the_torque_that_carries_the_arm_is_that_of_its_masses(write: Write) -> None:
    arm = find_arm(str(write(ARM)))
    with ArmBody(arm, 0.0) as body:
        torques = body.carrying(np.array([0.0, math.pi / 2, 0.0, 0.0, 0.0, 0.0]))
    # Lying along x from joint 2 on, with centres of mass 0.1, 0.3, 0.5, 0.7 and 0.9 m away, 1 kg each.
    assert abs(torques[1]) == pytest.approx(9.81 * (0.1 + 0.3 + 0.5 + 0.7 + 0.9))
    assert torques[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_held_joint_stays_and_the_rest_is_the_arm(write: Write, kind: str) -> None:
    # The axis and the origin are oblique, so that a wrong order of rotations shows.
    torso = joint("torso", "base", "t", kind, "1 2 2").replace(
        '<origin xyz="0 0 .2"/>', '<origin xyz=".1 0 .2" rpy=".3 -.4 .5"/>'
    )
    rest = link("t") + chain([f"j{i + 1}" for i in range(6)], start="t")
    path = str(write(link("base") + torso + rest))
    held, free = find_arm(path, hold=(("torso", 0.3),)), find_arm(path)
    assert (held.n_joints, free.n_joints) == (6, 7)
    assert held.held == (("torso", 0.3),)
    q = np.array([0.2, -0.5, 0.4, 0.3, -0.7, 0.1])
    with ArmBody(held, 0.0) as one, ArmBody(free, 0.0) as other:
        one.pose(q)
        other.pose(np.array([0.3, *q]))
        assert one.hand()[0] == pytest.approx(other.hand()[0], abs=1e-9)


@pytest.mark.parametrize(
    ("hold", "said"), [(("jx", 0.0), "no moving joint 'jx'"), (("j2", 9.0), "between -2 and 1.5, not 9")]
)
def test_what_cannot_be_held_is_refused(write: Write, hold: tuple[str, float], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        find_arm(str(write(ARM)), hold=(hold,))


MIMIC = '<mimic joint="{}" multiplier="-2" offset=".1"/>'


def mimicking(name: str, master: str) -> str:
    follows = joint(name, "l2", "l3").replace(LIMIT, LIMIT + MIMIC.format(master))
    return ARM.replace(joint(name, "l2", "l3"), follows)


def test_a_joint_that_follows_another_is_no_joint_of_its_own(write: Write) -> None:
    path = str(write(mimicking("j3", "j2")))
    with pytest.raises(InputDataError, match="between base and hand, j3, that mimics another, j2"):
        find_arm(path)
    arm = find_arm(path, hold=(("j2", 0.2),))
    assert dict(arm.held) == {"j2": 0.2, "j3": pytest.approx(-2 * 0.2 + 0.1)}
    with pytest.raises(UsageError, match="hold: joint j3 mimics j2"):
        find_arm(path, hold=(("j3", 0.2),))


def test_followers_of_followers_stay_with_them(write: Write) -> None:
    follows = joint("j4", "l3", "l4", axis="0 0 1")
    inside = mimicking("j3", "j2").replace(
        follows, follows.replace(LIMIT, LIMIT + '<mimic joint="j3" multiplier="3" offset=".2"/>')
    )
    arm = find_arm(str(write(inside)), hold=(("j2", 0.05),))
    assert dict(arm.held)["j4"] == pytest.approx(3 * (-2 * 0.05 + 0.1) + 0.2)


@pytest.mark.parametrize("masters", [("j3", "j1"), ("j4", "j3")])
def test_joints_that_follow_each_other_are_refused(write: Write, masters: tuple[str, str]) -> None:
    inside = ARM
    for name, parent, child, axis, master in (
        ("j3", "l2", "l3", "0 1 0", masters[0]),
        ("j4", "l3", "l4", "0 0 1", masters[1]),
    ):
        alone = joint(name, parent, child, axis=axis)
        inside = inside.replace(alone, alone.replace(LIMIT, LIMIT + f'<mimic joint="{master}"/>'))
    with pytest.raises(InputDataError, match="mimics itself"):
        find_arm(str(write(inside)))


def test_a_follower_beside_the_arm_stays_and_this_is_said(write: Write) -> None:
    bellows = link("bellows") + joint("b", "l2", "bellows", more=LIMIT + MIMIC.format("j2"))
    arm = find_arm(str(write(ARM + bellows)))
    assert arm.n_joints == 6
    assert "joint b mimics j2" in arm.notes[0]


@pytest.mark.parametrize("ends", ['lower="0" upper="0"', 'lower="-0.3" upper="0.3"'])
def test_what_the_check_tells_of_an_arm_by_file_is_what_happens(
    write: Write, linear: Callable[..., SedsSkill], ends: str
) -> None:
    """Bullet enforces the limits of continuous joints, so the run could not do what the check promised."""
    free = f'<limit {ends} effort="80" velocity="2.5"/>'
    inside = ARM
    for name, parent, child in (("j1", "base", "l1"), ("j4", "l3", "l4")):
        limited = joint(name, parent, child, axis="0 0 1")
        inside = inside.replace(limited, joint(name, parent, child, "continuous", "0 0 1", free))
    scenario = Scenario(arm=str(write(inside)), start=(0.1, 0.5, 0.5), hand="free", base_yaw=0.0)
    skill = linear((0.5, 0.1, 0.5))
    told, happened = check(skill, scenario), simulate(skill, scenario)
    assert inside != ARM
    assert told.reachable
    assert happened.success
    assert np.abs(happened.series.joints[:, 0]).max() > 0.5  # beyond what is written
    assert told.joint_margin == pytest.approx(happened.metrics.joint_margin, abs=0.01)
    assert told.torque_ratio == pytest.approx(happened.metrics.torque_ratio, rel=0.2)


def fixed(parent: str, *frames: str) -> str:
    return "".join(link(frame, "") + joint(f"{frame}_fixed", parent, frame, "fixed") for frame in frames)


def moving(name: str, parent: str, child: str, kind: str = "revolute", reach: float = 0.04) -> str:
    limit = f'<limit lower="0" upper="{reach}" effort="5" velocity="1"/>'
    return link(child) + joint(name, parent, child, kind, more=limit)


NAMES = ("j1", "j2", "j3", "j4", "j5", "j6")
SEVEN = link("base") + chain([f"j{i}" for i in range(7)])


@pytest.mark.parametrize(
    ("inside", "end", "hand"),
    [
        (ARM, "l6", "l6"),
        (ARM + moving("jaw_j", "l6", "jaw"), "l6", "l6"),
        (
            ARM + moving("gripper", "l6", "moving_jaw") + fixed("l6", "gripper_frame_link"),
            "l6",
            "gripper_frame_link",
        ),
        (ARM + moving("j7", "l6", "l7") + fixed("l6", "gripper_frame_link"), "l6", "gripper_frame_link"),
        (ARM + moving("j7", "l6", "l7", "prismatic"), "l6", "l6"),
        (ARM + moving("j7", "l6", "l7", "prismatic", 0.4), "l7", "l7"),
        (ARM + moving("a", "l6", "f1", "prismatic") + moving("b", "l6", "f2", "prismatic"), "l6", "l6"),
        # Fingers of two joints each beside the frame between them, as on a Kinova
        (
            ARM
            + fixed("l6", "end_effector")
            + moving("k1", "l6", "f1")
            + moving("k2", "f1", "f1_tip")
            + moving("m1", "l6", "f2")
            + moving("m2", "f2", "f2_tip"),
            "l6",
            "end_effector",
        ),
        (
            SEVEN + fixed("l7", "end_effector_link", "camera_link", "camera_color_frame"),
            "l7",
            "end_effector_link",
        ),
        (ARM + fixed("l6", "flange") + fixed("flange", "tool0") + fixed("l6", "ft_frame"), "l6", "tool0"),
        (
            ARM
            + fixed("l6", "flange")
            + fixed("flange", "tool0")
            + fixed("tool0", "camera_link")
            + fixed("camera_link", "tcp"),
            "l6",
            "tcp",
        ),
        (ARM + fixed("l6", "gripper_base", "gripper_fingertip", "gripper_cover"), "l6", "gripper_base"),
        (ARM + fixed("l6", "gripper_base") + fixed("gripper_base", "right_gripper"), "l6", "right_gripper"),
        (ARM + fixed("l6", "plate") + fixed("plate", "camera_link"), "l6", "plate"),
        # A mobile base with a torso, a head and wheels
        (
            link("base")
            + link("torso")
            + joint("lift", "base", "torso", "prismatic")
            + chain(NAMES, start="torso")
            + moving("head_pan", "torso", "neck")
            + moving("head_tilt", "neck", "head")
            + moving("wheel_l", "base", "wl")
            + moving("wheel_r", "base", "wr"),
            "l6",
            "l6",
        ),
        # A wrist whose link is called a jaw, as on an SO-100
        (
            link("base")
            + chain(("a", "b", "c", "d"))
            + moving("Wrist_Roll", "l4", "Fixed_Jaw", reach=3.0)
            + moving("Jaw", "Fixed_Jaw", "Moving_Jaw"),
            "Fixed_Jaw",
            "Fixed_Jaw",
        ),
    ],
)
def test_the_hand_is_chosen_as_a_person_would(write: Write, inside: str, end: str, hand: str) -> None:
    robot = read_robot(write(inside))
    assert arm_ends(robot, {}) == [end]
    assert hand_frame(robot, end, {}) == hand


def test_a_held_jaw_is_no_hand_and_a_held_wrist_carries_it(write: Write) -> None:
    inside = ARM + moving("jaw_j", "l6", "jaw") + fixed("l6", "plate")
    assert find_arm(str(write(inside)), hold=(("jaw_j", 0.02),)).tip_link == "l6"
    arm = find_arm(str(write(ARM + fixed("l6", "tool0"))), hold=(("j6", 0.3),))
    assert (arm.n_joints, arm.tip_link) == (5, "tool0")


def test_two_equal_arms_are_a_question(write: Write) -> None:
    left = chain(NAMES).replace('"j', '"left_j').replace('"l', '"left_l')
    with pytest.raises(InputDataError, match="2 arms of equal length") as refusal:
        find_arm(str(write(ARM + left)))
    assert "--tip: l6, left_l6" in refusal.value.hint


@pytest.mark.parametrize(
    ("inside", "said"),
    [
        (link("base") + link("other"), "2 base links"),
        (ARM + joint("again", "l1", "l3"), "two joints for l3"),
        (ARM + joint("lost", "l6", "nowhere"), "at a link nowhere that does not exist"),
        (link("base") + link("a") + link("b") + joint("x", "a", "b") + joint("y", "b", "a"), "form a loop"),
    ],
)
def test_what_is_no_tree_is_refused(write: Write, inside: str, said: str) -> None:
    with pytest.raises(InputDataError, match=said):
        find_arm(str(write(inside)))


TRIANGLE = (
    bytes(80)
    + (1).to_bytes(4, "little")
    + np.array([0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0], "<f4").tobytes()
    + b"\0\0"
)
ASCII = (
    b"solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    * 3
)


def shaped(name: str) -> str:
    shape = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
    return ARM.replace(link("l6"), link("l6", BODY + shape))


@pytest.mark.parametrize(
    ("name", "at", "variable"),
    [
        ("m.stl", "robots/m.stl", None),
        ("meshes\\m.stl", "robots/meshes/m.stl", None),
        ("package://robots/meshes/m.stl", "robots/meshes/m.stl", None),
        ("package://arm_description/meshes/m.stl", "robots/arm_description/meshes/m.stl", None),
        ("package://arm_description/m.stl", "ws/arm_description/m.stl", ("ROS_PACKAGE_PATH", "ws")),
        ("package://arm_description/m.stl", "ws/src/arm_description/m.stl", ("ROS_PACKAGE_PATH", "ws")),
        ("package://arm_description/m.stl", "ws/share/arm_description/m.stl", ("AMENT_PREFIX_PATH", "ws")),
    ],
)
def test_meshes_are_found(
    write: Write,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    at: str,
    variable: tuple[str, str] | None,
) -> None:
    for each in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(each, raising=False)
    if variable is not None:
        monkeypatch.setenv(variable[0], str(tmp_path / variable[1]))
    mesh = tmp_path / at
    mesh.parent.mkdir(parents=True, exist_ok=True)
    mesh.write_bytes(TRIANGLE)
    arm = find_arm(str(write(shaped(name), "robots/robot.urdf")))
    assert str(mesh) in arm.text


@pytest.mark.parametrize(
    ("name", "content", "said", "hint"),
    [
        ("m.stl", ASCII, "'m.stl', which is an ASCII STL file; Bullet reads binary STL only", "MeshLab"),
        ("m.stl", b"version https://git-lfs.github.com/spec/v1\n", "a Git LFS pointer", "git lfs pull"),
        ("m.stl", TRIANGLE[:-9], "no STL file, or is cut off", "again"),
        ("m.stl", b"", "which is empty", "again"),
        ("m.ply", b"ply\n", "which Bullet does not read", ".stl, .obj, .dae"),
        ("M.STL", None, "'M.STL', which is missing", "There is m.stl: upper and lower case count"),
        ("package://lost/m.stl", None, "which is missing", "ROS_PACKAGE_PATH"),
        ("http://example.org/m.stl", None, "not on this machine", "Download"),
    ],
)
def test_a_mesh_is_said_for_what_it_is(
    write: Write, tmp_path: Path, name: str, content: bytes | None, said: str, hint: str
) -> None:
    (tmp_path / (name if content is not None else "m.stl")).write_bytes(
        TRIANGLE if content is None else content
    )
    with pytest.raises(InputDataError) as refusal:
        find_arm(str(write(shaped(name))))
    assert said in str(refusal.value)
    assert hint in refusal.value.hint


PICTURED = b"mtllib %s\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nusemtl m\nf 1//1 2//1 3//1\n"


@pytest.fixture
def elsewhere(tmp_path: Path) -> Path:
    """A folder with a mesh, materials and pictures, of which no URDF file is told."""
    (folder := tmp_path / "elsewhere").mkdir()
    (folder / "m.stl").write_bytes(TRIANGLE)
    (folder / "m.mtl").write_text("newmtl m\n")
    (folder / "m.png").write_bytes(b"\x89PNG\r\n")
    (folder / "data").mkdir()
    (folder / "data" / "d.png").write_bytes(b"\x89PNG\r\n")
    return folder


@pytest.mark.parametrize(
    "name", ["{0}/m.stl", "file://{0}/m.stl", "../elsewhere/m.stl", "package://elsewhere/m.stl", "link.stl"]
)
def test_meshes_outside_of_the_package_are_read_if_that_is_told(
    write: Write, elsewhere: Path, name: str
) -> None:
    path = write(shaped(name.format(elsewhere)), "robots/robot.urdf")
    (path.parent / "link.stl").symlink_to(elsewhere / "m.stl")
    said = f"which is {elsewhere}/m.stl, outside of {path.parent}"
    with pytest.raises(InputDataError, match=said) as refusal:
        find_arm(str(path))
    assert f"--package {elsewhere}" in refusal.value.hint
    assert f'"{elsewhere}/m.stl"' in find_arm(str(path), packages=(str(elsewhere),)).text


@pytest.mark.parametrize("name", ["../meshes/m.stl", "package://arm/meshes/m.stl"])
def test_a_package_is_the_folder_of_its_manifest(write: Write, tmp_path: Path, name: str) -> None:
    path = write(shaped(name), "arm/urdf/robot.urdf")
    (tmp_path / "arm" / "meshes").mkdir()
    (tmp_path / "arm" / "meshes" / "m.stl").write_bytes(TRIANGLE)
    with pytest.raises(InputDataError, match=r"outside of .*/arm/urdf"):
        find_arm(str(path))
    (tmp_path / "arm" / "package.xml").write_text("<package/>")
    path.write_text(path.read_text() + "\n")  # what was refused is not remembered, but what is read may be
    assert str(tmp_path / "arm" / "meshes" / "m.stl") in find_arm(str(path)).text


@pytest.mark.parametrize(
    ("materials", "picture", "said"),
    [
        (b"../elsewhere/m.mtl", b"", "'m.obj, with ../elsewhere/m.mtl', which is {0}/m.mtl, outside of"),
        (b"/../elsewhere/m.mtl", b"", "which is {0}/m.mtl, outside of"),
        (b"link.mtl", b"", "'m.obj, with link.mtl', which is {0}/m.mtl, outside of"),
        (b"own.mtl", b"map_Kd ../elsewhere/m.png\n", "which is {0}/m.png, outside of"),
        (b"own.mtl", b"#" * 1023 + b"map_Kd ../elsewhere/m.png \r\n", "which is {0}/m.png, outside of"),
        (b"own.mtl", b"map_Kd m.png\n", "which is {0}/m.png, outside of"),  # in the working directory
        (b"own.mtl", b"map_Kd d.png\n", "which is {0}/data/d.png, outside of"),
        (b"m" * 300, b"", "which names no file"),
        (b"none.mtl", b"", None),
        (b"own.mtl", b"map_Kd none.png\n", None),
        (b"own.mtl", b"# map_Kd m.png\nKd 1 0 0\n", None),
        (b"own.mtl", b"map_Kd own.png\n", None),
    ],
)
def test_what_a_mesh_names_lies_in_the_package(
    write: Write,
    elsewhere: Path,
    monkeypatch: pytest.MonkeyPatch,
    materials: bytes,
    picture: bytes,
    said: str | None,
) -> None:
    monkeypatch.chdir(elsewhere)
    path = write(shaped("m.obj"), "robots/robot.urdf")
    (path.parent / "m.obj").write_bytes(PICTURED % materials)
    (path.parent / "own.mtl").write_bytes(b"newmtl m\n" + picture)
    (path.parent / "own.png").write_bytes(b"\x89PNG\r\n")
    (path.parent / "link.mtl").symlink_to(elsewhere / "m.mtl")
    if said is None:
        assert find_arm(str(path)).n_joints == 6
        return
    with pytest.raises(InputDataError, match=said.format(elsewhere)):
        find_arm(str(path))


def test_the_picture_of_a_material_of_the_file_is_not_read(write: Write) -> None:
    arm = find_arm(str(write('<material name="m"><texture filename="/etc/passwd"/></material>' + ARM)))
    assert "passwd" not in arm.text


OPENS = "import sys; from skillctl.simulation.urdf import find_arm; find_arm(sys.argv[1])"


@pytest.mark.skipif(shutil.which("strace") is None, reason="sees with strace which files are opened")
def test_bullet_opens_nothing_outside_of_the_package(write: Write, elsewhere: Path, tmp_path: Path) -> None:
    """Our scan of a mesh and Bullet's reader could disagree about what the mesh names."""
    meshes = "".join(
        f'<visual><geometry><mesh filename="{name}.obj"/></geometry></visual>' for name in ("m", "n")
    )
    path = write(ARM.replace(link("l6"), link("l6", BODY + meshes)), "robots/robot.urdf")
    (path.parent / "m.obj").write_bytes(PICTURED % b"own.mtl")
    (path.parent / "n.obj").write_bytes(PICTURED % f"{elsewhere}/m.mtl".encode())  # is not found there
    (path.parent / "own.mtl").write_bytes(
        b"newmtl m\n# map_Kd m.png\nmap_Ka ../elsewhere/m.png\nmap_Kd own.png\n"
    )
    (path.parent / "own.png").write_bytes(b"\x89PNG\r\n")
    log = tmp_path / "log"
    command = ["strace", "-f", "-e", "trace=open,openat", "-o", log, sys.executable, "-c", OPENS, path]
    subprocess.run(command, cwd=elsewhere, check=True)
    opened = [line for line in log.read_text().splitlines() if "ENOENT" not in line]
    assert [line for line in opened if f'"{path.parent}/own.png"' in line]
    assert not [line for line in opened if re.search(r"/?elsewhere/|\bm\.(png|mtl|stl)", line)]


def test_a_template_is_said_for_what_it_is(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(f'<robot name="r">{ARM}</robot>')
    with pytest.raises(InputDataError, match="is a xacro template") as refusal:
        find_arm(str(path))
    assert refusal.value.hint == f"Expand it, with ROS: xacro {path} > {tmp_path / 'arm.urdf'}"


def test_other_formats_and_entities_are_refused(tmp_path: Path) -> None:
    for text, said in (
        ('<mujoco model="m"/>', "holds <mujoco>, a MuJoCo model,"),
        ('<!DOCTYPE r [<!ENTITY a "b">]><robot name="r"/>', "defines entities"),
    ):
        (tmp_path / "m.urdf").write_text(text)
        with pytest.raises(InputDataError, match=said):
            find_arm(str(tmp_path / "m.urdf"))
