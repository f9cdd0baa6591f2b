"""The simulated arm of `simulate`, in real time, and in a window if there is a display."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from contextlib import ExitStack

import numpy as np

from skillctl.drivers.driver import Driver, Measured, Setup
from skillctl.simulation.arm import CONTROL_PERIOD, ArmBody, Shapes
from skillctl.simulation.bullet import silenced
from skillctl.simulation.grasp import Gripper
from skillctl.simulation.gui import require_window
from skillctl.simulation.ik import Kinematics
from skillctl.simulation.position import PositionArm
from skillctl.simulation.prepare import prepare
from skillctl.simulation.scenario import Scenario


class BulletArm(Driver):
    """``pybullet``, or ``pybullet:ARM`` with an arm as ``simulate --arm`` takes it.

    Bullet's time is the real one as long as the machine keeps up; else commands come late, and are counted.
    """

    def __init__(self, setup: Setup) -> None:
        """Choose the posture at the start, and put the arm there. See ``prepare`` for what it raises."""
        super().__init__(setup)
        setup.require_hand()
        self.period = setup.period or CONTROL_PERIOD
        window = bool(os.environ.get("DISPLAY"))
        if window:
            require_window()
        chosen: dict[str, object] = {"arm": setup.address} if setup.address else {}
        if setup.start is not None:
            chosen["start"] = tuple(setup.start.tolist())
        self._space = setup.skill.space
        self._worlds = ExitStack()
        with silenced(1):
            scenario = Scenario().changed(**chosen)
            prepared = prepare(setup.skill, scenario)
            model, yaw = prepared.arm, prepared.base_yaw
            twin = self._worlds.enter_context(ArmBody(model, yaw, shapes="none"))
            seen: Shapes = "all" if window else "collision"
            body = self._worlds.enter_context(ArmBody(model, yaw, shapes=seen, gui=window))
            self._arm = PositionArm(body, prepared.joints, Kinematics(twin, prepared.hand, yaw))
        self._plan, self.grips = scenario.grasp, bool(model.fingers)
        self._gripper = Gripper(body) if self.grips else None
        self._done: float | None = None  # when the fingers will have done what they do
        self._velocity = np.zeros(setup.skill.dimension)
        self._began, self._simulated = time.monotonic(), 0.0

    def now(self) -> float:
        """Return the real time since the arm was put there."""
        return time.monotonic() - self._began

    def wait(self, until: float) -> None:
        """Simulate until then, and wait for the real time."""
        while self._simulated + 0.5 * CONTROL_PERIOD < until:
            self._arm.drive(self._velocity)
            self._simulated += CONTROL_PERIOD
        super().wait(until)

    def state(self) -> Measured:
        """Return the simulated measurement."""
        return Measured(self._simulated, self._space.given(self._arm.place_now))

    def command(self, velocity: Sequence[float]) -> None:
        """Have the reference of the hand move with this velocity."""
        self._velocity = np.array(velocity)

    def event(self, text: str) -> bool:
        """Close or open the fingers, for as long as ``simulate`` does."""
        if self._gripper is None or text not in ("close", "open"):
            return False
        if self._done is None:
            plan, closes = self._plan, text == "close"
            (self._gripper.close if closes else self._gripper.open)(plan.force, plan.speed)
            self._done = self._simulated + (plan.close_time if closes else plan.open_time)
        if self._simulated < self._done:
            return True
        self._done = None
        return False

    def close(self) -> None:
        """Close the worlds, and the window."""
        self._worlds.close()
