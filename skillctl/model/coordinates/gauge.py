"""The gauge of a rounded convex body: how many times the body a point is away from its pole."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from operator import mul
from typing import Any

import numpy as np

from skillctl.arrays import FloatArray, Frozen, frozen_array

TINY = 1e-300  # keeps a quotient by a core of no size from being none
ROOT_BITS = 200  # of rational bounds of square roots


@dataclass(frozen=True, eq=False, slots=True)
class Gauge(Frozen):
    r"""ν(x) ≥ 0, the smallest t with p + (x − p)/t in a body K: 1 on its surface, and t ν at t times as far.

    K is said in its own coordinates u = Q (x − p): a core, whose coordinates or their lengths w are within
    sizes h, and all points within m of it. So t = ν solves

        Σ_g max(w_g − t h_g, 0)² = t² m²,   w_g = ‖u_g‖

    A box has each coordinate for itself, a cylinder the first two together, a ball all. Since m > 0 the
    surface has no edge, and ν is continuously differentiable off the pole.

    Attributes:
        pole: p, shape (d,).
        frame: Q, invertible, shape (d, d).
        groups: Which coordinates are taken together, each g as indices.
        below, above: Sizes h of the core, towards negative and positive u, shape (number of groups,). Of
            a group of several coordinates both are its radius.
        rounding: m > 0.
    """

    pole: FloatArray
    frame: FloatArray
    groups: tuple[tuple[int, ...], ...]
    below: FloatArray
    above: FloatArray
    rounding: float
    inverse: FloatArray = field(init=False, repr=False)
    radius: float = field(init=False, repr=False)
    _lists: tuple[Any, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        d, groups = len(self.pole), len(self.groups)
        shapes = {"pole": (d,), "frame": (d, d), "below": (groups,), "above": (groups,)}
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), shape))
        object.__setattr__(self, "inverse", frozen_array("inverse", np.linalg.inv(self.frame), (d, d)))
        sizes = np.maximum(self.below, self.above)
        farthest = self.rounding + math.sqrt(float(sizes @ sizes))
        object.__setattr__(self, "radius", float(np.linalg.norm(self.inverse, 2)) * farthest * (1 + 1e-12))
        lists = [each.tolist() for each in (self.pole, self.frame, self.below, self.above)]
        singly = all(len(members) == 1 for members in self.groups)
        object.__setattr__(self, "_lists", (*lists, singly, self.rounding))

    def values(self, points: FloatArray) -> FloatArray:
        """Return ν at points (n, d). Shape (n,)."""
        return self._solved((points - self.pole) @ self.frame.T)[0]

    def slopes(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ν at points (n, d), shape (n,), and its gradient, shape (n, d); zero at the pole."""
        u = (points - self.pole) @ self.frame.T
        t, w, h = self._solved(u)
        over = np.maximum(w - t[:, None] * h, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            along = over / ((over * h).sum(axis=1) + t * self.rounding**2)[:, None] / w
        along = np.nan_to_num(along, nan=0.0, posinf=0.0)
        gradient = np.empty_like(u)
        for g, members in enumerate(self.groups):
            gradient[:, members] = along[:, g, None] * u[:, members]
        return t, gradient @ self.frame

    def _solved(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return ν (n,), w (n, groups) and h (n, groups) of places in the body's own coordinates (n, d)."""
        w = np.stack([np.linalg.norm(u[:, members], axis=1) for members in self.groups], axis=1)
        firsts = u[:, [members[0] for members in self.groups]]
        h = np.where(firsts < 0, self.below, self.above)
        ratios = w / np.maximum(h, TINY)
        order = np.argsort(-ratios, axis=1, kind="stable")
        ratios, ws, hs = (np.take_along_axis(each, order, axis=1) for each in (ratios, w, h))
        t, b, c, cross = (np.zeros(len(u)) for _ in range(4))
        for k in range(w.shape[1]):  # groups beyond the core by more than the solution so far take part
            take = ratios[:, k] > t
            wk, hk = np.where(take, ws[:, k], 0.0), np.where(take, hs[:, k], 0.0)
            for j in range(k):  # those taken before; once one is not, no later one is
                cross += np.where(take, (ws[:, j] * hs[:, k] - ws[:, k] * hs[:, j]) ** 2, 0.0)
            b, c = b + wk * hk, c + wk**2
            with np.errstate(divide="ignore", invalid="ignore"):
                root = c / (b + np.sqrt(np.maximum(self.rounding**2 * c - cross, 0.0)))
            t = np.where(take, root, t)
        return t, w, h

    # One point goes through lists of floats: of a handful of numbers that takes a third of the time.

    def at(self, offset: Sequence[float]) -> float:
        """Return ν for one point, given as its offset x − p (d numbers)."""
        return self._at(offset)[0]

    def slope_at(self, offset: Sequence[float]) -> tuple[float, list[float]]:
        """Return ν and its gradient for one point, given as its offset x − p (d numbers)."""
        t, u, w, h = self._at(offset)
        frame, m = self._lists[1], self.rounding
        gradient = [0.0] * len(u)
        if t == 0:
            return t, gradient
        scale = sum(max(a - t * b, 0.0) * b for a, b in zip(w, h, strict=True)) + t * m * m
        for g, members in enumerate(self.groups):
            over = w[g] - t * h[g]
            if over > 0:
                factor = over / (scale * w[g])
                for i in members:
                    along = factor * u[i]
                    gradient = [a + along * b for a, b in zip(gradient, frame[i], strict=True)]
        return t, gradient

    def _at(self, offset: Sequence[float]) -> tuple[float, list[float], list[float], list[float]]:
        _, frame, below, above, singly, m = self._lists
        u = [sum(map(mul, row, offset)) for row in frame]
        if len(below) == 1:
            w, h = [math.hypot(*u)], above
            return w[0] / (h[0] + m), u, w, h
        if singly:
            w = [abs(each) for each in u]
            h = [low if each < 0 else high for each, low, high in zip(u, below, above)]  # noqa: B905
        else:
            w = [math.hypot(*[u[i] for i in members]) for members in self.groups]
            firsts = [u[members[0]] for members in self.groups]
            h = [low if each < 0 else high for each, low, high in zip(firsts, below, above)]  # noqa: B905
        t = max([a / (b + m) for a, b in zip(w, h)])  # noqa: B905
        over = [(a, b) for a, b in zip(w, h) if a > t * b]  # noqa: B905
        if len(over) > 1:  # before an edge or a corner, not a face
            t = _solved_at(over, m * m)
        return t, u, w, h

    def exit(self) -> list[float]:
        """Return an offset from the pole to the surface, along the axis on which that is nearest."""
        nearest = int(np.argmin(self.above + self.rounding))
        u = np.zeros(len(self.pole))
        u[self.groups[nearest][0]] = self.above[nearest] + self.rounding
        return [float(each) for each in self.inverse @ u]

    def bounds(self, times: float = 1.0) -> tuple[FloatArray, FloatArray]:
        """Return the lowest and highest coordinates of {ν ≤ ``times``}, (d,) each."""
        axes = np.eye(len(self.pole)).tolist()
        high = [self.support(axis, times) for axis in axes]
        low = [-self.support([-each for each in axis], times) for axis in axes]
        return np.array(low), np.array(high)

    def support(self, direction: Sequence[float], times: float) -> float:
        """Return max n·x over {ν ≤ ``times``} for a direction n (d numbers)."""
        return float(_support(self, direction, times, self.inverse.tolist(), math.sqrt))

    def support_above(self, direction: Sequence[float], times: float) -> Fraction:
        """Return a number not below that maximum, from the stored numbers as they are, without rounding."""
        exact = [[Fraction(each) for each in row] for row in self.frame.tolist()]
        n = [Fraction(each) for each in direction]
        return Fraction(_support(self, n, Fraction(times), inverted(exact), root_above))

    def farthest(self, direction: FloatArray, times: float) -> FloatArray:
        """Return the point of {ν ≤ ``times``} that is farthest along a direction (d,), not zero."""
        n = self.inverse.T @ direction
        u = self.rounding * n / np.linalg.norm(n)
        for g, members in enumerate(self.groups):
            part = n[list(members)]
            size = float(np.linalg.norm(part))
            if size > 0:
                u[list(members)] += (self.below[g] if part[0] < 0 else self.above[g]) * part / size
        return np.asarray(self.pole + times * self.inverse @ u)


def _solved_at(over: list[tuple[float, float]], square: float) -> float:
    """Return t of Σ max(w − t h, 0)² = t² m² for pairs (w, h), of which some may not take part."""
    t, b, c, cross = 0.0, 0.0, 0.0, 0.0
    taken: list[tuple[float, float]] = []
    for ratio, wk, hk in sorted([(w / (h or TINY), w, h) for w, h in over], reverse=True):
        if ratio <= t:
            break
        for wj, hj in taken:
            cross += (wj * hk - wk * hj) ** 2
        b, c = b + wk * hk, c + wk * wk
        t = c / (b + math.sqrt(max(square * c - cross, 0.0)))
        taken.append((wk, hk))
    return t


def _support(
    gauge: Gauge,
    direction: Sequence[Any],
    times: Any,
    inverse: Sequence[Sequence[Any]],
    root: Callable[[Any], Any],
) -> Any:
    """Return max n·x over {ν ≤ times} in the arithmetic of the given numbers."""
    exact = type(times)
    d = len(direction)
    n = [sum(inverse[i][j] * direction[i] for i in range(d)) for j in range(d)]
    total = exact(gauge.rounding) * root(sum(each * each for each in n))
    for g, members in enumerate(gauge.groups):
        size = exact(float(gauge.below[g] if n[members[0]] < 0 else gauge.above[g]))
        one = abs(n[members[0]]) if len(members) == 1 else root(sum(n[i] * n[i] for i in members))
        total += size * one
    pole = gauge.pole.tolist()
    return sum(exact(pole[i]) * direction[i] for i in range(d)) + times * total


def root_above(square: Fraction) -> Fraction:
    """Return a rational not below √q for q ≥ 0, and hardly above."""
    scaled = square.numerator * square.denominator << 2 * ROOT_BITS
    root = math.isqrt(scaled)
    return Fraction(root + (root * root < scaled), square.denominator << ROOT_BITS)


def inverted(matrix: list[list[Fraction]]) -> list[list[Fraction]]:
    """Return the inverse of a matrix of rationals.

    Raises:
        ZeroDivisionError: It has none.
    """
    d = len(matrix)
    rows = [[*row, *(Fraction(int(i == j)) for j in range(d))] for i, row in enumerate(matrix)]
    for i in range(d):
        pivot = next((k for k in range(i, d) if rows[k][i]), i)
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [each / rows[i][i] for each in rows[i]]
        for k in range(d):
            if k != i and rows[k][i]:
                rows[k] = [a - rows[k][i] * b for a, b in zip(rows[k], rows[i], strict=True)]
    return [row[d:] for row in rows]
