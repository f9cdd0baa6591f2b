from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skillctl.learning.objective import LearningObjective
from skillctl.learning.options import EFFORTS, LearnOptions
from skillctl.learning.preprocess import align, training_data
from skillctl.learning.solve import COARSE_AND_FINE, Progress, initial_mixtures, optimise, stability_barrier
from skillctl.model.demonstration import DemonstrationSet

Curved = Callable[..., DemonstrationSet]


def test_a_fit_that_exploits_its_own_step_size_is_polished_finer(curved: Curved) -> None:
    # So few samples that Heun's step is a fifth of the motion: coarse and fine rollouts disagree.
    data = training_data(*align(curved(count=6)), samples=6)
    options = LearnOptions(preset="fast", period=0.0)
    barrier = stability_barrier(data, np.eye(2), options)
    mixtures = initial_mixtures(data, barrier, 3, options, lambda _: None)
    seen: list[Progress] = []
    state, _ = optimise(data, barrier, mixtures, options, seen.append)
    assert "refine" in {p.stage for p in seen}

    coarse, fine = LearningObjective(data), LearningObjective(data, substeps=4)
    unchecked, _ = optimise_without_check(data, barrier, mixtures, options)
    assert fine.evaluate(unchecked).cost > COARSE_AND_FINE * coarse.evaluate(unchecked).cost
    assert fine.evaluate(state.evaluation.field).cost <= fine.evaluate(unchecked).cost


def optimise_without_check(data, barrier, mixtures, options):  # type: ignore[no-untyped-def]
    """The same probes and polish, written out without the check."""
    from skillctl.learning.levenberg import State, minimise
    from skillctl.learning.parameters import field_of

    objective, effort = LearningObjective(data), EFFORTS[options.preset]
    state = minimise(objective, State(objective.evaluate(field_of(mixtures[0])), barrier), effort.probe_steps)
    state = minimise(objective, state, effort.polish_steps)
    return state.evaluation.field, state


def test_a_fit_with_fine_steps_is_left_alone(curved: Curved) -> None:
    data = training_data(*align(curved(count=6)), samples=40)
    options = LearnOptions(preset="fast")
    barrier = stability_barrier(data, np.eye(2), options)
    seen: list[Progress] = []
    optimise(data, barrier, initial_mixtures(data, barrier, 3, options, lambda _: None), options, seen.append)
    assert "refine" not in {p.stage for p in seen}
