"""The search itself: several starts, short probes, one polish, and a check of the step size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from skillctl.arrays import FloatArray, IntArray
from skillctl.errors import InputDataError
from skillctl.learning.barrier import StabilityBarrier
from skillctl.learning.em import POSITION_FLOOR, JointMixture, constrained_em, log_likelihood, position_em
from skillctl.learning.field import Field
from skillctl.learning.initialize import partitions
from skillctl.learning.levenberg import State, minimise
from skillctl.learning.objective import LearningObjective
from skillctl.learning.options import Effort, LearnOptions
from skillctl.learning.parameters import field_of
from skillctl.learning.preprocess import TrainingData

BROAD_START = 1e-3  # variance that gates start with where an optimiser goes on: narrow ones leave it no slope
COARSE_AND_FINE = 1.15  # a fit whose cost grows by more under fine integration exploits its own step size


@dataclass(frozen=True, slots=True)
class Progress:
    """How far learning has come: ``done`` of ``total`` steps of a stage, and the objective there."""

    stage: str
    done: int
    total: int
    objective: float


ProgressCallback = Callable[[Progress], None]


@dataclass(frozen=True, eq=False, slots=True)
class Solution:
    """A stable field in the learner's units.

    Attributes:
        field: A_k and gate logits.
        density: Priors (K,), means (K, d) and covariances (K, d, d) of the position density.
        objective: What was minimised, at its end.
        log_likelihood: Mean log p(ξ, ξ̇) of the constrained mixture the field came from.
    """

    field: Field
    density: tuple[FloatArray, FloatArray, FloatArray]
    objective: float
    log_likelihood: float


def solve(
    data: TrainingData,
    lyapunov: FloatArray,
    n_components: int,
    options: LearnOptions,
    progress: ProgressCallback,
) -> Solution:
    """Return the best stable field with ``n_components`` components for this P (d, d).

    Whatever the objective, starts are compared by their rollouts: the lowest velocity error is seldom
    the best motion.

    Raises:
        InputDataError: Fewer distinct points than components.
    """
    barrier = stability_barrier(data, lyapunov, options)
    mixtures = initial_mixtures(data, barrier, n_components, options, progress)
    if options.objective == "likelihood":
        ranking = LearningObjective(data)
        best = min(mixtures, key=lambda mixture: ranking.evaluate(field_of(mixture)).cost)
        likelihood = log_likelihood(best, *data.points)
        density = best.priors, best.means, best.covariances
        return Solution(field_of(best), density, -likelihood, likelihood)
    state, best = optimise(data, barrier, mixtures, options, progress)
    likelihood = log_likelihood(best, *data.points)
    return Solution(state.evaluation.field, position_em(best, data.points[0]), state.cost, likelihood)


def stability_barrier(data: TrainingData, lyapunov: FloatArray, options: LearnOptions) -> StabilityBarrier:
    """Return the constraint in the learner's units.

    A period too long for the data (a motion that lasts a few periods) is shortened to what leaves room
    for the −I that every fit can fall back to.
    """
    period = min(options.period / data.time_scale, 1.0 - options.slowest_rate)
    return StabilityBarrier(lyapunov, options.slowest_rate, period)


def initial_mixtures(
    data: TrainingData,
    barrier: StabilityBarrier,
    n_components: int,
    options: LearnOptions,
    progress: ProgressCallback,
) -> list[JointMixture]:
    """Return the constrained mixture that EM reaches from each partition of the data."""
    labels: list[IntArray] = partitions(data, n_components, options.effort.starts, options.seed)
    if not labels:
        raise InputDataError(
            f"the demonstrations have fewer than {n_components} distinct parts.", hint="Use fewer components."
        )
    converged = options.objective == "likelihood"
    iterations, floor = (200, POSITION_FLOOR) if converged else (10, BROAD_START)
    mixtures = []
    for index, partition in enumerate(labels):
        mixtures.append(constrained_em(partition, *data.points, barrier, iterations=iterations, floor=floor))
        progress(Progress("mixtures", index + 1, len(labels), -log_likelihood(mixtures[-1], *data.points)))
    return mixtures


def optimise(
    data: TrainingData,
    barrier: StabilityBarrier,
    mixtures: list[JointMixture],
    options: LearnOptions,
    progress: ProgressCallback,
) -> tuple[State, JointMixture]:
    """Probe every start, polish the one whose rollouts are best, and check it with a fine integration."""
    effort = options.effort
    rollouts = options.objective == "reproduction"
    objective = LearningObjective(data, rollouts=rollouts)
    ranking = LearningObjective(data)
    states = []
    for index, mixture in enumerate(mixtures):
        state = State(objective.evaluate(field_of(mixture)), barrier)
        states.append(minimise(objective, state, effort.probe_steps))
        progress(Progress("starts", index + 1, len(mixtures), states[-1].cost))
    best = min(range(len(states)), key=lambda i: ranking.evaluate(states[i].evaluation.field).cost)

    def on_step(step: int, cost: float) -> None:
        progress(Progress("polish", step, effort.polish_steps, cost))

    state = minimise(objective, states[best], effort.polish_steps, on_step=on_step)
    if rollouts:
        state = _checked_finely(data, state, effort, progress)
    progress(Progress("polish", effort.polish_steps, effort.polish_steps, state.cost))
    return state, mixtures[best]


def _checked_finely(data: TrainingData, state: State, effort: Effort, progress: ProgressCallback) -> State:
    """Integrate four times as finely; where that costs more, polish with twice as fine rollouts."""
    field = state.evaluation.field
    fine = LearningObjective(data, substeps=4)
    if fine.evaluate(field).cost <= COARSE_AND_FINE * state.cost:
        return state
    finer = LearningObjective(data, substeps=2)
    restart = replace(state, evaluation=finer.evaluate(field))
    refined = minimise(finer, restart, effort.polish_steps // 2)
    progress(Progress("refine", effort.polish_steps, effort.polish_steps, refined.cost))
    better = fine.evaluate(refined.evaluation.field).cost < fine.evaluate(field).cost
    return refined if better else state
