"""A cup that a chain takes, carries and sets down, and takes again where it was lost."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from skillctl.arrays import FloatArray, length
from skillctl.simulation.episode import Phase
from skillctl.simulation.grasp import Gripper, Standing, upright
from skillctl.simulation.judge import Verdict
from skillctl.simulation.motion import Motion
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.scene import Contact, set_down_at

SLIP = 0.1  # [s] without both fingers at the cup, after which it counts as lost: contacts may flicker
REST_TIME, REST_STEP = 0.2, 2e-5  # [s], [m] in a control period: a lost cup has come to rest
LONGEST_FALL = 3.0  # [s]
GRAVITY = 9.81  # [m/s²]
OFF_BOARD = 5e-3  # [m]: a cup this far above its place does not stand there
STANDS = 1.0  # [s] after it was let go: until then the cup must stand
TRIES = 3  # times that the fingers close


class Handling:
    """What the fingers do as a chain asks, and what happens to the cup.

    If the cup is lost, the hand stops and opens. Where the cup then stands in reach, the stages that are
    bound to it follow it, and the first of them begins anew.

    Attributes:
        phase: The present phase.
        began: When it began, [s].
        busy: Whether the fingers still do what the chain asked for.
        taken: When the cup was first taken, [s]; None before.
        lost, stood: How often the cup was lost, and how often it then stood in reach.
        closed: How often the fingers closed.
        let_go: When the fingers had let the cup go, [s]; NaN before.
    """

    def __init__(
        self,
        scenario: Scenario,
        gripper: Gripper,
        motion: Motion,
        cup: FloatArray,
        in_reach: Callable[[FloatArray], bool],
    ) -> None:
        """Make what handles the scenario's cup.

        Args:
            scenario: With a cup.
            gripper: With open fingers.
            motion: Of a chain.
            cup: Pose (7,) of the cup at the start.
            in_reach: Returns whether a cup of this pose stands where the hand can take it.
        """
        self.phase: Phase = "approach"
        self.began = 0.0
        self.busy = False
        self.taken: float | None = None
        self.lost, self.stood, self.closed = 0, 0, 0
        self.let_go = math.nan
        self._scenario, self._plan = scenario, scenario.grasp
        self._gripper, self._motion, self._in_reach = gripper, motion, in_reach
        self._standing = Standing(cup)
        self._cup, self._touching = cup, set[str]()
        self._event: str | None = None
        self._since = 0.0  # since when the event is due, or the cup has slipped or come to rest
        self._done_since: float | None = None

    @property
    def _held(self) -> bool:
        return self._touching.issuperset(self._gripper.links)

    def carried(self, time: float) -> float | None:
        """Return how long ago the cup in the hand was first taken, [s]; None if there is none in it."""
        return time - self.taken if self.phase == "carry" and self.taken is not None else None

    @property
    def load(self) -> float:
        """Weight of the cup in the hand, of which the arm is told, [N]."""
        cup = self._scenario.cup
        return GRAVITY * cup.mass if cup is not None and self.phase == "carry" and self._held else 0.0

    def cup_moved(self, offset: FloatArray) -> None:
        """Move the place where the cup should stand by ``offset`` (3,) [m]."""
        self._standing.moved(offset)

    def velocity(self, time: float, reference: FloatArray) -> FloatArray | None:
        """Return no velocity (3,) [m/s] after the cup was lost; None while the chain moves the hand."""
        return np.zeros(3) if self.phase == "lost" else None

    def proceed(self, time: float, distance: float, turn: float = 0.0) -> None:
        """Do what the chain asks for; where its target is does not matter here."""
        if self.phase == "lost":
            return
        asked = self._motion.event
        if asked != self._event:
            self._ended(self._event, time)
            self._event, self._since = asked, time
            self._begun(asked, time)
        wait = {"close": self._plan.close_time, "open": self._plan.open_time}.get(asked or "", 0.0)
        self.busy = time - self._since < wait

    def _begun(self, event: str | None, time: float) -> None:
        if event == "close":
            self.closed += 1
            self._gripper.close(self._plan.force, self._plan.speed)
            self._begin("close", time)
        elif event == "open":
            self._gripper.open(self._plan.force, self._plan.speed)
            if self.phase == "carry" and not self._held:  # it has just been lost
                self._lose(time)
            else:
                self._begin("open", time)

    def _lose(self, time: float) -> None:
        self._begin("lost", time)
        self._since = time
        self.lost += 1

    def _ended(self, event: str | None, time: float) -> None:
        if event == "close":
            self._begin("carry", time)
            if self.taken is None and self._held:
                self.taken = time
        elif event == "open":
            self.let_go = time
            self._begin("leave", time)

    def _begin(self, phase: Phase, time: float) -> None:
        self.phase, self.began = phase, time

    def verdict(self, time: float, cup: FloatArray, contacts: Sequence[Contact]) -> Verdict | None:
        """Return how it ended, None while it goes on.

        Args:
            time: The present time, [s].
            cup: Pose (7,) of the cup.
            contacts: Contacts of the arm.
        """
        before, self._cup = self._cup, cup
        self._touching = {contact.link for contact in contacts if contact.thing == "cup"}
        if self.phase in ("approach", "close") and not self._held:
            return self._standing.verdict(time, cup, self._touching)
        if self.phase == "carry":
            return self._carried(time)
        if self.phase == "lost":
            return self._lost(time, length(cup[:3] - before[:3]))
        if self.phase == "leave" and time - self.began >= STANDS and self._motion.done:
            return self._set_down()
        return None

    def _carried(self, time: float) -> Verdict | None:
        if self._held:
            self._since = time
            if not self._motion.done:
                self._done_since = None
                return None
            self._done_since = time if self._done_since is None else self._done_since
            return Verdict("grasped") if time - self._done_since >= self._plan.hold_time else None
        if time - self._since >= SLIP:
            self._gripper.open(self._plan.force, self._plan.speed)
            self._lose(time)
        return None

    def _lost(self, time: float, moved: float) -> Verdict | None:
        """Wait until the cup is at rest, and go back to take it, or return why not."""
        if moved > REST_STEP:
            self._since = time
        waited = time - self.began
        at_rest = time - self._since >= REST_TIME and waited >= self._plan.open_time
        if not at_rest and waited < LONGEST_FALL:
            return None
        if not (upright(self._cup) and self._in_reach(self._cup)):
            return self._why_lost("and does not stand in reach")
        self.stood += 1
        if self.closed >= TRIES:
            return self._why_lost(f"{TRIES} times")
        self._motion.follow_cup(self._cup[:3] - self._standing.place)
        self._standing = Standing(self._cup)
        self._motion.take_again()
        self._event, self.busy = None, False
        self._begin("approach", time)
        return None

    def _why_lost(self, end: str) -> Verdict:
        if self.taken is None:
            missed = self._standing.missed(self._cup, self._touching, self._gripper.links)
            return Verdict("missed", f"{missed.detail}, {end}")
        return Verdict("dropped", f"the cup left the hand {end}")

    @property
    def off_place(self) -> FloatArray:
        """From the place where the cup shall stand to where it is, (3,), [m]; NaN without such a place."""
        if self._scenario.place is None:
            return np.full(3, np.nan)
        return np.asarray(self._cup[:3] - set_down_at(self._scenario))

    def _set_down(self) -> Verdict:
        if not upright(self._cup):
            return Verdict("tipped", "the cup fell over after it was let go")
        if self._scenario.place is None:
            return Verdict("misplaced", "the cup was let go, and there is no place for it")
        *aside, above = self.off_place
        if abs(above) > OFF_BOARD:
            return Verdict("misplaced", f"the cup is {1e3 * above:.0f} mm above where it should stand")
        if (off := math.hypot(*aside)) > self._scenario.place.within:
            return Verdict("misplaced", f"the cup stands {1e3 * off:.0f} mm from its place")
        return Verdict("placed")
