"""The clauses of a task: what each requires of a motion, and by what margin a motion fulfils it.

A margin is a number in the clause's unit: zero or more if the clause holds, and by how much; negative if it
fails. It is the robustness of signal temporal logic (``signal`` has the formula), so a motion that is changed
by less than the margin still fulfils the clause.

References:
    A. Donzé & O. Maler, Robust Satisfaction of Temporal Logic over Real-Valued Signals (FORMATS 2010).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar, TypeAlias

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.geometry import resample_by_arc_length
from skillctl.model.space import Space

COMPARED = 40  # points of two paths that are compared, evenly spaced in arc length
TURN = 5.0  # [deg], allowed at the end of a pose unless the task has another number
STILL = 1e-9  # [m] of a step: a shorter one has no direction

# Strict: 0.3 and 1 are numbers, "0.3" and true are not.
Number: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NotNegative: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]
Vector: TypeAlias = Annotated[tuple[Number, ...], Field(min_length=1)]


@dataclass(frozen=True, eq=False)
class Paths:
    """What n motions do.

    Attributes:
        states: States at equal steps of time; a motion that has arrived rests. Shape (n, T, d).
        steps: Time between two states of each motion, (n,), [s].
        target: Where they should end, (d,).
        space: Of the states.
        tolerance: Distance to the target within which they have arrived, [m].
        hand_radius: The hand is a ball of this radius around the position, [m].
    """

    states: FloatArray
    steps: FloatArray
    target: FloatArray
    space: Space
    tolerance: float
    hand_radius: float = 0.0

    @cached_property
    def positions(self) -> FloatArray:
        """Positions of the hand. Shape (n, T, 3), or (n, T, d) of a skill that moves something else."""
        return self.states[..., : self.space.positions]

    @cached_property
    def gaps(self) -> FloatArray:
        """Distance of the position to the target at every state. Shape (n, T), [m]."""
        return lengths(self.positions - self.target[: self.space.positions])

    @cached_property
    def ways(self) -> FloatArray:
        """What leads from each position to the next. Shape (n, T − 1, k), [m]."""
        return np.diff(self.positions, axis=1)

    @cached_property
    def lengths(self) -> FloatArray:
        """Their lengths. Shape (n, T − 1), [m]."""
        return lengths(self.ways)

    @cached_property
    def times(self) -> FloatArray:
        """From when on each motion is within the tolerance for good; past its end if never. Shape (n,)."""
        late = self.gaps > self.tolerance
        last = np.where(late.any(axis=1), late.shape[1] - np.argmax(late[:, ::-1], axis=1), 0)
        return np.asarray(last * self.steps)


class Table(BaseModel):
    """A frozen table of a task file, with dashes in its keys; an unknown key is an error."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        populate_by_name=True,
        alias_generator=lambda name: name.replace("_", "-"),
    )


class Clause(Table):
    """One requirement of a task on a motion.

    Attributes:
        name: What reports call it; empty: its key in the file.
        unit: Of its margin.
        signal: What it requires, in signal temporal logic: G always, F at some time.
    """

    unit: ClassVar[str]
    signal: ClassVar[str]

    name: str = ""

    def margins(self, paths: Paths) -> FloatArray:
        """Return by how much each motion fulfils the clause, negative if it fails. Shape (n,)."""
        raise NotImplementedError

    def scale(self, way: float) -> float:
        """Return a margin of this clause that is as good as ample, in its unit.

        Args:
            way: Distance from the middle of the starts to the target, [m].
        """
        return 0.05 * way


class Target(Clause):
    """The motion comes to the target and stays there; [m].

    Attributes:
        position: Where, in the skill's frame: coordinates; of poses also ``x,y,z,qx,qy,qz,qw``.
        tolerance: Within this distance it has arrived, [m].
        tolerance_deg: Largest angle to the target's orientation at the end, [deg]; a clause of its own. None:
            ``TURN`` where the position is a pose, else none.
    """

    unit: ClassVar[str] = "m"
    signal: ClassVar[str] = "F G (distance to the target ≤ tolerance)"

    position: Vector
    tolerance: Positive = 0.005
    tolerance_deg: Positive | None = None

    def margins(self, paths: Paths) -> FloatArray:
        """Return by how much the end is nearer to the target than it must be."""
        return np.asarray(self.tolerance - paths.gaps[:, -1])

    def scale(self, way: float) -> float:
        """Return a quarter of the tolerance: motions end when they are a good deal nearer than it."""
        return 0.25 * self.tolerance


class Orientation(Clause):
    """The hand ends with the target's orientation; [deg].

    Attributes:
        most: Largest angle between both, [deg].
    """

    unit: ClassVar[str] = "deg"
    signal: ClassVar[str] = "F G (angle to the target's orientation ≤ tolerance-deg)"

    most: Positive

    def margins(self, paths: Paths) -> FloatArray:
        """Return by how much the last angle is smaller than it may be."""
        _, angles = paths.space.apart(paths.states[:, -1], paths.target)
        if angles is None:
            raise UsageError("target.tolerance-deg: the skills have no orientation.", hint="Leave it out.")
        return np.asarray(self.most - np.degrees(angles))

    def scale(self, way: float) -> float:
        """Return a quarter of the tolerance, as of the position."""
        return 0.25 * self.most


class Via(Clause):
    """The motion passes a point; [m].

    Attributes:
        point: In the skill's frame, [m].
        within: Distance within which it passes, [m].
    """

    unit: ClassVar[str] = "m"
    signal: ClassVar[str] = "F (distance to the point ≤ within)"

    point: Vector
    within: Positive

    def margins(self, paths: Paths) -> FloatArray:
        """Return by how much it comes nearer than it must; the ways between samples count, too."""
        to_point = np.array(self.point) - paths.positions[:, :-1]
        along = np.einsum("ntk,ntk->nt", to_point, paths.ways)
        share = np.clip(along / np.maximum(paths.lengths, STILL) ** 2, 0.0, 1.0)
        nearest = lengths(to_point - share[..., None] * paths.ways).min(axis=1)
        return np.asarray(self.within - nearest)

    def scale(self, way: float) -> float:
        """Return half of the distance within which it has to pass."""
        return 0.5 * self.within


class StayIn(Clause):
    """The position of the hand never leaves a box; [m].

    Attributes:
        low, high: Its corners, in the skill's frame, [m].
    """

    unit: ClassVar[str] = "m"
    signal: ClassVar[str] = "G (low ≤ position ≤ high)"

    low: Vector
    high: Vector

    @model_validator(mode="after")
    def _ascends(self) -> StayIn:
        _require_box(self.low, self.high)
        return self

    def margins(self, paths: Paths) -> FloatArray:
        """Return the least distance to a face; a box is convex, so it holds between samples, too."""
        x = paths.positions
        least, most = x.min(axis=1), x.max(axis=1)
        return np.asarray(np.minimum(least - np.array(self.low), np.array(self.high) - most).min(axis=1))


class Approach(Clause):
    """Near the target the hand moves along a direction; [deg].

    Attributes:
        direction: In the skill's frame; its length does not matter.
        within_deg: Largest angle between the motion and the direction, [deg].
        distance: From this distance to the target on, until the target's tolerance, [m]. (``from``)
    """

    unit: ClassVar[str] = "deg"
    signal: ClassVar[str] = "G (tolerance < distance to the target ≤ from → angle ≤ within-deg)"

    direction: Vector
    within_deg: Annotated[float, Field(strict=True, gt=0, le=180)]
    distance: Positive = Field(alias="from")

    @model_validator(mode="after")
    def _leads_somewhere(self) -> Approach:
        if not any(self.direction):
            raise ValueError("direction: must not be zero.")
        return self

    def margins(self, paths: Paths) -> FloatArray:
        """Return how far from the largest angle the motion stays; none at all counts as the best."""
        unit = np.array(self.direction) / np.linalg.norm(self.direction)
        cosines = np.clip(paths.ways @ unit / np.maximum(paths.lengths, STILL), -1.0, 1.0)
        gaps = paths.gaps[:, 1:]
        near = (gaps <= self.distance) & (gaps > paths.tolerance) & (paths.lengths > STILL)
        return np.asarray(self.within_deg - np.degrees(np.arccos(np.where(near, cosines, 1.0).min(axis=1))))

    def scale(self, way: float) -> float:
        """Return half of the largest angle."""
        return 0.5 * self.within_deg


class Limit(Clause):
    """One number that a motion must not exceed.

    Attributes:
        most: The number, in the unit.
    """

    most: Positive

    def scale(self, way: float) -> float:
        """Return a tenth of the number: the room that the search leaves where it chooses the speed."""
        return 0.1 * self.most


class SpeedLimit(Limit):
    """The hand is never faster; [m/s]."""

    unit: ClassVar[str] = "m/s"
    signal: ClassVar[str] = "G (speed ≤ limit)"

    def margins(self, paths: Paths) -> FloatArray:
        """Return how much slower the hand is than it may be."""
        fastest = paths.lengths.max(axis=1) / paths.steps
        return np.asarray(self.most - fastest)


class TimeLimit(Limit):
    """The motion has arrived by then, and stays; [s]."""

    unit: ClassVar[str] = "s"
    signal: ClassVar[str] = "F[0, limit] G (distance to the target ≤ tolerance)"

    def margins(self, paths: Paths) -> FloatArray:
        """Return how much earlier the motion arrives than it must."""
        return np.asarray(self.most - paths.times)


class PeriodLimit(Limit):
    """A controller that gives a command every ``most`` seconds still converges; [s].

    The margin is how much longer the proved period is; no motion shows it.
    """

    unit: ClassVar[str] = "s"
    signal: ClassVar[str] = "V falls at every step of the period"


class NearTo(Clause):
    """The way is near to a reference: the mean distance of points at equal shares of both ways; [m].

    Attributes:
        tolerance: Largest mean distance, [m].
    """

    unit: ClassVar[str] = "m"
    signal: ClassVar[str] = "mean distance to the reference ≤ tolerance"

    tolerance: Positive

    def against(self, references: FloatArray, paths: Paths) -> FloatArray:
        """Return the margins of motions, given points (n, COMPARED, k) of the reference of each."""
        points = compared(paths.positions)
        distances = lengths(points - references).mean(axis=1)
        return np.asarray(self.tolerance - distances)

    def scale(self, way: float) -> float:
        """Return half of the largest mean distance."""
        return 0.5 * self.tolerance


class Demonstrations(NearTo):
    """From the starts of demonstrations the motion is near to them; each counts relative to its own end.

    Attributes:
        files: What ``learn`` reads, relative to the task file.
    """

    files: Annotated[tuple[str, ...], Field(min_length=1)]


class Like(NearTo):
    """From every start the motion is near to that of a skill, moved to the target.

    Attributes:
        skill: A file relative to the task file, or a name of the store.
    """

    skill: str


def lengths(vectors: FloatArray) -> FloatArray:
    """Return the lengths of vectors (..., k). Shape (...).

    For a million short vectors that is five times as fast as NumPy's norm.
    """
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))


def compared(positions: FloatArray) -> FloatArray:
    """Return ``COMPARED`` points of each path (n, T, k), evenly spaced in arc length."""
    return np.stack([resample_by_arc_length(path, COMPARED) for path in positions])


def _require_box(low: tuple[float, ...], high: tuple[float, ...]) -> None:
    if len(low) != len(high):
        raise ValueError("low, high: must have equally many numbers.")
    if any(a > b for a, b in zip(low, high, strict=True)):
        raise ValueError("low, high: the first must not be above the second.")
