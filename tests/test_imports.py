"""What each command imports: start-up time is a feature, and one careless import undoes it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from skillctl.cli.app import COMMANDS

REPORT = """
import sys
before = set(sys.modules)
sys.argv = ["skillctl", *sys.argv[1:]]
from skillctl.__main__ import main
try:
    main()
except SystemExit as stop:
    assert not stop.code, stop.code
loaded = {name.partition(".")[0] for name in set(sys.modules) - before}
print(*sorted(loaded - set(sys.stdlib_module_names)), file=sys.stderr)
"""

OURS = {"skillctl"}
# What Typer brings along, version by version; nothing of it is heavy.
TYPER = {"typer", "annotated_doc", "typing_extensions", "click", "shellingham", "colorama"}


def packages(*arguments: object, cwd: Path) -> set[str]:
    """Return the top-level packages outside the standard library that a command imports."""
    command = [sys.executable, "-c", REPORT, *map(str, arguments)]
    result = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return set(result.stderr.splitlines()[-1].split())


def test_version_imports_nothing_but_the_package(tmp_path):
    assert packages("--version", cwd=tmp_path) == OURS


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_imports_nothing_but_typer(command, tmp_path):
    assert packages(*command.split(), "--help", cwd=tmp_path) <= OURS | TYPER


def test_importing_the_package_imports_nothing_else(tmp_path):
    code = "import sys; before = set(sys.modules); import skillctl; print(*set(sys.modules) - before)"
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    loaded = {name.partition(".")[0] for name in result.stdout.split()}
    assert loaded - set(sys.stdlib_module_names) == OURS


def test_ls_reads_no_skill(tmp_path):
    assert packages("ls", "--store", tmp_path, cwd=tmp_path).isdisjoint(
        {"h5py", "pydantic", "scipy", "pybullet"}
    )


def test_inspect_needs_neither_scipy_nor_pybullet(tmp_path, library):
    loaded = packages("inspect", "curve", "--store", library, cwd=tmp_path)
    assert {"numpy", "h5py", "pydantic"} <= loaded  # the report does see imports
    assert loaded.isdisjoint({"scipy", "pybullet", "pybullet_data", "rich", "PIL", "matplotlib"})


def test_verify_stability_needs_neither_scipy_nor_pybullet(tmp_path, library):
    loaded = packages("verify-stability", "curve", "--store", library, cwd=tmp_path)
    assert loaded.isdisjoint({"scipy", "pybullet", "pybullet_data", "rich", "PIL", "matplotlib"})


def test_running_needs_no_simulator_and_no_library_of_a_robot(tmp_path, library):
    loaded = packages("run", "curve", "--store", library, cwd=tmp_path)
    assert "h5py" in loaded  # the report does see imports
    assert loaded.isdisjoint({"scipy", "pybullet", "pybullet_data", "rich", "PIL", "matplotlib"})
    assert loaded.isdisjoint({"franky", "rtde_control", "rclpy"})


def test_diff_needs_neither_scipy_nor_pybullet(tmp_path, library):
    loaded = packages("diff", "curve", "plain", "--store", library, cwd=tmp_path)
    assert loaded.isdisjoint({"scipy", "pybullet", "pybullet_data", "rich", "PIL", "matplotlib"})


def test_learning_needs_no_simulator(tmp_path, curve_files):
    loaded = packages("learn", *curve_files[:2], "--preset", "fast", "-o", "a.h5", cwd=tmp_path)
    assert "numpy" in loaded
    assert loaded.isdisjoint({"pybullet", "pybullet_data", "PIL", "matplotlib"})


@pytest.mark.parametrize(
    "line", ["completion bash", "__complete words merge c", "__complete words inspect curve@"]
)
def test_completion_imports_nothing_but_typer(line, tmp_path, library, monkeypatch):
    monkeypatch.setenv("SKILLCTL_STORE", str(library))
    assert packages(*line.split(), cwd=tmp_path) <= OURS | TYPER


@pytest.mark.parametrize(
    "line", ["schema", "schema learn", "log curve", "ls --check", "tag curve a --store ."]
)
def test_small_commands_need_no_mathematics(line, tmp_path, library, monkeypatch):
    monkeypatch.setenv("SKILLCTL_STORE", str(library))
    (tmp_path / "curve").mkdir()
    (tmp_path / "curve" / "1.h5").write_bytes((library / "curve" / "1.h5").read_bytes())
    loaded = packages(*line.split(), cwd=tmp_path)
    assert loaded.isdisjoint(
        {"scipy", "pybullet", "pybullet_data", "rich", "PIL", "matplotlib", "cryptography"}
    )


def test_adapting_skills_needs_no_simulator(tmp_path, library):
    task = "[target]\nposition = [0, 0.0]\n[start]\nlow = [0.2, 0.1]\nhigh = [0.21, 0.1]\n"
    (tmp_path / "t.toml").write_text(task)
    arguments = ("adapt", "t.toml", "curve", "hook", "--store", library, "-o", "a.h5")
    loaded = packages(*arguments, cwd=tmp_path)
    assert loaded.isdisjoint({"pybullet", "pybullet_data", "rich", "PIL", "matplotlib", "cryptography"})


@pytest.mark.parametrize("command", ["merge", "combine"])
def test_making_skills_of_skills_needs_no_simulator(command, tmp_path, library):
    loaded = packages(command, "curve", "hook", "--store", library, "-o", "a.h5", cwd=tmp_path)
    assert loaded.isdisjoint({"pybullet", "pybullet_data", "rich", "PIL", "matplotlib", "cryptography"})
