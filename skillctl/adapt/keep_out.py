"""Keep-out clauses: bodies that the hand must not touch, and how far points are from them."""

from __future__ import annotations

from functools import reduce
from itertools import product
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

import numpy as np
from pydantic import Field

from skillctl.adapt.clauses import Clause, NotNegative, Number, Paths, Positive, Vector, lengths
from skillctl.arrays import FloatArray
from skillctl.model.coordinates.bodies import Ball, Body, Box, Cylinder, Ellipsoid

NEWTON_STEPS = 15  # towards the nearest point of an ellipsoid; from below it converges quadratically
TINY = 1e-300


class KeepOutClause(Clause):
    """The hand never comes nearer to a convex body than ``clearance``; [m].

    The margin is the smallest distance of the hand to the body, without the clearance. Between two samples
    the hand moves straight, and a distance changes by no more than the way: with distances a and b at the
    ends of a step of length s it is nowhere less than (a + b − s) / 2.

    Attributes:
        centre: Its middle, in the skill's frame, [m].
        clearance: Distance to keep, [m], beyond the radius of the hand.
    """

    unit: ClassVar[str] = "m"
    signal: ClassVar[str] = "G (distance ≥ clearance)"

    centre: Vector
    clearance: NotNegative = 0.0

    def margins(self, paths: Paths) -> FloatArray:
        """Return the least distance between the hand and the body, beyond the clearance."""
        distances = self.distances(paths.positions)
        between = 0.5 * (distances[:, 1:] + distances[:, :-1] - paths.lengths)
        least = np.minimum(distances.min(axis=1), between.min(axis=1, initial=np.inf))
        return np.asarray(least - self.clearance - paths.hand_radius)

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points (..., d) to the surface, negative inside. Shape (...), [m]."""
        raise NotImplementedError

    def outline(self) -> FloatArray:
        """Return points (n, d) of the surface whose convex hull is, nearly, the body: for pictures."""
        raise NotImplementedError

    def body(self, name: str) -> Body:
        """Return the body as coordinates and controllers know it, under the name of the clause."""
        raise NotImplementedError

    def _offsets(self, points: FloatArray) -> FloatArray:
        return np.asarray(points - np.array(self.centre))


class KeepOutBall(KeepOutClause):
    """All points within ``radius`` [m] of the centre."""

    kind: Literal["ball"]
    radius: Positive

    def distances(self, points: FloatArray) -> FloatArray:
        """Return ‖x − c‖ − r; see ``KeepOutClause``."""
        return np.asarray(lengths(self._offsets(points)) - self.radius)

    def outline(self) -> FloatArray:
        """Return points of the sphere."""
        return np.array(self.centre) + self.radius * _sphere(len(self.centre))

    def body(self, name: str) -> Body:
        """Return the ball."""
        return Ball(name, self.centre, self.radius)


class KeepOutTurned(KeepOutClause):
    """A body with axes of its own.

    Attributes:
        turn: Rotation of its axes: a rotation vector in space, an angle in the plane, [rad]; empty: none.
    """

    turn: tuple[Number, ...] = ()

    def _offsets(self, points: FloatArray) -> FloatArray:
        offsets = points - np.array(self.centre)
        return np.asarray(offsets @ _rotation(self.turn)) if self.turn else offsets

    def _placed(self, local: FloatArray) -> FloatArray:
        """Return points (n, d) that are given along the body's own axes."""
        turned = local @ _rotation(self.turn).T if self.turn else local
        return np.asarray(np.array(self.centre) + turned)


class KeepOutEllipsoid(KeepOutTurned):
    """An ellipsoid with semi-axes ``radii`` [m] along its own axes."""

    kind: Literal["ellipsoid"]
    radii: Annotated[tuple[Positive, ...], Field(min_length=1)]

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the distance outside, and inside a number between that and zero; see ``KeepOutClause``.

        The nearest point of u is yᵢ = aᵢ² uᵢ / (aᵢ² + t) with Σ (aᵢ uᵢ / (aᵢ² + t))² = 1; the sum is convex
        and falls with t, so Newton's method from below does not overshoot.
        """
        u, a = np.abs(self._offsets(points)), np.array(self.radii)
        t = np.maximum((a * u - a * a).max(axis=-1), 0.0)
        for _ in range(NEWTON_STEPS):
            terms = a * u / (a * a + t[..., None])
            value, slope = (terms**2).sum(axis=-1), (terms**2 / (a * a + t[..., None])).sum(axis=-1)
            t = t + np.maximum(value - 1, 0.0) / np.maximum(2 * slope, TINY)
        outside = lengths(u - a * a * u / (a * a + t[..., None]))
        gauge = lengths(u / a)
        return np.asarray(np.where(gauge > 1, outside, (gauge - 1) * a.min()))

    def outline(self) -> FloatArray:
        """Return points of the surface."""
        return self._placed(_sphere(len(self.radii)) * np.array(self.radii))

    def body(self, name: str) -> Body:
        """Return the ellipsoid."""
        return Ellipsoid(name, self.centre, turn=self.turn, radii=self.radii)


class KeepOutBox(KeepOutTurned):
    """A box with edges ``size`` [m] along its own axes."""

    kind: Literal["box"]
    size: Annotated[tuple[Positive, ...], Field(min_length=1)]

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the distance to the nearest face, edge or corner; see ``KeepOutClause``."""
        return _beyond(np.abs(self._offsets(points)) - 0.5 * np.array(self.size))

    def outline(self) -> FloatArray:
        """Return the corners."""
        signs = np.array(list(product((-0.5, 0.5), repeat=len(self.size))))
        return self._placed(signs * np.array(self.size))

    def body(self, name: str) -> Body:
        """Return the box."""
        return Box(name, self.centre, turn=self.turn, size=self.size)


class KeepOutCylinder(KeepOutTurned):
    """A cylinder in space along its own third axis, upright unless turned; radius and height in m."""

    kind: Literal["cylinder"]
    centre: tuple[Number, Number, Number]
    radius: Positive
    height: Positive

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the distance to the nearest part of side, lid or rim; see ``KeepOutClause``."""
        u = self._offsets(points)
        around = np.hypot(u[..., 0], u[..., 1]) - self.radius
        return _beyond(np.stack([around, np.abs(u[..., 2]) - 0.5 * self.height], axis=-1))

    def outline(self) -> FloatArray:
        """Return points of both rims."""
        rim = self.radius * _sphere(2)
        lids = [np.column_stack([rim, np.full(len(rim), side * self.height)]) for side in (-0.5, 0.5)]
        return self._placed(np.concatenate(lids))

    def body(self, name: str) -> Body:
        """Return the cylinder."""
        return Cylinder(name, self.centre, turn=self.turn, radius=self.radius, height=self.height)


AnyKeepOut: TypeAlias = Annotated[
    KeepOutBall | KeepOutEllipsoid | KeepOutBox | KeepOutCylinder, Field(discriminator="kind")
]
BODIES: tuple[type[KeepOutClause], ...] = (KeepOutBall, KeepOutEllipsoid, KeepOutBox, KeepOutCylinder)


def box_between(low: Any, high: Any) -> dict[str, Any]:
    """Return the entries of a box from its lowest to its highest corner, (d,) each."""
    middle, size = 0.5 * (np.asarray(low) + np.asarray(high)), np.asarray(high) - np.asarray(low)
    return {"kind": "box", "centre": middle.tolist(), "size": size.tolist()}


def _sphere(dimension: int) -> FloatArray:
    """Return points all over the unit circle, or sphere; of more dimensions where the axes meet it."""
    angles = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    if dimension == 2:
        return circle
    if dimension == 3:
        heights = np.sin(np.linspace(-np.pi / 2, np.pi / 2, 13))
        rings = [np.column_stack([np.sqrt(1 - z * z) * circle, np.full(len(circle), z)]) for z in heights]
        return np.concatenate(rings)
    return np.concatenate([np.eye(dimension), -np.eye(dimension)])


def _beyond(over: FloatArray) -> FloatArray:
    """Return the signed distance from how far each of several conditions (..., k) is exceeded."""
    deepest = reduce(np.maximum, np.moveaxis(over, -1, 0))  # much faster than a maximum along a short axis
    return np.asarray(lengths(np.maximum(over, 0.0)) + np.minimum(deepest, 0.0))


def _rotation(turn: tuple[float, ...]) -> FloatArray:
    """Return the rotation by an angle, or by a rotation vector (Rodrigues), whose columns are the axes."""
    angle = float(np.linalg.norm(turn))
    if len(turn) == 1:
        c, s = np.cos(turn[0]), np.sin(turn[0])
        return np.array([[c, -s], [s, c]])
    x, y, z = np.array(turn) / max(angle, TINY)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)
