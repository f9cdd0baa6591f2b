"""Interior-point Levenberg–Marquardt: least squares over stable fields only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.learning.barrier import StabilityBarrier
from skillctl.learning.objective import Evaluation, LearningObjective
from skillctl.learning.outcome import Result, StageResult

# All tuned on the 30 LASA motions.
FIRST_BARRIER, LAST_BARRIER, BARRIER_FALL = 1e-3, 1e-4, 0.7  # weight of the barrier, and its fall a step
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-7, 1e3
TRUSTED, EASED, TIGHTENED, REFUSED = 0.5, 0.3, 1.5, 5.0  # see ``_step``
TRIALS = 12  # dampings tried in one step
PATIENCE = 3  # steps in a row that gain little before the optimiser stops


@dataclass(eq=False, slots=True)
class State:
    """The state of the optimiser, with which a probe can be continued."""

    evaluation: Evaluation
    barrier: StabilityBarrier
    barrier_weight: float = FIRST_BARRIER
    damping: float = FIRST_DAMPING

    @property
    def cost(self) -> float:
        """The data's part of the objective, without the barrier."""
        return self.evaluation.cost


def minimise(
    objective: LearningObjective,
    state: State,
    steps: int,
    *,
    stage: str = "polish",
    on_step: Callable[[int, float], None] | None = None,
    tolerance: float = 1e-4,
) -> tuple[State, StageResult]:
    """Take up to ``steps`` Levenberg–Marquardt steps on cost + weight · barrier; every iterate is stable.

    Args:
        objective: Residuals and Jacobian.
        state: A strictly stable field to start from, which is moved; the barrier's weight falls with every
            accepted step.
        steps: Number of linearisations.
        stage: What the result calls this.
        on_step: Called with the step number and the cost.
        tolerance: Stop after three steps in a row that gain less than this share of the cost.

    Returns:
        The same state, moved, and how the optimiser ended.
    """
    costs = [state.cost]
    small_gains, result = 0, Result.OUT_OF_STEPS
    for step in range(steps):
        if not _step(objective, state):
            result = Result.NO_BETTER_STEP
            break
        costs.append(state.cost)
        if on_step is not None:
            on_step(step + 1, state.cost)
        small_gains = small_gains + 1 if costs[-2] - costs[-1] < tolerance * costs[-2] else 0
        if small_gains == PATIENCE:
            result = Result.CONVERGED
            break
    before = costs[-1 - PATIENCE :][0]
    return state, StageResult(stage, result, len(costs) - 1, (before - costs[-1]) / before if before else 0.0)


def _step(objective: LearningObjective, state: State) -> bool:
    """Replace the state by a better one; False where no damping gives one.

    If a step gains more than half of what the linearisation predicts, the damping falls for the next; if it
    gains less, the damping grows. A step that gains nothing, or leads to gates that cannot be represented, is
    refused, and a shorter one is tried with more damping.
    """
    field, barrier, weight = state.evaluation.field, state.barrier, state.barrier_weight
    normal, slope = _equations(objective, state)
    diagonal = normal.diagonal().copy()
    start = state.evaluation.cost + weight * float(barrier.value(field.matrices).sum())
    for _ in range(TRIALS):
        # Marquardt's scaling by the diagonal makes the step independent of the parameters' units; the share
        # of its mean keeps directions damped that the data do not determine.
        damped = normal.copy()
        damped[np.diag_indices_from(damped)] += state.damping * (diagonal + 1e-3 * diagonal.mean()) + 1e-12
        step = np.asarray(-np.linalg.solve(damped, slope), dtype=np.float64)
        step *= barrier.feasible_share(field.matrices, field.split(step)[0])
        trial = field.stepped(step)
        wall = float(barrier.value(trial.matrices).sum())
        if np.isfinite(wall) and objective.representable(trial):
            evaluation = objective.evaluate(trial)
            gain = start - evaluation.cost - weight * wall
            promised = -float(step @ slope) - 0.5 * float(step @ normal @ step)
            if gain > 0:
                factor = EASED if gain > TRUSTED * promised else TIGHTENED
                state.evaluation = evaluation
                state.barrier_weight = max(weight * BARRIER_FALL, LAST_BARRIER)
                state.damping = float(np.clip(state.damping * factor, LEAST_DAMPING, MOST_DAMPING))
                return True
        state.damping *= REFUSED
    return False


def _equations(objective: LearningObjective, state: State) -> tuple[FloatArray, FloatArray]:
    """Return the Gauss–Newton matrix (p, p) and the gradient (p,) of cost + weight · barrier.

    The barrier's own Hessian is exact, and block diagonal: each S_k depends on one A_k only.
    """
    matrices = state.evaluation.field.matrices
    normal, slope = objective.normal_equations(state.evaluation)
    barrier_slope, barrier_hessian = state.barrier.derivatives(matrices)
    k, size = barrier_slope.shape
    slope[: k * size] += state.barrier_weight * barrier_slope.ravel()
    for index in range(k):
        block = slice(index * size, (index + 1) * size)
        normal[block, block] += state.barrier_weight * barrier_hessian[index]
    return normal, slope
