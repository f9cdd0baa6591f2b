"""How far a controller has come in a chain: the events of the stage that is over, one after the other."""

from __future__ import annotations

from skillctl.arrays import FloatArray
from skillctl.model.chained import WAIT, ChainedSkill

ROUNDING = 1e-6  # of a period: 0.3 s are three periods of 0.1 s


class Course:
    """The memory of a controller between the stages of a chain.

    Events take place at the end of their stage, with V at its level or below: outside, as after a push,
    nothing goes on until the stage has led back.

    Attributes:
        event: What is due now: an event of the stage that is over; None while there is none.
        done: Whether the last stage, and its events, are over.
    """

    def __init__(self, period: float) -> None:
        """Args: period: Time between two calls of ``onward``, [s]."""
        self._period = period
        self.begin()

    def begin(self, past: int = 0, due: int = 0, event: str | None = None, done: bool = False) -> None:
        """Begin a stage, or go on with one.

        Args:
            past: How many of its events are over.
            due: For how many periods the one behind these has been due.
            event: As the attribute.
            done: As the attribute.
        """
        self._past, self._due, self.event, self.done = past, due, event, done

    def state(self) -> dict[str, int | str | None]:
        """Return what ``begin`` takes."""
        return {"past": self._past, "due": self._due, "event": self.event, "done": self.done}

    def onward(self, chain: ChainedSkill, state: FloatArray, part: int, busy: bool) -> int:
        """Return the part that acts next at one state (d,): where a stage is over, its events come first.

        Args:
            chain: What is followed.
            state: Where the robot is, shape (d,).
            part: The part that acted last.
            busy: Whether the event that was due at the last call is still going on.
        """
        while chain.over_at(state, part):
            stage = chain.stage_of(part)
            self.event = self._next(chain.events[stage], busy)
            if self.event is not None:
                self._due += 1
                break
            if stage + 1 == len(chain.parts):
                self.done = True
                break
            part, busy = chain.begun_at(stage + 1, state), False
            self.begin()
        return part

    def _next(self, events: tuple[str, ...], busy: bool) -> str | None:
        """Return the event that is due; None once all are over."""
        if self._due and not self._goes_on(events[self._past], busy):
            self._past, self._due = self._past + 1, 0
        return events[self._past] if self._past < len(events) else None

    def _goes_on(self, event: str, busy: bool) -> bool:
        if event.startswith(WAIT):
            return self._due < float(event.removeprefix(WAIT)) / self._period - ROUNDING
        return busy
