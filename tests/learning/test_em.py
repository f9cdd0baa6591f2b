from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import scipy.stats

from skillctl.learning.barrier import StabilityBarrier
from skillctl.learning.em import (
    POSITION_FLOOR,
    TRACE,
    JointMixture,
    constrained_em,
    expectation,
    log_likelihood,
    log_normal,
    maximisation,
    position_em,
)
from skillctl.learning.initialize import kmeans, partitions
from skillctl.learning.outcome import Result
from skillctl.learning.preprocess import align, training_data
from skillctl.model.demonstration import DemonstrationSet

Curved = Callable[..., DemonstrationSet]


def test_log_normal_agrees_with_scipy() -> None:
    generator = np.random.default_rng(0)
    roots = generator.standard_normal((3, 2, 2))
    covariances = roots @ roots.swapaxes(1, 2) + 0.1 * np.eye(2)
    deviations = generator.standard_normal((5, 3, 2))
    ours = log_normal(deviations, covariances)
    for k in range(3):
        expected = scipy.stats.multivariate_normal(np.zeros(2), covariances[k]).logpdf(deviations[:, k])
        np.testing.assert_allclose(ours[:, k], expected, rtol=1e-12)


def test_the_likelihood_never_falls_and_every_matrix_is_stable(curved: Curved) -> None:
    data = training_data(*align(curved()), samples=50)
    barrier = StabilityBarrier(np.eye(2), 0.03)
    labels = np.random.default_rng(0).integers(0, 4, len(data.points[0]))  # a bad start: much to gain
    values = []
    for iterations in range(1, 12):
        mixture, _ = constrained_em(labels, *data.points, barrier, iterations=iterations, tolerance=-np.inf)
        values.append(log_likelihood(mixture, *data.points))
        assert np.linalg.eigvalsh(barrier.slack(mixture.matrices)).min() > 0
    # The M-step adds a variance floor of 1e-4 and a barrier of weight 1e-4, so exact ascent is lost by
    # as much at most; the whole gain is hundreds of times larger.
    assert np.diff(values).min() > -2e-3
    assert values[-1] > values[0] + 0.5


def test_a_noisy_linear_system_is_recovered() -> None:
    generator = np.random.default_rng(1)
    truth = np.array([[-1.0, 0.8], [-0.8, -0.6]])
    positions = generator.standard_normal((4000, 2))
    noise = 0.05
    velocities = positions @ truth.T + noise * generator.standard_normal((4000, 2))
    mixture, _ = constrained_em(
        np.zeros(4000, dtype=np.int64),
        positions,
        velocities,
        StabilityBarrier(np.eye(2), 0.03),
        iterations=20,
    )
    # Standard error of a regression coefficient: noise / √n; five of them.
    np.testing.assert_allclose(mixture.matrices[0], truth, atol=5 * noise / np.sqrt(4000) + 1e-3)
    np.testing.assert_allclose(
        mixture.residual_covariances[0], noise**2 * np.eye(2), atol=5 * noise**2 * np.sqrt(2 / 4000) + 2e-4
    )


def test_em_says_whether_it_converged(curved: Curved) -> None:
    data = training_data(*align(curved()), samples=50)
    barrier = StabilityBarrier(np.eye(2), 0.03)
    labels = np.random.default_rng(0).integers(0, 4, len(data.points[0]))
    _, short = constrained_em(labels, *data.points, barrier, iterations=3)
    assert (short.stage, short.result, short.steps) == ("mixture", Result.OUT_OF_STEPS, 3)
    reached, ended = constrained_em(labels, *data.points, barrier, iterations=500, tolerance=1e-4)
    assert ended.result is Result.CONVERGED
    assert 3 < ended.steps < 500
    before, _ = constrained_em(
        labels, *data.points, barrier, iterations=ended.steps - 1, tolerance=-np.inf
    )  # one iteration less
    assert log_likelihood(reached, *data.points) - log_likelihood(before, *data.points) < 1e-4


def test_the_density_of_positions_forgets_the_velocities() -> None:
    # Two clumps far apart, a third of the points in one: from a start whose means are both in between, with
    # velocities that say nothing, EM must find the priors, means and covariances of the clumps.
    generator = np.random.default_rng(4)
    clumps = [
        generator.standard_normal((50, 2)) - [6, 0],
        generator.standard_normal((100, 2)) @ [[2, 0.5], [0, 1]],
    ]
    clumps[1] += [6, 0]
    start = JointMixture(
        priors=np.array([0.5, 0.5]),
        means=np.array([[-1.0, 0], [1.0, 0]]),
        covariances=np.tile(9 * np.eye(2), (2, 1, 1)),
        matrices=np.tile(-np.eye(2), (2, 1, 1)),
        residual_covariances=np.tile(np.eye(2), (2, 1, 1)),
    )
    priors, means, covariances = position_em(start, *[np.vstack(clumps)] * 2, iterations=50)
    # Every component keeps TRACE / 2 of every point, up to 20 away from its own; the clumps are 12 apart, and
    # points at three of the wider one's standard deviations lie between them with shares of about 1e-4.
    np.testing.assert_allclose(priors, [1 / 3, 2 / 3], atol=1e-3)
    for k, clump in enumerate(clumps):
        np.testing.assert_allclose(means[k], clump.mean(axis=0), atol=0.02)
        expected = np.cov(clump.T, bias=True) + POSITION_FLOOR * np.eye(2)
        np.testing.assert_allclose(covariances[k], expected, atol=0.05)
    assert TRACE < 1e-4


def test_expectation_is_bayes_rule_far_from_all_components() -> None:
    logs = np.array([[-1e5, -1e5 - np.log(3)], [0.0, -np.inf]])
    # A share of 1e-6 of every point is spread over all components, by definition.
    np.testing.assert_allclose(expectation(logs), [[0.75, 0.25], [1.0, 0.0]], atol=1e-6)


def test_a_component_that_has_lost_its_points_does_no_harm() -> None:
    generator = np.random.default_rng(3)
    positions = generator.standard_normal((100, 2))
    velocities = -positions
    logs = np.stack([np.zeros(100), np.full(100, -1e4)], axis=1)
    barrier = StabilityBarrier(np.eye(2), 0.03)
    mixture = maximisation(expectation(logs), positions, velocities, barrier)
    mixture = maximisation(expectation(logs), positions, velocities, barrier, mixture)
    # The gram matrix of 100 unit points carries a floor of 1e-4, and the barrier a weight of 1e-4.
    np.testing.assert_allclose(mixture.matrices, np.tile(-np.eye(2), (2, 1, 1)), atol=1e-3)


def test_kmeans_finds_separated_clusters() -> None:
    generator = np.random.default_rng(2)
    centres = np.array([[0.0, 0], [10, 0], [0, 10]])
    points = np.repeat(centres, 30, axis=0) + 0.1 * generator.standard_normal((90, 2))
    labels = kmeans(points, 3, np.random.default_rng(0)).reshape(3, 30)
    assert (labels == labels[:, :1]).all()
    assert len(set(labels[:, 0])) == 3


@pytest.mark.parametrize("count", [1, 2, 5])
def test_every_partition_uses_every_label(curved: Curved, count: int) -> None:
    data = training_data(*align(curved()), samples=50)
    for labels in partitions(data, 6, count, seed=0):
        assert labels.shape == (4 * 50,)
        assert sorted(set(labels.tolist())) == list(range(6))
