from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from skillctl.learning.barrier import StabilityBarrier
from skillctl.learning.em import constrained_em
from skillctl.learning.field import Field
from skillctl.learning.initialize import partitions
from skillctl.learning.levenberg import State, minimise
from skillctl.learning.objective import LearningObjective, Weights, _nearest_place, _weighted
from skillctl.learning.parameters import field_of, gate_mixture
from skillctl.learning.preprocess import TrainingData, align, training_data
from skillctl.model.coordinates.chain import Chain
from skillctl.model.coordinates.shears import Shears
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.mixture import GaussianMixture, quadratic_features, softmax

Curved = Callable[..., DemonstrationSet]
BARRIER = StabilityBarrier(np.eye(2), 0.03)


@pytest.fixture
def data(curved: Curved) -> TrainingData:
    return training_data(*align(curved()), samples=40)


@pytest.fixture
def initial(data: TrainingData) -> Field:
    labels = partitions(data, 3, 1, seed=0)[0]
    return field_of(constrained_em(labels, *data.points, BARRIER, iterations=5)[0])


@pytest.fixture(params=["plain", "bent"])
def either(data: TrainingData, request: pytest.FixtureRequest) -> TrainingData:
    """The data as they are, and in coordinates of two bent shears."""
    random = np.random.default_rng(3).standard_normal((2, 6, 2))
    shears = Shears(
        np.eye(2), np.array([[0.6, 0.8], [-0.8, 0.6]]), np.full(2, -2.5), np.ones(2), 0.2 * random
    )
    return data if request.param == "plain" else replace(data, coordinates=Chain((shears,)))


def times(factors: np.ndarray | None, errors: np.ndarray) -> np.ndarray:
    return errors if factors is None else np.einsum("nij,nj->ni", factors, errors)


def ridge_of(objective: LearningObjective) -> Callable[[Field], np.ndarray]:
    """Return the ridge as residuals."""
    return lambda field: np.sqrt(objective.ridge) * field.matrices.ravel()


def test_only_fits_by_rollouts_look_beyond_the_data_and_have_a_ridge(data: TrainingData) -> None:
    plain = LearningObjective(data, rollouts=False)
    assert plain.ridge == 0
    assert plain.moments.positions.shape[1] == len(data.points[0])


def test_the_nearest_place_is_the_nearest_of_a_fine_path() -> None:
    generator = np.random.default_rng(0)
    path = np.cumsum(generator.standard_normal((1, 12, 2)), axis=1)
    points = generator.standard_normal((1, 30, 2)) * 2
    phase = np.zeros((1, 12))
    index, share = _nearest_place(points, np.zeros((1, 30)), path, phase, 1.0)
    place = (1 - share[0])[:, None] * path[0, index[0]] + share[0][:, None] * path[0, index[0] + 1]
    found = np.linalg.norm(place - points[0], axis=1)

    vertices = np.linalg.norm(path[0][None] - points[0][:, None], axis=2)
    nearest = vertices.argmin(axis=1)
    for i in range(30):  # the documented rule: the better of the two segments beside the nearest vertex
        candidates = []
        for k in (nearest[i] - 1, nearest[i]):
            if 0 <= k < 11:
                fine = np.linspace(path[0, k], path[0, k + 1], 20001)
                candidates.append(np.linalg.norm(fine - points[0, i], axis=1).min())
        # A grid of 20,000 parts misses the foot of the perpendicular by at most half a part.
        assert found[i] == pytest.approx(min(candidates), abs=1e-6)


def test_errors_count_in_the_state(data: TrainingData, initial: Field) -> None:
    # Coordinates that stretch everything threefold: y errs three times as much as the state it stands for.
    threefold = Shears(3 * np.eye(2), np.eye(2), np.zeros(2), np.ones(2), np.zeros((2, 4, 2)))
    stretched = replace(data, coordinates=Chain((threefold,)))
    # Quadratic gates of y / 3 instead of y, and the same matrices: the same motion of the state.
    same = Field(initial.matrices, initial.logits / np.array([1, 3, 3, 9, 9, 9]))
    # Without copies beside the demonstrations, which are made in y; matching is done there, too.
    weights = Weights(displacement=0.0, distances=())
    objective = LearningObjective(data, weights)
    other = LearningObjective(stretched, replace(weights, phase=3.0))
    plain, found = objective.evaluate(initial), other.evaluate(same)
    weighed = objective.moments.weighed(plain.velocity_errors)
    moved = other.moments.weighed(found.velocity_errors)  # WᵀW e with W = 1/3 and e threefold
    np.testing.assert_allclose(3 * moved, weighed, rtol=1e-9, atol=1e-12)
    assert plain.matching is not None
    assert found.matching is not None
    np.testing.assert_allclose(found.matching.errors, plain.matching.errors, rtol=1e-9, atol=1e-12)
    assert found.cost == pytest.approx(plain.cost, rel=1e-9)


def test_the_gradient_of_the_cost_is_that_of_finite_differences_at_fixed_matching(
    either: TrainingData, initial: Field
) -> None:
    # A huge phase cost ties the matching to the share of the path, which moves little: then the
    # derivative through the matching is second order and the analytic gradient must be the true one.
    objective = LearningObjective(either, Weights(robust=0.5, ridge=0.01))
    evaluation = objective.evaluate(initial)
    assert evaluation.matching is not None
    ridge = ridge_of(objective)
    _, slope = objective.normal_equations(evaluation)
    matching = evaluation.matching

    def frozen_cost(field: Field) -> float:
        """The same matching, its weights w ρ'(r)/2r replaced by the robust cost of moved rollouts."""
        moved = objective.evaluate(field)
        assert moved.matching is not None
        table = moved.matching.states.transpose(0, 2, 1).reshape(-1, 2)
        before = matching.states.transpose(0, 2, 1).reshape(-1, 2)
        first, second = matching.rows
        share = matching.shares[:, None]
        shift = (1 - share) * (table[first] - before[first]) + share * (table[second] - before[second])
        errors = matching.errors + times(matching.factors, shift)
        squared = (matching.errors**2).sum(axis=1)
        weights = matching.scales**2 * np.sqrt(1 + squared / 0.25)  # undo ρ'(r)/2r = 1/√(1 + r²/δ²)
        rho = 0.25 * (np.sqrt(1 + (errors**2).sum(axis=1) / 0.25) - 1)
        errors = moved.velocity_errors
        quadratic = (errors * objective.moments.weighed(errors)).sum() + ridge(field) @ ridge(field)
        return float(0.5 * quadratic + weights @ rho)

    assert frozen_cost(initial) == pytest.approx(evaluation.cost, rel=1e-12)
    step = 1e-6
    for index in range(0, initial.n_parameters, 3):
        unit = np.zeros(initial.n_parameters)
        unit[index] = step
        numeric = (frozen_cost(initial.stepped(unit)) - frozen_cost(initial.stepped(-unit))) / (2 * step)
        assert slope[index] == pytest.approx(numeric, abs=1e-7)


def test_the_normal_matrix_is_that_of_finite_differences_at_fixed_matching(
    either: TrainingData, initial: Field, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("skillctl.learning.objective.NODES", 1000)  # rollouts count at every step
    objective = LearningObjective(either, Weights(ridge=3.0))  # as large as the other entries
    evaluation = objective.evaluate(initial)
    assert evaluation.matching is not None
    normal, _ = objective.normal_equations(evaluation)
    matching = evaluation.matching
    points = objective.moments.positions

    def outputs(field: Field) -> tuple[np.ndarray, np.ndarray]:
        moved = objective.evaluate(field).matching
        assert moved is not None
        return field.velocities(points).T, moved.states.transpose(0, 2, 1).reshape(-1, 2)

    step = 1e-6
    pairs = [
        (outputs(initial.stepped(unit)), outputs(initial.stepped(-unit)))
        for unit in step * np.eye(initial.n_parameters)
    ]
    velocities, table = (
        np.stack([(ahead[which] - behind[which]) / (2 * step) for ahead, behind in pairs], axis=2)
        for which in (0, 1)
    )
    weighed = np.stack(
        [objective.moments.weighed(column.T).T for column in velocities.transpose(2, 0, 1)], axis=2
    )
    expected = np.tensordot(velocities, weighed, ([0, 1], [0, 1]))
    matrices = np.arange(initial.matrices.size)
    expected[matrices, matrices] += 3.0
    for row, share in zip(matching.rows, (1 - matching.shares, matching.shares), strict=True):
        moved = table[row]
        if matching.factors is not None:
            moved = matching.factors @ moved
        moved = (np.sqrt(share) * matching.scales)[:, None, None] * moved
        expected += np.tensordot(moved, moved, ([0, 1], [0, 1]))
    # A central difference with step 1e-6 of a rollout is good to about seven digits of the largest entry.
    np.testing.assert_allclose(normal, expected, atol=1e-6 * np.abs(normal).max())


def test_states_between_two_nodes_count_at_both(data: TrainingData) -> None:
    weights = np.arange(1.0, 12.0)[:, None, None, None]  # of states 0 … 10, with nodes at 2, 6 and 10
    rows = _weighted(np.eye(3)[:, None, None], weights, every=4)
    # Node 6: itself, and of the states 3, 4, 5 and 7, 8, 9 a quarter, half, three quarters and back.
    middle = 7 + 4 * 0.25 + 5 * 0.5 + 6 * 0.75 + 8 * 0.75 + 9 * 0.5 + 10 * 0.25
    # The first node is four steps after the zeroth, which is two steps before the start.
    first = 3 + 2 * 0.75 + 1 * 0.5 + 4 * 0.75 + 5 * 0.5 + 6 * 0.25
    last = 11 + 8 * 0.25 + 9 * 0.5 + 10 * 0.75
    np.testing.assert_allclose(rows.T @ rows, np.diag([first, middle, last]), rtol=1e-12)


def test_a_field_whose_rollouts_explode_has_an_infinite_cost(data: TrainingData, initial: Field) -> None:
    # Heun's step multiplies by 1 − r + r²/2, here by 5e13, and does so 44 times.
    rate = 1e7 / data.steps.min()
    evaluation = LearningObjective(data).evaluate(
        Field(0 * initial.matrices - rate * np.eye(2), initial.logits)
    )
    assert (evaluation.cost, evaluation.matching) == (np.inf, None)


def test_every_step_lowers_the_cost_and_stays_strictly_stable(data: TrainingData, initial: Field) -> None:
    objective = LearningObjective(data)
    state = State(objective.evaluate(initial), BARRIER)
    costs = [state.cost]
    for _ in range(15):
        state, _ = minimise(objective, state, 1)
        costs.append(state.cost)
        assert np.linalg.eigvalsh(BARRIER.slack(state.evaluation.field.matrices)).min() > 0
    # Each step lowers cost + weight · barrier; while the weight falls the cost alone may rise by as much
    # as the barrier gains, at most 1e-3 · log of the change of slack: far below the total gain.
    assert costs[-1] < 0.7 * costs[0]
    assert np.diff(costs).max() < 0.02 * costs[0]


def test_a_field_that_made_the_data_is_found_again() -> None:
    truth = Field(
        np.array([[[-1.0, 2.0], [-2.0, -1.0]], [[-0.5, -0.3], [0.3, -1.5]]]),
        np.array([[0.0, 3.0, 0, 0, 0, 0], [0.0, -3.0, 0, 0, 0, 0]]),
    )
    starts = np.random.default_rng(0).uniform(-1.5, 1.5, (2, 8))
    points = np.random.default_rng(1).uniform(-1.5, 1.5, (1, 400, 2))
    data = TrainingData(
        points, truth.velocities(points[0].T).T[None], np.array([0.01]), 1.0, 1.0, np.zeros(2)
    )
    labels = (points[0, :, 0] < 0).astype(np.int64)
    initial = field_of(constrained_em(labels, *data.points, BARRIER, iterations=2)[0])
    objective = LearningObjective(data, rollouts=False)
    state, _ = minimise(objective, State(objective.evaluate(initial), BARRIER), 200, tolerance=1e-9)
    error = state.evaluation.field.velocities(starts) - truth.velocities(starts)
    # The barrier's final weight is 1e-6 against a mean squared error: velocities agree to about its root.
    assert np.abs(error).max() < 2e-2


def test_the_gauge_changes_no_weight() -> None:
    generator = np.random.default_rng(5)
    for d in (1, 2, 3):
        logits = 3 * generator.standard_normal((4, 1 + d + d * (d + 1) // 2))  # indefinite quadratics
        positions = generator.standard_normal((50, d))
        mixture = GaussianMixture(*gate_mixture(logits, positions))
        expected = softmax(logits @ quadratic_features(positions.T)).T
        np.testing.assert_allclose(mixture.responsibilities(positions), expected, atol=1e-10)
