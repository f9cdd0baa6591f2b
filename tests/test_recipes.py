"""What people copy into their repositories is run here: the workflow, the Makefile, the pre-commit hook."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from skillctl.usecases.files import load, save

ROOT = Path(__file__).parent.parent
RECIPES = ROOT / ".github" / "recipes"
ZEROS = "0" * 40  # what GitHub calls the state before a new branch


@pytest.fixture
def project(library, tmp_path, monkeypatch):
    """A git repository with one proved skill, committed; `unstable.h5` waits outside."""
    (program := tmp_path / "bin" / "skillctl").parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m skillctl "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")
    for name in [name for name in os.environ if name.startswith("GIT_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("RUNNER_TEMP", str(tmp_path))
    monkeypatch.setenv("PRE_COMMIT_HOME", str(tmp_path / "pre-commit"))
    (skill,) = load("curve", store=library).leaves
    matrices = skill.system_matrices.copy()
    matrices[0] = np.eye(2)
    save(replace(skill, system_matrices=matrices), tmp_path / "unstable.h5")
    (folder := tmp_path / "project").mkdir()
    git(folder, "init", "--initial-branch=main")
    git(folder, "config", "user.name", "someone")
    git(folder, "config", "user.email", "someone@example.org")
    add(folder, library / "curve" / "1.h5", "skills/curve/1.h5")
    return folder


def git(folder, *arguments):
    """Run git and return what it prints."""
    result = subprocess.run(["git", *arguments], cwd=folder, capture_output=True, text=True, check=True)
    return result.stdout.strip()


def add(folder, source, name):
    """Commit a file and return the commit."""
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(source, folder / name)
    git(folder, "add", name)
    git(folder, "commit", "-m", name)
    return git(folder, "rev-parse", "HEAD")


def workflow():
    """Return the steps of the workflow that are commands, but for the one that needs a network."""
    (job,) = yaml.safe_load((RECIPES / "verify-skills.yml").read_text())["jobs"].values()
    steps = [step for step in job["steps"] if "run" in step and step["name"] != "Install skillctl"]
    assert len(steps) == 1
    return steps


def run_workflow(folder, base):
    """Run the steps as GitHub does, with ``base`` for what the event says."""
    said = ""
    for step in workflow():
        assert list(step.get("env", {})) == ["BASE"]
        result = subprocess.run(
            ["bash", "-e", "-c", step["run"]], cwd=folder, env={**os.environ, "BASE": base},
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        said += result.stdout
        if result.returncode:
            return result.returncode, said
    return 0, said


def test_the_workflow_proves_what_changed_and_nothing_else(project, library, tmp_path):
    base = git(project, "rev-parse", "HEAD")
    add(project, library / "hook" / "1.h5", "skills/hook of mine/1.h5")
    assert run_workflow(project, base) == (0, "1 of 1 skills proved.\n")
    add(project, tmp_path / "unstable.h5", "skills/curve/2.h5")
    code, said = run_workflow(project, base)
    assert code == 1
    assert said.startswith("::error file=skills/curve/2.h5,title=")
    assert said.endswith("1 of 2 skills proved.\n")
    last = git(project, "rev-parse", "HEAD")
    git(project, "rm", "-q", "skills/curve/2.h5")
    git(project, "commit", "-m", "away with it")
    assert run_workflow(project, last) == (0, "")


def test_the_workflow_proves_everything_on_a_new_branch(project, tmp_path):
    assert run_workflow(project, ZEROS) == (0, "1 of 1 skills proved.\n")
    add(project, tmp_path / "unstable.h5", "skills/curve/2.h5")
    assert run_workflow(project, ZEROS)[0] == 1


def test_the_workflow_refuses_a_damaged_skill(project, tmp_path):
    base = git(project, "rev-parse", "HEAD")
    (tmp_path / "cut.h5").write_bytes((project / "skills/curve/1.h5").read_bytes()[:-1])
    add(project, tmp_path / "cut.h5", "skills/cut.h5")
    code, said = run_workflow(project, base)
    assert code == 7
    assert "::error file=skills/cut.h5" in said


def make(folder):
    """Run the Makefile and return the exit code and what it did."""
    result = subprocess.run(
        ["make", "-f", RECIPES / "Makefile"], cwd=folder, capture_output=True, text=True, check=False
    )
    return result.returncode, [line for line in result.stdout.splitlines() if line.startswith("skillctl")]


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
def test_the_makefile_learns_and_proves_what_changed(project, curve_files, hook_files, tmp_path):
    for name, files in (("curve", curve_files), ("hook", hook_files)):
        (folder := project / "demonstrations" / name).mkdir(parents=True)
        for file in files[:2]:
            shutil.copy(file, folder)
    code, done = make(project)
    assert (code, len(done)) == (0, 3)
    assert done[-1] == "skillctl verify-stability --period 0.01 build/curve.h5 build/hook.h5"
    assert make(project) == (0, [])
    shutil.copy(hook_files[2], project / "demonstrations" / "hook")
    code, (learned, proved) = make(project)
    assert (code, "demonstrations/hook" in learned) == (0, True)
    assert proved.endswith("--period 0.01 build/hook.h5")
    shutil.copy(tmp_path / "unstable.h5", project / "build" / "curve.h5")
    for _ in range(2):  # a failed proof is tried again
        code, done = make(project)
        assert (code, len(done)) == (2, 1)


def pre_commit(folder, *arguments):
    """Run pre-commit in a repository."""
    command = [sys.executable, "-m", "pre_commit", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def test_the_hook_lets_proved_skills_pass_and_stops_others(project, library, tmp_path):
    """Our hook in a local configuration: all of it but the installation, which needs a network."""
    pytest.importorskip("pre_commit")
    assert pre_commit(ROOT, "validate-manifest", ROOT / ".pre-commit-hooks.yaml").returncode == 0
    (hook,) = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text())
    configuration = {"repos": [{"repo": "local", "hooks": [{**hook, "language": "system"}]}]}
    (project / ".pre-commit-config.yaml").write_text(yaml.safe_dump(configuration))
    git(project, "add", ".pre-commit-config.yaml")
    shutil.copy(library / "hook" / "1.h5", project / "hook.h5")
    (project / "notes.txt").write_text("no skill")
    git(project, "add", "hook.h5", "notes.txt")
    passed = pre_commit(project, "run")
    assert passed.returncode == 0, passed.stdout + passed.stderr
    shutil.copy(tmp_path / "unstable.h5", project / "bad.h5")
    git(project, "add", "bad.h5")
    stopped = pre_commit(project, "run")
    assert stopped.returncode == 1
    assert "not proved" in stopped.stdout
    assert "bad.h5" in stopped.stdout
    assert "notes.txt" not in stopped.stdout
