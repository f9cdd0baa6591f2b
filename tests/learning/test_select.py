"""The number of components: the rule on scores made up by hand, the scores against formulas written out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

from skillctl.learning import select
from skillctl.learning.em import JointMixture
from skillctl.learning.objective import LearningObjective
from skillctl.learning.options import LearnOptions
from skillctl.learning.preprocess import TrainingData, align, training_data
from skillctl.learning.select import CANDIDATES, component_limit, select_components
from skillctl.learning.solve import initial_mixtures, solve, stability_barrier
from skillctl.model.demonstration import DemonstrationSet

Curved = Callable[..., DemonstrationSet]
FAST = LearnOptions(preset="fast")


def selected(data: TrainingData, limit: int = 10) -> int:
    return select_components(data, np.eye(data.dimension), FAST, limit, lambda *_: None)


def scored(monkeypatch: pytest.MonkeyPatch, name: str, scores: dict[int, float]) -> None:
    monkeypatch.setattr(select, name, lambda data, lyapunov, k, options: scores.get(k, 9.0))


@pytest.mark.parametrize(
    ("scores", "limit", "answer"),
    [
        ({4: 1.0}, 10, 4),
        ({3: 1.04, 4: 1.0}, 10, 3),  # within a tie of 5 %: the smaller
        ({3: 1.06, 4: 1.0}, 10, 4),
        ({1: 1.0, 8: 0.5}, 7, 1),  # 8 is more than the data carry
        ({10: 1.0}, 10, 10),
    ],
)
def test_the_fewest_components_with_nearly_the_least_error_are_selected(
    curved: Curved, monkeypatch: pytest.MonkeyPatch, scores: dict[int, float], limit: int, answer: int
) -> None:
    scored(monkeypatch, "_left_out_error", scores)
    assert selected(training_data(*align(curved(count=2)), samples=20), limit) == answer


def test_for_one_demonstration_the_least_criterion_is_selected(
    curved: Curved, monkeypatch: pytest.MonkeyPatch
) -> None:
    scored(monkeypatch, "_bic", {3: -99.0, 4: -100.0, 5: -50.0})  # a criterion in nats: no ties in per cent
    assert selected(training_data(*align(curved(count=1)), samples=20)) == 4


def linear_motion(noise: float, steps: int = 150) -> TrainingData:
    """One motion of ẋ = A x from (1, 1), its velocities with noise."""
    matrix = np.array([[-1.0, 0.6], [-0.6, -1.0]])
    positions = [np.ones(2)]
    for _ in range(steps - 1):
        positions.append(positions[-1] + 0.03 * matrix @ positions[-1])
    x = np.array(positions)
    v = x @ matrix.T + noise * np.random.default_rng(0).standard_normal(x.shape)
    return TrainingData(x[None], v[None], np.array([0.03]), 1.0, 1.0, np.zeros(2))


def test_one_linear_motion_needs_fewer_components_than_a_curved_one(curved: Curved) -> None:
    # By BIC some components describe where a motion has been, too: more than one, for a path is no blob.
    linear = selected(linear_motion(noise=0.1))
    bent = selected(training_data(*align(curved(count=1)), samples=150))
    assert linear < bent


def test_the_criterion_is_that_of_schwarz(curved: Curved) -> None:
    data = linear_motion(noise=0.1)
    for k in (1, 3):
        barrier = stability_barrier(data, np.eye(2), FAST)
        mixture: JointMixture = initial_mixtures(data, barrier, k, FAST, lambda *_: None)[0][0]
        x, v = data.points
        densities = sum(
            mixture.priors[i]
            * scipy.stats.multivariate_normal(mixture.means[i], mixture.covariances[i]).pdf(x)
            * np.array(
                [
                    scipy.stats.multivariate_normal(
                        mixture.matrices[i] @ a, mixture.residual_covariances[i]
                    ).pdf(b)
                    for a, b in zip(x, v, strict=True)
                ]
            )
            for i in range(k)
        )
        # Free in two dimensions: k − 1 priors, and of each component 2 means, 2 · 3 covariances, 4 of A.
        expected = (k - 1 + 12 * k) * np.log(150) - 2 * np.log(densities).sum()
        assert select._bic(data, np.eye(2), k, FAST) == pytest.approx(expected, rel=1e-9)


def test_the_error_is_that_on_demonstrations_that_were_left_out(curved: Curved) -> None:
    data = training_data(*align(curved(count=6)), samples=20)
    errors = []
    for out in ([0, 4], [1, 5], [2], [3]):  # each in turn, in four folds
        kept = [i for i in range(6) if i not in out]
        learned = solve(part(data, kept), np.eye(2), 2, FAST, lambda *_: None)
        errors.append(LearningObjective(part(data, out)).evaluate(learned.field).cost)
    assert select._left_out_error(data, np.eye(2), 2, FAST) == pytest.approx(np.mean(errors), rel=1e-12)


def part(data: TrainingData, rows: list[int]) -> TrainingData:
    return replace(
        data, positions=data.positions[rows], velocities=data.velocities[rows], steps=data.steps[rows]
    )


def test_the_data_carry_one_component_per_five_points_and_dimension(curved: Curved) -> None:
    assert component_limit(curved(count=1, samples=50)) == 5
    assert component_limit(curved(count=3, samples=1000)) == 60  # 200 points of each count
    assert component_limit(curved(count=1, samples=3)) == 1
    assert max(CANDIDATES) == 10
