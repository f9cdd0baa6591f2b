"""Grasping: close the fingers at the cup, lift it, hold it, and judge whether that succeeded."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from skillctl.arrays import FloatArray, length
from skillctl.errors import UsageError
from skillctl.simulation.arm import ArmBody
from skillctl.simulation.arms import ArmModel
from skillctl.simulation.episode import Phase
from skillctl.simulation.judge import Verdict
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.scene import Contact

TIPPED = math.cos(math.radians(20.0))  # cosine of the angle between the cup's axis and the vertical
FALLEN = 0.02  # [m]: a cup this far below its start has left its board
HOLD_RATE = 5.0  # [1/s], at which the lifted hand returns to where it should be
FIRST_LOOK = 0.05  # [s]: a cup lost this soon in the hold was lost in the lift
GEAR_FORCE, GEAR_ERP = 50.0, 0.1  # of a gear, as one motor drives both fingers of the real hand


def require_gripper(model: ArmModel, scenario: Scenario) -> None:
    """Raise UsageError unless the arm has fingers that fit around the scenario's cup, if there is one."""
    if scenario.cup is None:
        return
    if not model.fingers:
        raise UsageError(f"the {model.name} arm has no gripper to take the cup.", hint="Use --arm panda.")
    opening = sum(place for _, place in model.fingers)
    if 2 * scenario.cup.radius >= opening:
        raise UsageError(
            f"cup.radius: a cup {2e3 * scenario.cup.radius:.0f} mm wide does not fit between fingers "
            f"{1e3 * opening:.0f} mm apart."
        )


class Gripper:
    """The fingers of an arm in a world with a cup."""

    def __init__(self, arm: ArmBody) -> None:
        """Args: the arm, whose fingers are open."""
        self._arm = arm
        self._joints = [joint for joint, _ in arm.model.fingers]
        bullet, (first, second) = arm.bullet, self._joints
        gear = bullet.createConstraint(
            arm.body, first, arm.body, second, bullet.JOINT_GEAR, (1, 0, 0), (0, 0, 0), (0, 0, 0)
        )
        bullet.changeConstraint(gear, gearRatio=-1, erp=GEAR_ERP, maxForce=GEAR_FORCE)
        for joint in self._joints:
            bullet.changeDynamics(arm.body, joint, lateralFriction=1.0)
        self._open = dict(arm.model.fingers)
        names = arm.link_names()
        self.links = tuple(names[joint] for joint in self._joints)

    def close(self, force: float, speed: float) -> None:
        """Begin to close with ``force`` [N] and ``speed`` [m/s] a finger."""
        self._go(dict.fromkeys(self._joints, 0.0), force, speed)

    def open(self, force: float, speed: float) -> None:
        """Begin to open; see ``close``."""
        self._go(self._open, force, speed)

    def _go(self, places: dict[int, float], force: float, speed: float) -> None:
        body, bullet = self._arm.body, self._arm.bullet
        motor = {"controlMode": bullet.POSITION_CONTROL, "force": force, "maxVelocity": speed}
        for joint, place in places.items():
            bullet.setJointMotorControl2(body, joint, targetPosition=place, **motor)


class Standing:
    """A cup that should stand where it is until it is taken."""

    def __init__(self, cup: FloatArray) -> None:
        """Args: pose (7,) of the cup."""
        self.place = cup[:3]
        self._toucher = ""

    def moved(self, offset: FloatArray) -> None:
        """Move the place where it should stand by ``offset`` (3,) [m]."""
        self.place = self.place + offset

    def verdict(self, time: float, cup: FloatArray, touching: set[str]) -> Verdict | None:
        """Return how the cup fell, None if it stands.

        Args:
            time: The present time, [s].
            cup: Pose (7,) of the cup.
            touching: Links that touch it.
        """
        if touching:
            self._toucher = min(touching)
        low = self.place[2] - FALLEN
        if upright(cup) and cup[2] > low:
            return None
        how = "fell off its board" if upright(cup) else "fell over"
        cause = f", pushed by {self._toucher}" if self._toucher else ""
        return Verdict("tipped", f"the cup {how} {time:.1f} s into the approach{cause}")

    def missed(self, cup: FloatArray, touching: set[str], fingers: Sequence[str]) -> Verdict:
        """Return that the cup was not between both fingers when they had closed; see ``verdict``."""
        reached = touching.intersection(fingers)
        had = f"only {min(reached)} touched the cup" if reached else "no finger touched the cup"
        moved = 1e3 * length(cup[:3] - self.place)
        return Verdict("missed", f"{had} when the hand had closed; the cup had been moved {moved:.0f} mm")


def upright(cup: FloatArray) -> bool:
    """Return whether a cup of this pose (7,) stands within 20° of the vertical."""
    x, y = cup[3:5]
    return bool(1 - 2 * (x * x + y * y) > TIPPED)


class Grasping:
    """The phases of a grasp, approach, close, lift and hold, and the motion of the last two.

    Attributes:
        phase: The present phase.
        began: When it began, [s].
    """

    def __init__(
        self, scenario: Scenario, gripper: Gripper, cup: FloatArray, liftable: Callable[[], float]
    ) -> None:
        """Args: scenario with a cup; gripper; pose (7,) of the cup at the start; function that returns how
        far up the hand can go from where it is, at most the scenario's lift, [m].
        """
        self.phase: Phase = "approach"
        self.began = 0.0
        self._plan, self._gripper, self._liftable = scenario.grasp, gripper, liftable
        self._lift, self._lifting_since = 0.0, 0.0
        self._from: FloatArray | None = None
        self._standing = Standing(cup)

    @property
    def busy(self) -> bool:
        """Whether a chain has to wait for the fingers; there is none here."""
        return False

    @property
    def load(self) -> float:
        """Weight that the arm is told of, [N]: none."""
        return 0.0

    def cup_moved(self, offset: FloatArray) -> None:
        """Move the place where the cup should stand by ``offset`` (3,) [m]."""
        self._standing.moved(offset)

    def proceed(self, time: float, distance: float, turn: float = 0.0) -> None:
        """Begin the next phase if it is due; ``distance`` [m] and ``turn`` [rad] are those to the target."""
        plan, elapsed = self._plan, time - self.began
        if self.phase == "approach" and distance < plan.distance and turn < plan.turn:
            self._gripper.close(plan.force, plan.speed)
            self._begin("close", time)
        elif self.phase == "close" and elapsed >= plan.close_time:
            self._lift, self._lifting_since = self._liftable(), time
            self._begin("lift", time)
        elif self.phase == "lift" and elapsed >= plan.lift_time:
            self._begin("hold", time)

    def _begin(self, phase: Phase, time: float) -> None:
        self.phase, self.began = phase, time

    def velocity(self, time: float, reference: FloatArray) -> FloatArray | None:
        """Return the hand's velocity (3,) [m/s] in lift and hold; None while the skill moves it.

        A compliant hand sags under its load, so its position is corrected, too.

        Args:
            time: The present time, [s].
            reference: Where the arm's controller takes the hand to be, shape (3,), [m].
        """
        if self.phase in ("approach", "close"):
            return None
        if self._from is None:
            self._from = reference
        share = min(1.0, (time - self._lifting_since) / self._plan.lift_time)
        height = self._lift * share**3 * (10 - 15 * share + 6 * share**2)  # minimum jerk
        speed = self._lift / self._plan.lift_time * 30 * (share * (1 - share)) ** 2
        up = np.array([0.0, 0.0, 1.0])
        return HOLD_RATE * (self._from + height * up - reference) + speed * up

    def verdict(self, time: float, cup: FloatArray, contacts: Sequence[Contact]) -> Verdict | None:
        """Return how the grasp ended, None while it goes on.

        Args:
            time: The present time, [s].
            cup: Pose (7,) of the cup.
            contacts: Contacts of the arm.
        """
        touching = {contact.link for contact in contacts if contact.thing == "cup"}
        if self.phase == "approach":
            return self._standing.verdict(time, cup, touching)
        held = touching.issuperset(self._gripper.links)
        elapsed, plan = time - self.began, self._plan
        if self.phase == "close":
            if held:
                return None
            fallen = self._standing.verdict(time, cup, touching)
            late = elapsed >= plan.close_time
            return fallen or (self._standing.missed(cup, touching, self._gripper.links) if late else None)
        if self.phase == "lift":
            if self._lift >= plan.rise:
                return None
            return Verdict("unreachable", f"the arm can lift the cup by {1e3 * self._lift:.0f} mm only")
        rise = float(cup[2] - self._standing.place[2])
        if rise < plan.rise:
            when = "after the lift" if elapsed < FIRST_LOOK else f"{elapsed:.1f} s into the hold"
            return Verdict("dropped", f"the cup was {1e3 * max(rise, 0.0):.0f} mm up {when}")
        return Verdict("grasped", "") if elapsed >= plan.hold_time else None
