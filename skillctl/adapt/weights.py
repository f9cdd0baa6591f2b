"""Adaptation to a task (Fig. 1): weights of parts whose velocities add up to the demonstrated ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skillctl.adapt.charted import charted
from skillctl.arrays import FloatArray
from skillctl.compose.parts import in_one_space, normalised, on_one_attractor
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.merged import MergedSkill
from skillctl.model.skill import ActingSkill


@dataclass(frozen=True, eq=False, slots=True)
class WeightedMerger:
    """A merged skill (superposition), and the weights of the parts it was chosen from.

    Attributes:
        skill: Made of the parts with a weight.
        weights: Of each given part, zero for one that was left out. Shape (number of given parts,).
    """

    skill: MergedSkill
    weights: FloatArray


def fit_velocities(parts: Sequence[ActingSkill], demonstrations: DemonstrationSet) -> WeightedMerger | None:
    """Return the superposition of the parts whose velocities are nearest to demonstrations of a new task.

    Minimises the mean of ‖ξ̇ − Σᵢ wᵢ fᵢ(ξ)‖² over w ≥ 0, every demonstration with the same total weight. The
    speed of the result is the sum of the weights. Weights scale Aₖ by positive numbers, so a P that proves
    the parts proves the result. What it does not show: how far a rollout stays from the demonstrations.

    Args:
        parts: SEDS or merged skills with one attractor and one Lyapunov matrix.
        demonstrations: Of the new task; each counts relative to its own end point.

    Returns:
        None if all weights are zero: no mixture of the parts moves along with the demonstrations.

    References:
        Section 3 and 3.1 of the paper; theory page, adaptation to the task (ours).
    """
    fields, goal = _least_squares(parts, demonstrations)
    weights = _nonnegative(fields, goal)
    used = np.flatnonzero(weights)
    if not used.size:
        return None
    shares = normalised("part weights", weights[used], used.size)
    skill = MergedSkill(tuple(parts[i] for i in used.tolist()), shares, speed=float(weights.sum()))
    return WeightedMerger(skill, weights)


def most_helpful(
    parts: Sequence[ActingSkill], demonstrations: DemonstrationSet, most: int
) -> tuple[int, ...]:
    """Return which parts, at most ``most`` of them, move along with demonstrations when they act together.

    Non-negative least squares on velocities leaves most weights at zero; while more are positive than
    wanted, the part that moves least is left out. The parts need no common P for this.

    Args:
        parts: SEDS or merged skills in the state space of the demonstrations.
        demonstrations: Of the new task.
        most: At least 1.

    Returns:
        Indices, rising; empty if no part moves along.
    """
    target = demonstrations.demonstrations[0].positions[-1]
    members = on_one_attractor(in_one_space(parts), np.full(len(parts), 1 / len(parts)), target)
    fields, goal = _least_squares(*charted(members, demonstrations))
    lengths = np.linalg.norm(fields, axis=0)
    chosen = np.arange(len(members))
    while True:
        moved = _nonnegative(fields[:, chosen], goal) * lengths[chosen]
        chosen, moved = chosen[moved > 0], moved[moved > 0]
        if len(chosen) <= most:
            return tuple(chosen.tolist())
        chosen = np.delete(chosen, moved.argmin())  # one a turn: parts that tie must not all go at once


def _least_squares(
    parts: Sequence[ActingSkill], demonstrations: DemonstrationSet
) -> tuple[FloatArray, FloatArray]:
    """Return the parts' velocities where demonstrations lead to their attractor, and the demonstrated ones.

    Rows are scaled by the square root of their share, so that every demonstration has the same total weight.

    Returns:
        Columns to be weighted, shape (n d, number of parts), and the goal, shape (n d,).
    """
    states = np.vstack([m.positions - m.positions[-1] + parts[0].attractor for m in demonstrations])
    lengths = np.concatenate([np.full(len(m.times), len(m.times)) for m in demonstrations])
    row_weights = 1 / np.sqrt(lengths * len(demonstrations))[:, None]
    fields = [(row_weights * part.velocity(states)).ravel() for part in parts]
    goal = row_weights * np.vstack([m.velocities for m in demonstrations])
    return np.stack(fields, axis=1), goal.ravel()


def _nonnegative(columns: FloatArray, goal: FloatArray) -> FloatArray:
    """Return w ≥ 0 that minimises ‖columns w − goal‖."""
    from scipy.optimize import nnls  # late: it would double the start-up time of every merge

    return np.asarray(nnls(columns, goal)[0], dtype=np.float64)
