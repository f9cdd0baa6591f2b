"""The search itself: several starts, short probes, one polish, and a check of the step size."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from skillctl.arrays import FloatArray, IntArray
from skillctl.errors import FitError, InputDataError
from skillctl.learning.barrier import StabilityBarrier
from skillctl.learning.em import POSITION_FLOOR, JointMixture, constrained_em, log_likelihood, position_em
from skillctl.learning.field import Field
from skillctl.learning.initialize import partitions
from skillctl.learning.levenberg import State, minimise
from skillctl.learning.objective import LearningObjective
from skillctl.learning.options import Effort, LearnOptions
from skillctl.learning.outcome import StageResult
from skillctl.learning.parameters import field_of
from skillctl.learning.preprocess import TrainingData
from skillctl.progress import Progress

# Both tuned on the 30 LASA motions.
BROAD_START = 1e-3  # least variance of gates that the optimiser starts from: narrow ones have no slope
COARSE_AND_FINE = 1.15  # a fit whose cost grows by more under fine integration is refined
EM_STEPS, FIRST_EM_STEPS = 200, 10  # of EM where it is the whole fit, and where the optimiser goes on from it


@dataclass(frozen=True, eq=False, slots=True)
class Solution:
    """A stable field in the learner's units.

    Attributes:
        field: A_k and gate logits.
        density: Priors (K,), means (K, d) and covariances (K, d, d) of the position density.
        objective: Final value of the objective.
        log_likelihood: Mean log p(ξ, ξ̇) of the constrained mixture the field came from.
        results: How the stages that led to the field ended, in their order; probes of starts are not among
            them, as they are cut short on purpose.
    """

    field: Field
    density: tuple[FloatArray, FloatArray, FloatArray]
    objective: float
    log_likelihood: float
    results: tuple[StageResult, ...]


def solve(
    data: TrainingData,
    lyapunov: FloatArray,
    n_components: int,
    options: LearnOptions,
    progress: Progress,
) -> Solution:
    """Return the best stable field with ``n_components`` components for this P (d, d).

    With every objective, starts are compared by their rollouts: the start with the lowest velocity error
    seldom gives the best motion.

    Raises:
        InputDataError: Fewer distinct points than components.
        FitError: The search broke down.
    """
    _keep_freed_memory()
    try:
        return _solve(data, lyapunov, n_components, options, progress)
    except np.linalg.LinAlgError as error:
        raise FitError(
            f"no skill could be fitted: a matrix became singular ({error}).",
            hint="Look for demonstrations that differ from the others, or use fewer --components.",
        ) from error


def _keep_freed_memory() -> None:
    """Make the C library keep memory that is freed, for the next array of that size.

    Every iteration makes arrays of some hundred kilobytes. GNU's malloc gives such memory back to the system
    as soon as it is free, and getting it anew, page by page, takes a fourth of learning. Once a block of
    nearly 32 MB (never touched, so that it costs nothing) has been freed, it keeps up to twice as much.
    """
    np.empty(2**25 - 2**16, dtype=np.uint8)


def _solve(
    data: TrainingData,
    lyapunov: FloatArray,
    n_components: int,
    options: LearnOptions,
    progress: Progress,
) -> Solution:
    barrier = stability_barrier(data, lyapunov, options)
    starts = initial_mixtures(data, barrier, n_components, options, progress)
    if options.objective == "likelihood":
        ranking = LearningObjective(data)
        best, ended = min(starts, key=lambda start: ranking.evaluate(field_of(start[0], data.blocks)).cost)
        likelihood = log_likelihood(best, *data.points)
        density = best.priors, best.means, best.covariances
        if data.coordinates.links:
            density = position_em(best, data.points[0], data.states)
        return Solution(field_of(best, data.blocks), density, -likelihood, likelihood, (ended,))
    state, best, results = optimise(data, barrier, [mixture for mixture, _ in starts], options, progress)
    likelihood = log_likelihood(best, *data.points)
    density = position_em(best, data.points[0], data.states)
    return Solution(state.evaluation.field, density, state.cost, likelihood, results)


def stability_barrier(data: TrainingData, lyapunov: FloatArray, options: LearnOptions) -> StabilityBarrier:
    """Return the constraint in the learner's units.

    A period too long for the data (a motion that lasts a few periods) is shortened so that A_k = −I, to which
    every fit can fall back, stays inside: −½(−2 + Δt) − ε > 0 needs Δt < 2 − 2 ε, and 1 − ε is half of that.
    """
    period = min(options.period / data.time_scale, 1.0 - options.slowest_rate)
    return StabilityBarrier(lyapunov, options.slowest_rate, period, data.blocks)


def initial_mixtures(
    data: TrainingData,
    barrier: StabilityBarrier,
    n_components: int,
    options: LearnOptions,
    progress: Progress,
) -> list[tuple[JointMixture, StageResult]]:
    """Return the constrained mixture that EM reaches from each partition of the data, and how EM ended."""
    labels: list[IntArray] = partitions(data, n_components, options.effort.starts, options.seed)
    if not labels:
        raise InputDataError(
            f"the demonstrations have fewer than {n_components} distinct parts.", hint="Use fewer components."
        )
    whole = options.objective == "likelihood"
    iterations, floor = (EM_STEPS, POSITION_FLOOR) if whole else (FIRST_EM_STEPS, BROAD_START)
    starts = []
    for index, partition in enumerate(labels):
        starts.append(constrained_em(partition, *data.points, barrier, iterations=iterations, floor=floor))
        progress("mixtures", index + 1, len(labels))
    return starts


def optimise(
    data: TrainingData,
    barrier: StabilityBarrier,
    mixtures: list[JointMixture],
    options: LearnOptions,
    progress: Progress,
) -> tuple[State, JointMixture, tuple[StageResult, ...]]:
    """Probe every start, polish the one whose rollouts are best, and check it with a fine integration.

    Returns:
        The optimiser's last state, the mixture it started from, and how the polish, and the refinement if
        there was one, ended.
    """
    effort = options.effort
    rollouts = options.objective == "reproduction"
    objective = LearningObjective(data, rollouts=rollouts)
    ranking = LearningObjective(data)
    states = []
    for index, mixture in enumerate(mixtures):
        state = State(objective.evaluate(field_of(mixture, data.blocks)), barrier)
        states.append(minimise(objective, state, effort.probe_steps)[0])
        done, total = index + 1, len(mixtures)
        progress(f"start {done} of {total}, objective {states[-1].cost:.3g}", done, total)
    best = min(range(len(states)), key=lambda i: ranking.evaluate(states[i].evaluation.field).cost)

    def on_step(step: int, _: float) -> None:
        progress("polish", step, effort.polish_steps)

    state, polished = minimise(objective, states[best], effort.polish_steps, on_step=on_step)
    results: tuple[StageResult, ...] = (polished,)
    if rollouts:
        state, refined = _checked_finely(data, state, effort, progress)
        results += refined
    progress("polish", effort.polish_steps, effort.polish_steps)
    return state, mixtures[best], results


def _checked_finely(
    data: TrainingData, state: State, effort: Effort, progress: Progress
) -> tuple[State, tuple[StageResult, ...]]:
    """Integrate four times as finely; where that costs more, polish with twice as fine rollouts.

    Returns:
        The state that is better under fine integration, and how the refinement ended if it gave that state.
    """
    field = state.evaluation.field
    fine = LearningObjective(data, substeps=4)
    cost = fine.evaluate(field).cost
    if cost <= COARSE_AND_FINE * state.cost:
        return state, ()
    finer = LearningObjective(data, substeps=2)
    restart = replace(state, evaluation=finer.evaluate(field))
    refined, result = minimise(finer, restart, effort.polish_steps // 2, stage="refine")
    progress("refine", effort.polish_steps, effort.polish_steps)
    better = fine.evaluate(refined.evaluation.field).cost < cost
    return (refined, (result,)) if better else (state, ())
