r"""Steering clear of bodies that are seen at run time: at the velocity, with no map made beforehand (ours).

For each convex body {ν ≤ 1}, the plane through the point before which the state x lies, as seen from the
body's pole, has the body on one side: ∇ν·(y − x) ≥ 1 − ν holds for no y in it. So a step Δt v with
∇ν·v ≥ −κ (ν − 1) and κ Δt < 1 stays before the plane, and so does the straight way to its end. Of the v with
this for each body and V̇ ≤ σ V̇(f) < 0, the one nearest to the skill's f is taken, as V measures it, and
shortened until V falls at the step.

No motion enters a body that stands still, and V never rises. It does not follow that the motion arrives:
before a face that is wide, as seen from the target, no such v is left. Then the robot stops there, and is
told so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.model.coordinates.gauge import Gauge
from skillctl.model.skill import ActingSkill
from skillctl.model.stepper import UNCAPPED, Caps

APPROACH = 0.5  # κ Δt: the share of the room before a body that one step may take
DESCENT = 0.02  # σ: of how fast V would fall without bodies
HALVINGS = 40  # of a step after which V is not below what it was
SLACK = 1e-12  # of constraints, relative to the sizes of their terms


@dataclass(frozen=True, eq=False, slots=True)
class Steered:
    """A velocity that keeps clear of bodies.

    Attributes:
        velocity: Shape (d,), per second; zero where nothing is left.
        blocked: Indices of the bodies before which it is zero; none where the motion goes on.
    """

    velocity: FloatArray
    blocked: tuple[int, ...] = ()


def steered(
    part: ActingSkill,
    state: FloatArray,
    velocity: FloatArray,
    bodies: Sequence[Gauge],
    period: float,
    caps: Caps = UNCAPPED,
) -> Steered:
    """Return the velocity nearest to a skill's own that enters no body, and with which V falls.

    Args:
        part: The skill that acts, over positions.
        state: ξ, shape (d,).
        velocity: What the skill would command, shape (d,), per second.
        bodies: In the skill's frame.
        period: Δt, [s].
        caps: What the velocity keeps.
    """
    value, slope, metric = _descent(part, state)
    sides = [body.slope_at((state - body.pole).tolist()) for body in bodies]
    rows = [np.array(gradient) for _, gradient in sides]
    bounds = [-APPROACH / period * (t - 1) for t, _ in sides]
    fall = float(slope.dot(velocity))
    found = nearest(velocity, metric, np.array([*rows, -slope]), np.array([*bounds, -DESCENT * fall]))
    if found is None:
        room = [(t, index) for index, (t, _) in enumerate(sides)]
        near = tuple(index for t, index in sorted(room) if t <= min(room)[0] + 0.01)
        return Steered(np.zeros_like(velocity), near)
    found = found * min(1.0, caps.allow(part.space, found))
    for _ in range(HALVINGS):
        if part.v_distance((state + period * found)[None])[0] < value:
            return Steered(found)
        found = 0.5 * found
    return Steered(np.zeros_like(velocity))


def nearest(
    wanted: FloatArray, metric: FloatArray, rows: FloatArray, bounds: FloatArray
) -> FloatArray | None:
    """Return the v with A v ≥ b that is nearest to ``wanted`` (d,) in a metric; None if there is none.

    Few dimensions and few constraints: each set of at most d of them is tried as those that hold with
    equality, fewest first. The first that leaves multipliers ≥ 0 and breaks no other is the answer.

    Args:
        wanted: f, shape (d,).
        metric: M, symmetric positive definite, shape (d, d).
        rows: A, shape (n, d).
        bounds: b, shape (n,).
    """
    inverse = np.linalg.inv(metric)
    missing = bounds - rows @ wanted
    tolerance = SLACK * (np.abs(bounds) + np.abs(rows) @ np.abs(wanted))
    for count in range(min(len(wanted), len(rows)) + 1):
        for chosen in combinations(range(len(rows)), count):
            active = rows[list(chosen)]
            try:
                multipliers = np.linalg.solve(active @ inverse @ active.T, missing[list(chosen)])
            except np.linalg.LinAlgError:  # of these, fewer say the same
                continue
            v = wanted + inverse @ active.T @ multipliers
            if (multipliers >= 0).all() and (rows @ v >= bounds - tolerance).all():
                return np.asarray(v)
    return None


def _descent(part: ActingSkill, state: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Return √V at a state (d,), ½∇V (d,), and the metric Dcᵀ P Dc of V there (d, d)."""
    offset = state - part.attractor
    y, pull = part.coordinates.tangent_at(offset)
    if not part.coordinates.links:
        return float(np.sqrt(y @ part.lyapunov @ y)), part.lyapunov @ y, part.lyapunov
    jacobian = np.linalg.inv(np.stack([pull(axis) for axis in np.eye(len(y))], axis=1))
    pulled = jacobian.T @ part.lyapunov
    return float(part.v_distance(state[None])[0]), pulled @ y, pulled @ jacobian
