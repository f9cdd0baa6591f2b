"""An arm in a file on the command line: what is printed of it, and what is said where it cannot be used."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx=".02" iyy=".02" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>'
)
AXES = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 1 0")
SHORT = ("--max-duration", "0.1", "--hand", "free")


@pytest.fixture
def jaw(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The relative path of an arm of six joints, whose last link carries a jaw."""
    parts = [f'<link name="base">{INERTIAL}</link>']
    for i, axis in enumerate(AXES, start=1):
        name, parent = (f"l{i}", f"l{i - 1}" if i > 1 else "base") if i < 7 else ("jaw", "l6")
        parts.append(
            f'<link name="{name}">{INERTIAL}</link><joint name="{name}_joint" type="revolute">'
            f'<parent link="{parent}"/><child link="{name}"/><origin xyz="0 0 .25"/><axis xyz="{axis}"/>'
            '<limit lower="-2.9" upper="2.9" effort="200" velocity="3"/></joint>'
        )
    (tmp_path / "arm.urdf").write_text(f'<robot name="r">{"".join(parts)}</robot>')
    monkeypatch.chdir(tmp_path)
    return "arm.urdf"


def test_the_hand_and_what_is_held_are_printed(run, library: Path, jaw: str) -> None:
    arguments = ("simulate", "reach", "--store", library, "--arm", jaw, *SHORT[2:])
    for_people = run(*arguments, "--check", "--hold", "jaw_joint=0.3")
    assert "arm.urdf, hand free, tip l6\n" in for_people.stdout
    assert "jaw_joint at 0.3\n" in for_people.stdout
    told = json.loads(run(*arguments, "--check", "--json").stdout)["reachability"]
    assert (told["tip"], told["held"]) == ("l6", {"jaw_joint": 0.0})
    ran = json.loads(run(*arguments, *SHORT[:2], "--tip", "l5", "--json").stdout)
    assert (ran["tip"], sorted(ran["held"])) == ("l5", ["jaw_joint", "l6_joint"])


def test_a_batch_says_which_hand_it_had(run, library: Path, jaw: str, tmp_path: Path) -> None:
    arguments = ("simulate", "reach", "--store", library, "--arm", jaw, *SHORT, "--episodes", 2)
    found = run(*arguments, "--min-success", 0, "--table", tmp_path / "t.csv")
    assert "arm.urdf, hand free, tip l6\n" in found.stdout
    rows = list(csv.DictReader((tmp_path / "t.csv").read_text().splitlines()))
    assert [row["hand"] for row in rows if row["outcome"] == "timeout"] == ["free"] * 2


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("--arm", "nothing"), 2, "arm: one of panda, iiwa, xarm6, or a file.urdf; not 'nothing'"),
        (("--arm", "lost.urdf"), 4, "lost.urdf: there is no such arm"),
        (("--arm", "arm.urdf.xacro"), 5, "error: arm.urdf.xacro: this file is a xacro template"),
        (("--arm", "arm.urdf", "--hold", "jaw=0"), 2, "hold: arm.urdf has no moving joint 'jaw'"),
        (("--arm", "arm.urdf", "--hold", "jaw_joint"), 2, "'jaw_joint' is not JOINT=Q"),
        (("--hold", "jaw_joint=0"), 2, "hold: the arm panda has its own"),
    ],
)
def test_what_is_no_arm_is_said_in_a_sentence(
    run, library: Path, jaw: str, arguments: tuple[str, ...], code: int, words: str
) -> None:
    Path("arm.urdf.xacro").write_text(Path(jaw).read_text())
    found = run("simulate", "reach", "--store", library, "--check", *arguments)
    assert (found.exit_code, found.stdout) == (code, "")
    assert words in found.stderr
    assert "hint:" in found.stderr


def test_only_the_command_line_lets_an_arm_read_outside_of_its_package(
    run, library: Path, jaw: str, tmp_path: Path
) -> None:
    (tmp_path / "robots").mkdir()
    (tmp_path / "elsewhere").mkdir()
    mesh = '<visual><geometry><mesh filename="package://elsewhere/m.stl"/></geometry></visual>'
    described = (tmp_path / jaw).read_text().replace('<link name="jaw">', f'<link name="jaw">{mesh}')
    (tmp_path / "robots" / "arm.urdf").write_text(described)
    (tmp_path / "elsewhere" / "m.stl").write_bytes(bytes(80) + (1).to_bytes(4, "little") + bytes(50))
    arguments = ("simulate", "reach", "--store", library, "--check", "--hand", "free")
    refused = run(*arguments, "--arm", "robots/arm.urdf")
    assert refused.exit_code == 5
    assert f"outside of {tmp_path}/robots" in refused.stderr
    assert run(*arguments, "--arm", "robots/arm.urdf", "--package", ".").exit_code == 0
    (tmp_path / "s.toml").write_text('arm = "robots/arm.urdf"\npackage = ["."]\n')
    by_file = run(*arguments, "--scenario", "s.toml")
    assert (by_file.exit_code, "package: this is for the command line" in by_file.stderr) == (5, True)
    assert "package" not in run(*arguments, "--package", ".", "--print-scenario").stdout


def test_joints_are_learned_with_an_arm_whose_package_is_told(run, jaw: str, tmp_path: Path) -> None:
    (tmp_path / "robots").mkdir()
    mesh = '<visual><geometry><mesh filename="../m.stl"/></geometry></visual>'
    described = (tmp_path / jaw).read_text().replace('<link name="jaw">', f'<link name="jaw">{mesh}')
    (tmp_path / "robots" / "arm.urdf").write_text(described)
    (tmp_path / "m.stl").write_bytes(bytes(80) + (1).to_bytes(4, "little") + bytes(50))
    rows = [f"{i / 20},{i / 40},0.3,0.2,0.1,0,{i / 60}" for i in range(21)]
    (tmp_path / "j.csv").write_text(
        "t,l1_joint,l2_joint,l3_joint,l4_joint,l5_joint,l6_joint\n" + "\n".join(rows)
    )
    arguments = ("learn", "j.csv", "--units", "rad", "--preset", "fast", "--arm", "robots/arm.urdf")
    refused = run(*arguments, "-o", "a.h5")
    assert (refused.exit_code, (tmp_path / "a.h5").exists()) == (5, False)
    assert run(*arguments, "-o", "a.h5", "--package", ".").exit_code == 0
