"""A header, compiled by the compilers that there are, and compared with the skill in Python."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.codegen.recording import Taken, recorded
from skillctl.errors import NotFoundError
from skillctl.model.skill import Skill

STATES = 10_000
TOLERANCE = 1e-12  # of a command
LAST_BITS = 8.0  # times what a command changes by the last bit of one coordinate of its state
SHARE = 20  # of so many states one may be delicate; those beyond are not excused
SMALLEST = 1e-300  # keeps a quotient by a command that is zero from being none
PATIENCE = 300.0  # [s] for a compiler, and for a run

STRICT = ("-O2", "-Wall", "-Wextra", "-Werror", "-pedantic")
LANGUAGES = (  # with the variable that names a compiler, those looked for, and options
    ("C99", "CC", ("cc", "gcc", "clang"), ("-std=c99", "-x", "c")),
    ("C++17", "CXX", ("c++", "g++", "clang++"), ("-std=c++17", "-x", "c++")),
)


@dataclass(frozen=True)
class Check:
    """How a header compares with its skill.

    Attributes:
        compilers: With which it was compiled, as in ``cc (C99)``.
        states: At how many states.
        difference: The largest of commands, relative to the command. Where it is above ``TOLERANCE``, what
            the skill's own command changes with the last bits of the state is taken off before.
        delicate: At how many states that was so.
        nanoseconds: A step takes on the average, with limits at some.
        problem: Why it is not the same, in one sentence; empty if it is.
    """

    compilers: tuple[str, ...]
    states: int = 0
    difference: float = 0.0
    delicate: int = 0
    nanoseconds: float = 0.0
    problem: str = ""


def check(
    skill: Skill, header: str, taught: Sequence[FloatArray], period: float, environment: Mapping[str, str]
) -> Check:
    """Compile a header and compare what it commands with what the skill's controller does.

    Args:
        skill: The skill.
        header: Its header.
        taught: Its demonstrations, (n, d) each; there may be none.
        period: Between two steps, [s].
        environment: Where ``CC`` and ``CXX`` may name the compilers, and ``PATH`` where they are looked for.

    Raises:
        NotFoundError: There is no C compiler. Without one of C++ the header is compiled as C alone.
    """
    steps = recorded(skill, taught, period, STATES)
    given, found = np.array([step.given for step in steps]).tobytes(), Check((), len(steps))
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        (place / "skill.h").write_text(header, encoding="ascii")
        driver = files("skillctl.codegen").joinpath("driver.c").read_text(encoding="ascii")
        (place / "driver.c").write_text(driver, encoding="ascii")
        for language, variable, programs, options in LANGUAGES:
            compiler = _compiler(environment, variable, programs)
            if compiler is None and not found.compilers:
                raise NotFoundError(
                    f"{environment.get(variable) or programs[0]}: there is no C compiler to check with.",
                    hint="Install one, such as gcc or clang, or name yours in CC; or leave out --check.",
                )
            if compiler is None:
                continue
            found = replace(found, compilers=(*found.compilers, f"{Path(compiler[0]).name} ({language})"))
            command = [*compiler, *options, *STRICT, "driver.c", "-o", "driver", "-lm"]
            try:
                compiled = _run(command, place)
                if compiled.returncode:
                    lines = compiled.stderr.decode(errors="replace").strip().splitlines()
                    return replace(
                        found, problem=f"It does not compile with {found.compilers[-1]}: {lines[0]}"
                    )
                answers = _run(["./driver", str(found.states), repr(period)], place, given)
            except subprocess.TimeoutExpired:
                return replace(found, problem=f"{found.compilers[-1]} took longer than {PATIENCE:g} s.")
            found = _compared(answers, steps, found)
            if found.problem:
                return found
    return found


def _compared(run: subprocess.CompletedProcess[bytes], steps: Sequence[Taken], found: Check) -> Check:
    """Return how what the driver has answered differs."""
    expected = np.array([[0, *step.memory, *step.command] for step in steps], dtype=np.float64)
    if run.returncode or len(run.stdout) != expected.nbytes:
        return replace(found, problem=f"{found.compilers[-1]}: what it compiled died.")
    answered = np.frombuffer(run.stdout).reshape(expected.shape)
    for index in np.flatnonzero((answered[:, :3] != expected[:, :3]).any(axis=1))[:1]:
        return replace(found, problem=f"It remembers something else at {steps[index].state.tolist()}.")
    off = np.linalg.norm(answered[:, 3:] - expected[:, 3:], axis=1)
    size = np.linalg.norm(expected[:, 3:], axis=1)
    delicate = np.flatnonzero(~(off <= TOLERANCE * size))
    for index in delicate[: len(steps) // SHARE].tolist():
        step, far = steps[index], off[index]
        off[index] = max(0.0, far - LAST_BITS * step.rounding)
        if off[index] > TOLERANCE * size[index]:
            off[index] = max(0.0, far - LAST_BITS * step.spread)
    difference = float((off / np.maximum(size, SMALLEST)).max())
    problem = "" if difference <= TOLERANCE else f"Commands differ by {difference:.1e} of their size."
    return replace(
        found,
        difference=max(found.difference, difference),
        delicate=max(found.delicate, len(delicate)),
        nanoseconds=found.nanoseconds or 1e9 * float(run.stderr) / len(steps),
        problem=problem,
    )


def _compiler(environment: Mapping[str, str], variable: str, programs: tuple[str, ...]) -> list[str] | None:
    """Return the command of a compiler: the one that the user names, else the first that there is."""
    for command in [environment[variable]] if environment.get(variable) else programs:
        words = shlex.split(command)
        if words and shutil.which(words[0], path=environment.get("PATH")):
            return words
    return None


def _run(command: list[str], place: Path, given: bytes = b"") -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(command, cwd=place, input=given, capture_output=True, timeout=PATIENCE, check=False)
