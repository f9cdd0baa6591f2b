"""The optimiser: its rules on problems whose answer is known, its optimum against a convex solver."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import cvxpy
import numpy as np
import pytest

from skillctl.learning.barrier import StabilityBarrier
from skillctl.learning.field import Field
from skillctl.learning.levenberg import (
    BARRIER_FALL,
    EASED,
    FIRST_BARRIER,
    FIRST_DAMPING,
    LAST_BARRIER,
    LEAST_DAMPING,
    REFUSED,
    TIGHTENED,
    TRIALS,
    State,
    minimise,
)
from skillctl.learning.objective import Evaluation, LearningObjective
from skillctl.learning.outcome import Result
from skillctl.learning.preprocess import TrainingData

CENTRE = -np.eye(2)
WIDE = StabilityBarrier(np.eye(2), 0.0)


@dataclass
class Quadratic:
    """least + ½ ‖A − target‖² for one component, whose curvature is reported wrong by a factor."""

    target: np.ndarray
    reported: float = 1.0
    least: float = 0.0
    representable_after: int = 0
    trials: int = 0

    def representable(self, field: Field) -> bool:
        self.trials += 1
        return self.trials > self.representable_after

    def evaluate(self, field: Field) -> Evaluation:
        residuals = (field.matrices - self.target).ravel()
        return Evaluation(field, self.least + 0.5 * float(residuals @ residuals), residuals, None)

    def normal_equations(self, evaluation: Evaluation) -> tuple[np.ndarray, np.ndarray]:
        normal = np.eye(evaluation.field.n_parameters) * self.reported
        return normal, np.append(evaluation.velocity_errors, np.zeros(evaluation.field.logits.size))


def at(objective: Quadratic, matrix: np.ndarray, barrier: StabilityBarrier = WIDE) -> State:
    return State(objective.evaluate(Field(matrix[None], np.zeros((1, 6)))), barrier)


def run(objective: Quadratic, state: State, steps: int, **options: float) -> tuple[State, Result, int]:
    state, outcome = minimise(objective, state, steps, **options)
    return state, outcome.result, outcome.steps


def test_a_step_that_gains_what_was_promised_eases_the_damping() -> None:
    objective = Quadratic(3 * CENTRE)
    state, _, steps = run(objective, at(objective, CENTRE), 3)
    assert steps == 3
    assert state.damping == pytest.approx(FIRST_DAMPING * EASED**3, rel=1e-12)


def test_a_step_that_gains_less_than_half_of_what_was_promised_tightens_the_damping() -> None:
    # With a curvature reported c times too small the step is 1/c of the way, and gains 2/c − 1/c² where 1/c
    # is promised (in units of the whole gain): for c = 0.6 that is 0.56 of 1.67.
    objective = Quadratic(3 * CENTRE, reported=0.6)
    state, _, _ = run(objective, at(objective, CENTRE), 1)
    assert state.damping == pytest.approx(FIRST_DAMPING * TIGHTENED, rel=1e-12)


def test_the_damping_has_a_floor() -> None:
    objective = Quadratic(3 * CENTRE)
    state = at(objective, CENTRE)
    state.damping = 2 * LEAST_DAMPING
    assert run(objective, state, 1)[0].damping == LEAST_DAMPING


@pytest.mark.parametrize("refused", [1, 4])
def test_every_refused_trial_raises_the_damping(refused: int) -> None:
    objective = Quadratic(3 * CENTRE, representable_after=refused)
    state, _, _ = run(objective, at(objective, CENTRE), 1)
    assert objective.trials == refused + 1
    assert state.damping == pytest.approx(FIRST_DAMPING * REFUSED**refused * EASED, rel=1e-12)


def test_the_damping_shortens_the_step_as_marquardts_formula_says() -> None:
    objective = Quadratic(3 * CENTRE)
    start = at(objective, CENTRE)
    start.damping, start.barrier_weight = 1.0, 0.0
    state, _, _ = run(objective, start, 1)
    # The curvature is the identity, and the damping adds λ(1 + 10⁻³) to it: the rest of the way is the gap
    # times 1 − 1/(1 + λ(1 + 10⁻³)).
    left = 1 - 1 / (1 + 1.001 + 1e-12)
    np.testing.assert_allclose(state.evaluation.field.matrices[0], CENTRE * (3 - 2 * left), rtol=1e-12)


def test_the_weight_of_the_barrier_falls_with_every_step_to_its_last() -> None:
    objective = Quadratic(3 * CENTRE)
    state = at(objective, CENTRE)
    for steps in range(1, 10):
        run(objective, state, 1)
        assert state.barrier_weight == pytest.approx(max(FIRST_BARRIER * BARRIER_FALL**steps, LAST_BARRIER))
    assert state.barrier_weight == LAST_BARRIER  # 10⁻³ · 0.7⁷ is below 10⁻⁴


def test_an_optimiser_at_the_optimum_has_converged() -> None:
    objective = Quadratic(3 * CENTRE, least=1.0)
    state = at(objective, CENTRE)
    costs = [state.cost]
    _, outcome = minimise(
        objective,
        state,
        50,
        on_step=lambda _, cost: costs.append(cost),
        tolerance=1e-2,
    )
    assert (outcome.result, outcome.steps) == (Result.CONVERGED, len(costs) - 1)
    small = [before - after < 1e-2 * before for before, after in pairwise(costs)]
    assert small == [False] * (len(small) - 3) + [True] * 3
    assert 3 < len(small) < 50


def test_an_optimiser_out_of_steps_says_so_and_what_it_gained_last() -> None:
    objective = Quadratic(3 * CENTRE)
    state = at(objective, CENTRE)
    state.damping = 100.0
    costs = [state.cost]
    _, outcome = minimise(objective, state, 5, on_step=lambda _, cost: costs.append(cost))
    assert (outcome.result, outcome.steps, outcome.stage) == (Result.OUT_OF_STEPS, 5, "polish")
    assert outcome.late_gain == (costs[2] - costs[5]) / costs[2]


def test_an_optimiser_that_finds_no_better_step_says_so() -> None:
    objective = Quadratic(3 * CENTRE, representable_after=10**6)
    state, result, steps = run(objective, at(objective, CENTRE), 5)
    assert (result, steps, objective.trials) == (Result.NO_BETTER_STEP, 0, TRIALS)
    np.testing.assert_array_equal(state.evaluation.field.matrices[0], CENTRE)


def test_one_component_reaches_the_optimum_of_a_convex_solver() -> None:
    generator = np.random.default_rng(0)
    lyapunov = np.array([[1.4, 0.3], [0.3, 0.6]])
    barrier = StabilityBarrier(lyapunov, 0.05)
    positions = generator.standard_normal((80, 2))
    truth = np.array([[0.5, 1.0], [-1.0, -0.4]])  # unstable: the barrier acts
    velocities = positions @ truth.T
    data = TrainingData(positions[None], velocities[None], np.array([0.01]), 1.0, 1.0, np.zeros(2))
    objective = LearningObjective(data, rollouts=False)
    state = State(objective.evaluate(Field(CENTRE[None], np.zeros((1, 6)))), barrier)
    state, _ = minimise(objective, state, 200, tolerance=0.0)
    assert state.barrier_weight == LAST_BARRIER

    unknown = cvxpy.Variable((2, 2))
    product = lyapunov @ unknown
    slack = -(product + product.T) / 2 - 0.05 * lyapunov
    error = cvxpy.sum_squares(positions @ unknown.T - velocities) / (2 * len(positions))
    cvxpy.Problem(cvxpy.Minimize(error - LAST_BARRIER * cvxpy.log_det(slack))).solve(solver=cvxpy.CLARABEL)
    # The solver stops at a gap of about 1e-8; the problem is strongly convex with a Gram matrix near one.
    np.testing.assert_allclose(state.evaluation.field.matrices[0], unknown.value, atol=2 * np.sqrt(2e-8))
