"""The loop that runs a skill on a robot: measure, ask the controller, command, once a period."""

from __future__ import annotations

import gc
import math
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from types import FrameType
from typing import Literal, TypeAlias

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.drivers.driver import Driver
from skillctl.drivers.log import Recorder, Rows
from skillctl.drivers.options import RunOptions
from skillctl.errors import GoalNotReachedError, NotFoundError, StateError, UsageError
from skillctl.model.chained import WAIT, ChainedSkill
from skillctl.model.controller import Controller
from skillctl.model.limits import Limits
from skillctl.model.skill import Skill
from skillctl.model.space import Space

Outcome: TypeAlias = Literal[
    "arrived",
    "timeout",
    "left the box",
    "no state",
    "bad state",
    "log ended",
    "fault",
    "interrupted",
    "terminated",
]
CONNECTING = 5.0  # [s] within which the first state has to come
STALE, STALE_PERIODS = 0.1, 5  # [s], periods: how old the newest state may be
SIGNALS: dict[int, Outcome] = {
    signal.SIGINT: "interrupted",
    signal.SIGTERM: "terminated",
    signal.SIGHUP: "terminated",  # the terminal is gone
}


@dataclass(frozen=True, slots=True)
class Ending:
    """How a run ended.

    Attributes:
        outcome: In a word.
        detail: What happened, in words; may be empty.
    """

    outcome: Outcome
    detail: str = ""


@dataclass(frozen=True, slots=True)
class DueEvent:
    """What a chain asks for.

    Attributes:
        time: When, from the beginning of the run, [s].
        stage: At the end of which stage, from 0.
        event: What it asks for.
    """

    time: float
    stage: int
    event: str


def limits_of(options: RunOptions) -> Limits:
    """Return the limits that options ask for; those that are not given are infinite."""
    given = {field.name: getattr(options, f"max_{field.name}", None) for field in fields(Limits)}
    return Limits(**{name: value for name, value in given.items() if value is not None})


def as_state(space: Space, numbers: Sequence[float]) -> FloatArray:
    """Return the state (d,) that a robot has measured; of a hand's pose its position, if no more is needed.

    Raises:
        StateError: Of another length, or not finite.
    """
    if space.flat and space.unit == "m" and space.dimension == 3 and len(numbers) in (6, 7):
        numbers = numbers[:3]
    return space.measured(numbers)


class Loop:
    """One motion of a robot.

    Attributes:
        events: What a chain has asked for.
        state: The newest state (d,).
    """

    def __init__(self, driver: Driver, skill: Skill, options: RunOptions) -> None:
        """Args: driver; skill, which is proved as far as it has to be; options."""
        self._driver, self._options = driver, options
        self._space, self._period = skill.space, driver.period
        limits = limits_of(options)
        self._controller = Controller(skill, driver.period, limits=limits, allow_unproved=True)
        self._recorder = Recorder(self._space.dimension)
        self.events: list[DueEvent] = []
        self.state = np.full(self._space.dimension, np.nan)
        self._stamp, self._fresh = -1.0, 0.0
        self._event: str | None = None
        self._stale = options.stale or max(STALE, STALE_PERIODS * self._period)
        self._began = self._due = 0.0
        if options.box is not None and len(options.box) != self._space.positions:
            names = ", ".join(self._space.names[: self._space.positions])
            raise UsageError(f"box: expected a range for each of {names}, got {len(options.box)}.")

    @property
    def rows(self) -> Rows:
        """What was measured and commanded so far."""
        return self._recorder.rows()

    def connect(self) -> FloatArray:
        """Return the first state (d,), once it is there.

        Raises:
            NotFoundError: None comes.
            StateError: It cannot be used.
            GoalNotReachedError: It, or every target, is outside the box.
        """
        driver = self._driver
        began = driver.now()
        while (measured := driver.state()) is None:
            if driver.now() - began > CONNECTING:
                raise NotFoundError(
                    f"no state came from {driver.place} within {CONNECTING:g} s.",
                    hint="Start the robot's side first, and check address and frame.",
                )
            driver.wait(driver.now() + self._period)
        self._stamp, self._fresh = measured.stamp, driver.now()
        self.state = as_state(self._space, measured.numbers)
        for name, states in (("start", [self.state]), ("target", self._controller.skill.attractors)):
            if all(self._outside(state) for state in states):
                raise GoalNotReachedError(
                    f"the {name} is outside the box; nothing moves.", hint="Check --box."
                )
        return self.state

    def _outside(self, state: FloatArray, margin: float = 0.0) -> bool:
        """Return whether a state (d,) is outside the box, or nearer to its sides than a margin, [m]."""
        sides = zip(state.tolist(), self._options.box or (), strict=False)  # a pose has more coordinates
        return any(x < low + margin or x > high - margin for x, (low, high) in sides)

    def drive(self, stopped: list[Outcome]) -> Ending:
        """Lead the robot until the run ends, and bring it to rest; whatever happens, it rests in the end.

        Args:
            stopped: The run ends once something is in it.
        """
        gc.collect()
        gc.disable()  # a full collection takes several periods of a fast robot
        self._began = self._due = self._fresh = self._driver.now()
        try:
            try:
                ending = self._follow(stopped)
            except StateError as error:
                ending = Ending("bad state", str(error))
            self._slow_down()
        except self._driver.faults as error:
            ending = Ending("fault", f"{type(error).__name__}: {error}")
        finally:
            gc.enable()
            with suppress(Exception):  # an error before this one is the one to tell of
                self._driver.command([0.0] * self._space.dimension)
        return ending

    def _follow(self, stopped: list[Outcome]) -> Ending:
        """Give commands until the run ends, and return how."""
        driver, controller, options = self._driver, self._controller, self._options
        busy, chained = False, isinstance(controller.skill, ChainedSkill)
        while not stopped:
            now = driver.now()
            measured = driver.state()
            if measured is None:
                return Ending("log ended")
            if measured.stamp != self._stamp:
                self._stamp, self._fresh = measured.stamp, now
            elif now - self._fresh > self._stale:
                return Ending("no state", f"the robot has sent none for {now - self._fresh:.2g} s")
            state = self.state = as_state(self._space, measured.numbers)
            if not chained and self._near(state):
                return Ending("arrived")
            if now - self._began > options.timeout:
                return Ending("timeout", f"not there after {options.timeout:g} s")
            command = controller.step(state, busy=busy)
            self._give(now, command, resting=False)
            busy = self._do(now, controller.event)
            leaving = self._outside(state) or self._leaving(command)
            self._pause(now)
            if controller.done:
                return Ending("arrived")
            if leaving:
                return Ending("left the box", "the hand was stopped before it would have left it")
        return Ending(stopped[0])

    def _do(self, now: float, event: str | None) -> bool:
        """Have the robot do what is due, and return whether it is still doing it."""
        if event != self._event and event is not None:
            self.events.append(DueEvent(now - self._began, self._controller.stage or 0, event))
        self._event = event
        return event is not None and not event.startswith(WAIT) and self._driver.event(event)

    def _give(self, now: float, command: FloatArray, *, resting: bool) -> None:
        """Give and record a command."""
        self._driver.command(command.tolist())
        stage, part = self._controller.stage or 0, self._controller.part or 0
        self._recorder.add(
            (now - self._began, now - self._due, stage, part, resting),
            self.state,
            command,
        )

    def _pause(self, now: float) -> None:
        """Wait until the next command is due."""
        # Deadlines are absolute, so that delays do not add up; of those that were missed none is made up for.
        self._due = max(self._due + self._period, now)
        self._driver.wait(self._due)

    def _near(self, state: FloatArray) -> bool:
        """Return whether a state (d,) is at an attractor."""
        moved, turned = self._space.apart(state, self._controller.skill.attractors)
        near = moved < self._options.tolerance
        if turned is not None:
            near &= turned < self._options.turn_tolerance
        return bool(near.any())

    def _leaving(self, command: FloatArray) -> bool:
        """Return whether the hand, after one more command, might come to rest outside of the box.

        By that command the place where it comes to rest moves by at most 2 Δt ‖w‖: Δt ‖w‖, and as much
        because it takes longer to brake. w is the command before averages, at most a²/j above them.
        """
        options, period = self._options, self._period
        a, jerk = options.max_acceleration, options.max_jerk or math.inf
        fastest = self._space.speeds(command)[0] + a * period + a * a / jerk
        rest = self._controller.rest
        return rest is not None and self._outside(rest, 2 * period * fastest)

    def _slow_down(self) -> None:
        """Bring the hand to rest on the way it is on, within the limits."""
        while not self._controller.resting:
            now = self._driver.now()
            if (measured := self._driver.state()) is not None:
                with suppress(StateError):
                    self.state = as_state(self._space, measured.numbers)
            self._give(now, self._controller.brake(), resting=True)
            self._pause(now)


@contextmanager
def heeded() -> Iterator[list[Outcome]]:
    """Yield a list that tells of the first SIGINT, SIGTERM or SIGHUP; a second one interrupts as usual.

    Outside the main thread no signal can be heeded.
    """
    stopped: list[Outcome] = []
    before = {number: signal.getsignal(number) for number in SIGNALS}
    if before[signal.SIGHUP] == signal.SIG_IGN:
        del before[signal.SIGHUP]  # nohup

    def heed(number: int, frame: FrameType | None) -> None:
        if stopped:
            usual = before[number]
            if callable(usual):
                usual(number, frame)
            raise KeyboardInterrupt
        stopped.append(SIGNALS[number])

    try:
        for number in before:
            signal.signal(number, heed)
    except ValueError:
        yield stopped
        return
    try:
        yield stopped
    finally:
        for number, usual in before.items():
            signal.signal(number, usual)
