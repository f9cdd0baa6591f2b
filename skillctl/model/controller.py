"""The controller: what a control loop calls once per period, and the only owner of memory."""

from __future__ import annotations

import math

import numpy.typing as npt

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.model.skill import Skill, contraction_period
from skillctl.model.stepper import UNCAPPED, Caps, Step, Stepper


class Controller:
    """Turns the measured state into a velocity command, once per period.

    A latched combined skill needs memory: which part acts. It is chosen at the first step and again
    whenever the measured state lies more than the skill's ``disturbance_distance`` from where the last
    command should have led. All other skills need none.

    Attributes:
        skill: What is followed.
        period: Time between two calls of ``step``, [s].
        part: Index of the part that acted last; None before the first step.
    """

    def __init__(self, skill: Skill, period: float, *, allow_unproved: bool = False) -> None:
        """Args: skill; period: time between two calls of ``step``, [s]; allow_unproved: a longer period, too.

        The period is held against the one at which every component contracts, which agrees with the
        certificate's to one part in 10¹²; what is proved of the whole skill only ``verify`` says.

        Raises:
            UsageError: A period that is not positive, or longer than steps are known to contract for.
        """
        self._stepper = Stepper(skill, period)
        longest = contraction_period(skill)
        if period > longest and not allow_unproved:
            proved = f"at most {longest:.3g} s is" if longest > 0 else "no period is"
            raise UsageError(
                f"period: {period:g} s is too long: {proved} proved for this skill.",
                hint="Step it more often, learn it with a longer --period, or pass allow_unproved=True.",
            )
        self.skill, self.period = skill, period
        self._last: Step | None = None

    @property
    def part(self) -> int | None:
        """Index of the part that acted last; None before the first step."""
        return None if self._last is None else int(self._last.parts)

    def reset(self) -> None:
        """Forget which part acts: the next step is a start."""
        self._last = None

    @property
    def next(self) -> FloatArray | None:
        """The state (d,) that the last command leads to in a period; None before the first step."""
        return None if self._last is None else self._last.states

    def step(
        self, state: npt.ArrayLike, *, max_speed: float | None = None, max_turn: float | None = None
    ) -> FloatArray:
        """Return the velocity command for the measured state (d,), per second.

        A command for a pose is a twist in the base frame: (vx, vy, vz [m/s], ωx, ωy, ωz [rad/s]).

        Args:
            state: Where the robot is, shape (d,); a pose also as (x, y, z, qx, qy, qz, qw).
            max_speed: The largest speed the robot will be given, per second; a faster command is shortened.
                Told here, a robot that falls behind an uncapped command is not mistaken for a disturbed one.
            max_turn: The same for the speed at which a pose turns, [rad/s].

        Raises:
            StateError: A state of another shape, or not finite; the controller is as before.
            UsageError: A cap that is not positive and finite.
        """
        x = self.skill.space.measured(state)
        caps = UNCAPPED
        if max_speed is not None or max_turn is not None:
            caps = Caps(_cap("max_speed", max_speed), _cap("max_turn", max_turn))
        last, part, near = self._last, None, None
        if last is not None and not self._disturbed(x, last):
            part, near = int(last.parts), last.offset
        self._last = self._stepper.step(x, part, caps, near)
        return self._last.command

    def _disturbed(self, state: FloatArray, last: Step) -> bool:
        return self.skill.space.distance_at(state, last.states) > self.skill.disturbance_distance


def _cap(name: str, value: float | None) -> float:
    """Return a cap, infinite if there is none."""
    if value is None:
        return math.inf
    if not 0 < value < math.inf:
        raise UsageError(f"{name}: must be a positive number, got {value!r}.")
    return value
