"""When a motion is over, and how it ended."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray, length
from skillctl.simulation.arm import CONTROL_PERIOD, Tracking
from skillctl.simulation.disturbances import jumped
from skillctl.simulation.episode import Outcome, Unit
from skillctl.simulation.motion import Motion, Plan
from skillctl.simulation.scenario import Scenario

UNREACHABLE_TIME = 0.25  # [s] without joints for the reference, in a row
DIVERGED_FACTOR, DIVERGED_ROOM = 1.5, 0.05  # of the plan's largest distance to its target; [m]


@dataclass(frozen=True, slots=True)
class Verdict:
    """How an episode ended; ``detail`` is the cause of a failure, as the end of a sentence."""

    outcome: Outcome
    detail: str = ""


def apart(distance: float, unit: Unit, *, fine: bool = False, turn: float = 0.0) -> str:
    """Return how far the arm was from its target, in words.

    Args:
        distance: In the unit.
        unit: Metres, or radians of joints.
        fine: Give metres in millimetres.
        turn: Angle to the target's orientation, [rad]; zero is not mentioned.
    """
    if unit == "rad":
        return f"the joints were {distance:.2f} rad from their target"
    away = f"{1e3 * distance:.0f} mm" if fine else f"{distance:.2f} m"
    return f"the hand was {away}{f' and {math.degrees(turn):.0f}°' if turn else ''} from its target"


class Judge:
    """Decides when a motion is over, and how it ended.

    Attributes:
        farthest: Distance to the nearest target from which on the motion counts as diverged, [m].
    """

    def __init__(
        self, plan: Plan, scenario: Scenario, period: float = CONTROL_PERIOD, unit: Unit = "m"
    ) -> None:
        """Args: plan of the motion, without disturbances; scenario; control period, [s]; unit of the plan."""
        self._unit = unit
        n = len(plan.target) if unit == "rad" else 3
        distances = np.linalg.norm(plan.positions[:, :n] - plan.target[:n], axis=1)
        planned = distances.max() if plan.arrived else distances[0]
        self.farthest = DIVERGED_FACTOR * float(planned) + DIVERGED_ROOM + jumped(scenario.disturbances)
        self._tolerance, self._turn_tolerance = scenario.tolerance, scenario.turn_tolerance
        self._settle_steps = math.ceil(scenario.settle_time / period)
        self._refusals = math.ceil(UNREACHABLE_TIME / period)
        self._near_true, self._near_seen = 0, 0  # control periods within the tolerance so far, in a row

    def failure(
        self, motion: Motion, hand: FloatArray, velocity: FloatArray, tracking: Tracking
    ) -> Verdict | None:
        """Return how the motion failed, None if it has not."""
        distance = motion.distance_to_goals(hand)
        if not np.isfinite(velocity).all():
            return Verdict("diverged", "the skill's velocity was not a number")
        if not distance < self.farthest:
            return Verdict("diverged", f"{apart(distance, self._unit)}, and going away")
        if tracking.refusals < self._refusals:
            return None
        where = "({:.2f}, {:.2f}, {:.2f}) m".format(*tracking.reference)
        if tracking.at_limit is None:
            return Verdict("unreachable", f"no joints put the hand near {where}")
        joint = tracking.at_limit + 1
        return Verdict("joint_limit", f"joint {joint} would have to pass its limit for the hand at {where}")

    def settled(self, motion: Motion, hand: FloatArray, seen_off: FloatArray) -> Verdict | None:
        """Return ``reached`` when the hand has stayed at its target for long enough, else None.

        The target is the true one. A hand that stays where it perceives the target, beyond the tolerance of
        the true one, has ``missed`` it.

        Args:
            motion: The motion, towards the perceived target.
            hand: Place of the hand.
            seen_off: Offset of the perceived target from the true one, of the shape of a place.
        """
        seen = motion.target(hand)
        off, turn = motion.gap(hand, seen - seen_off)
        turned = turn < self._turn_tolerance
        self._near_true = self._near_true + 1 if turned and off < self._tolerance else 0
        near_seen = turned and motion.gap(hand, seen)[0] < self._tolerance
        self._near_seen = self._near_seen + 1 if near_seen else 0
        if self._near_true > self._settle_steps:
            return Verdict("reached")
        if self._near_seen > self._settle_steps and length(seen_off) >= self._tolerance:
            away = f"{1e3 * off:.0f} mm from its target"
            return Verdict("missed", f"the hand stopped {away}, which it perceived there")
        return None
