"""Interior-point Levenberg–Marquardt: least squares over stable fields only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from skillctl.learning.barrier import StabilityBarrier
from skillctl.learning.objective import Evaluation, LearningObjective

FIRST_BARRIER, LAST_BARRIER, BARRIER_FALL = 1e-3, 1e-4, 0.7


@dataclass(eq=False, slots=True)
class State:
    """Where the optimiser stands, so that a probe can go on later."""

    evaluation: Evaluation
    barrier: StabilityBarrier
    barrier_weight: float = FIRST_BARRIER
    damping: float = 1e-2

    @property
    def cost(self) -> float:
        """The data's part of the objective, without the barrier."""
        return self.evaluation.cost


def minimise(
    objective: LearningObjective,
    state: State,
    steps: int,
    *,
    on_step: Callable[[int, float], None] | None = None,
    tolerance: float = 1e-4,
) -> State:
    """Take up to ``steps`` Levenberg–Marquardt steps on cost + weight · barrier; every iterate is stable.

    Args:
        objective: Residuals and Jacobian.
        state: A strictly stable field to start from; the barrier's weight falls with every accepted step.
        steps: Number of linearisations.
        on_step: Called with the step number and the cost.
        tolerance: Stop after three steps in a row that gain less than this share of the cost.
    """
    small_gains = 0
    for step in range(steps):
        before = state.cost
        if not _step(objective, state):
            break
        if on_step is not None:
            on_step(step + 1, state.cost)
        small_gains = small_gains + 1 if before - state.cost < tolerance * before else 0
        if small_gains == 3:
            break
    return state


def _step(objective: LearningObjective, state: State) -> bool:
    """Replace the state by a better one; False where no damping gives one."""
    field, barrier = state.evaluation.field, state.barrier
    matrices = field.matrices
    k, d, _ = matrices.shape
    weight = state.barrier_weight
    normal, slope = objective.normal_equations(state.evaluation)
    barrier_slope, barrier_hessian = barrier.derivatives(matrices)
    size = d * d
    slope[: k * size] += weight * barrier_slope.ravel()
    for index in range(k):
        block = slice(index * size, (index + 1) * size)
        normal[block, block] += weight * barrier_hessian[index]
    diagonal = normal.diagonal().copy()
    start = state.evaluation.cost + weight * float(barrier.value(matrices).sum())
    for _ in range(12):
        damped = normal.copy()
        damped[np.diag_indices_from(damped)] += state.damping * (diagonal + 1e-3 * diagonal.mean()) + 1e-12
        step = np.asarray(-np.linalg.solve(damped, slope), dtype=np.float64)
        step *= barrier.feasible_share(matrices, step[: k * size].reshape(matrices.shape))
        trial = field.stepped(step)
        wall = float(barrier.value(trial.matrices).sum())
        if np.isfinite(wall) and objective.representable(trial):
            evaluation = objective.evaluate(trial)
            gain = start - evaluation.cost - weight * wall
            predicted = -float(step @ slope) - 0.5 * float(step @ normal @ step)
            if gain > 0:
                state.evaluation = evaluation
                state.barrier_weight = max(weight * BARRIER_FALL, LAST_BARRIER)
                state.damping = float(
                    np.clip(state.damping * (0.3 if gain > 0.5 * predicted else 1.5), 1e-7, 1e3)
                )
                return True
        state.damping *= 5.0
    return False
