"""The README is true: its lines are what CI runs, its outputs are what the commands print."""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from skillctl.cli.app import COMMANDS
from skillctl.cli.exit_codes import ExitCode

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
HAS_PYBULLET = importlib.util.find_spec("pybullet") is not None
TOUR = [block.strip().split("\n") for block in re.findall(r"```console\n(.*?)```", README, re.DOTALL)]


def blocks(language: str) -> list[str]:
    """Return the code blocks of a language."""
    return [block.strip() for block in re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)]


def test_two_lines_are_to_be_pasted():
    install, test = blocks("sh")
    for line in (install, test):
        assert "\n" not in line
        assert line.startswith('V="${V:-.venv}"; python3 -m venv "$V" && "$V/bin/python" -m pip install ')
    assert install.endswith('"$V/bin/skillctl" quickstart')
    assert "-m pytest" in test


def test_ci_runs_exactly_the_test_line_of_the_readme():
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    (command,) = re.findall(r'line="\$\((.*)\)"', script)
    found = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == blocks("sh")[1]
    assert 'bash -euo pipefail -c "$line"' in script


def test_every_command_is_shown_and_every_shown_command_exists():
    shown = set(re.findall(r"^\$ skillctl (\S+)", README, re.MULTILINE))
    assert shown <= set(COMMANDS)
    (besides,) = re.findall(r"^Besides.*?^\|", README, re.MULTILINE | re.DOTALL)
    assert shown | set(re.findall(r"`([a-z][a-z-]*)(?: [^`]*)?`", besides)) == set(COMMANDS)


def test_every_exit_code_is_explained():
    table = "".join(re.findall(r"^\| [\d, ]+ \|", README, re.MULTILINE))
    assert {int(code) for code in re.findall(r"\d+", table)} == set(ExitCode)


def test_links_and_pictures_lead_somewhere():
    targets = re.findall(r"\]\(([^)#:]+)\)", README)
    assert targets
    for target in targets:
        assert (ROOT / target).is_file(), target
    for picture in (ROOT / ".github").glob("*.png"):
        assert picture.name in README
        assert picture.stat().st_size < 300_000, picture


@pytest.fixture(scope="module")
def tour(tmp_path_factory):
    """Every command of the README with what it prints, typed one after the other by a newcomer."""
    folder = tmp_path_factory.mktemp("tour")
    environment = {name: value for name, value in os.environ.items() if name != "SKILLCTL_STORE"}
    printed = []
    for command, *expected in TOUR:
        words = command.removeprefix("$ skillctl ")
        spoken = " 2>&1" if words.startswith("quickstart") else ""  # it says on standard error what it types
        result = subprocess.run(
            ["bash", "-c", f"{shlex.quote(sys.executable)} -m skillctl {words}{spoken}"],
            cwd=folder / "quickstart" if printed else folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        printed.append((command, expected, result))
    return folder / "quickstart", printed


def shape(text: str) -> str:
    """Return a line with digests, numbers and gaps made equal: those differ between machines and builds."""
    text = re.sub(r"\b[0-9a-f]{12,}\b", "DIGEST", text)
    text = re.sub(r"\d[\d.]*", "N", text)
    return re.sub(r"\s+", " ", text).strip()


@pytest.mark.skipif(not HAS_PYBULLET, reason="PyBullet has no wheel for this Python")
def test_the_outputs_shown_are_real(tour):
    _, printed = tour
    assert len(printed) == 7
    for command, expected, result in printed:
        assert result.returncode == 0, result.stdout
        found = [shape(line) for line in result.stdout.strip().split("\n")]
        assert found == [shape(line) for line in expected], f"{command}: .ci/readme writes it anew"


@pytest.mark.skipif(not HAS_PYBULLET, reason="PyBullet has no wheel for this Python")
def test_the_python_example_runs(tour):
    folder, _ = tour
    (example,) = blocks("python")
    result = subprocess.run(
        [sys.executable, "-W", "error", "-c", example],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert re.fullmatch(r"stable \[.*\]\n", result.stdout)


@pytest.mark.skipif(not HAS_PYBULLET, reason="PyBullet has no wheel for this Python")
def test_the_manifest_runs(tour, tmp_path):
    folder, _ = tour
    (manifest,) = blocks("toml")
    (folder / "skills.toml").write_text(manifest)
    (line,) = re.findall(r"`(learn --batch [^`]*)`", README)
    result = subprocess.run(
        [sys.executable, "-m", "skillctl", *line.split(), "--store", tmp_path],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (result.returncode, result.stdout.count("learned")) == (0, 2), result.stderr
