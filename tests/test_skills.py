"""The skills that come with the project: a store made by the tool itself, and the Makefile people copy."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from skillctl.simulation.scenario_file import read_scenario

SKILLS = Path(__file__).parent.parent / "skills"
needs_make = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")


@pytest.fixture
def copy(tmp_path, monkeypatch):
    """A copy of the directory without what was built in it, and skillctl on the path."""
    (program := tmp_path / "bin" / "skillctl").parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m skillctl "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")
    for name in ("SKILLCTL_STORE", "MAKEFLAGS"):
        monkeypatch.delenv(name, raising=False)
    return shutil.copytree(SKILLS, tmp_path / "skills", ignore=shutil.ignore_patterns("build", "__pycache__"))


def make(folder, *words):
    """Run Make as one would from outside."""
    command = ["make", "--no-print-directory", "-C", folder, f"PYTHON={sys.executable}", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def versions(folder):
    """Return the bytes of every version in a store."""
    return {path.relative_to(folder): path.read_bytes() for path in folder.glob("*/*.h5")}


def test_the_demonstrations_are_written_again_to_the_byte(tmp_path):
    subprocess.run([sys.executable, SKILLS / "teach.py", tmp_path], check=True)
    there = {path.relative_to(tmp_path): path.read_bytes() for path in tmp_path.rglob("*.csv")}
    committed = SKILLS / "demonstrations"
    assert there == {path.relative_to(committed): path.read_bytes() for path in committed.rglob("*.csv")}


@needs_make
def test_every_skill_is_read_proved_and_comes_out_the_same_again(copy):
    before = versions(copy)
    assert before
    done = make(copy, "verify")
    assert done.returncode == 0, done.stdout + done.stderr
    assert versions(copy) == before
    assert done.stdout.endswith(f"{len(before)} skills came out the same again.\n")
    assert "Nothing to be done" in make(copy, "all").stdout

    shutil.copy(copy / "places" / "1.h5", copy / "shelf" / "2.h5")
    done = make(copy, "compare")
    assert done.returncode == 2
    assert "shelf: does not come out the same again" in done.stdout


@needs_make
def test_a_damaged_skill_is_found(copy):
    damaged = copy / "places" / "1.h5"
    whole = damaged.read_bytes()
    damaged.chmod(0o644)
    damaged.write_bytes(whole[:5000] + bytes([whole[5000] ^ 1]) + whole[5001:])
    done = make(copy, "verify")
    assert done.returncode == 2
    assert "places" in done.stderr


@needs_make
def test_the_small_experiment_prints_its_table(copy):
    pytest.importorskip("pybullet")
    done = make(copy, "experiment-small")
    assert done.returncode == 0, done.stdout + done.stderr
    rows = re.findall(r"^\| (\S+) +\| (\S+) +\| (\d+) of 4 ", done.stdout, re.MULTILINE)
    counts = {(skill, scenario): int(successes) for skill, scenario, successes in rows}
    assert set(counts) == {
        ("shelf", "whole"), ("top-centre", "whole"), ("straight", "top"),
        ("shelf", "moved"), ("places", "places"),
    }  # fmt: skip
    assert counts["shelf", "whole"] >= 3  # of those 50, all but one or two succeed
    runs = copy / "build" / "runs-4"
    assert (runs / "shelf--whole.png").read_bytes().startswith(b"\x89PNG")
    assert len((runs / "shelf--whole.csv").read_text().splitlines()) == 1 + 4
    done = make(copy, "experiment-small")
    assert "skillctl" not in done.stdout  # nothing is run again


def test_the_task_of_the_readme_is_adapted_proved_simulated_and_refused_when_impossible(copy):
    pytest.importorskip("pybullet")

    def run(*arguments):
        command = [sys.executable, "-m", "skillctl", *map(str, arguments), "--store", "."]
        return subprocess.run(command, cwd=copy, capture_output=True, text=True, check=False)

    taught, task = ("bottom-left", "bottom-right", "top-centre"), "tasks/top-left.toml"
    made = run("adapt", task, *taught, "--name", "between", "--json")
    assert made.returncode == 0, made.stderr
    report = json.loads(made.stdout)
    assert (report["held"], report["starts"]) == (200, 200)
    margins = {row["clause"]: row for row in report["clauses"]}
    assert all(row["margin"] > 0 for row in margins.values())
    assert margins["approach"]["single"] < 0  # no skill does it alone, moved there,
    assert margins["right bottle"]["equal"] < 0  # nor do all with equal weights
    assert run("verify-stability", "between", "--task", task).returncode == 0
    done = run("simulate", "between", "--scenario", "scenarios/bottles.toml", "--task", task)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"outcome +grasped", done.stdout)
    text = (copy / task).read_text(encoding="utf-8")
    (copy / "tasks" / "no.toml").write_text(text.replace("[0.63, 0.12, 0.8]", "[0.63, 0.28, 0.8]"))
    refused = run("adapt", "tasks/no.toml", *taught, "--name", "no")
    assert refused.returncode == 1
    assert "right bottle fails by 0.135 m" in refused.stdout
    assert "no motion that arrives keeps it" in refused.stderr
    assert not (copy / "no").exists()


def test_the_oracle_counts_a_scene_that_any_of_the_skills_does(tmp_path):
    tables = []
    for name, outcomes in {"a": (1, 0, 0, 0), "b": (1, 1, 0, 0), "c": (0, 1, 0, 1)}.items():
        tables.append(tmp_path / f"{name}.csv")
        tables[-1].write_text("episode,success\n" + "".join(f"{i},{won}\n" for i, won in enumerate(outcomes)))
    done = subprocess.run([sys.executable, SKILLS / "oracle.py", *tables], capture_output=True, check=True)
    report = json.loads(done.stdout)
    assert (report["successes"], report["episodes"]) == (3, 4)
    (tmp_path / "best--clutter.json").write_bytes(done.stdout)
    table = [sys.executable, SKILLS / "table.py", tmp_path / "best--clutter.json"]
    assert b"| 3 of 4 " in subprocess.run(table, capture_output=True, check=True).stdout


def test_cluttered_scenarios_have_the_same_scenes():
    plain, *others = (
        read_scenario(SKILLS / f"scenarios/{name}.toml")
        for name in ("clutter", "clutter-adapted", "clutter-kept-out")
    )
    assert [(each.adapt, each.avoid) for each in (plain, *others)] == [
        (False, False),
        (True, False),
        (True, True),
    ]
    assert all(plain == other.changed(adapt=False, avoid=False) for other in others)
