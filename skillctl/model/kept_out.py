"""Skills that keep out of bodies, in coordinates in which they never meet them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.model.coordinates.bodies import AnyBody, Body
from skillctl.model.coordinates.chain import Chain, Link, OnPosition
from skillctl.model.coordinates.gauge import Gauge
from skillctl.model.coordinates.keep_out import KeepOut
from skillctl.model.coordinates.separation import separated
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import AnySkill, Skill

LARGEST_REACH = 2.0  # of an influence, in sizes of its body; less of a wide, thin one
LEAST_REACH = 1.01  # smaller ones bend motions too sharply to compute with
HALVINGS = 6  # of the room between two influences


def kept_out(
    skill: AnySkill,
    bodies: Sequence[Body],
    *,
    margin: float,
    stride: float | None = None,
    start: npt.ArrayLike | None = None,
) -> AnySkill:
    """Return the same skill, whose motions come no nearer to any of the bodies than ``margin``.

    That holds from every start outside, for the point that the skill moves: of the rest of a robot it says
    nothing. It is as stable as before: V falls at each step, and every start arrives but those whose motion
    meets the pole of a body, a curve of starts for each (see ``KeepOut``). The bodies stay where they are
    relative to the skill's target; so move the skill first.

    Between two steps the state moves straight. A chord of at most ``stride`` s between points that are at
    least √(m² + s²/4) away from every point of a body is everywhere at least m away from it: so much the
    bodies are inflated, and no step near them is longer.

    Args:
        skill: Any skill over positions or poses; of a pose the bodies concern the position.
        bodies: In the skill's frame.
        margin: m, [m]: what must stay free, such as the radius of the hand.
        stride: s, [m], such as the largest speed times the period. Default: the margin.
        start: A start that must be outside, shape (d,).

    Raises:
        UsageError: A body of another dimension; a target or start in a body, or too near to it; two bodies
            too near to each other.
    """
    if not bodies:
        return skill
    space, size = skill.space, skill.space.positions
    stride = margin if stride is None else stride
    inflation = math.hypot(margin, 0.5 * stride)
    for body in bodies:
        if len(body.centre) != size or space.unit != "m":
            raise UsageError(
                f"{body.name}: a body with {len(body.centre)} coordinates, [m], means nothing to a skill "
                f"over {', '.join(space.names)} [{space.unit}]."
            )
    gauges = [body.inflated(inflation) for body in bodies]
    for body, gauge in zip(bodies, gauges, strict=True):
        if start is not None and gauge.values(np.asarray(start, dtype=np.float64)[None, :size])[0] < 1:
            raise UsageError(f"{body.name}: the start is in it, or nearer than {_length(inflation)}.")
    links: dict[bytes, KeepOut] = {}

    def change(leaf: SedsSkill) -> SedsSkill:
        target = leaf.attractor[:size]
        if (key := target.tobytes()) not in links:
            links[key] = _link(bodies, gauges, target, inflation, stride)
        link: Link = links[key] if size == space.dimension else OnPosition(links[key], size)
        return replace(leaf, coordinates=Chain((link, *leaf.coordinates.links)))

    return skill.with_leaves(change)


def admitted(
    skill: Skill,
    bodies: Sequence[AnyBody],
    *,
    margin: float,
    stride: float | None = None,
    starts: FloatArray | None = None,
) -> tuple[list[AnyBody], tuple[tuple[AnyBody, str], ...]]:
    """Return those of the bodies that a skill can keep out of together; and the others, with reasons.

    A body is left out if a target is in it, or if it is too near to one before it in the list.

    Args:
        skill: As of ``kept_out``.
        bodies: In the order of their worth.
        margin: As of ``kept_out``.
        stride: As of ``kept_out``.
        starts: Where the motion is known to start, shape (n, d); a body that one is in is left out, too.
    """
    chosen: list[tuple[AnyBody, Gauge]] = []
    refusals = []
    inflation = math.hypot(margin, 0.5 * (margin if stride is None else stride))
    least = (LEAST_REACH, LEAST_REACH)
    for body in bodies:
        gauge = body.inflated(inflation)
        if gauge.values(skill.attractors[:, : len(gauge.pole)]).min() < LEAST_REACH:
            refusals.append((body, "the target is in it, or next to it"))
        elif starts is not None and gauge.values(starts[:, : len(gauge.pole)]).min() < 1:
            refusals.append((body, "the motion starts in it"))
        elif met := [other.name for other, taken in chosen if not separated(taken, gauge, least)]:
            refusals.append((body, f"it meets the {met[0]}"))
        else:
            chosen.append((body, gauge))
    return [body for body, _ in chosen], tuple(refusals)


def _link(
    bodies: Sequence[Body], gauges: Sequence[Gauge], target: FloatArray, inflation: float, stride: float
) -> KeepOut:
    moved = [replace(gauge, pole=gauge.pole - target) for gauge in gauges]
    names = tuple(body.name for body in bodies)
    return KeepOut(names, tuple(moved), _reaches(names, moved, inflation), stride)


def _reaches(names: Sequence[str], gauges: Sequence[Gauge], inflation: float) -> FloatArray:
    """Return how large each influence can be, in sizes of its body, for a target at zero. Shape (n,)."""
    reaches = np.empty(len(gauges))
    for i, (name, gauge) in enumerate(zip(names, gauges, strict=True)):
        away = float(gauge.values(np.zeros((1, len(gauge.pole))))[0])
        if away < LEAST_REACH:
            raise UsageError(
                f"{name}: the target is in it, or hardly farther from it than {_length(inflation)}.",
                hint="Move the target, or take a smaller margin.",
            )
        reaches[i] = min(_largest(gauge), away * (1 - 1e-9))
    smaller = reaches.copy()
    for i, j in combinations(range(len(gauges)), 2):
        shared = _shared(gauges[i], gauges[j], (float(reaches[i]), float(reaches[j])))
        if shared is None:
            raise UsageError(
                f"{names[i]} and {names[j]} are closer to each other than twice {_length(inflation)}.",
                hint="Put one body around both, as `around` does, or take a smaller margin.",
            )
        smaller[i], smaller[j] = min(smaller[i], shared[0]), min(smaller[j], shared[1])
    return smaller


def _largest(gauge: Gauge) -> float:
    """Return how large an influence should be: a wide board sends nobody round it from half a metre away."""
    thin = float((0.5 * (gauge.below + gauge.above)).min()) + gauge.rounding
    far = float(np.linalg.norm(np.maximum(gauge.below, gauge.above))) + gauge.rounding
    return min(LARGEST_REACH, 1 + 2 * thin / far)


def _shared(first: Gauge, second: Gauge, reaches: tuple[float, float]) -> tuple[float, float] | None:
    """Return the largest of two influences that are apart, both reduced alike; None if there are none."""

    def reduced(share: float) -> tuple[float, float]:
        return tuple(LEAST_REACH + share * (reach - LEAST_REACH) for reach in reaches)  # type: ignore[return-value]

    if separated(first, second, reaches):
        return reaches
    if not separated(first, second, reduced(0.0)):
        return None
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if separated(first, second, reduced(middle)) else (low, middle)
    return reduced(low)


def _length(metres: float) -> str:
    return f"{1e3 * metres:.3g} mm"
