r"""Keep-out bodies: coordinates in which no motion ever enters a body (ours).

A point, the body's pole p, is opened to the body {ν ≤ 1}, where ν is its gauge (``Gauge``). Within the
influence {ν < R}, each point moves straight away from the pole, and beyond nothing changes:

    x = p + β(r)/r (z − p),   r = ν(z − p),   β(r) = 1 + (R − 1)² r / (R² − r)

β(0) = 1, β(R) = R and β′(R) = 1; β′ = (R − 1)² R²/(R² − r)² > 0 for every R > 1. So this is a continuously
differentiable, invertible map of all points but the pole onto the outside of the body. A motion in z does
not know of the body, and what it becomes in x never enters it: V falls at each step as ever, and every start
arrives but those whose z-motion meets a pole. The influence needs to leave out only the target and the
other influences, however near to the body they are.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from itertools import combinations
from math import dist
from operator import sub
from typing import Any

import numpy as np

from skillctl.arrays import FloatArray, Frozen, IntArray, frozen_array
from skillctl.errors import InvalidModelError
from skillctl.model.coordinates.chain import Link, Pull
from skillctl.model.coordinates.gauge import Gauge, inverted, root_above
from skillctl.model.coordinates.separation import separated

NUDGE = 1e-6  # z is never nearer to a pole than this share of the body: there x would have no direction
GUARD = 1e-9  # of the bounds of an influence: far more than rounding


@dataclass(frozen=True, eq=False, slots=True)
class KeepOut(Frozen, Link):
    """The outside of bodies on offsets from the target; ``kept_out`` makes it for a skill.

    A state inside a body, which only a measurement can be, counts as the one on its surface straight away
    from its pole; the pole itself as the nearest on an axis of the body.

    Attributes:
        names: Of the bodies.
        gauges: ν of each, around offsets from the target.
        reaches: R of each, above one: the size of its influence in sizes of the body. Shape (n,).
        stride: How far the state may move in a straight line near a body, in the unit of the space.
    """

    names: tuple[str, ...]
    gauges: tuple[Gauge, ...]
    reaches: FloatArray
    stride: float
    _bodies: tuple[tuple[Any, ...], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "reaches", frozen_array("reaches", self.reaches, (len(self.gauges),)))
        if reasons := self.check():
            raise InvalidModelError(reasons[0])
        bodies = [
            (r * g.radius, g.pole.tolist(), g, r)
            for g, r in zip(self.gauges, self.reaches.tolist(), strict=True)
        ]
        object.__setattr__(self, "_bodies", tuple(bodies))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, KeepOut):
            return False
        mine, others = (_numbers(each) for each in (self, other))
        return self.names == other.names and mine == others

    def __hash__(self) -> int:
        return hash((self.names, self.reaches.tobytes()))

    def in_unit(self, unit: float) -> KeepOut:
        """Return the same bodies in other lengths; see ``Link``."""
        gauges = tuple(
            Gauge(unit * g.pole, g.frame / unit, g.groups, g.below, g.above, g.rounding) for g in self.gauges
        )
        return KeepOut(self.names, gauges, self.reaches, unit * self.stride)

    def check(self) -> tuple[str, ...]:
        """Return why the map is not exactly invertible, in sentences; see ``Link``.

        All is decided with rationals, from the stored numbers as they are.
        """
        sentences = []
        for name, gauge, reach in zip(self.names, self.gauges, self.reaches.tolist(), strict=True):
            if not (reach > 1 and gauge.rounding > 0 and min(gauge.below.min(), gauge.above.min()) >= 0):
                sentences.append(f"coordinates: {name} is no rounded body with an influence around it.")
            elif not _outside(gauge, reach):
                sentences.append(f"coordinates: the target is in the influence of {name}.")
        if sentences:
            return tuple(sentences)
        for i, j in combinations(range(len(self.names)), 2):
            first, second = self.gauges[i], self.gauges[j]
            if not separated(first, second, (float(self.reaches[i]), float(self.reaches[j]))):
                pair = f"{self.names[i]} and {self.names[j]}"
                sentences.append(f"coordinates: the influences of {pair} are not proved to be apart.")
        return tuple(sentences)

    def forward(self, offsets: FloatArray) -> FloatArray:
        """Return z for offsets (n, d). Shape (n, d)."""
        z = np.array(offsets)
        for gauge, reach in zip(self.gauges, self.reaches, strict=True):
            near, e, t, _ = self._met(gauge, reach, offsets)
            z[near] = gauge.pole + e * (_closed(np.maximum(t, 1.0), reach) / t)[:, None]
        return z

    def back(self, coordinates: FloatArray) -> FloatArray:
        """Return x for coordinates (n, d). Shape (n, d)."""
        x = np.array(coordinates)
        for gauge, reach in zip(self.gauges, self.reaches, strict=True):
            near, e, r, _ = self._met(gauge, reach, coordinates)
            x[near] = gauge.pole + e * (_opened(np.maximum(r, NUDGE), reach) / r)[:, None]
        return x

    def tangent(self, offsets: FloatArray) -> tuple[FloatArray, Pull]:
        """Return z for offsets (n, d), and what leads velocities back.

        With λ = β(r)/r and u = (x − p)/ν: ẋ = λ ż + (β′(r) − λ) (∇ν·ż) u.
        """
        z, pulls = np.array(offsets), []
        for gauge, reach in zip(self.gauges, self.reaches, strict=True):
            near, e, t, gradient = self._met(gauge, reach, offsets)
            r = _closed(np.maximum(t, 1.0), reach)
            z[near] = gauge.pole + e * (r / t)[:, None]
            stretch = _opened(r, reach) / r
            turn = (_slope(r, reach) - stretch)[:, None] * e / t[:, None]
            pulls.append((near, gradient, stretch[:, None], turn))

        def pull(velocities: FloatArray) -> FloatArray:
            pulled = np.array(velocities)
            for near, gradient, stretch, turn in pulls:
                v = velocities[near]
                pulled[near] = stretch * v + (gradient * v).sum(axis=1)[:, None] * turn
            return pulled

        return z, pull

    def nudged(self, coordinates: FloatArray) -> FloatArray:
        """Return whether z (n, d) is so near to a pole that x is moved aside. Shape (n,)."""
        aside = np.zeros(len(coordinates), dtype=bool)
        for gauge in self.gauges:
            aside |= gauge.values(coordinates) < 2 * NUDGE
        return aside

    def inside(self, offsets: FloatArray) -> FloatArray:
        """Return whether offsets (n, d) are inside a body, which no motion from outside is. Shape (n,)."""
        within = np.zeros(len(offsets), dtype=bool)
        for gauge in self.gauges:
            within |= gauge.values(offsets) < 1
        return within

    def longest(self, offsets: FloatArray) -> FloatArray:
        """Return how far the state may move in a straight line from offsets (n, d); see ``Link``."""
        free = [np.linalg.norm(offsets - g.pole, axis=1) - g.radius for g in self.gauges]
        return np.asarray(np.maximum(np.min(free, axis=0), self.stride))

    def longest_at(self, offset: FloatArray) -> float:
        """Return how far the state may move in a straight line from one offset (d,); see ``Link``."""
        x = offset.tolist()
        free = min([dist(x, pole) - gauge.radius for _, pole, gauge, _ in self._bodies])
        return max(float(free), self.stride)

    def bounds_forward(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return boxes that hold z for all x in boxes, (n, d) each; see ``Link``.

        An influence is mapped into itself: a box that meets one is joined with the box around it.
        """
        low, high = np.array(low), np.array(high)
        for gauge, reach in zip(self.gauges, self.reaches, strict=True):
            least, most = gauge.bounds(float(reach))
            pad = GUARD * (np.abs(least) + np.abs(most) + (most - least))
            meets = ((low <= most + pad) & (high >= least - pad)).all(axis=1)
            low[meets] = np.minimum(low[meets], least - pad)
            high[meets] = np.maximum(high[meets], most + pad)
        return low, high

    def bounds_back(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return boxes that hold x for all z in boxes, (n, d) each; see ``bounds_forward``."""
        return self.bounds_forward(low, high)

    def forward_at(self, offset: FloatArray) -> FloatArray:
        """Return z for one offset (d,)."""
        met = self._met_at(offset)
        if met is None:
            return offset
        pole, e, t, _, reach = met
        share = (_closed(t, reach) if t > 1 else NUDGE) / t
        return np.array([p + share * each for p, each in zip(pole, e)])  # noqa: B905

    def back_at(self, coordinate: FloatArray) -> FloatArray:
        """Return x for one z (d,)."""
        met = self._met_at(coordinate)
        if met is None:
            return coordinate
        pole, e, r, _, reach = met
        share = _opened(r if r > NUDGE else NUDGE, reach) / r
        return np.array([p + share * each for p, each in zip(pole, e)])  # noqa: B905

    def tangent_at(self, offset: FloatArray) -> tuple[FloatArray, Pull]:
        """Return z for one offset (d,), and what leads a velocity (d,) back; see ``tangent``."""
        met = self._met_at(offset)
        if met is None:
            return offset, _as_it_is
        pole, e, t, gauge, reach = met
        r = _closed(max(t, 1.0), reach)
        z = np.array([p + r / t * each for p, each in zip(pole, e, strict=True)])
        stretch = _opened(r, reach) / r
        turn = (_slope(r, reach) - stretch) / t
        gradient = gauge.slope_at(e)[1]

        def pull(velocity: FloatArray) -> FloatArray:
            v = velocity.tolist()
            along = turn * sum([a * b for a, b in zip(gradient, v, strict=True)])
            return np.array([stretch * a + along * b for a, b in zip(v, e, strict=True)])

        return z, pull

    def _met(
        self, gauge: Gauge, reach: float, points: FloatArray
    ) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """Return which points (n, d) are in an influence, and of those x − p, ν and ∇ν."""
        away = points - gauge.pole
        near = np.flatnonzero((away**2).sum(axis=1) < (reach * gauge.radius) ** 2)
        t, gradient = gauge.slopes(points[near])
        within = t < reach
        near, t, gradient = near[within], t[within], gradient[within]
        e = away[near]
        if (t == 0).any():
            e[t == 0] = NUDGE * np.array(gauge.exit())
            gradient[t == 0] = gauge.slopes(gauge.pole + e[t == 0])[1]
            t = np.where(t == 0, NUDGE, t)
        return near, e, t, gradient

    def _met_at(self, point: FloatArray) -> tuple[list[float], list[float], float, Gauge, float] | None:
        """Return p, x − p, ν, the gauge and R of the influence that one point (d,) is in; None if in none."""
        x = point.tolist()
        for farthest, pole, gauge, reach in self._bodies:
            if dist(x, pole) < farthest:
                e = list(map(sub, x, pole))
                t = gauge.at(e)
                if t < reach:  # influences have no point in common: there is no other
                    if t == 0:
                        e, t = [NUDGE * each for each in gauge.exit()], NUDGE
                    return pole, e, t, gauge, reach
        return None


def _as_it_is(velocity: FloatArray) -> FloatArray:
    return velocity


def _opened(r: Any, reach: float) -> Any:
    """Return β(r)."""
    return 1 + (reach - 1) ** 2 * r / (reach**2 - r)


def _slope(r: Any, reach: float) -> Any:
    """Return β′(r)."""
    return ((reach - 1) * reach / (reach**2 - r)) ** 2


def _closed(t: Any, reach: float) -> Any:
    """Return β⁻¹(t) = R² (t − 1) / ((R − 1)² + t − 1), but not below ``NUDGE``."""
    r = reach**2 * (t - 1) / ((reach - 1) ** 2 + t - 1)
    return max(r, NUDGE) if isinstance(r, float) else np.maximum(r, NUDGE)


def _outside(gauge: Gauge, reach: float) -> bool:
    """Return whether the target, offset zero, has ν ≥ R: with rationals, and exactly if true."""
    rows = [[Fraction(each) for each in row] for row in gauge.frame.tolist()]
    try:
        inverted(rows)
    except ZeroDivisionError:
        return False
    pole = [Fraction(each) for each in gauge.pole.tolist()]
    u = [-sum((q * p for q, p in zip(row, pole, strict=True)), Fraction(0)) for row in rows]
    times, total = Fraction(reach), Fraction(0)
    for g, members in enumerate(gauge.groups):
        first = u[members[0]]
        square = sum((u[i] * u[i] for i in members), Fraction(0))
        size = Fraction(float(gauge.below[g] if first < 0 else gauge.above[g]))
        # Of the root a number that is not above it: q/√q, with √q rounded up.
        w = abs(first) if len(members) == 1 else square / root_above(square) if square else square
        total += max(w - times * size, Fraction(0)) ** 2
    return total >= (times * Fraction(gauge.rounding)) ** 2


def _numbers(link: KeepOut) -> list[Any]:
    """Return all numbers of a link, in lists."""
    gauges = [
        (g.pole.tolist(), g.frame.tolist(), g.groups, g.below.tolist(), g.above.tolist(), g.rounding)
        for g in link.gauges
    ]
    return [*gauges, link.reaches.tolist(), link.stride]
