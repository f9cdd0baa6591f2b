r"""Limits of speed, acceleration and jerk: commands that a robot can follow from rest to rest (ours).

Acceleration. The stop z of a state s and a command w is where the state comes to rest if w is brought to zero
in equal parts, as few as the acceleration a allows: in n steps, z = s ⊞ ½ (n − 1) Δt w. Of the commands
within a Δt of the last one, the one is taken that

1. is the longest along the skill's own command f (its path stays), or, if there is none, comes nearest to it;
2. leaves the next period enough: it is at most √(0.8 a Δt / ‖f⁺ − f‖) of f, where f⁺ is the command at the
   place f leads to. So the robot slows down in curves, and towards the target;
3. moves z so that √V falls there by at least a share of what it falls along f, for the length;
4. leaves z, and the straight way to it, outside of bodies.

If 1 and 2 give a command that breaks 3 or 4, the shortest along f is tried, and then braking, which keeps
both, as it leaves z where it is; of the commands between, the last that keeps them is taken. At rest z is s,
and of the skill's own step the largest share with ‖w‖ ≤ a Δt is taken: there V falls as is proved.

So V(z) never rises. Nor does it stay above zero: by 3 the way of z is finite, so z has a limit; there the
robot comes to rest, and unless that is the target, a step of the skill's own leads on. A push, a moved target
or another part begin this anew; as z may then be a worse place than s, the robot may first move away from the
target, for at most ‖w‖ / a and over ‖w‖² / 2a. No command ever breaks a limit.

Jerk. Commands are averaged over N = ⌈2a / (j Δt)⌉ periods. That keeps speed and acceleration and, as
‖Δw‖ ≤ a Δt, the jerk. The skill is asked at s = x ⊞ what the averages will still add to the measured x: s
moves by Δt w in each period, so all of the above is true of it. x is the mean of the last N places of s, and
about a / j behind. Turns do not commute: of poses this is exact while the axis of turning stays.

So s is on the skill's own path, except where a curve begins too suddenly to slow down before it; and x cuts
the corners of that path as averages do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np

from skillctl.arrays import FloatArray, length
from skillctl.errors import UsageError
from skillctl.model.coordinates.gauge import Gauge
from skillctl.model.skill import ActingSkill
from skillctl.model.space import Space
from skillctl.model.stepper import UNCAPPED, Caps, Step, Stepper, moved

FOLLOWING = 0.8  # of the acceleration may be spent on following the path; the rest is for slowing down
DESCENT = 0.1  # of the fall of √V along the skill's own step, for the length: what the stop has to fall by
HALVINGS = 6  # of the difference between a command that is allowed and one that is not
WHOLE = 1e-9  # of a number of steps: what rounding may add
LONGEST_MEAN = 10.0  # [s] over which commands are averaged
CLOSED = 1e-9  # of the distance to the target: coordinates that lead back this near hold there


@dataclass(frozen=True, slots=True)
class Limits:
    """What a robot will be asked for; infinite unless given.

    Attributes:
        speed: [m/s], or per second in the unit of the space.
        acceleration: [m/s²], or in the unit of the space.
        jerk: [m/s³], or in the unit of the space; needs an acceleration.
        turn: [rad/s], of a space with orientations, as the other two.
        turn_acceleration: [rad/s²].
        turn_jerk: [rad/s³]; needs an acceleration.
    """

    speed: float = math.inf
    acceleration: float = math.inf
    jerk: float = math.inf
    turn: float = math.inf
    turn_acceleration: float = math.inf
    turn_jerk: float = math.inf

    def __post_init__(self) -> None:
        """Check the limits.

        Raises:
            UsageError: One that is not positive, or a jerk without an acceleration.
        """
        for field in fields(self):
            if not (value := getattr(self, field.name)) > 0:
                raise UsageError(f"{field.name}: must be a positive number, got {value!r}.")
        for prefix in ("", "turn_"):
            if getattr(self, f"{prefix}jerk") < math.inf == getattr(self, f"{prefix}acceleration"):
                raise UsageError(
                    f"{prefix}jerk: can only be kept together with an acceleration.",
                    hint=f"Give {prefix}acceleration, too.",
                )

    @property
    def caps(self) -> Caps:
        """Those of the speed; ``UNCAPPED`` itself if there are none."""
        return Caps(self.speed, self.turn) if min(self.speed, self.turn) < math.inf else UNCAPPED

    @property
    def ramps(self) -> bool:
        """Whether commands may change only so fast."""
        return min(self.acceleration, self.turn_acceleration) < math.inf

    def periods(self, period: float, turns: bool) -> int:
        """Return over how many periods [s] commands are averaged, N, of a state that turns or does not.

        Raises:
            UsageError: A jerk so small that it would be for more than ten seconds.
        """
        pairs = ((self.acceleration, self.jerk), (self.turn_acceleration, self.turn_jerk))
        longest = max((2 * a / j for a, j in pairs[: 1 + turns] if j < math.inf), default=0.0)
        if longest > LONGEST_MEAN:
            raise UsageError(
                f"jerk: is so small that it takes {0.5 * longest:.3g} s to reach the acceleration.",
                hint="Give a larger jerk, or a smaller acceleration.",
            )
        return max(1, math.ceil(longest / period - WHOLE))


class Ramp:
    """The memory that limits need: what has been commanded. At first the robot is at rest.

    Attributes:
        resting: Whether nothing is commanded any more.
    """

    def __init__(self, space: Space, limits: Limits, period: float) -> None:
        """Args: space; limits; period: Δt, [s]."""
        self._space, self._period = space, period
        split = space.positions
        n = limits.periods(period, split < space.dimension)
        changes = limits.acceleration * period, limits.turn_acceleration * period
        self._changes = tuple(zip((slice(0, split), slice(split, space.dimension)), changes, strict=True))
        self._left = np.arange(n - 1, -1, -1) * (period / n)  # what is still to come of each command
        self._commands = np.zeros((n, space.dimension))  # w of the last N periods, the newest first

    def state(self) -> list[list[float]]:
        """Return the memory as plain numbers: w of the last N periods, the newest first."""
        return self._commands.tolist()

    def restore(self, memory: Sequence[Sequence[float]]) -> None:
        """Go on with a memory.

        Raises:
            ValueError: It is not of as many periods, or of another space.
        """
        self._commands = np.array(memory, dtype=np.float64).reshape(self._commands.shape)

    @property
    def resting(self) -> bool:
        """Whether nothing is commanded any more."""
        return not self._commands.any()

    def caps(self, caps: Caps) -> Caps:
        """Return the caps of the skill's next step: those given, and from rest what one period reaches."""
        if self._commands[0].any():
            return caps
        return caps.within(Caps(*(change for _, change in self._changes)))

    def ahead(self, state: FloatArray) -> FloatArray:
        """Return s for the measured state (d,): where it will be once the averages have run out."""
        if len(self._left) == 1:
            return state
        return self._space.displace_at(state, self._left @ self._commands)

    def rest(self, state: FloatArray) -> FloatArray:
        """Return the state (d,) where ``brake``, from a state (d,) on, leads."""
        command = self._commands[0]
        return self._moved(self.ahead(state), command, self._steps(command) - 1)

    def brake(self) -> FloatArray:
        """Return the next command (d,) on the way to rest: zero at the end, and from then on."""
        return self._commanded(self._braked())

    def follow(
        self,
        state: FloatArray,
        ahead: FloatArray,
        step: Step,
        stepper: Stepper,
        caps: Caps,
        bodies: Sequence[Gauge] = (),
    ) -> Step:
        """Return the step that a robot is given within the limits.

        Args:
            state: x, as measured, shape (d,).
            ahead: s, shape (d,).
            step: What the skill does at s, within ``caps``.
            stepper: What made it.
            caps: As returned by ``caps``.
            bodies: That no stop may be behind.
        """
        command = step.command
        if self._commands[0].any():
            command = self._moving(ahead, step, stepper, caps, bodies)
        command = self._commanded(command)
        return Step(moved(self._space, state, command, self._period), command, step.parts, step.offset)

    def _commanded(self, command: FloatArray) -> FloatArray:
        """Remember a command w (d,); return the average that is sent."""
        if len(self._commands) == 1:
            self._commands = command[None]
            return command
        self._commands = np.concatenate([command[None], self._commands[:-1]])
        return np.asarray(self._commands.mean(axis=0))

    def _moving(
        self, s: FloatArray, step: Step, stepper: Stepper, caps: Caps, bodies: Sequence[Gauge]
    ) -> FloatArray:
        """Return the next w (d,) of a state that moves, for a step that the skill would like to do at s."""
        braked = self._braked()
        if not step.command.any():
            return braked
        part = stepper.skill.acting_parts[int(step.parts)]
        onward = stepper.step(step.states, int(step.parts), caps, step.offset).command
        longest, shortest = self._along(step.command * self._ease(onward - step.command))
        stop = self._moved(s, self._commands[0], self._steps(self._commands[0]) - 1)
        asked = _Descent(part, s, step.states, stop)

        def allowed(command: FloatArray) -> bool:
            trial = self._moved(s, command, self._steps(command) + 1)
            return asked.met_by(trial) and _free(part, s, trial, bodies)

        if allowed(longest):
            return longest
        if allowed(shortest):
            return _last(allowed, shortest, longest)
        return _last(allowed, braked, shortest)

    def _moved(self, s: FloatArray, command: FloatArray, halves: int) -> FloatArray:
        return self._space.displace_at(s, 0.5 * halves * self._period * command)

    def _size(self, change: FloatArray) -> float:
        """Return in how many periods, a fraction, a command can change so."""
        return max(length(change[block]) / most for block, most in self._changes)

    def _steps(self, command: FloatArray) -> int:
        """Return in how many periods a command (d,) can be brought to zero: n, at least one."""
        return max(1, math.ceil(self._size(command) * (1 - WHOLE)))

    def _braked(self) -> FloatArray:
        command = self._commands[0]
        return np.asarray(command * (1 - 1 / self._steps(command)))

    def _ease(self, change: FloatArray) -> float:
        """Return the factor on a command which is to change so, by which it takes what may be spent on it."""
        size = self._size(change)
        return min(1.0, math.sqrt(FOLLOWING / size)) if size > 0 else 1.0

    def _along(self, wanted: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the longest and the shortest command along ``wanted`` (d,) that one period allows.

        If there is none, both are the one that comes nearest to any of these.
        """
        last = self._commands[0]
        low, high = 0.0, 1.0
        for block, change in self._changes:
            if change < math.inf:
                ends = _chord(wanted[block], last[block], change)
                low, high = max(low, ends[0]), min(high, ends[1])
        if low <= high:
            return high * wanted, low * wanted
        weights = np.empty_like(last)
        for block, most in self._changes:
            weights[block] = 1 / most
        scaled = weights * wanted
        along = float(scaled @ (weights * last) / (scaled @ scaled))
        change = min(1.0, max(0.0, along)) * wanted - last
        nearest = last + change / self._size(change)
        return nearest, nearest


def _last(allowed: Callable[[FloatArray], bool], good: FloatArray, bad: FloatArray) -> FloatArray:
    """Return about the last command that is allowed on the way from one that is to one that is not."""
    for _ in range(HALVINGS):
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if allowed(middle) else (good, middle)
    return good


def _chord(along: FloatArray, centre: FloatArray, radius: float) -> tuple[float, float]:
    """Return between which t the point t ``along`` (n,) is in a ball; an empty range if it never is."""
    square, product = float(along @ along), float(along @ centre)
    if square == 0:
        return (0.0, 1.0) if length(centre) <= radius else (1.0, 0.0)
    room = product * product - square * float(centre @ centre - radius * radius)
    if room < 0:
        return 1.0, 0.0
    half = math.sqrt(room)
    return (product - half) / square, (product + half) / square


class _Descent:
    """Whether √V falls from the old stop to a new one as on the skill's own step, or a share of that.

    Where that step itself lowers no V, as of a skill that is not proved, nothing is asked.
    """

    def __init__(self, part: ActingSkill, state: FloatArray, onward: FloatArray, stop: FloatArray) -> None:
        """Args: part; state: s, and onward: where its own step leads; stop: z; each of shape (d,)."""
        self._part = part
        self._stop = self._lifted(stop)
        here, there = self._lifted(state), self._lifted(onward)
        own = self._size(there - here)
        self._share = DESCENT * (self._size(here) - self._size(there)) / own if own > 0 else 0.0

    def met_by(self, trial: FloatArray) -> bool:
        """Return whether it falls so at a new stop (d,)."""
        if self._share <= 0:
            return True
        y = self._lifted(trial)
        return self._size(self._stop) - self._size(y) >= self._share * self._size(y - self._stop)

    def _lifted(self, state: FloatArray) -> FloatArray:
        part = self._part
        return part.coordinates.forward_at(part.space.offset_at(state, part.attractor))

    def _size(self, y: FloatArray) -> float:
        return math.sqrt(y.dot(self._part.lyapunov.dot(y)))


def _free(part: ActingSkill, s: FloatArray, trial: FloatArray, bodies: Sequence[Gauge]) -> bool:
    """Return whether the straight way from a state to a stop, (d,) each, is free of bodies."""
    for body in bodies:  # all of it lies before the plane through the point of the body that is before s
        value, slope = body.slope_at((s - body.pole).tolist())
        if np.dot(slope, trial - s) < 1 - value:
            return False
    space, coordinates = part.space, part.coordinates
    longest = coordinates.longest_at(space.offset_at(s, part.attractor))
    if longest == math.inf:
        return True
    end = space.offset_at(trial, part.attractor)
    outside = coordinates.back_at(coordinates.forward_at(end))  # of what is in a body: its surface
    return space.speeds(space.difference_at(trial, s))[0] <= longest and length(
        outside - end
    ) <= CLOSED * length(end)
