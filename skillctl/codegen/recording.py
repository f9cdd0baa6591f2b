"""What the controller of a skill does in Python, step by step: what it has to do in another language."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, field, replace

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.codegen.states import capped, stage_ends, states_around, stepped
from skillctl.model.chained import ChainedSkill
from skillctl.model.controller import Controller
from skillctl.model.limits import Limits
from skillctl.model.skill import Skill, extent
from skillctl.model.stepper import CLOSE

STEPS = 50  # of each motion; three of eight states are those of starts
PUSHED, PUSH = 0.1, 0.2  # share of its steps before which a state is pushed, and how far, in extents
NUDGES = (0.01, 0.1)  # how far starts are pushed after one step: a disturbance or none, over a seam or not
BUSY = 0.7  # share of the steps at which an event of a chain still goes on
CARRIED = 10 * CLOSE  # see ``Taken.rounding``
RISE, EASE = 20, 5  # periods to the usual speed, and to the acceleration, in motions that have such limits


@dataclass(frozen=True, eq=False)
class Taken:
    """A step that was taken.

    Attributes:
        motion: The steps of the same motion, this one among them.
        place: Its index there.
        stage: That the motion began with.
        busy, state: What it was given.
        command, memory, ahead: What it answered, what it remembers as numbers, and where it leads.
    """

    motion: Motion
    place: int
    busy: bool
    state: FloatArray
    command: FloatArray
    memory: tuple[int, int]
    ahead: FloatArray

    @property
    def given(self) -> list[float]:
        """The stage that is begun, counted from 1, or 0; the six limits; busy; the state."""
        begun = 0 if self.place else self.motion.stage + 1
        return [float(begun), *astuple(self.motion.limits), float(self.busy), *self.state.tolist()]

    @property
    def rounding(self) -> float:
        """The last bit of a command: in coordinates it leads from one state to another, per period.

        Within a limit of acceleration a command is made of those before it, and the first one from rest is
        searched, to ``CLOSE``: it is known to ``CARRIED`` of what the limit allows in a period.
        """
        controller, limits = self.motion.controller, self.motion.limits
        if limits.ramps:
            allowed = [a for a in (limits.acceleration, limits.turn_acceleration) if a < math.inf]
            return CARRIED * max(allowed) * controller.period
        plain = all(part.plain for part in controller.skill.acting_parts)
        return 0.0 if plain else float(np.linalg.norm(np.spacing(self.state))) / controller.period

    @property
    def spread(self) -> float:
        """How far the command changes with the last bit of one coordinate of the state."""
        changes = [self.rounding]
        for axis, value in enumerate(self.state):
            for beside in (np.nextafter(value, -math.inf), np.nextafter(value, math.inf)):
                state = self.state.copy()
                state[axis] = beside
                changes.append(float(np.linalg.norm(self._again(state) - self.command)))
        return max(changes)

    def _again(self, state: FloatArray) -> FloatArray:
        """Return the command for another state in the place of this one, after the same steps."""
        self.motion.begin()
        for step in self.motion.steps[: self.place]:
            self.motion.commanded(step.state, step.busy)
        return self.motion.commanded(state, self.busy)


@dataclass(eq=False)
class Motion:
    """Steps from one start.

    Attributes:
        controller: That takes them; it may have taken those of others before.
        limits: Of them.
        stage: That they begin with.
        steps: So far.
    """

    controller: Controller
    limits: Limits
    stage: int = 0
    steps: list[Taken] = field(default_factory=list)

    def begin(self) -> None:
        """Let the controller begin anew."""
        self.controller.reset()
        if self.stage:
            self.controller.go(self.stage)

    def commanded(self, state: FloatArray, busy: bool) -> FloatArray:
        """Return the command (d,) for a state (d,)."""
        return stepped(self.controller, state, self.limits, busy)

    def step(self, state: FloatArray, busy: bool) -> Taken:
        """Take a step, the first one as a start."""
        if not self.steps:
            self.begin()
        controller, command = self.controller, self.commanded(state, busy)
        past, event = controller.state()["course"]["past"], controller.event is not None
        memory = controller.part or 0, 4 * past + 2 * event + controller.done
        taken = Taken(self, len(self.steps), busy, state, command, memory, np.asarray(controller.next))
        self.steps.append(taken)
        return taken


def recorded(skill: Skill, taught: Sequence[FloatArray], period: float, count: int) -> list[Taken]:
    """Return about ``count`` steps: starts of all kinds, and motions that are pushed; many have limits."""
    space, rng, controllers = skill.space, np.random.default_rng(1), {}

    def motion(limits: Limits, stage: int = 0) -> Motion:
        ramps = replace(limits, speed=math.inf, turn=math.inf)
        if ramps not in controllers:
            controllers[ramps] = Controller(skill, period, limits=ramps, allow_unproved=True)
        return Motion(controllers[ramps], limits, stage)

    def pushed(state: FloatArray, size: float) -> FloatArray:
        return space.displace(state, size * rng.standard_normal(skill.dimension))

    def busy() -> bool:
        return bool(rng.uniform() < BUSY)

    motions = []
    for state in states_around(skill, count // 8, taught, seed=1):
        free = motion(Limits())
        first = free.step(state, busy())
        free.step(pushed(first.ahead, float(rng.choice(NUDGES))), busy())
        limited = motion(capped(space.speeds(first.command), (0.5, 0.8)))
        limited.step(state, busy())
        motions += [free, limited]
    rest = (count - sum(len(each.steps) for each in motions)) // STEPS
    starts = [(0, state) for state in states_around(skill, rest, taught, seed=2)]
    if isinstance(skill, ChainedSkill):
        starts[::2] = stage_ends(skill, len(starts[::2]), rng)
    usual = np.median([space.speeds(skill.velocity(state)) for _, state in starts], axis=0)
    ramps = ramped(usual.tolist(), period)
    for index, (stage, state) in enumerate(starts):
        caps = capped(space.speeds(skill.velocity(state)), (0.3, 0.3))
        kinds = Limits(), caps, ramps[0], replace(ramps[1], speed=caps.speed, turn=caps.turn)
        each = motion(kinds[index // 2 % 4], stage)
        for _ in range(STEPS):
            state = each.step(state, busy()).ahead
            if rng.uniform() < PUSHED:
                state = pushed(state, PUSH * extent(skill.density))
        motions.append(each)
    return [step for each in motions for step in each.steps]


def ramped(speeds: Sequence[float], period: float) -> tuple[Limits, Limits]:
    """Return limits of acceleration, and of jerk, too, that suit usual speeds; none where nothing turns."""
    moving, turning = (speed / (RISE * period) if speed > 0 else math.inf for speed in speeds)
    only = Limits(acceleration=moving, turn_acceleration=turning)
    ease = EASE * period
    return only, replace(only, jerk=moving / ease, turn_jerk=turning / ease)
