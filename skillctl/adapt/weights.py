"""Adaptation to a task (Fig. 1): the weights of a merger from one or a few demonstrations of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray
from skillctl.compose.merge import common_members
from skillctl.compose.parts import normalised, on_one_attractor
from skillctl.errors import FitError, UsageError
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.merged import MergedSkill
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import ActingSkill, AnyActing, Skill


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
    target: npt.ArrayLike | None = None,
    lyapunov: FloatArray | None = None,
) -> Adaptation:
    """Return the superposition of the parts whose velocities are nearest to demonstrations of a new task.

    Minimises the mean of ‖ξ̇ − Σᵢ wᵢ fᵢ(ξ)‖² over w ≥ 0, demonstrations counting alike. Weights scale Aₖ by
    positive numbers, so a P that proves the parts proves the result. What it does not show: how far a
    rollout stays from the demonstrations.

    Args:
        parts: Two or more SEDS or merged skills in one state space.
        demonstrations: Of the new task; motions count relative to their own end points.
        target: Attractor of the result (d,); by default the mean of the demonstrations' end points.
        lyapunov: Common P (d, d); may be omitted where the parts share one already.

    Raises:
        UsageError: As ``merge``; or demonstrations of another dimension.
        NoCommonLyapunovError: As ``merge``.
        FitError: No mixture of the parts moves along with the demonstrations.

    References:
        Section 3 and 3.1 of the paper; theory page, adaptation to the task (ours).
    """
    members = common_members(parts, lyapunov)
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
    shares = normalised("part weights", weights[list(used)], len(used))
    return Adaptation(MergedSkill(chosen, shares, speed=float(weights.sum())), weights, used)


def most_helpful(
    parts: Sequence[ActingSkill], demonstrations: DemonstrationSet, most: int
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
        speeds = [float(np.linalg.norm(members[i].velocity(task.states))) for i in chosen]
        moved = {i: w * speed for i, w, speed in zip(chosen, weights, speeds, strict=True) if w * speed > 0}
        if len(moved) <= most:
            return tuple(moved)
        moved.pop(min(moved, key=moved.__getitem__))  # one a turn: parts that tie must not all go at once
        chosen = list(moved)


def _velocity_weights(members: Sequence[ActingSkill], task: _Task) -> FloatArray:
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


def scaled_components(part: AnyActing, factors: FloatArray) -> AnyActing:
    """Return the part with its components' velocities multiplied by positive factors (K,): h̃ᵏ = αᵏ hᵏ."""
    splits = iter(np.split(factors, np.cumsum([leaf.n_components for leaf in part.leaves])[:-1]))

    def scaled(leaf: SedsSkill) -> SedsSkill:
        own = next(splits)[:, None, None]
        matrices, residuals = leaf.system_matrices * own, leaf.residual_covariances * own**2
        return replace(leaf, system_matrices=matrices, residual_covariances=residuals)

    return part.with_leaves(scaled)
