"""Learned shears: coordinates in which V is an ellipse, though in the state it is none (ours).

    φ = S_m ∘ … ∘ S_1 ∘ L,   S_i(x) = x + a_i(w_i·x),   w_i·a_i = 0,   a_i(0) = 0

A shear moves every point across w_i by an amount that depends on w_i·x alone. It leaves w_i·x as it was, so
subtracting the same amount undoes it: whatever the a_i, φ is a diffeomorphism of R^d with det Dφ = det L.
The a_i are cubic splines on evenly spaced bumps: twice continuously differentiable, constant far away, and a
cubic polynomial in each cell. That costs no exponential, and their bounds are exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from operator import mul

import numpy as np

from skillctl.arrays import FloatArray, Frozen, frozen_array
from skillctl.errors import InvalidModelError
from skillctl.model.coordinates.chain import Link, Pull
from skillctl.model.coordinates.enclosure import GUARD, Enclosure, inverse_with_error

LARGEST = 1e100  # of a number, and of how much φ or φ⁻¹ stretches: products of a few stay within float64

# A bump spans four cells. Its cubic in each, from left to right, as coefficients of 1, f, f², f³ for f in
# [0, 1): the uniform cubic B-spline.
BUMP = np.array([[0, 0, 0, 1], [1, 3, 3, -3], [4, 0, -6, 3], [1, -3, 3, -1]]) / 6.0

SHEAR_ARRAYS = ("linear", "directions", "firsts", "spacings", "coefficients")


@dataclass(frozen=True, eq=False, slots=True)
class Shears(Frozen, Link):
    """φ on offsets from the target.

    Attributes:
        linear: L, upper triangular with a positive diagonal, shape (d, d).
        directions: w_i, not zero, shape (m, d).
        firsts: Where along w_i·x each shear's first bump is, shape (m,).
        spacings: From each bump to the next, positive, shape (m,).
        coefficients: c_ij of a_i(t) = Σ_j c_ij (ψ_j(t) − ψ_j(0)), shape (m, J, d), in the unit of the space;
            what of them is along w_i does not count.
    """

    linear: FloatArray
    directions: FloatArray
    firsts: FloatArray
    spacings: FloatArray
    coefficients: FloatArray
    inverse: FloatArray = field(init=False, repr=False)
    shears: tuple[_Shear, ...] = field(init=False, repr=False)
    _rows: tuple[list[list[float]], list[list[float]]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        m, bumps, d = frozen_array("coefficients", self.coefficients, (None, None, None)).shape
        shapes = {
            "linear": (d, d),
            "directions": (m, d),
            "firsts": (m,),
            "spacings": (m,),
            "coefficients": (m, bumps, d),
        }
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), shape))
        if reasons := self.check():
            raise InvalidModelError(reasons[0])
        shears = zip(self.directions, self.firsts, self.spacings, self.coefficients, strict=True)
        inverse = frozen_array("inverse", np.triu(np.linalg.inv(self.linear)), (d, d))
        object.__setattr__(self, "inverse", inverse)
        object.__setattr__(self, "shears", tuple(_Shear(w, float(t), float(s), c) for w, t, s, c in shears))
        object.__setattr__(self, "_rows", (self.linear.tolist(), inverse.tolist()))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Shears) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in SHEAR_ARRAYS
        )

    def __hash__(self) -> int:
        return hash(self.coefficients.tobytes())

    def in_unit(self, unit: float) -> Shears:
        """Return the same map in other lengths; see ``Link``."""
        lengths = (unit * each for each in (self.firsts, self.spacings, self.coefficients))
        return Shears(self.linear, self.directions, *lengths)

    def turned(self, rotation: FloatArray) -> tuple[Shears, FloatArray]:
        """Return φ in a turned frame, and how what it leads to is turned; see ``Link``.

        With L Qᵀ = Uᵀ L′, L′ upper triangular, all turns with U: w_i, a_i, and L′ Q = U L.
        """
        turn, linear = np.linalg.qr(self.linear @ rotation.T)
        signs = np.where(np.diagonal(linear) < 0, -1.0, 1.0)
        back = turn * signs  # Uᵀ
        turned = Shears(
            signs[:, None] * linear,
            self.directions @ back,
            self.firsts,
            self.spacings,
            self.coefficients @ back,
        )
        return turned, np.asarray(back.T)

    def check(self) -> tuple[str, ...]:
        """Return why φ is not exactly invertible, in sentences; see ``Link``.

        Each comparison is of stored numbers, so that nothing is rounded. The last, which is not, only keeps
        what is computed within float64.
        """
        diagonal = np.diagonal(self.linear)
        conditions = {
            "linear must be upper triangular with a positive diagonal": bool(
                (diagonal > 0).all() and (np.tril(self.linear, -1) == 0).all()
            ),
            "no direction may be zero": bool((np.abs(self.directions).max(axis=1) > 0).all()),
            "spacings must be positive": bool((self.spacings > 0).all()),
        }
        if all(conditions.values()):
            conditions[f"the map stretches by more than {LARGEST:g}"] = self._computable()
        return tuple(f"coordinates: {reason}." for reason, holds in conditions.items() if not holds)

    def _computable(self) -> bool:
        """Return whether φ, φ⁻¹ and their slopes stay far within float64 near the data and far away."""
        with np.errstate(all="ignore"):
            lengths = np.linalg.norm(self.directions, axis=1)
            sizes = np.abs(self.coefficients).sum(axis=2).max(axis=1)
            linear = np.abs(self.linear).sum() + np.abs(np.linalg.inv(self.linear)).sum()
            stretches = np.log(linear) + np.log1p(4 * lengths * sizes / self.spacings).sum()
            others = np.concatenate([lengths, 1 / lengths, self.spacings, 1 / self.spacings, sizes])
            places = np.abs(self.firsts / self.spacings)
            return bool(stretches < math.log(LARGEST) and max(others.max(), places.max()) < LARGEST)

    def forward(self, offsets: FloatArray) -> FloatArray:
        """Return y = φ(x) for offsets (n, d). Shape (n, d)."""
        y = offsets @ self.linear.T
        for shear in self.shears:
            y = y + shear.amounts(y @ shear.direction)
        return y

    def back(self, coordinates: FloatArray) -> FloatArray:
        """Return x = φ⁻¹(y) for coordinates (n, d). Shape (n, d)."""
        for shear in reversed(self.shears):
            coordinates = coordinates - shear.amounts(coordinates @ shear.direction)
        return coordinates @ self.inverse.T

    def bounds_forward(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return boxes that hold φ(x) for all x in boxes, (n, d) each; see ``Link``."""
        enclosure = Enclosure.of(low, high).multiplied(self.linear)
        for shear in self.shears:
            enclosure = enclosure.sheared(shear)
        return enclosure.box()

    def bounds_back(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return boxes that hold φ⁻¹(y) for all y in boxes, (n, d) each; see ``Link``."""
        enclosure = Enclosure.of(low, high)
        for shear in reversed(self.shears):
            enclosure = enclosure.sheared(shear, -1)
        return enclosure.multiplied(*inverse_with_error(self.linear)).box()

    def tangent(self, offsets: FloatArray) -> tuple[FloatArray, Pull]:
        """Return y for offsets (n, d), and what leads velocities back: Dφ⁻¹ = L⁻¹ Π (I − a_i′ w_iᵀ)."""
        y, slopes = offsets @ self.linear.T, []
        for shear in self.shears:
            places = y @ shear.direction
            slopes.append((shear.direction, shear.slopes(places)))
            y = y + shear.amounts(places)

        def pull(velocities: FloatArray) -> FloatArray:
            for direction, slope in reversed(slopes):
                velocities = velocities - slope * (velocities @ direction)[:, None]
            return velocities @ self.inverse.T

        return y, pull

    # One state goes through lists of floats: of a handful of numbers that takes a third of the time.

    def forward_at(self, offset: FloatArray) -> FloatArray:
        """Return y = φ(x) for one offset (d,)."""
        y = _product(self._rows[0], offset.tolist())
        for shear in self.shears:
            y = [a + b for a, b in zip(y, shear.amount(y), strict=True)]
        return np.array(y)

    def back_at(self, coordinate: FloatArray) -> FloatArray:
        """Return x = φ⁻¹(y) for one y (d,)."""
        x = coordinate.tolist()
        for shear in reversed(self.shears):
            x = [a - b for a, b in zip(x, shear.amount(x), strict=True)]
        return np.array(_product(self._rows[1], x))

    def tangent_at(self, offset: FloatArray) -> tuple[FloatArray, Pull]:
        """Return y for one offset (d,), and what leads a velocity (d,) back; see ``tangent``."""
        y, slopes = _product(self._rows[0], offset.tolist()), []
        for shear in self.shears:
            y, slope = shear.sheared(y)
            slopes.append((shear.row, slope))

        def pull(velocity: FloatArray) -> FloatArray:
            v = velocity.tolist()
            for direction, slope in reversed(slopes):
                along = sum(map(mul, direction, v))
                v = [a - b * along for a, b in zip(v, slope, strict=True)]
            return np.array(_product(self._rows[1], v))

        return np.array(y), pull


class _Shear:
    """The amounts a(t) of one shear, and their slopes, from the cubic of each cell.

    Attributes:
        direction: w, shape (d,).
        row: The same as a list.
        blur: See ``enclosure.Shear``.
        sizes: See ``enclosure.Shear``.
    """

    __slots__ = (
        "_extremes",
        "_lists",
        "_zero",
        "blur",
        "cells",
        "count",
        "direction",
        "per_length",
        "row",
        "shift",
        "sizes",
        "start",
    )

    def __init__(self, direction: FloatArray, first: float, spacing: float, coefficients: FloatArray) -> None:
        across = coefficients - np.outer(coefficients @ direction, direction) / (direction @ direction)
        bumps, d = across.shape
        self.count = bumps + 3
        cells = np.zeros((self.count + 1, 4, d))  # the last one stands for everything beyond the bumps
        for piece, cubic in enumerate(BUMP):
            cells[piece : piece + bumps] += cubic[:, None] * across[:, None]
        self.direction, self.row = direction, direction.tolist()
        self.per_length, self.start = 1 / spacing, 2 - first / spacing
        self.cells = cells
        self._lists = cells.transpose(0, 2, 1).tolist()
        self.shift = np.zeros(d)
        self.shift = self.amounts(np.zeros(1))[0]
        self._zero = self.shift.tolist()
        self.blur = (abs(self.start) + self.count) * spacing
        along = np.abs(coefficients @ direction)[:, None] * np.abs(direction) / (direction @ direction)
        self.sizes = 16 * (np.abs(coefficients) + along).max(axis=0)  # BUMP's entries add up to less
        self._extremes = _slope_extremes(cells, 1 / spacing)
        for array in (self.direction, self.cells, self.shift, self.sizes):  # others are computed from them
            array.setflags(write=False)

    def amounts(self, places: FloatArray) -> FloatArray:
        """Return a at places t (n,). Shape (n, d); exactly zero at zero."""
        cubics, f = self._located(places)
        return ((cubics[:, 3] * f + cubics[:, 2]) * f + cubics[:, 1]) * f + cubics[:, 0] - self.shift

    def slopes(self, places: FloatArray) -> FloatArray:
        """Return a′ at places t (n,). Shape (n, d)."""
        cubics, f = self._located(places)
        return ((3 * cubics[:, 3] * f + 2 * cubics[:, 2]) * f + cubics[:, 1]) * self.per_length

    def slope_bounds(self, places: FloatArray, reach: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return bounds of a′ within ``reach`` (n,) of places t (n,). Shape (n, d) each.

        Over a cell, a′ is no more than its extremes there, and differs from a′(t) by ``reach`` times the
        largest |a″|; of the two bounds the better one counts.
        """
        u, wide = places * self.per_length + self.start, reach * self.per_length
        wide = wide + GUARD * (1 + np.abs(u) + wide)
        cells = np.arange(-1, self.count + 1)  # beyond the bumps on either side, too
        covered = (cells <= (u + wide)[:, None]) & (cells + 1 >= (u - wide)[:, None])
        covered[:, 0] |= u - wide < 0
        covered[:, -1] |= u + wide >= self.count
        least, most, bend = self._extremes
        lowest = np.where(covered[:, :, None], least, np.inf).min(axis=1)
        highest = np.where(covered[:, :, None], most, -np.inf).max(axis=1)
        change = np.where(covered[:, :, None], bend, 0.0).max(axis=1) * wide[:, None] / self.per_length
        middle, guard = self.slopes(places), GUARD * self.sizes * self.per_length
        return np.maximum(lowest, middle - change) - guard, np.minimum(highest, middle + change) + guard

    def _located(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the cubics (n, 4, d) of the cells around places, and how far along each they are (n, 1)."""
        u = places * self.per_length + self.start
        inside = (u >= 0) & (u < self.count)
        u = np.where(inside, u, self.count)
        index = u.astype(np.int64)
        return self.cells[index], (u - index)[:, None]

    def amount(self, y: list[float]) -> list[float]:
        """Return a(w·y) for one y."""
        u = sum(map(mul, self.row, y)) * self.per_length + self.start
        if not 0 <= u < self.count:
            return [-shift for shift in self._zero]
        index = int(u)
        f = u - index
        cubics = zip(self._lists[index], self._zero, strict=True)
        return [((p3 * f + p2) * f + p1) * f + p0 - shift for (p0, p1, p2, p3), shift in cubics]

    def sheared(self, y: list[float]) -> tuple[list[float], list[float]]:
        """Return y + a and a′ at w·y for one y."""
        u = sum(map(mul, self.row, y)) * self.per_length + self.start
        if not 0 <= u < self.count:
            return [a - shift for a, shift in zip(y, self._zero, strict=True)], [0.0] * len(y)
        index = int(u)
        f, cubics = u - index, self._lists[index]
        per_length, shifts = self.per_length, self._zero
        moved = [
            a + (((p3 * f + p2) * f + p1) * f + p0 - shift)
            for a, (p0, p1, p2, p3), shift in zip(y, cubics, shifts, strict=True)
        ]
        return moved, [((3 * p3 * f + 2 * p2) * f + p1) * per_length for _, p1, p2, p3 in cubics]


def _slope_extremes(cells: FloatArray, per_length: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return least and largest a′, and largest |a″|, of every cell and one before the first, (cells, d) each.

    a′ is a parabola in each cell: its extremes are at the ends, or where a″, which is linear, is zero.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.nan_to_num(-cells[:, 2] / (3 * cells[:, 3]), nan=0.0)  # where a″ = 0
    places = np.stack([np.zeros_like(turn), np.clip(turn, 0.0, 1.0), np.ones_like(turn)])
    slopes = (3 * cells[:, 3] * places + 2 * cells[:, 2]) * places + cells[:, 1]
    bends = np.abs(6 * cells[:, 3] * places + 2 * cells[:, 2])
    found = (
        slopes.min(axis=0) * per_length,
        slopes.max(axis=0) * per_length,
        bends.max(axis=0) * per_length**2,
    )
    return tuple(np.concatenate([np.zeros((1, each.shape[1])), each]) for each in found)  # type: ignore[return-value]


def _product(rows: list[list[float]], vector: list[float]) -> list[float]:
    return [sum(map(mul, row, vector)) for row in rows]
