"""How a cup is taken, and where a chain sets it down."""

from __future__ import annotations

from pydantic import model_validator

from skillctl.simulation.options import Board
from skillctl.simulation.values import Duration, Part, Place, Positive

DEFAULT_PLACE = (0.62, 0.0)  # [m], of a cup


class Destination(Part):
    """Where a chain sets the cup down.

    Attributes:
        position: Place of the cup's axis, (x, y), [m]. None: (0.62, 0); in a batch it may be drawn.
        board: The board of a shelf on which it shall stand.
        above: Height of the cup above the board when the fingers open, [m].
        within: Largest distance from the position, along the board, that counts as set down there, [m].
    """

    position: Place | None = None
    board: Board = "top"
    above: Positive = 0.008
    within: Positive = 0.02

    @property
    def place(self) -> Place:
        """Place of the cup's axis, (x, y), [m]."""
        return DEFAULT_PLACE if self.position is None else self.position


class Grasp(Part):
    """The motion of the hand when it has reached the cup; a chain only takes its fingers' part.

    Attributes:
        distance, turn: Distance to the target [m], of a pose skill angle [rad], at which fingers close.
        force: Force of each finger, [N].
        speed: Speed of each finger, [m/s].
        close_time, open_time: Time from then to the lift, and for the fingers to open, [s].
        lift: Height of the lift, [m], with minimum jerk; less if the arm does not reach so far, but not less
            than ``rise``.
        lift_time, hold_time: Duration of the lift, and of the hold after it, [s].
        rise: Smallest height of the cup above its start during the hold, [m].
    """

    distance: Positive = 0.006
    turn: Positive = 0.1
    force: Positive = 20.0
    speed: Positive = 0.1
    close_time: Duration = 0.8
    open_time: Duration = 0.5
    lift: Positive = 0.10
    lift_time: Duration = 1.2
    hold_time: Duration = 1.0
    rise: Positive = 0.05

    @model_validator(mode="after")
    def _lifts_enough(self) -> Grasp:
        if self.lift < self.rise:
            raise ValueError("lift: must not be less than rise.")
        return self
