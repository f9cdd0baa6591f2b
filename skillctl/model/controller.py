"""The controller: what a control loop calls once per period, and the only owner of memory."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray, length
from skillctl.errors import UsageError
from skillctl.model.skill import CombinedSkill, Skill


class Controller:
    """Turns the measured state into a velocity command, once per period.

    A latched combined skill needs memory: which part acts. It is chosen at the first step and again
    whenever the measured state lies more than the skill's ``disturbance_distance`` from where the last
    command should have led. All other skills need none.
    """

    def __init__(self, skill: Skill, period: float) -> None:
        """Args: skill; period: time between two calls of ``step``, [s]."""
        if not (np.isfinite(period) and period > 0):
            raise UsageError(f"period: must be a positive number of seconds, got {period!r}.")
        self.skill = skill
        self.period = period
        self.part: int | None = None
        self._expected: FloatArray | None = None

    def reset(self) -> None:
        """Forget which part acts: the next step is a start."""
        self.part, self._expected = None, None

    def step(self, state: npt.ArrayLike, *, max_speed: float = np.inf) -> FloatArray:
        """Return the velocity command for the measured state (d,), per second.

        Args:
            state: Where the robot is, shape (d,).
            max_speed: The largest speed the robot will be given; a faster command is shortened to it. Said
                here, a robot that falls behind an uncapped command is not mistaken for a disturbed one.
        """
        x = np.asarray(state, dtype=np.float64)
        if not isinstance(self.skill, CombinedSkill):
            return _shortened(self.skill.velocity(x), max_speed)
        if self.part is None or self.skill.gate == "instantaneous" or self._disturbed(x, self.skill):
            self.part = int(self.skill.part_at(x[None])[0])
        velocity = _shortened(self.skill.velocity(x, np.array([self.part])), max_speed)
        self._expected = x + self.period * velocity
        return velocity

    def _disturbed(self, state: FloatArray, skill: CombinedSkill) -> bool:
        if self._expected is None:
            return False
        return length(state - self._expected) > skill.disturbance_distance


def _shortened(velocity: FloatArray, max_speed: float) -> FloatArray:
    speed = length(velocity)
    return velocity * (max_speed / speed) if speed > max_speed else velocity
