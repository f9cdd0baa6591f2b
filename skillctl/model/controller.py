"""The controller: what a control loop calls once per period, and the only owner of memory."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.model.chained import ChainedSkill
from skillctl.model.coordinates.bodies import Body
from skillctl.model.coordinates.gauge import Gauge
from skillctl.model.course import Course
from skillctl.model.kept_out import kept_out
from skillctl.model.limits import Limits, Ramp
from skillctl.model.skill import Skill, contraction_period
from skillctl.model.steering import steered
from skillctl.model.stepper import Caps, Step, Stepper, moved


class Controller:
    """Turns the measured state into a velocity command, once per period.

    A latched combined skill needs memory: which part acts. It is chosen at the first step and again
    whenever the measured state lies more than the skill's ``disturbance_distance`` from where the last
    command should have led. A chain needs the same number, which says its stage, too; and how far the events
    between two stages have come. All other skills need none.

    Attributes:
        skill: What is followed.
        period: Time between two calls of ``step``, [s].
        part: Index of the part that acted last; None before the first step.
        stage: Of a chain: index of the stage that acted last; 0 of other skills; None before the first step.
        event: Of a chain: what the caller is to do now, such as ``close``; None if there is nothing to do. A
            ``wait`` counts by itself.
        done: Of a chain: whether the last stage, and its events, are over.
        blocked: Names of the bodies before which the last step ended, since nothing leads on; see ``step``.
    """

    def __init__(
        self,
        skill: Skill,
        period: float,
        *,
        keep_out: Sequence[Body] = (),
        margin: float | None = None,
        limits: Limits | None = None,
        allow_unproved: bool = False,
    ) -> None:
        """Make a controller of a skill at its target.

        Args:
            skill: What is followed.
            period: Time between two calls of ``step``, [s].
            keep_out: Bodies that the motion must not enter, in the skill's frame; see ``kept_out``.
            margin: What stays free around these, and around those that ``step`` is told of, [m].
            limits: Of speed, acceleration and jerk, which hold at every step from rest on; see ``limits``.
            allow_unproved: Accept a longer period than is proved.

        The period is held against the one at which every component contracts, which agrees with the
        certificate's to one part in 10¹²; what is proved of the whole skill only ``verify`` says.

        Raises:
            UsageError: A period that is not positive, or longer than steps are known to contract for; bodies
                without a margin, or that ``kept_out`` refuses.
        """
        self._margin = margin
        self._known = [(body.name, self._inflated(body)) for body in keep_out]
        if margin is not None:
            skill = kept_out(skill, keep_out, margin=margin)
        self._stepper = Stepper(skill, period)
        longest = contraction_period(skill)
        if period > longest and not allow_unproved:
            proved = f"at most {longest:.3g} s is" if longest > 0 else "no period is"
            raise UsageError(
                f"period: {period:g} s is too long: {proved} proved for this skill.",
                hint="Step it more often, learn it with a longer --period, or pass allow_unproved=True.",
            )
        self.skill, self.period = skill, period
        self._limits = limits or Limits()
        self._ramp = self._at_rest()
        self._begin = 0  # the stage that a start begins with
        self._last: Step | None = None
        self._course = Course(period)
        self._measured: FloatArray | None = None
        self.blocked: tuple[str, ...] = ()

    def __copy__(self) -> Controller:
        """Return a controller that goes on from here by itself: no memory is shared."""
        return deepcopy(self)

    @property
    def part(self) -> int | None:
        """Index of the part that acted last; None before the first step."""
        return None if self._last is None else int(self._last.parts)

    @property
    def stage(self) -> int | None:  # noqa: D102
        return None if self.part is None else self.skill.stage_of(self.part)

    @property
    def event(self) -> str | None:  # noqa: D102
        return self._course.event

    @property
    def done(self) -> bool:  # noqa: D102
        return self._course.done

    @property
    def inside(self) -> tuple[str, ...]:
        """Names of the known bodies that the last measured state was in, or nearer to than the margin.

        No command leads there; a push may. The next commands lead straight out again.
        """
        if self._measured is None:
            return ()
        position = self._measured[None, : self.skill.space.positions]
        return tuple(name for name, gauge in self._known if gauge.values(position)[0] < 1)

    def follow(self, skill: Skill) -> None:
        """Go on with another skill of the same parts, as among bodies that moved; which one acts stays."""
        self.skill, self._stepper = skill, Stepper(skill, self.period)

    def reset(self) -> None:
        """Forget which part acts, and what was commanded: the next step is a start from rest."""
        self._start(0)
        self._ramp = self._at_rest()

    def go(self, stage: int) -> None:
        """Begin a stage of a chain at the next step, as the one that takes a cup which was lost.

        Args:
            stage: Counted from 0.

        Raises:
            UsageError: The skill is no chain, or has no such stage.
        """
        if not isinstance(self.skill, ChainedSkill) or not 0 <= stage < len(self.skill.parts):
            raise UsageError(f"stage: this skill has no stage {stage}.")
        self._start(stage)

    def _start(self, stage: int) -> None:
        self._last, self._begin = None, stage
        self._course.begin()

    def state(self) -> dict[str, Any]:
        """Return the memory as plain numbers and texts, for ``restore`` of a controller of the same skill."""
        memory: dict[str, Any] = {"begin": self._begin, "course": self._course.state(), "last": None}
        if (last := self._last) is not None:
            offset = None if last.offset is None else last.offset.tolist()
            vectors = {"states": last.states.tolist(), "command": last.command.tolist(), "offset": offset}
            memory["last"] = {**vectors, "parts": int(last.parts)}
        return memory if self._ramp is None else {**memory, "ramp": self._ramp.state()}

    def restore(self, memory: Mapping[str, Any], *, moving: bool = False) -> None:
        """Go on where another controller of the same skill, period and limits was.

        Args:
            memory: What its ``state`` returned.
            moving: Whether the robot still moves as was commanded then. If not, the limits begin at rest.

        Raises:
            UsageError: It is not that of such a controller; this one is as before.
        """
        course, ramp = Course(self.period), self._at_rest()
        try:
            last, begin = memory["last"], range(len(self.skill.parts) or 1)[memory["begin"]]
            course.begin(**memory["course"])
            if last is not None:
                states, command = self._vector(last["states"]), self._vector(last["command"])
                offset = None if last["offset"] is None else self._vector(last["offset"])
                part = range(len(self.skill.acting_parts))[last["parts"]]
                last = Step(states, command, part, offset)
            if moving and ramp is not None:
                ramp.restore(memory["ramp"])
        except (KeyError, IndexError, TypeError, ValueError):
            raise UsageError("state: it is not that of a controller of this skill.") from None
        self._course, self._last, self._begin, self._ramp = course, last, begin, ramp

    def _vector(self, values: Sequence[float]) -> FloatArray:
        return np.array(values, dtype=np.float64).reshape(self.skill.dimension)

    def brake(self) -> FloatArray:
        """Return the next command (d,) of a straight way to rest within the limits, whatever the skill says.

        It takes at most ‖v‖ / acceleration + 2 acceleration / jerk, then the command is zero and ``resting``
        true; without limits that is at once. A step after it goes on from there.
        """
        command = np.zeros(self.skill.dimension) if self._ramp is None else self._ramp.brake()
        if self._last is not None:
            states = moved(self.skill.space, self._last.states, command, self.period)
            self._last = replace(self._last, states=states, command=command)
        return command

    @property
    def rest(self) -> FloatArray | None:
        """The state (d,) where ``brake`` leads after the last command; None before the first step."""
        return self.next if self._last is None or self._ramp is None else self._ramp.rest(self._last.states)

    @property
    def resting(self) -> bool:
        """Whether nothing more is commanded: before the first step, and at the end of ``brake``."""
        if self._ramp is None:
            return self._last is None or not self._last.command.any()
        return self._ramp.resting

    def _at_rest(self) -> Ramp | None:
        return Ramp(self.skill.space, self._limits, self.period) if self._limits.ramps else None

    @property
    def next(self) -> FloatArray | None:
        """The state (d,) that the last command leads to in a period; None before the first step."""
        return None if self._last is None else self._last.states

    def step(
        self,
        state: npt.ArrayLike,
        *,
        max_speed: float | None = None,
        max_turn: float | None = None,
        seen: Sequence[Body] = (),
        busy: bool = False,
    ) -> FloatArray:
        """Return the velocity command for the measured state (d,), per second.

        A command for a pose is a twist in the base frame: (vx, vy, vz [m/s], ωx, ωy, ωz [rad/s]).

        Args:
            state: Where the robot is, shape (d,); a pose also as (x, y, z, qx, qy, qz, qw).
            max_speed: The largest speed the robot will be given, per second; a faster command is shortened.
                Told here, a robot that falls behind an uncapped command is not mistaken for a disturbed one.
            max_turn: The same for the speed at which a pose turns, [rad/s].
            seen: Bodies that are seen now, or move slowly, beside those that were known before. None that
                stands still is entered, and V never rises; that the motion arrives is not proved. Before a
                face that is wide, as seen from the target, it may stop: then ``blocked`` names the body,
                and the command is zero until the body moves.
            busy: Whether the ``event`` of the last step is still going on, as while the gripper closes.

        Raises:
            StateError: A state of another shape, or not finite; the controller is as before.
            UsageError: A cap that is not positive and finite; bodies seen without a margin, or by a skill
                over anything but positions.
        """
        x = self.skill.space.measured(state)
        caps, ramp = self._caps(max_speed, max_turn), self._ramp
        bodies = self._seen(seen)
        self._measured = x
        part, near = self._acting(x, busy)
        ahead = x if ramp is None else ramp.ahead(x)
        step = self._stepper.step(ahead, part, caps, near)
        self.blocked = ()
        if bodies:
            step = self._steered(ahead, step, bodies, caps)
        if ramp is not None:
            step = ramp.follow(x, ahead, step, self._stepper, caps, [gauge for _, gauge in bodies])
        self._last = step
        return step.command

    def _caps(self, max_speed: float | None, max_turn: float | None) -> Caps:
        """Return the caps of the next step of the skill: ``UNCAPPED`` itself if there are none."""
        caps = self._limits.caps
        if max_speed is not None or max_turn is not None:
            caps = caps.within(Caps(_cap("max_speed", max_speed), _cap("max_turn", max_turn)))
        return caps if self._ramp is None else self._ramp.caps(caps)

    def _acting(self, state: FloatArray, busy: bool) -> tuple[int | None, FloatArray | None]:
        """Return the part that acts at a state, None for a start; and, where it goes on, its last offset."""
        last, skill = self._last, self.skill
        going = None if last is None or self._disturbed(state, last) else last
        part = None if going is None else int(going.parts)
        if isinstance(skill, ChainedSkill):
            if part is None:
                part = skill.begun_at(self._begin, state)
                if last is not None:
                    part = skill.resumed_at(state, int(last.parts))
                self._course.begin()
            part = self._course.onward(skill, state, part, busy)
        return part, going.offset if going is not None and part == going.parts else None

    def _seen(self, seen: Sequence[Body]) -> list[tuple[str, Gauge]]:
        """Return what is to be steered clear of: what is seen, and then what is known, too; refuse first."""
        space = self.skill.space
        if not seen:
            return []
        if space.positions < space.dimension or space.unit != "m":
            raise UsageError("seen: only a skill over positions can be steered clear of what is seen.")
        return [*((body.name, self._inflated(body)) for body in seen), *self._known]

    def _steered(
        self, state: FloatArray, step: Step, bodies: Sequence[tuple[str, Gauge]], caps: Caps
    ) -> Step:
        """Return a step that is steered clear of bodies; say which ones block it."""
        space = self.skill.space
        part = self.skill.acting_parts[int(step.parts)]
        gauges = [gauge for _, gauge in bodies]
        turned = steered(part, state, step.command, gauges, self.period, caps)
        self.blocked = tuple(bodies[index][0] for index in turned.blocked)
        return Step(moved(space, state, turned.velocity, self.period), turned.velocity, step.parts)

    def _inflated(self, body: Body) -> Gauge:
        if self._margin is None:
            raise UsageError(
                f"{body.name}: a controller among bodies needs a margin.",
                hint="Give margin=…, in metres, such as the radius of the hand.",
            )
        return body.inflated(self._margin)

    def _disturbed(self, state: FloatArray, last: Step) -> bool:
        return self.skill.space.distance_at(state, last.states) > self.skill.disturbance_distance


def _cap(name: str, value: float | None) -> float:
    """Return a cap, infinite if there is none."""
    if value is None:
        return math.inf
    if not 0 < value < math.inf:
        raise UsageError(f"{name}: must be a positive number, got {value!r}.")
    return value
