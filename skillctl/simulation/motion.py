"""The motion asked of the hand: a skill's velocity in the workspace, at speeds an arm can follow."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.model.chained import ChainedSkill
from skillctl.model.controller import Controller
from skillctl.model.skill import Skill
from skillctl.simulation.arm import CONTROL_PERIOD
from skillctl.simulation.avoid import Avoidance
from skillctl.simulation.placement import Placement
from skillctl.simulation.scenario import Scenario

PUSH_MEMORY = 1.0  # [s]: what a push adds up to within about this time counts as a jump
LONGEST_PLAN = 60.0  # [s]
PLAN_ARRIVAL = 0.25  # of the tolerance: the plan ends well inside it
WORKSPACE_RADIUS = 3.0  # [m]: a plan that goes farther diverges
SLOWEST = 1e-12  # [m/s], [rad/s]: a cap has to be positive, even with the hand at its target


class Motion:
    """The hand's velocity, from the perceived place of the hand, once per control period.

    The skill gives the direction; the speed is the skill's, reduced where it exceeds the speed cap, what
    the acceleration allows since the last step, or √(a · distance to the target), from which the hand
    can brake with a. A hand that turns is slowed down in the same way for its turning speed. Reducing the
    speed changes no path: a skill times a positive factor has the same trajectories and stays stable (Eq. 7,
    first half).

    A place is a position in the workspace (3,), [m], whose velocity is a vector; a pose (6,), whose velocity
    is a twist; or a posture of joints.
    """

    def __init__(
        self,
        skill: Skill,
        placement: Placement,
        scenario: Scenario,
        period: float = CONTROL_PERIOD,
        avoid: Avoidance | None = None,
    ) -> None:
        """Make the motion of a skill.

        Args:
            skill: Already moved to its target.
            placement: In the workspace.
            scenario: For the limits.
            period: Of control, [s].
            avoid: What keeps it out of the scene, if anything does.
        """
        self._skill, self._space = skill, skill.space
        self._turns = skill.space.positions < skill.dimension
        self._period = period
        self._placement = placement
        self._max_speed, self._max_acceleration = scenario.max_speed, scenario.max_acceleration
        self._max_turn, self._max_turn_acceleration = scenario.max_turn, scenario.max_turn_acceleration
        self._avoid, self._at_cup = avoid, scenario.stages_at("cup")
        self._ends = placement.to_workspace(np.stack([part.attractor for part in skill.acting_parts]))
        self._moved = np.zeros(self._ends.shape[1])
        self._controller = Controller(self._among_bodies(), period, allow_unproved=True)
        self._speed, self._turning = 0.0, 0.0
        self._led: FloatArray | None = None  # where commands have led a hand that nobody pushes
        self._given = np.zeros(len(self._moved))  # the last velocity, as far as the joints allowed

    def follow_cup(self, offset: FloatArray) -> None:
        """Move the skill with the cup by ``offset`` (3,) [m]; of a chain, the stages that are bound to it."""
        skill, placement = self._skill, self._placement
        if not isinstance(skill, ChainedSkill):
            self.move(offset)
            return
        inner = placement.to_state(offset) - placement.to_state(np.zeros(3))
        for stage in self._at_cup:
            self._ends[list(skill.stages[stage]), :3] += offset
            skill = skill.with_stage(stage, skill.parts[stage].translated(inner))
        self._skill = skill
        self._controller.follow(self._among_bodies())

    def take_again(self) -> None:
        """Begin the first stage of a chain that is bound to the cup anew."""
        self._controller.go(self._at_cup[0])
        self._led = None

    @property
    def event(self) -> str | None:
        """What a chain asks for now, between two stages."""
        return self._controller.event

    @property
    def done(self) -> bool:
        """Whether the last stage of a chain, and its events, are over; of any other skill always."""
        return not isinstance(self._skill, ChainedSkill) or self._controller.done

    def move(self, offset: FloatArray) -> None:
        """Move the skill in the workspace, all its targets with it, by ``offset`` (3,) [m].

        For the skill this is a jump of the hand, so a latched gate may select another part.
        """
        self._moved[:3] += offset
        self._ends[:, :3] += offset
        if self._avoid is not None:  # the cup moves with the skill, the boards do not
            self._controller.follow(self._among_bodies())

    def _among_bodies(self) -> Skill:
        return self._skill if self._avoid is None else self._avoid.applied(self._skill, self._moved[:3])

    @property
    def part(self) -> int:
        """The part that acts, 0 for a skill without regions."""
        return self._controller.part or 0

    def target(self, place: FloatArray) -> FloatArray:
        """Return the place where the acting part ends; for instantaneous gates the nearest end."""
        acting = self.part
        if self._skill.reselects:
            acting = int(self._space.distance(self._ends, place).argmin())
        return np.array(self._ends[acting])

    def gap(self, to: FloatArray, start: FloatArray) -> tuple[float, float]:
        """Return how far apart two places are, [m] or of joints [rad], and the angle of poses, [rad]."""
        return self._space.speeds(self._space.difference_at(to, start))

    def distance_to_goals(self, place: FloatArray) -> float:
        """Return the distance of a place to the nearest end of any part, [m]."""
        return min(self.gap(end, place)[0] for end in self._ends)

    def velocity(self, place: FloatArray, *, busy: bool = False) -> FloatArray:
        """Return the hand's velocity at a perceived place, [m/s] and [rad/s].

        Args:
            place: Perceived place of the hand.
            busy: Whether what a chain asked for between two stages is still being done.
        """
        distance, angle = self.gap(self.target(place), place)
        limit = min(
            self._max_speed,
            self._speed + self._max_acceleration * self._period,
            math.sqrt(self._max_acceleration * distance),
        )
        max_turn = None
        if self._turns:
            fastest = min(
                self._max_turn,
                self._turning + self._max_turn_acceleration * self._period,
                math.sqrt(self._max_turn_acceleration * angle),
            )
            max_turn = max(fastest, SLOWEST)
        place = place - self._moved
        self._notice_push(place)
        inner = self._controller.step(
            self._placement.to_state(place),
            busy=busy,
            max_speed=max(limit / self._placement.scale, SLOWEST),
            max_turn=max_turn,
        )
        velocity = self._placement.lift(inner, place)
        speed, self._turning = self._space.speeds(velocity)
        if speed > limit:  # only the velocity towards a plane can add to the skill's own
            velocity *= limit / speed
        self._speed = min(speed, limit)
        self._given = velocity
        return velocity

    def _notice_push(self, place: FloatArray) -> None:
        """Begin a stage anew, which may choose another part, where a hand that yields was pushed away.

        It moves steadily, so no step of it is a jump to the controller; all of them together are one.
        """
        skill, controller = self._skill, self._controller
        if not isinstance(skill, ChainedSkill):
            return
        led = place
        if self._led is not None:
            led = self._space.displace_at(self._led, self._period * self._given)
        gap = self._space.difference_at(place, led)
        pushed = self._space.speeds(gap)[0] > self._placement.scale * skill.disturbance_distance
        if pushed and controller.stage is not None and controller.event is None:
            controller.go(controller.stage)
            led, gap = place, 0 * gap
        self._led = self._space.displace_at(led, self._period / PUSH_MEMORY * gap)

    def slowed(self, factor: float) -> None:
        """Take into account that only this share of the last velocity was commanded."""
        self._speed *= factor
        self._turning *= factor
        self._given = factor * self._given


@dataclass(frozen=True, eq=False, slots=True)
class Plan:
    """The ideal motion, of a hand that follows each velocity at once.

    Attributes:
        positions: Places (see ``Motion``), one per control period, shape (n, 3) or (n, 6).
        target: Its target at the end, a place.
        arrived: Whether it reached the target within the longest time.
    """

    positions: FloatArray
    target: FloatArray
    arrived: bool

    @property
    def path(self) -> FloatArray:
        """Positions of the hand alone, shape (n, 3), [m]."""
        return self.positions[:, :3]

    @property
    def duration(self) -> float:
        """Time the plan takes, [s]."""
        return CONTROL_PERIOD * (len(self.positions) - 1)


def plan_motion(
    skill: Skill,
    placement: Placement,
    scenario: Scenario,
    start: FloatArray,
    *,
    farthest: float = WORKSPACE_RADIUS,
    avoid: Avoidance | None = None,
) -> Plan:
    """Return the ideal motion from a place in the workspace; it ends ``farthest`` from zero, [m]."""
    motion = Motion(skill, placement, scenario, avoid=avoid)
    place = start
    places = [place]
    arrived = False
    for _ in range(round(LONGEST_PLAN / CONTROL_PERIOD)):
        velocity = motion.velocity(place)
        # A place of a skill in a plane has three numbers; flat spaces do not mind.
        place = skill.space.displace_at(place, CONTROL_PERIOD * velocity)
        if not motion.gap(place, np.zeros_like(place))[0] < farthest:
            break
        places.append(place)
        moved, turned = motion.gap(motion.target(place), place)
        if (
            motion.done
            and moved < PLAN_ARRIVAL * scenario.tolerance
            and turned < PLAN_ARRIVAL * scenario.turn_tolerance
        ):
            arrived = True
            break
    return Plan(np.stack(places), motion.target(place), arrived)
