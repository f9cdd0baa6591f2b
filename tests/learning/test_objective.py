from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from skillctl.learning.augmentation import distant_samples
from skillctl.learning.barrier import StabilityBarrier
from skillctl.learning.em import constrained_em
from skillctl.learning.field import Field
from skillctl.learning.initialize import partitions
from skillctl.learning.levenberg import State, minimise
from skillctl.learning.objective import LearningObjective, Weights, _nearest_place
from skillctl.learning.parameters import field_of, gate_mixture
from skillctl.learning.preprocess import TrainingData, align, training_data
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


@pytest.fixture(params=["plain", "weighted"])
def either(data: TrainingData, request: pytest.FixtureRequest) -> TrainingData:
    """The data as they are, and with a random W for every sample."""
    random = np.random.default_rng(3).standard_normal((*data.positions.shape, 2))
    return data if request.param == "plain" else replace(data, weights=np.eye(2) + 0.4 * random)


def times(factors: np.ndarray | None, errors: np.ndarray) -> np.ndarray:
    return errors if factors is None else np.einsum("nij,nj->ni", factors, errors)


def ridge_of(objective: LearningObjective) -> Callable[[Field], np.ndarray]:
    """Return the ridge as residuals."""
    return lambda field: np.sqrt(objective.ridge) * field.matrices.ravel()


def test_only_fits_by_rollouts_look_beyond_the_data_and_have_a_ridge(data: TrainingData) -> None:
    plain = LearningObjective(data, rollouts=False)
    assert plain.ridge == 0
    assert plain.positions.shape[1] == len(data.points[0])


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


def test_an_error_counts_in_the_metric_of_the_sample_it_belongs_to(
    data: TrainingData, initial: Field
) -> None:
    trajectories, samples, d = data.positions.shape
    sizes = 1.0 + np.arange(trajectories * samples)  # tell all samples apart
    swap = np.eye(2)[::-1]
    weights = (sizes[:, None, None] * swap).reshape(trajectories, samples, d, d)
    objective = LearningObjective(replace(data, weights=weights))
    expected, found = LearningObjective(data).evaluate(initial), objective.evaluate(initial)

    count = objective.positions.shape[1]
    sources = np.append(np.arange(len(sizes)), distant_samples(data, Weights().distances)[2])
    velocity = sizes[sources, None] * expected.residuals[: d * count].reshape(-1, d)[:, ::-1]
    np.testing.assert_allclose(found.residuals[: d * count].reshape(-1, d), velocity, rtol=1e-12)

    assert expected.matching is not None
    assert found.matching is not None
    errors = [each.matching.errors.reshape(3 * trajectories, -1, d) for each in (expected, found)]
    ratio = errors[1] / np.where(errors[0] == 0, np.nan, errors[0])[..., ::-1]
    own = np.tile(sizes.reshape(trajectories, samples), (3, 1))
    points = ~np.isnan(ratio[:, :samples, 0])  # a rollout starts where its demonstration does
    np.testing.assert_allclose(ratio[:, :samples, 0][points], own[points], rtol=1e-9)
    # A state of a rollout counts as the nearer end of the segment that it is compared with.
    paths, states = objective.paths, expected.matching.states.transpose(2, 0, 1)
    for path, rolled, ratios, scales in zip(paths, states, ratio[:, samples:, 0], own, strict=True):
        nearest = np.linalg.norm(rolled[:, None] - path, axis=2).argmin(axis=1)
        known = ~np.isnan(ratios)
        assert np.abs(ratios - scales[nearest])[known].max() < 1.5  # phase moves it by one sample at most


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
        velocity = moved.residuals[: 2 * objective.positions.shape[1]]
        return float(0.5 * (velocity @ velocity + ridge(field) @ ridge(field)) + weights @ rho)

    assert frozen_cost(initial) == pytest.approx(evaluation.cost, rel=1e-12)
    step = 1e-6
    for index in range(0, initial.n_parameters, 3):
        unit = np.zeros(initial.n_parameters)
        unit[index] = step
        numeric = (frozen_cost(initial.stepped(unit)) - frozen_cost(initial.stepped(-unit))) / (2 * step)
        assert slope[index] == pytest.approx(numeric, abs=1e-7)


def test_the_normal_matrix_is_that_of_finite_differences_at_fixed_matching(
    either: TrainingData, initial: Field
) -> None:
    objective = LearningObjective(either, Weights(ridge=3.0))  # as large as the other entries
    ridge = ridge_of(objective)
    evaluation = objective.evaluate(initial)
    assert evaluation.matching is not None
    normal, _ = objective.normal_equations(evaluation)
    matching = evaluation.matching
    first, second = matching.rows

    def residuals(field: Field) -> np.ndarray:
        moved = objective.evaluate(field)
        assert moved.matching is not None
        table = moved.matching.states.transpose(0, 2, 1).reshape(-1, 2)
        share = matching.shares[:, None]
        places = times(matching.factors, (1 - share) * table[first] + share * table[second])
        velocity = moved.residuals[: 2 * objective.positions.shape[1]]
        return np.concatenate([velocity, (matching.scales[:, None] * places).ravel(), ridge(field)])

    step = 1e-6
    columns = []
    for unit in step * np.eye(initial.n_parameters):
        columns.append((residuals(initial.stepped(unit)) - residuals(initial.stepped(-unit))) / (2 * step))
    jacobian = np.stack(columns, axis=1)
    # A central difference with step 1e-6 of a rollout is good to about seven digits of the largest entry.
    np.testing.assert_allclose(normal, jacobian.T @ jacobian, atol=1e-6 * np.abs(normal).max())


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
