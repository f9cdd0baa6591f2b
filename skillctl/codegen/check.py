"""A header, compiled by the compilers that there are, and compared with the skill in Python."""

from __future__ import annotations

import math
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.codegen.states import Limits, shares_of, stage_ends, states_around, stepped
from skillctl.errors import NotFoundError
from skillctl.model.chained import ChainedSkill
from skillctl.model.controller import Controller
from skillctl.model.skill import Skill, extent

STATES = 10_000
STEPS = 50  # of each motion; half of the states are starts
PUSHED, PUSH = 0.1, 0.2  # share of its steps before which a state is pushed, and how far, in extents
NUDGES = (0.01, 0.1)  # how far starts are pushed after one step: a disturbance or none, over a seam or not
TOLERANCE = 1e-12  # of a command
LAST_BITS = 8.0  # times what a command changes by the last bit of one coordinate of its state
BUSY = 0.7  # share of the steps at which an event of a chain still goes on
SMALLEST = 1e-300  # keeps a quotient by a command that is zero from being none
FREE = (math.inf, math.inf)
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
        nanoseconds: A step takes; with limits on every second motion.
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
    steps = recorded(skill, taught, period)
    found = Check((), len(steps))
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
                answers = _run(["./driver", str(found.states), repr(period)], place, _given(steps))
            except subprocess.TimeoutExpired:
                return replace(found, problem=f"{found.compilers[-1]} took longer than {PATIENCE:g} s.")
            found = _compared(answers, steps, found)
            if found.problem:
                return found
    return found


class Taken(NamedTuple):
    """A step that the skill's controller has taken in Python.

    Attributes:
        controller: Which took it; it has gone on since.
        before: The memory of the controller before it.
        start: The stage that it began, counted from 1; 0 if it went on.
        limits, busy, state: What it was given.
        command, memory, ahead: What it answered, what it remembers as numbers, and where it leads.
    """

    controller: Controller
    before: Mapping[str, Any]
    start: int
    limits: Limits
    busy: bool
    state: FloatArray
    command: FloatArray
    memory: tuple[int, int]
    ahead: FloatArray

    def again(self, state: FloatArray) -> FloatArray:
        """Return the command (d,) for another state (d,) in its place."""
        self.controller.restore(self.before)
        return stepped(self.controller, state, self.limits, self.busy)

    def spread(self) -> float:
        """Return how far the command changes with the last bit of one coordinate of the state.

        In coordinates a command is what leads from one state to another, per period: it has the last bits of
        those.
        """
        plain = all(part.plain for part in self.controller.skill.acting_parts)
        changes = [0.0 if plain else float(np.linalg.norm(np.spacing(self.state))) / self.controller.period]
        for axis, value in enumerate(self.state):
            for beside in (np.nextafter(value, -math.inf), np.nextafter(value, math.inf)):
                state = self.state.copy()
                state[axis] = beside
                changes.append(float(np.linalg.norm(self.again(state) - self.command)))
        return max(changes)


def recorded(skill: Skill, taught: Sequence[FloatArray], period: float) -> list[Taken]:
    """Return steps from starts of all kinds, and of motions that are pushed; half of them have limits."""
    controller, space, rng = (
        Controller(skill, period, allow_unproved=True),
        skill.space,
        np.random.default_rng(1),
    )
    steps: list[Taken] = []

    def step(state: FloatArray, limits: Limits, start: int = 0) -> Taken:
        if start == 1:
            controller.reset()
        elif start:
            controller.go(start - 1)
        before, busy = controller.state(), bool(rng.uniform() < BUSY)
        command = stepped(controller, state, limits, busy)
        past, event = controller.state()["course"]["past"], controller.event is not None
        memory = controller.part or 0, 4 * past + 2 * event + controller.done
        ahead = np.asarray(controller.next)
        steps.append(Taken(controller, before, start, limits, busy, state, command, memory, ahead))
        return steps[-1]

    def pushed(state: FloatArray, size: float) -> FloatArray:
        return space.displace(state, size * rng.standard_normal(skill.dimension))

    for state in states_around(skill, STATES // 8, taught, seed=1):
        free = step(state, FREE, start=1)
        step(pushed(free.ahead, float(rng.choice(NUDGES))), FREE)
        step(state, shares_of(space.speeds(free.command), (0.5, 0.8)), start=1)
    count = (STATES - len(steps)) // STEPS
    starts = [(0, state) for state in states_around(skill, count, taught, seed=2)]
    if isinstance(skill, ChainedSkill):
        starts[::2] = stage_ends(skill, len(starts[::2]), rng)
    for index, (stage, state) in enumerate(starts):
        speeds = space.speeds(skill.velocity(state))
        limits = shares_of(speeds, (0.3, 0.3)) if index % 4 > 1 else FREE
        for number in range(STEPS):
            state = step(state, limits, start=0 if number else stage + 1).ahead
            if rng.uniform() < PUSHED:
                state = pushed(state, PUSH * extent(skill.density))
    return steps


def _given(steps: Sequence[Taken]) -> bytes:
    """Return what the driver reads."""
    rows = [[step.start, *step.limits, step.busy, *step.state] for step in steps]
    return np.array(rows, dtype=np.float64).tobytes()


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
    for index in delicate.tolist():
        off[index] = max(0.0, off[index] - LAST_BITS * steps[index].spread())
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
