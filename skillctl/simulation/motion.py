"""The motion asked of the hand: a skill's velocity in the workspace, at speeds an arm can follow."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray, length
from skillctl.model.controller import Controller
from skillctl.model.skill import Skill
from skillctl.simulation.arm import CONTROL_PERIOD
from skillctl.simulation.avoid import Avoidance
from skillctl.simulation.placement import Placement
from skillctl.simulation.scenario import Scenario

LONGEST_PLAN = 60.0  # [s]
PLAN_ARRIVAL = 0.25  # of the tolerance: the plan ends well inside it
WORKSPACE_RADIUS = 3.0  # [m]: a plan that goes farther diverges
SLOWEST = 1e-12  # [m/s]: a cap has to be positive, even with the hand at its target


class Motion:
    """The hand's velocity, from the perceived hand position, once per control period.

    The skill gives the direction; the speed is the skill's, reduced where it exceeds the speed cap, what
    the acceleration allows since the last step, or √(a · distance to the target), from which the hand
    can brake with a. Reducing the speed changes no path: a skill times a positive factor has the same
    trajectories and stays stable (Eq. 7, first half).
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
        self._skill = skill
        self._period = period
        self._placement = placement
        self._max_speed, self._max_acceleration = scenario.max_speed, scenario.max_acceleration
        self._avoid = avoid
        self._moved = np.zeros(len(placement.origin))
        self._controller = Controller(self._among_bodies(), period, allow_unproved=True)
        self._ends = placement.to_workspace(np.stack([part.attractor for part in skill.acting_parts]))
        self._speed = 0.0

    def move(self, offset: FloatArray) -> None:
        """Move the skill in the workspace, all its targets with it, by ``offset`` (3,) [m].

        For the skill this is a jump of the hand, so a latched gate may select another part.
        """
        self._moved = self._moved + offset
        self._ends = self._ends + offset
        if self._avoid is not None:  # the cup moves with the skill, the boards do not
            self._controller.follow(self._among_bodies())

    def _among_bodies(self) -> Skill:
        return self._skill if self._avoid is None else self._avoid.applied(self._skill, self._moved)

    @property
    def part(self) -> int:
        """The part that acts, 0 for a skill without regions."""
        return self._controller.part or 0

    def target(self, position: FloatArray) -> FloatArray:
        """Return where the acting part ends, shape (3,); for instantaneous gates the nearest end."""
        acting = self.part
        if self._skill.reselects:
            acting = int(np.linalg.norm(self._ends - position, axis=1).argmin())
        return np.asarray(self._ends[acting])

    def distance_to_goals(self, position: FloatArray) -> float:
        """Return the distance of a position (3,) to the nearest end of any part, [m]."""
        return min(length(end - position) for end in self._ends)

    def velocity(self, position: FloatArray) -> FloatArray:
        """Return the hand's velocity (3,) [m/s] at a perceived position (3,)."""
        distance = length(self.target(position) - position)
        limit = min(
            self._max_speed,
            self._speed + self._max_acceleration * self._period,
            math.sqrt(self._max_acceleration * distance),
        )
        position = position - self._moved
        state = self._placement.to_state(position)
        inner = self._controller.step(state, max_speed=max(limit / self._placement.scale, SLOWEST))
        velocity = self._placement.lift(inner, position)
        speed = length(velocity)
        if speed > limit:  # only the velocity towards a plane can add to the skill's own
            velocity *= limit / speed
        self._speed = min(speed, limit)
        return velocity

    def slowed(self, factor: float) -> None:
        """Take into account that only this share of the last velocity was commanded."""
        self._speed *= factor


@dataclass(frozen=True, eq=False, slots=True)
class Plan:
    """The ideal motion, of a hand that follows each velocity at once.

    Attributes:
        positions: One per control period, shape (n, 3), [m].
        target: Its target at the end, shape (3,), [m].
        arrived: Whether it reached the target within the longest time.
    """

    positions: FloatArray
    target: FloatArray
    arrived: bool

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
    """Return the ideal motion from a workspace position (3,); it ends ``farthest`` from zero, [m]."""
    motion = Motion(skill, placement, scenario, avoid=avoid)
    position = start
    positions = [position]
    arrived = False
    for _ in range(round(LONGEST_PLAN / CONTROL_PERIOD)):
        velocity = motion.velocity(position)
        # An Euler step in the workspace is right here, whatever the space of the skill is.
        position = position + CONTROL_PERIOD * velocity
        if not length(position) < farthest:
            break
        positions.append(position)
        if length(motion.target(position) - position) < PLAN_ARRIVAL * scenario.tolerance:
            arrived = True
            break
    return Plan(np.stack(positions), motion.target(position), arrived)
