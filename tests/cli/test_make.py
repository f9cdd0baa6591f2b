"""skillctl under a real Make: what is up to date is left alone, what changed is made, nothing half stays."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from skillctl import store
from skillctl.usecases.target import dependencies

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")

MAKEFILE = """
SKILLCTL = {python} -m skillctl
LEARN = $(SKILLCTL) learn --preset fast --components 2 -q

all: both.h5 mix.h5
both.h5: curve.h5 hook.h5
\t$(SKILLCTL) combine curve.h5 hook.h5 -o $@ --depfile both.d -q $(FLAGS)
mix.h5: curve.h5 hook.h5
\t$(SKILLCTL) merge curve.h5 hook.h5 --fit hook-0.csv -o $@ --depfile mix.d -q $(FLAGS)
%.h5:
\t$(LEARN) $(sort $(wildcard $*-*.csv)) -o $@ --depfile $*.d $(FLAGS)
curve.h5 hook.h5: %.h5:
-include curve.d hook.d both.d mix.d
"""
SKILLS = ("both.h5", "curve.h5", "hook.h5", "mix.h5")


@pytest.fixture
def project(tmp_path, curve_files, hook_files):
    for path in (*curve_files, *hook_files):
        shutil.copy(path, tmp_path)
        os.utime(tmp_path / path.name, (time.time() - 3600,) * 2)
    (tmp_path / "Makefile").write_text(MAKEFILE.format(python=sys.executable))
    return tmp_path


def make(project, *arguments):
    """Run make and return the skills that it called skillctl for."""
    result = subprocess.run(
        ["make", *arguments], cwd=project, capture_output=True, text=True, check=False, timeout=120
    )
    assert result.returncode == 0, result.stderr
    called = [line for line in result.stdout.splitlines() if "-m skillctl" in line]
    return [name for name in SKILLS if any(f"-o {name}" in line for line in called)]


def times(project):
    return {name: (project / name).stat().st_mtime_ns for name in SKILLS}


def contents(project):
    return {name: (project / name).read_bytes() for name in SKILLS}


def test_make_makes_what_changed_and_nothing_else(project):
    assert make(project) == list(SKILLS)
    first = contents(project)
    assert make(project) == []  # nothing changed, nothing done

    before = times(project)
    os.utime(project / "curve-1.csv")  # touched, not edited: the same bytes, and Make is satisfied
    assert make(project) == ["both.h5", "curve.h5", "mix.h5"]
    assert contents(project) == first
    assert times(project)["hook.h5"] == before["hook.h5"]
    assert make(project) == []

    os.utime(project / "hook-0.csv")  # only mix.d says that mix.h5 is fitted to it
    assert make(project) == ["both.h5", "hook.h5", "mix.h5"]
    assert contents(project) == first
    assert make(project) == []

    lines = (project / "curve-1.csv").read_text().splitlines()
    (project / "curve-1.csv").write_text("\n".join(lines[:-1]) + "\n")
    assert make(project) == ["both.h5", "curve.h5", "mix.h5"]
    assert contents(project)["curve.h5"] != first["curve.h5"]
    assert contents(project)["both.h5"] != first["both.h5"]
    assert make(project) == []


def test_if_changed_makes_nothing_again_from_what_stayed_the_same(project):
    make(project)
    before = times(project)
    os.utime(project / "curve-1.csv")
    assert "curve.h5" in make(project, "FLAGS=--if-changed")
    assert times(project) == before


def test_a_removed_input_stops_nothing(project):
    make(project)
    (project / "curve-3.csv").unlink()
    assert make(project) == ["both.h5", "curve.h5", "mix.h5"]


def test_eight_jobs_at_once_make_the_same(project):
    make(project)
    alone = contents(project)
    for name in SKILLS:
        (project / name).unlink()
    assert make(project, "-j8") == list(SKILLS)
    assert contents(project) == alone
    assert [path.name for path in project.iterdir() if ".tmp" in path.name] == []


@pytest.mark.parametrize("delay", [0.4, 0.9, 1.5, 2.5])
def test_an_interrupted_make_leaves_nothing_half(project, delay):
    process = subprocess.Popen(
        ["make", "-j8"], cwd=project, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
    )
    time.sleep(delay)
    os.killpg(process.pid, signal.SIGINT)  # as Ctrl-C does
    process.communicate(timeout=60)
    for name in SKILLS:
        if (project / name).exists():
            store.read_skill(project / name)
    assert [path.name for path in project.iterdir() if ".tmp" in path.name] == []
    make(project)
    assert make(project) == []


def test_a_fitted_merger_depends_on_every_skill_it_was_to_choose_from(run, project, monkeypatch):
    monkeypatch.chdir(project)
    make(project, "curve.h5", "hook.h5")
    arguments = [
        "merge",
        "curve.h5",
        "./hook.h5",
        "--fit",
        "hook-0.csv",
        "-o",
        "one.h5",
        "--depfile",
        "one.d",
    ]
    report = json.loads(run(*arguments, "--json").stdout)
    assert [part["skill"] for part in report["parts"]] == ["hook.h5"]  # curve.h5 got no weight
    assert "one.h5: curve.h5 hook.h5 hook-0.csv\n" in (project / "one.d").read_text()


def test_names_are_written_as_make_reads_them(tmp_path):
    (tmp_path / "a $b#c:d e.csv").touch()
    text = dependencies(Path("out file.h5"), [Path("a $b#c:d e.csv")] * 2)
    (tmp_path / "Makefile").write_text(text)
    asked = ["make", "-n", "-d", "out file.h5"]
    result = subprocess.run(asked, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert "'a $b#c:d e.csv'" in result.stdout
    assert text.count("csv") == 2


def test_a_build_tools_options_need_a_file(run, curve_files, tmp_path):
    for option in (["--depfile", tmp_path / "a.d"], ["--if-changed"]):
        result = run("learn", *curve_files, "--name", "a", "--store", tmp_path / "s", *option)
        assert (result.exit_code, result.stdout) == (2, "")
        assert option[0] in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_explain_says_why_it_is_learned_again(run, curve_files, tmp_path):
    files = [shutil.copy(path, tmp_path) for path in curve_files]
    arguments = ["-o", tmp_path / "a.h5", "--preset", "fast", "--explain"]

    def reasons(*more):
        result = run("learn", *files, *arguments, *more)
        assert result.exit_code == 0
        return [line.removeprefix("because: ") for line in result.stderr.splitlines() if "because" in line]

    assert reasons("--components", 2) == ["there is no readable skill yet"]
    assert reasons("--components", 2) == []
    assert reasons("--components", 2, "--force") == ["it was asked for"]
    assert reasons("--components", 1, "--seed", 4) == ["components is 1 and was 2", "seed is 4 and was 0"]
    with open(files[1], "a") as file:  # noqa: PTH123
        file.write("\n")
    assert reasons("--components", 1, "--seed", 4) == [f"{files[1]} has changed"]
    files.pop()
    assert reasons("--components", 1, "--seed", 4) == ["it was made from 4 files, not 3"]
