"""Adaptation to a task (Fig. 1): the weights of a merger from one or a few demonstrations of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray
from skillctl.compose.merge import common_members
from skillctl.compose.parts import normalised, on_one_attractor
from skillctl.errors import FitError, UsageError
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.skill import MergedSkill, SedsSkill, Skill

FitLevel: TypeAlias = Literal["part", "component"]
FIT_LEVELS: tuple[FitLevel, ...] = ("part", "component")
PULL = 0.1  # relative to the mean square of what a component moves in the demonstrations
FLOOR = 0.05  # a component keeps at least this share of its part's weight: a zero one would stand still


@dataclass(frozen=True, eq=False, slots=True)
class Adaptation:
    """A merger fitted to a task.

    Attributes:
        skill: The merged skill, superposition gate; its speed is the sum of the weights.
        weights: w_i ≥ 0 of each given part, speed included. Shape (number of given parts,).
        used: Indices of the parts with a weight; the others are left out of the skill.
    """

    skill: MergedSkill
    weights: FloatArray
    used: tuple[int, ...]


def adapt(
    parts: Sequence[Skill],
    demonstrations: DemonstrationSet,
    *,
    level: FitLevel = "part",
    pull: float = PULL,
    target: npt.ArrayLike | None = None,
    lyapunov: FloatArray | None = None,
) -> Adaptation:
    """Return the superposition of the parts whose velocities are nearest to demonstrations of a new task.

    Minimises the mean of ‖ξ̇ − Σᵢ wᵢ fᵢ(ξ)‖² over w ≥ 0, demonstrations counting alike. ``component``: then
    also one factor per component, ξ̇ = Σᵢₖ cᵢₖ hₖⁱ(ξ) Aₖⁱ (ξ − ξ*) with cᵢₖ ≥ FLOOR wᵢ, pulled towards wᵢ:
    h̃ = αᵏ hᵏ of the paper. Weights scale Aₖ by positive numbers, so a P that proves the parts proves the
    result. What it does not show: how far a rollout stays from the demonstrations.

    Args:
        parts: Two or more SEDS or merged skills in one state space.
        demonstrations: Of the new task; motions count relative to their own end points.
        level: One weight per part, or also one per component.
        pull: How strongly components keep to their part: the weight of (cᵢₖ / wᵢ − 1)², in shares of the mean
            square of one component's contribution to the velocities.
        target: Attractor of the result (d,); by default the mean of the demonstrations' end points.
        lyapunov: Common P (d, d); may be omitted where the parts share one already.

    Raises:
        UsageError: As ``merge``; or demonstrations of another dimension, or an unknown level.
        NoCommonLyapunovError: As ``merge``.
        FitError: No mixture of the parts moves along with the demonstrations.

    References:
        Section 3 and 3.1 of the paper; theory page, adaptation to the task (ours).
    """
    members = common_members(parts, lyapunov)
    if not (math.isfinite(pull) and pull >= 0):
        raise UsageError(f"pull: must not be negative, got {pull:g}.")
    if level not in FIT_LEVELS:
        raise UsageError(f"fit level: one of {', '.join(FIT_LEVELS)}, not {level!r}.")
    if demonstrations.dimension != members[0].dimension:
        raise UsageError(
            f"merge: the demonstrations have {demonstrations.dimension} dimensions, "
            f"the skills {members[0].dimension}.",
            hint="Fit to demonstrations with the same columns as the skills'.",
        )
    if target is None:
        target = np.mean([motion.positions[-1] for motion in demonstrations], axis=0)
    members = on_one_attractor(members, np.full(len(members), 1 / len(members)), target)
    task = _Task.of(demonstrations, members[0].attractor)
    weights = _velocity_weights(members, task)
    used = tuple(int(i) for i in np.flatnonzero(weights > 0))
    if not used:
        raise FitError(
            "merge: no mixture of these skills moves along with the demonstrations.",
            hint="Learn the task from the demonstrations, or choose other skills.",
        )
    chosen = tuple(members[i] for i in used)
    if level == "component":
        chosen = _scaled_components(chosen, weights[list(used)], task, pull)
    shares = normalised("part weights", weights[list(used)], len(used))
    return Adaptation(MergedSkill(chosen, shares, speed=float(weights.sum())), weights, used)


def most_helpful(
    parts: Sequence[SedsSkill | MergedSkill], demonstrations: DemonstrationSet, most: int
) -> tuple[int, ...]:
    """Return which parts, at most ``most`` of them, move along with demonstrations when they act together.

    Non-negative least squares on velocities leaves most weights at zero; while more are positive than
    wanted, the part that moves least is left out. No common P is needed to ask this.

    Args:
        parts: SEDS or merged skills in the state space of the demonstrations.
        demonstrations: Of the new task.
        most: At least 1.

    Returns:
        Indices, rising; empty if no part moves along.
    """
    target = demonstrations.demonstrations[0].positions[-1]
    members = on_one_attractor(parts, np.full(len(parts), 1 / len(parts)), target)
    task = _Task.of(demonstrations, members[0].attractor)
    chosen = list(range(len(members)))
    while True:
        weights = _velocity_weights([members[i] for i in chosen], task)
        moved = [
            w * float(np.linalg.norm(members[i].velocity(task.states)))
            for w, i in zip(weights, chosen, strict=True)
        ]
        chosen = [i for i, m in zip(chosen, moved, strict=True) if m > 0]
        if len(chosen) <= most:
            return tuple(chosen)
        least = min(m for m in moved if m > 0)
        chosen = [i for i, m in zip(chosen, (m for m in moved if m > 0), strict=True) if m > least]


def _velocity_weights(members: Sequence[SedsSkill | MergedSkill], task: _Task) -> FloatArray:
    return _nonnegative(task.columns([part.velocity(task.states) for part in members]), task.goal)


@dataclass(frozen=True, eq=False, slots=True)
class _Task:
    """The least-squares problem that demonstrations pose, each demonstration with the same total weight.

    Attributes:
        states: ξ, laid out so that every motion ends at the attractor. Shape (n, d).
        row_weights: Square root of each state's share. Shape (n, 1).
        goal: The weighted velocities. Shape (n d,).
    """

    states: FloatArray
    row_weights: FloatArray
    goal: FloatArray

    @classmethod
    def of(cls, demonstrations: DemonstrationSet, attractor: FloatArray) -> _Task:
        states = np.vstack([m.positions - m.positions[-1] + attractor for m in demonstrations])
        lengths = np.concatenate([np.full(len(m.times), len(m.times)) for m in demonstrations])
        row_weights = 1 / np.sqrt(lengths * len(demonstrations))[:, None]
        velocities = np.vstack([m.velocities for m in demonstrations])
        return cls(states, row_weights, (row_weights * velocities).ravel())

    def columns(self, fields: Sequence[FloatArray]) -> FloatArray:
        """Return velocity fields, (n, d) each at the states, as columns to be weighted. Shape (n d, m)."""
        return np.stack([(self.row_weights * field).ravel() for field in fields], axis=1)


def _nonnegative(columns: FloatArray, goal: FloatArray) -> FloatArray:
    """Return w ≥ 0 that minimises ‖columns w − goal‖."""
    from scipy.optimize import nnls  # imported late: it would double the start-up time of every merge

    return np.asarray(nnls(columns, goal)[0], dtype=np.float64)


def _scaled_components(
    parts: tuple[SedsSkill | MergedSkill, ...], weights: FloatArray, task: _Task, pull: float
) -> tuple[SedsSkill | MergedSkill, ...]:
    """Return the parts with every system matrix multiplied by its fitted factor cᵢₖ / wᵢ ≥ FLOOR."""
    offsets = task.states - parts[0].attractor
    fields = [
        weight * gate[:, None] * (offsets @ matrix.T)
        for weight, part in zip(weights.tolist(), parts, strict=True)
        for gate, matrix in zip(part.responsibilities(task.states).T, part.component_matrices, strict=True)
    ]
    columns = task.columns(fields)
    # Unknown: how far each factor lies above the floor; rows below the data pull it towards one.
    strength = np.sqrt(pull * np.square(columns).sum() / len(fields))
    factors = FLOOR + _nonnegative(
        np.vstack([columns, strength * np.eye(len(fields))]),
        np.concatenate(
            [task.goal - FLOOR * columns.sum(axis=1), np.full(len(fields), strength * (1 - FLOOR))]
        ),
    )
    splits = np.split(factors, np.cumsum([part.n_components for part in parts])[:-1])
    return tuple(_scaled(part, own) for part, own in zip(parts, splits, strict=True))


def _scaled(part: SedsSkill | MergedSkill, factors: FloatArray) -> SedsSkill | MergedSkill:
    """Return the part with its components' velocities multiplied by positive factors (K,)."""
    if isinstance(part, SedsSkill):
        matrices = part.system_matrices * factors[:, None, None]
        residuals = part.residual_covariances * factors[:, None, None] ** 2
        return replace(part, system_matrices=matrices, residual_covariances=residuals)
    splits = np.split(factors, np.cumsum([inner.n_components for inner in part.parts])[:-1])
    return replace(part, parts=tuple(_scaled(*pair) for pair in zip(part.parts, splits, strict=True)))
