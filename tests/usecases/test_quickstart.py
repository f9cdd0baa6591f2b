"""The quickstart: what it prints is what it does, and it needs nothing but the package."""

from __future__ import annotations

import importlib.util
import json
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

has_pybullet = importlib.util.find_spec("pybullet") is not None
TAUGHT = ["bottom-left", "bottom-right", "top-centre"]
SKILLS = [*TAUGHT, "top-left", "top-right", "shelf", "leave", "carry"]


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    """A quickstart in a new directory: where, and the process."""
    folder = tmp_path_factory.mktemp("quickstart")
    command = [sys.executable, "-m", "skillctl", "quickstart", "tour", "--json"]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert (result.returncode, result.stderr) == (0, "")
    return folder / "tour", json.loads(result.stdout)


def test_it_proves_eight_skills(started):
    folder, report = started
    assert [skill["skill"] for skill in report["skills"]] == [f"{name}@1" for name in SKILLS]
    assert [skill["made_by"] for skill in report["skills"]] == [
        *(["learn"] * 3 + ["merge"] * 2),
        *("combine", "learn", "chain"),
    ]
    assert {skill["verdict"] for skill in report["skills"]} == {"stable"}
    assert {entry.name for entry in folder.iterdir()} - {"shelf.png"} == {
        "cups.toml",
        "demonstrations",
        "skills",
    }


def test_there_are_seven_demonstrations_or_more_of_each_reach(started):
    folder, _ = started
    for task in TAUGHT:
        assert len(list((folder / "demonstrations").glob(f"{task}/*.csv"))) >= 7


@pytest.mark.skipif(not has_pybullet, reason="PyBullet has no wheel for this Python")
def test_it_simulates_one_reach_per_skill_and_leaves_a_picture(started):
    folder, report = started
    reached = report["skills"][:-2]  # the retreat and the chain take part in the last one
    assert {skill["outcome"] for skill in reached} == {"reached"}
    assert all(skill["final_error"] < 2e-3 for skill in reached)
    assert (folder / "shelf.png").read_bytes().startswith(b"\x89PNG")
    assert report["outcome"] == "placed"
    assert report["commands"][-1].startswith("skillctl simulate carry --scene shelf --cup ")


@pytest.mark.skipif(not has_pybullet, reason="PyBullet has no wheel for this Python")
def test_it_compares_the_combined_skill_with_its_parts(started, run, monkeypatch):
    folder, report = started
    grasped = {skill["skill"]: skill["grasped"] for skill in report["skills"]}
    assert grasped["top-left@1"] is grasped["top-right@1"] is None
    assert report["cups"] >= grasped["shelf@1"] >= max(grasped[f"{name}@1"] for name in TAUGHT)
    monkeypatch.chdir(folder)
    (command,) = (
        each for each in report["commands"] if each.startswith("skillctl simulate bottom-left --scen")
    )
    again = json.loads(run(*shlex.split(command)[1:], "--json").stdout)
    assert (again["successes"], again["episodes"]) == (grasped["bottom-left@1"], report["cups"])


def test_typing_what_it_printed_gives_the_same_skills(started, run, monkeypatch):
    folder, report = started
    change, *commands = report["commands"]
    assert change == "cd tour"
    monkeypatch.chdir(folder)
    for command in commands:
        program, name, *words = shlex.split(command)
        assert program == "skillctl"
        if name == "simulate":
            continue
        result = run(name, *(path for word in words for path in _glob(word, folder)), "--json")
        assert result.exit_code == 0, result.stderr
        if name != "verify-stability":
            assert json.loads(result.stdout)["written"]["created"] is False  # exactly this skill was there


def _glob(word: str, folder: Path) -> list[str]:
    """Return what a shell makes of a word."""
    found = sorted(str(path.relative_to(folder)) for path in folder.glob(word)) if "*" in word else []
    return found or [word]


def test_an_earlier_quickstart_is_taken_up_and_anything_else_is_left_alone(run, started, tmp_path):
    folder, _ = started
    (folder / "mine.txt").write_text("mine")
    refused = run("quickstart", folder)
    (folder / "mine.txt").unlink()
    assert refused.exit_code == 2
    assert "mine.txt" in refused.stderr
    (tmp_path / "file").write_text("")
    assert run("quickstart", tmp_path / "file").exit_code == 2


def test_without_a_simulator_it_does_everything_else(started):
    folder, _ = started
    code = "import sys; sys.modules['pybullet'] = None; from skillctl.__main__ import main; main()"
    result = subprocess.run(
        [sys.executable, "-c", code, "quickstart", "tour"],
        cwd=folder.parent,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert "note: nothing was simulated: " in result.stderr
    assert "pip install pybullet" in result.stderr
    assert result.stderr.count("$ skillctl simulate") == 1  # it does not try again and again
    assert all(f"{name}@1" in result.stdout for name in SKILLS)  # and no new versions were made
