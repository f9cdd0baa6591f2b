"""Bodies that a motion must not enter: balls, ellipsoids, boxes and cylinders, and how they are inflated."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, TypeVar

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.model.coordinates.gauge import Gauge
from skillctl.rotations import matrices

Point = tuple[float, ...]
AnyBody = TypeVar("AnyBody", bound="Body")


@dataclass(frozen=True)
class Body(ABC):
    """A convex body, closed and not moving, in the skill's frame.

    Attributes:
        name: What messages call it.
        centre: Its middle, d numbers, [m].
        kind: What it is: ``ball``, ``ellipsoid``, ``box`` or ``cylinder``.
    """

    kind: ClassVar[str]

    name: str
    centre: Point

    def __post_init__(self) -> None:
        self._require("centre", self.centre, len(self.centre))

    @abstractmethod
    def inflated(self, margin: float) -> Gauge:
        """Return the gauge of a set that holds all points within ``margin`` [m] of the body.

        Of a ball, a box and a cylinder it is the gauge of exactly these points.

        Raises:
            UsageError: The margin is not positive.
        """

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest coordinates of the body, (d,) each, [m]; a hair more than exact."""
        return self.inflated(1e-9).bounds()

    def translated(self: AnyBody, offset: Sequence[float] | FloatArray) -> AnyBody:
        """Return the same body, moved by ``offset`` (d,), [m]."""
        return replace(self, centre=_sum(self.centre, offset))

    def _require(self, what: str, numbers: Sequence[float], count: int, *, positive: bool = False) -> None:
        if len(numbers) != count or not all(map(math.isfinite, numbers)):
            raise UsageError(f"{self.name}: {what} must be {count} finite numbers, got {numbers!r}.")
        if positive and min(numbers) <= 0:
            raise UsageError(f"{self.name}: {what} must be positive, got {numbers!r}.")

    def _margin(self, margin: float) -> float:
        if not 0 < margin < math.inf:
            raise UsageError(
                f"{self.name}: the margin must be positive, got {margin!r}.",
                hint="Edges and corners are rounded by it; a millimetre is enough.",
            )
        return margin


@dataclass(frozen=True)
class Ball(Body):
    """All points within ``radius`` [m] of the centre, in any dimension; see ``Body``."""

    kind: ClassVar[str] = "ball"

    radius: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("radius", (self.radius,), 1, positive=True)

    def inflated(self, margin: float) -> Gauge:
        """Return the gauge of the larger ball; see ``Body``."""
        d, radius = len(self.centre), self.radius + self._margin(margin)
        return Gauge(np.array(self.centre), np.eye(d), (tuple(range(d)),), np.zeros(1), np.zeros(1), radius)


@dataclass(frozen=True)
class Turned(Body):
    """A body with axes of its own.

    Attributes:
        turn: Rotation of its axes: a rotation vector in space, an angle in the plane, [rad]. Empty: none.
    """

    turn: Point = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        d = len(self.centre)
        if self.turn:
            if d not in (2, 3):
                raise UsageError(f"{self.name}: only bodies in the plane or in space can be turned.")
            self._require("turn", self.turn, d * (d - 1) // 2)

    @property
    def axes(self) -> FloatArray:
        """The body's axes, one a row. Shape (d, d)."""
        return rotation(self.turn, len(self.centre)).T


@dataclass(frozen=True)
class Ellipsoid(Turned):
    """An ellipsoid with semi-axes ``radii`` [m] along its own axes; see ``Turned``."""

    kind: ClassVar[str] = "ellipsoid"

    radii: Point

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("radii", self.radii, len(self.centre), positive=True)

    def inflated(self, margin: float) -> Gauge:
        """Return the gauge of an ellipsoid around all points within ``margin``; see ``Body``.

        With semi-axes a of mean ā and margin m its semi-axes are b² = a² (1 + m/ā) + m² (1 + ā/m): for every
        unit n, (‖a n‖ + m)² ≤ (1 + m/ā) ‖a n‖² + (1 + ā/m) m² (the support functions of the sum and of the
        ellipsoid), since 2 m ‖a n‖ ≤ (m/ā) ‖a n‖² + (ā/m) m². A ball becomes the larger ball.
        """
        m, d, radii = self._margin(margin), len(self.centre), np.array(self.radii)
        mean = float(radii.mean())
        # The share of 1e-12 is more than rounding takes away.
        larger = np.sqrt(radii**2 * (1 + m / mean) + m**2 * (1 + mean / m)) * (1 + 1e-12)
        frame = self.axes / larger[:, None]
        return Gauge(np.array(self.centre), frame, (tuple(range(d)),), np.zeros(1), np.zeros(1), 1.0)


@dataclass(frozen=True)
class Box(Turned):
    """A box with edges ``size`` [m] along its own axes, in any dimension; see ``Turned``.

    Attributes:
        size: Its edges, d numbers, [m].
        pole: The point in it that is opened, in the skill's frame; default its centre. Motions go round the
            box on the side on which they pass the pole, as seen from the pole. Of a wide board a pole far
            behind the edge sends them round that edge.
    """

    kind: ClassVar[str] = "box"

    size: Point
    pole: Point | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("size", self.size, len(self.centre), positive=True)
        if self.pole is not None:
            self._require("pole", self.pole, len(self.centre))
            if (np.abs(self._pole_within) > 0.5 * np.array(self.size)).any():
                raise UsageError(f"{self.name}: the pole {self.pole!r} must be in the box.")

    @classmethod
    def between(
        cls, name: str, low: Sequence[float], high: Sequence[float], pole: Point | None = None
    ) -> Box:
        """Return the box from its lowest to its highest corner (d,), [m], along the axes of the frame."""
        centre = tuple(0.5 * (float(a) + float(b)) for a, b in zip(low, high, strict=True))
        size = tuple(float(b) - float(a) for a, b in zip(low, high, strict=True))
        return cls(name, centre, size=size, pole=pole)

    @property
    def _pole_within(self) -> FloatArray:
        """The pole from the centre, along the box's own axes. Shape (d,)."""
        pole = self.centre if self.pole is None else self.pole
        return self.axes @ (np.array(pole) - self.centre)

    def translated(self, offset: Sequence[float] | FloatArray) -> Box:
        """Return the same box, moved with its pole by ``offset`` (d,), [m]."""
        pole = None if self.pole is None else _sum(self.pole, offset)
        return replace(self, centre=_sum(self.centre, offset), pole=pole)

    def inflated(self, margin: float) -> Gauge:
        """Return the gauge of the box with rounded edges; see ``Body``."""
        d, half, within = len(self.centre), 0.5 * np.array(self.size), self._pole_within
        pole = np.array(self.centre if self.pole is None else self.pole)
        singly = tuple((i,) for i in range(d))
        return Gauge(pole, self.axes, singly, half + within, half - within, self._margin(margin))


@dataclass(frozen=True)
class Cylinder(Turned):
    """A cylinder in space, upright unless turned; see ``Turned``.

    Attributes:
        radius, height: [m].
    """

    kind: ClassVar[str] = "cylinder"

    radius: float
    height: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("centre", self.centre, 3)
        self._require("radius and height", (self.radius, self.height), 2, positive=True)

    def inflated(self, margin: float) -> Gauge:
        """Return the gauge of the cylinder with rounded rims; see ``Body``."""
        core = np.array([self.radius, 0.5 * self.height])
        return Gauge(np.array(self.centre), self.axes, ((0, 1), (2,)), core, core, self._margin(margin))


def around(name: str, bodies: Sequence[Body]) -> Box:
    """Return one box, along the axes of the frame, around several bodies."""
    lows, highs = zip(*(body.bounds for body in bodies), strict=True)
    return Box.between(name, np.min(lows, axis=0).tolist(), np.max(highs, axis=0).tolist())


def rotation(turn: Sequence[float], dimension: int) -> FloatArray:
    """Return the rotation by an angle in the plane, or by a rotation vector in space, [rad]; (d, d)."""
    if not turn:
        return np.eye(dimension)
    if dimension == len(turn) + 1:
        c, s = math.cos(turn[0]), math.sin(turn[0])
        return np.array([[c, -s], [s, c]])
    return matrices(np.array(turn))


def _sum(point: Sequence[float], offset: Sequence[float] | FloatArray) -> Point:
    return tuple(float(a) + float(b) for a, b in zip(point, offset, strict=True))
