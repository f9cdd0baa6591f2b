"""What the rest of the program must not notice: that PyBullet is there, is missing, or talks."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from collections.abc import Callable

import pytest

from skillctl.errors import NotFoundError
from skillctl.model.seds import SedsSkill
from skillctl.simulation.bullet import World, load_bullet, silenced
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import Scenario

MakeLinear = Callable[..., SedsSkill]


def test_without_pybullet_one_line_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, linear: MakeLinear
) -> None:
    monkeypatch.setitem(sys.modules, "pybullet", None)  # as if it were not installed
    with pytest.raises(NotFoundError, match="PyBullet is not installed") as refusal:
        simulate(linear((0.5, 0.0, 0.5)), Scenario())
    assert "pip install pybullet" in refusal.value.hint
    assert "\n" not in str(refusal.value) + refusal.value.hint


def test_a_pybullet_that_does_not_load_is_told_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        def find_spec(self, name: str, *_: object) -> None:
            if name == "pybullet":
                raise ImportError("libfoo.so: cannot open shared object file")

    monkeypatch.delitem(sys.modules, "pybullet", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Broken(), *sys.meta_path])
    with pytest.raises(NotFoundError, match=r"libfoo\.so"):
        load_bullet()


def test_importing_the_room_loads_neither_pybullet_nor_pillow() -> None:
    code = "import sys, skillctl.simulation as room; print({'pybullet', 'PIL', 'scipy'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


def test_a_silenced_descriptor_keeps_python_and_loses_c(capfd: pytest.CaptureFixture[str]) -> None:
    libc = ctypes.CDLL(None)
    os.write(1, b"before ")
    with silenced(1):
        libc.puts(b"from C")  # stays in C's own buffer unless it is flushed
        os.write(1, b"from the descriptor")
    os.write(1, b"after")
    libc.fflush(None)
    assert capfd.readouterr().out == "before after"


def test_silence_ends_with_an_exception(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ZeroDivisionError), silenced(1):
        _ = 1 / 0
    os.write(1, b"heard")
    assert capfd.readouterr().out == "heard"


def test_nothing_but_the_program_writes_to_its_standard_output(linear: MakeLinear) -> None:
    pytest.importorskip(
        "pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only"
    )
    code = """
import ctypes
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.bullet import World, load_bullet, silenced
from tests_skill import skill
print("first", flush=True)
simulate(skill, Scenario(max_duration=0.1))
bullet = load_bullet()
with silenced(1):
    client = bullet.connect(bullet.DIRECT)
    try:
        bullet.loadURDF("absent.urdf", physicsClientId=client)
    except bullet.error:
        pass
    bullet.disconnect(client)
    ctypes.CDLL(None).puts(b"from C")
print("last")
"""
    skill = linear((0.5, 0.0, 0.5))
    prelude = f"""
import sys, types
import numpy as np
from skillctl.model.space import Euclidean
from skillctl.model.mixture import GaussianMixture
from skillctl.model.seds import SedsSkill
one = np.ones(1)
square = np.array([np.eye(3)])
target = np.array({skill.attractor.tolist()})
module = types.ModuleType("tests_skill")
module.skill = SedsSkill(one, target[None], square, -2 * square, square, target, square[0],
                         GaussianMixture(one, target[None], square), Euclidean.cartesian(3))
sys.modules["tests_skill"] = module
"""
    # Left to itself C keeps its text and prints it at the end of the process, when nothing is silenced.
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    done = subprocess.run(
        [sys.executable, "-c", prelude + code], env=buffered, capture_output=True, text=True, check=True
    )
    assert done.stdout == "first\nlast\n"
    assert done.stderr == ""


def test_worlds_do_not_know_each_other() -> None:
    pytest.importorskip("pybullet")
    one, other = World(), World()
    one.createMultiBody(0)
    assert (one.getNumBodies(), other.getNumBodies()) == (1, 0)
    assert one.DIRECT == other.DIRECT
    one.disconnect()
    assert other.getNumBodies() == 0
    other.disconnect()
