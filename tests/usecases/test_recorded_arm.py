"""Recordings of an arm's joints: learned as positions of its hand, by the kinematics of the arm."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from skillctl.arrays import FloatArray
from skillctl.demonstrations.options import Reading
from skillctl.errors import InputDataError, NotFoundError, UsageError
from skillctl.usecases.learn import learn
from skillctl.usecases.manifest import read_manifest
from skillctl.usecases.options import Robot
from skillctl.usecases.recorded_arm import read_of

pytest.importorskip("pybullet")

# Modified Denavit-Hartenberg parameters of the Franka Panda, as its maker documents them: a, d [m], α [rad].
PANDA = (
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -math.pi / 2),
    (0.0, 0.316, math.pi / 2),
    (0.0825, 0.0, math.pi / 2),
    (-0.0825, 0.384, -math.pi / 2),
    (0.0, 0.0, math.pi / 2),
    (0.088, 0.0, math.pi / 2),
)
TOOL = 0.107 + 0.105  # [m] from the last joint to the flange, and to the point between the fingers
NAMES = tuple(f"panda_joint{i}" for i in range(1, 8))
LENGTHS = (0.4, 0.3, 0.2)  # [m], of an arm in a plane
JOINT = """<joint name="j{i}" type="revolute"><parent link="l{before}"/><child link="l{i}"/>
  <origin xyz="{x} 0 0"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="2" effort="9"/></joint>"""
LINK = """<link name="l{i}"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0"
  iyz="0"/></inertial></link>"""


def panda_hand(joints: FloatArray) -> FloatArray:
    """Return the hand's position (3,) as the parameters give it."""
    pose = np.eye(4)
    for angle, (a, d, alpha) in zip(joints, PANDA, strict=True):
        ct, st, ca, sa = math.cos(angle), math.sin(angle), math.cos(alpha), math.sin(alpha)
        pose = pose @ np.array(
            [
                [ct, -st, 0, a],
                [st * ca, ct * ca, -sa, -d * sa],
                [st * sa, ct * sa, ca, d * ca],
                [0, 0, 0, 1],
            ]
        )
    return pose[:3] @ np.array([0, 0, TOOL, 1])


def postures(samples: int = 30, seed: int = 0) -> FloatArray:
    """Return a smooth motion of the Panda's joints, (T, 7) [rad], to the same posture for all seeds."""
    end = np.array([0.1, -0.5, 0.2, -2.2, 0.1, 1.8, 0.6])
    start = end + np.random.default_rng(seed).uniform(-0.4, 0.4, 7)
    done = (1 - np.cos(np.linspace(0, np.pi, samples)))[:, None] / 2
    return start + done * (end - start)


def table(path: Path, joints: FloatArray, names: tuple[str, ...]) -> Path:
    rows = [
        ",".join(["t", *names]),
        *(f"{i / 20}," + ",".join(map(repr, r)) for i, r in enumerate(joints.tolist())),
    ]
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.fixture
def planar(tmp_path: Path) -> Path:
    """Write an arm of three links in a plane."""
    links = "".join(LINK.format(i=i) for i in range(5))
    joints = "".join(JOINT.format(i=i, before=i - 1, x=0 if i == 1 else LENGTHS[i - 2]) for i in range(1, 4))
    hand = (
        '<joint name="hand" type="fixed"><parent link="l3"/><child link="l4"/>'
        f'<origin xyz="{LENGTHS[2]} 0 0"/></joint>'
    )
    (tmp_path / "planar.urdf").write_text(f'<robot name="planar">{links}{joints}{hand}</robot>')
    return tmp_path / "planar.urdf"


def planar_hand(joints: FloatArray) -> FloatArray:
    """Return the hand's positions (T, 3) of the planar arm."""
    angles = np.cumsum(joints, axis=1)
    x, y = (np.sum(LENGTHS * turned(angles), axis=1) for turned in (np.cos, np.sin))
    return np.stack([x, y, 0 * x], axis=1)


def test_the_hand_of_the_panda_is_where_its_maker_says(tmp_path) -> None:
    joints = postures()
    path = table(tmp_path / "reach.csv", joints, NAMES)
    read = read_of(Robot(arm="panda"), Reading(units="rad"), [path])
    (demonstration,) = read.demonstrations
    # Bullet computes with doubles, but reads π/2 from the file with fewer digits.
    assert np.abs(demonstration.positions - [panda_hand(posture) for posture in joints]).max() < 1e-5
    space = read.demonstrations.space
    assert (space.names, space.unit) == (("x", "y", "z"), "m")
    assert "positions are of panda_grasptarget, from the base of the arm panda." in read.notes


def test_joints_are_taken_by_name_in_any_order(tmp_path) -> None:
    joints, order = postures(), [3, 0, 6, 1, 5, 2, 4]
    shuffled = table(tmp_path / "shuffled.csv", joints[:, order], tuple(NAMES[i] for i in order))
    plain = table(tmp_path / "plain.csv", joints, NAMES)
    read = [read_of(Robot(arm="panda"), Reading(units="rad"), [path]) for path in (shuffled, plain)]
    first, second = (each.demonstrations.demonstrations[0].positions for each in read)
    assert (first == second).all()


def test_an_arm_by_file_is_a_source(tmp_path, planar) -> None:
    joints = postures()[:, :3]
    path = table(tmp_path / "reach.csv", joints, ("a", "b", "c"))
    read = read_of(Robot(arm=str(planar)), Reading(units="rad"), [path])
    assert np.abs(read.demonstrations.demonstrations[0].positions - planar_hand(joints)).max() < 1e-6
    assert [(source.path, source.importer) for source in read.sources] == [(path, "csv"), (planar, "urdf")]
    elbow = read_of(Robot(arm=str(planar), tip="l3"), Reading(units="rad"), [path])
    shorter = planar_hand(joints) - elbow.demonstrations.demonstrations[0].positions
    assert np.abs(np.linalg.norm(shorter, axis=1) - LENGTHS[2]).max() < 1e-6


@pytest.mark.parametrize(
    ("change", "columns", "words", "hint"),
    [
        (lambda q: q[:, :6], NAMES[:6], "6 columns", "--columns"),
        (
            lambda q: q + 4 * np.eye(7)[3],
            NAMES,
            "sample|line 2: joint panda_joint4 is at",
            "the order of the",
        ),
        (np.degrees, NAMES, "joint panda_joint", "--units deg"),
    ],
)
def test_what_cannot_be_this_arm_is_refused(tmp_path, change, columns, words: str, hint: str) -> None:
    path = table(tmp_path / "reach.csv", change(postures()), columns)
    with pytest.raises(InputDataError, match=words) as error:
        read_of(Robot(arm="panda"), Reading(units="rad"), [path])
    assert hint in error.value.hint


def test_a_tip_needs_an_arm_and_an_arm_has_to_exist(tmp_path) -> None:
    with pytest.raises(UsageError, match="tip"):
        Robot(tip="hand")
    with pytest.raises(NotFoundError, match="no such arm"):
        read_of(Robot(arm=str(tmp_path / "nowhere.urdf")), Reading(), [tmp_path / "reach.csv"])


def test_the_file_of_an_arm_lies_beside_its_manifest(tmp_path, planar) -> None:
    table(tmp_path / "reach.csv", postures()[:, :3], ("a", "b", "c"))
    (manifest := tmp_path / "skills.toml").write_text(
        "[options]\narm = 'planar.urdf'\n"
        "[[skills]]\nname = 'a'\ndata = 'reach.csv'\n"
        "[[skills]]\nname = 'b'\ndata = 'reach.csv'\narm = 'panda'\n"
    )
    by_file, by_name = (entry.request(tmp_path, False).robot for entry in read_manifest(manifest))
    assert by_file.files == (planar,)
    assert by_file.recorded() == {"arm": "planar.urdf"}
    assert (by_name.arm, by_name.files) == ("panda", ())


def test_a_skill_of_the_hand_is_learned_again_when_the_arm_changes(tmp_path, planar) -> None:
    paths = [table(tmp_path / f"{i}.csv", postures(seed=i)[:, :3], ("a", "b", "c")) for i in range(3)]
    made = {"output": tmp_path / "hand.h5", "reading": Reading(units="rad"), "robot": Robot(arm=str(planar))}
    report = learn(paths, **made)
    assert (report.dimension, report.unit) == (3, "m")
    assert np.abs(report.attractor - planar_hand(postures()[-1:, :3])[0]).max() < 1e-6
    assert learn(paths, **made).status == "up to date"
    planar.write_text(planar.read_text().replace('xyz="0.4 0 0"', 'xyz="0.5 0 0"'))
    assert learn(paths, **made).status == "learned"
