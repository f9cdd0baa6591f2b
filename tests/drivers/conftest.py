"""A hand that can be made to fail, and runs of it without files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skillctl.drivers.driver import Measured, Setup
from skillctl.drivers.fake import FakeArm
from skillctl.drivers.loop import Loop
from skillctl.drivers.options import RunOptions


@dataclass
class Hooks:
    """What is done to a hand.

    Attributes:
        measured: Changes the measurement of a step (its number, measurement).
        slept: By how much a pause is longer than it should be, [s], by its number.
        events: What was asked for, one entry a call.
        busy: Whether an event is still being done, given the number of calls so far.
        last: The hand.
    """

    measured: Callable[[int, Measured], Measured | None] = lambda step, measured: measured
    slept: Callable[[int], float] = lambda step: 0.0
    events: list[str] = field(default_factory=list)
    busy: Callable[[int], bool] = lambda calls: False
    last: Any = None


class Probe(FakeArm):
    """A fake arm whose commands are kept, and that fails as it is told to."""

    faults = (ConnectionError,)

    def __init__(self, setup: Setup, hooks: Hooks) -> None:
        super().__init__(setup)
        self.hooks, self._steps, self._pauses = hooks, 0, 0
        self.commands: list[np.ndarray] = []
        hooks.last = self

    def state(self) -> Any:
        measured = super().state()
        self._steps += 1
        return self.hooks.measured(self._steps, measured)

    def command(self, velocity: Any) -> None:
        FakeArm.state(self)
        self._told = np.array(velocity)
        self.commands.append(np.array(velocity))

    def wait(self, until: float) -> None:
        self._pauses += 1
        super().wait(until + self.hooks.slept(self._pauses))

    def event(self, text: str) -> bool:
        self.hooks.events.append(text)
        return self.hooks.busy(len(self.hooks.events))


@pytest.fixture
def lead():
    """Lead a fake hand with a skill: return how it ended, the loop and the driver."""

    def call(
        skill: Any, start: Any, *, hooks: Hooks | None = None, stopped: Any = None, **options: Any
    ) -> Any:
        chosen = RunOptions(**options)
        start = skill.space.measured(start)
        driver = Probe(Setup("", skill, chosen.period, start=start), hooks or Hooks())
        loop = Loop(driver, skill, chosen)
        loop.connect()
        ending = loop.drive([] if stopped is None else stopped)
        return SimpleNamespace(ending=ending, loop=loop, rows=loop.rows, driver=driver)

    return call


@pytest.fixture
def make_probe():
    """What is done to a hand."""
    return Hooks


@pytest.fixture(scope="session")
def positions(make_skill):
    """A skill that leads a hand to (0.5, 0, 0.4)."""
    return make_skill(np.random.default_rng(5), dimension=3, attractor=[0.5, 0.0, 0.4])
