"""What is imported from ``skillctl`` in Python: the example of its docstring runs, types included."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import skillctl
from skillctl.errors import UsageError

EXAMPLE = "\n".join(re.findall(r"^    (.*)$", skillctl.__doc__, re.MULTILINE))


def test_the_example_of_the_docstring_runs(reach_files, tmp_path):
    for number, file in enumerate(reach_files, start=1):
        (tmp_path / f"{number}.csv").write_bytes(file.read_bytes())
    code = f"{EXAMPLE}\nassert report.written.path.samefile('skills/reach/1.h5')\nprint(command.shape)"
    command = [sys.executable, "-W", "error", "-c", code]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout) == (0, "(3,)\n"), result.stderr


def test_a_type_checker_knows_every_name_and_no_other(tmp_path):
    names = [name for name in skillctl.__all__ if not name.startswith("_")]
    (good := tmp_path / "good.py").write_text(
        f"from skillctl import {', '.join(names)}\n{EXAMPLE}\n"
        'merged = merge(["a", "b.h5"], output="c.h5", options=MergeOptions(speed=0.5))\n'
        "rate: float | None = merged.certificate.rate\n"
    )
    (bad := tmp_path / "bad.py").write_text("from skillctl import lern, learn\nlearn(data=1)\n")
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "cache")]
    result = subprocess.run([*command, good, bad], cwd=Path(skillctl.__file__).parents[1],
                            capture_output=True, text=True, check=False)  # fmt: skip
    complaints = [line for line in result.stdout.splitlines() if "error:" in line]
    assert all("bad.py" in line for line in complaints), result.stdout
    assert any('has no attribute "lern"' in line for line in complaints)
    assert any("Argument" in line for line in complaints)


@pytest.mark.parametrize("name", [name for name in skillctl.__all__ if name != "__version__"])
def test_every_name_is_there_and_explains_itself(name):
    value = getattr(skillctl, name)
    assert name in dir(skillctl)
    documentation = inspect.getdoc(value)
    if inspect.isfunction(value):
        undocumented = [
            word for word in inspect.signature(value).parameters if f"{word}:" not in documentation
        ]
        assert not undocumented, documentation


def test_other_names_are_refused():
    with pytest.raises(AttributeError, match="lern"):
        skillctl.lern  # type: ignore[attr-defined]  # noqa: B018 - the access is the test


def test_paths_may_be_text(library, tmp_path):
    report = skillctl.merge(["curve", "hook"], output=str(tmp_path / "m.h5"), store=str(library))
    skill = skillctl.load(str(tmp_path / "m.h5"))
    assert (
        skillctl.verify(skill).rate == report.certificate.rate == skillctl.verify(str(tmp_path / "m.h5")).rate
    )
    moved = skill.translated(np.array([0.1, 0.0]))
    path = skillctl.save(moved, str(tmp_path / "moved.h5"))
    state = np.array([0.2, 0.1])
    back = skillctl.load(path).velocity(state + np.array([0.1, 0.0]))
    # The offset is added to the means, too: one rounding of coordinates below one, times the slope.
    assert back == pytest.approx(skill.velocity(state), abs=1e-12)


def test_errors_are_of_one_kind_and_carry_the_hint(tmp_path):
    with pytest.raises(skillctl.SkillctlError) as caught:
        skillctl.learn(["nowhere.csv"])
    assert isinstance(caught.value, UsageError)
    assert "--name" in caught.value.hint
    with pytest.raises(skillctl.SkillctlError, match="no skill"):
        skillctl.load("nothing", store=tmp_path)
