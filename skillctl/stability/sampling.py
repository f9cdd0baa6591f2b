"""Evidence from rollouts: a search for a start from which no attractor is reached. Never a proof."""

from __future__ import annotations

import math

import numpy as np

from skillctl import rotations
from skillctl.arrays import BoolArray, FloatArray, IntArray
from skillctl.geometry import box
from skillctl.model.rollout import arrival_distance_of, rollout
from skillctl.model.skill import Skill
from skillctl.stability.blocks import whole_of
from skillctl.stability.report import Motions, PartCertificate, Sampling
from skillctl.stability.sublevels import sublevels_of

STARTS = 100  # if motions from 5 % of the box do not converge, only 1 of 170 searches finds none of them
DEVIATIONS = 3.0  # the box reaches this many standard deviations around every Gaussian of the data
SEGMENT = 500  # steps; between segments, motions that have arrived are dropped
SEGMENTS = 20  # bounds the cost to a second or two
FULL_SHARE = 0.2  # a motion is stuck if it came nearer by less than this share of what one part guarantees


def search_witness(skill: Skill, parts: tuple[PartCertificate, ...], seed: int) -> Sampling:
    """Follow seeded starts and return one whose motion reaches no attractor, if any was found.

    A start is a witness if its motion has not arrived and either the time is up in which every part on
    its own provably arrives from anywhere in the box, twice over; or over the second half of the motion it
    came nearer to no attractor, measured in that part's P-norm, by ``FULL_SHARE`` of the guarantee.

    Args:
        skill: Any skill; a combined one is followed under its own gate.
        parts: What is proved of its parts.
        seed: Of the starts.
    """
    starts = _starts(skill, seed)
    period = _period(skill, parts)
    needed = 2 * _arrival_bound(skill, parts, starts)
    with np.errstate(over="ignore", invalid="ignore"):  # an unproved part may leave all bounds
        active, middle, end, duration = _follow(skill, starts, period, needed)
        lost = _stuck(skill, parts, middle, end, 0.5 * duration) | (duration >= needed)
    witness = int(np.argmax(lost)) if lost.any() else None
    found = witness is not None
    return Sampling(
        seed=seed,
        starts=STARTS,
        arrived=STARTS - len(active),
        duration=duration,
        period=period,
        witness=tuple(starts[active[witness]].tolist()) if found else None,
        witness_end=tuple(end[witness].tolist()) if found and np.isfinite(end[witness]).all() else None,
    )


def follow_box(
    skill: Skill, low: FloatArray, high: FloatArray, period: float, arrival: float | None, seed: int
) -> Motions:
    """Return what seeded motions from the box between ``low`` and ``high``, (d,) each, do.

    Args:
        skill: Any skill.
        low: Corner of the box; of poses, a box of positions: motions start turned anyhow.
        high: The opposite corner.
        period: Of the controller, [s].
        arrival: Time in which all have provably arrived, [s], or None; they are followed no longer.
        seed: Of the starts; the first two are the corners.
    """
    rng = np.random.default_rng(seed)
    starts = rng.uniform(low, high, (STARTS, len(low)))
    starts[:2] = low, high
    if len(low) < skill.dimension:  # quaternions of normal numbers are turned anyhow, alike in all directions
        starts = np.hstack([starts, rotations.vectors(rng.normal(size=(STARTS, 4)))])
    longest = SEGMENT * SEGMENTS * period
    motions = rollout(skill, starts, duration=min(longest, arrival or longest), period=period)
    least, most = box(motions.positions[..., : len(low)].reshape(-1, len(low)))
    return Motions(
        seed=seed,
        starts=STARTS,
        arrived=int(motions.arrived.sum()),
        arrival=float(motions.arrival_times.max()) if motions.arrived.all() else None,
        low=tuple(least.tolist()),
        high=tuple(most.tolist()),
    )


def _follow(
    skill: Skill, starts: FloatArray, period: float, needed: float
) -> tuple[IntArray, FloatArray, FloatArray, float]:
    """Return the motions that never arrived, their states half-way and at the end, and the time followed."""
    active = np.arange(len(starts))
    x = middle = starts
    parts: IntArray | None = None  # each start selects; later segments go on with the same part
    span = SEGMENT * period
    for segment in range(1, SEGMENTS + 1):
        result = rollout(skill, x, duration=span, period=period, parts=parts)
        on_the_way = ~result.arrived
        active, middle = active[on_the_way], middle[on_the_way]
        x, parts = result.positions[on_the_way, -1], result.parts[on_the_way]
        if not len(active) or segment * span >= needed:
            break
        if segment == SEGMENTS // 2:
            middle = x
    return active, middle, x, segment * span


def _starts(skill: Skill, seed: int) -> FloatArray:
    """Return seeded starts in the box around the data and the attractors. Shape (STARTS, d).

    Of poses it is a box of charted states, which are taken as those of each attractor in turn.
    """
    density, space, attractors = skill.density, skill.space, skill.attractors
    reach = DEVIATIONS * np.sqrt(np.diagonal(density.covariances, axis1=1, axis2=2))
    anchors = np.array([space.anchor(attractor) for attractor in attractors])
    corners = np.vstack([density.means - reach, density.means + reach, anchors])
    starts = np.asarray(np.random.default_rng(seed).uniform(*box(corners), (STARTS, skill.dimension)))
    if space.flat:
        return starts
    turns = np.arange(STARTS) % len(attractors)
    return space.placed(starts - anchors[turns], attractors[turns])


def _period(skill: Skill, parts: tuple[PartCertificate, ...]) -> float:
    """Return a step that resolves the fastest component and that each proved part contracts at."""
    norms = [np.linalg.norm(part.component_matrices, 2, axis=(1, 2)).max() for part in skill.acting_parts]
    fastest = skill.outer_speed * float(max(norms))
    resolved = 0.25 / fastest if fastest > np.finfo(np.float64).tiny else 1.0  # if nothing moves, any will do
    return min([resolved] + [0.5 * p.period for p in parts if p.period is not None])


def _arrival_bound(skill: Skill, parts: tuple[PartCertificate, ...], starts: FloatArray) -> float:
    """Return when each part on its own has provably arrived from every start; infinite if unproved."""
    times = []
    for part, proof in zip(skill.acting_parts, parts, strict=True):
        near = None if proof.rate is None else sublevels_of(whole_of(part)).radius(arrival_distance_of(skill))
        if proof.rate is None or near is None:
            return math.inf
        farthest = float(part.v_distance(starts).max())
        times.append(math.log(max(farthest / near, math.e)) / proof.rate)
    return max(times)


def _stuck(
    skill: Skill, parts: tuple[PartCertificate, ...], middle: FloatArray, end: FloatArray, time: float
) -> BoolArray:
    """Return which motions came nearer to no attractor in the ``time`` from middle to end. Shape (n,)."""
    stuck = np.ones(len(end), dtype=np.bool_)
    for part, proof in zip(skill.acting_parts, parts, strict=True):
        share = FULL_SHARE * -math.expm1(-time * (proof.rate or 0.0))
        stuck &= ~(part.v_distance(end) < (1 - share) * part.v_distance(middle))
    return stuck
