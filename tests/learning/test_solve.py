from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from skillctl.learning import solve as solve_module
from skillctl.learning.em import log_likelihood
from skillctl.learning.objective import LearningObjective
from skillctl.learning.options import EFFORTS, LearnOptions, Objective
from skillctl.learning.preprocess import align, training_data
from skillctl.learning.solve import (
    COARSE_AND_FINE,
    initial_mixtures,
    optimise,
    solve,
    stability_barrier,
)
from skillctl.model.demonstration import DemonstrationSet

Curved = Callable[..., DemonstrationSet]


def test_a_fit_that_exploits_its_own_step_size_is_polished_finer(curved: Curved) -> None:
    # So few samples that Heun's step is a fifth of the motion: coarse and fine rollouts disagree.
    data = training_data(*align(curved(count=6)), samples=6)
    options = LearnOptions(preset="fast", period=0.0)
    barrier = stability_barrier(data, np.eye(2), options)
    mixtures = [start[0] for start in initial_mixtures(data, barrier, 3, options, lambda *_: None)]
    seen: list[str] = []
    state, _, results = optimise(data, barrier, mixtures, options, lambda stage, *_: seen.append(stage))
    assert [result.stage for result in results] == ["polish", "refine"]
    assert "refine" in seen

    coarse, fine = LearningObjective(data), LearningObjective(data, substeps=4)
    unchecked, _ = optimise_without_check(data, barrier, mixtures, options)
    assert fine.evaluate(unchecked).cost > COARSE_AND_FINE * coarse.evaluate(unchecked).cost
    assert fine.evaluate(state.evaluation.field).cost <= fine.evaluate(unchecked).cost


def optimise_without_check(data, barrier, mixtures, options):
    """The same probes and polish, written out without the check."""
    from skillctl.learning.levenberg import State, minimise
    from skillctl.learning.parameters import field_of

    objective, effort = LearningObjective(data), EFFORTS[options.preset]
    state, _ = minimise(
        objective, State(objective.evaluate(field_of(mixtures[0])), barrier), effort.probe_steps
    )
    state, _ = minimise(objective, state, effort.polish_steps)
    return state.evaluation.field, state


@pytest.mark.parametrize("objective", ["reproduction", "mse", "likelihood"])
@pytest.mark.parametrize("good", [0, 1, 2])
def test_the_start_with_the_best_motion_goes_on(
    curved: Curved, monkeypatch: pytest.MonkeyPatch, objective: Objective, good: int
) -> None:
    data = training_data(*align(curved(count=6)), samples=40)
    options = LearnOptions(objective=objective, preset="fast")
    barrier = stability_barrier(data, np.eye(2), options)
    ((mixture, ended), *_) = initial_mixtures(data, barrier, 3, options, lambda *_: None)
    # Components that all do the same have no gates to gain from: they cannot bow as the motion does.
    straight = replace(mixture, matrices=np.tile(-np.eye(2), (3, 1, 1)), means=np.zeros((3, 2)))
    starts = [(mixture if index == good else straight, ended) for index in range(3)]
    monkeypatch.setattr(solve_module, "initial_mixtures", lambda *_: starts)
    monkeypatch.setitem(EFFORTS, "fast", replace(EFFORTS["fast"], probe_steps=0))

    solution = solve(data, np.eye(2), 3, options, lambda *_: None)
    assert solution.log_likelihood == log_likelihood(mixture, *data.points)
    assert [result.stage for result in solution.results] == (
        ["mixture"] if objective == "likelihood" else ["polish"]
    )


def test_a_period_that_is_long_for_the_data_leaves_room_for_the_fallback(curved: Curved) -> None:
    data = training_data(*align(curved()), samples=40)
    for period in (0.0, 0.01, 100.0):
        barrier = stability_barrier(data, np.eye(2), LearnOptions(period=period, slowest_rate=0.5))
        assert barrier.period == pytest.approx(min(period / data.time_scale, 0.5))
        assert np.isfinite(barrier.value(-np.eye(2)))


def test_a_fit_with_fine_steps_is_left_alone(curved: Curved) -> None:
    data = training_data(*align(curved(count=6)), samples=40)
    options = LearnOptions(preset="fast")
    barrier = stability_barrier(data, np.eye(2), options)
    seen: list[str] = []
    mixtures = [start[0] for start in initial_mixtures(data, barrier, 3, options, lambda *_: None)]
    optimise(data, barrier, mixtures, options, lambda stage, *_: seen.append(stage))
    assert "refine" not in seen
