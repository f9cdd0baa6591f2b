"""Learning a skill: demonstrations in, a provably stable SEDS skill out (Section 2, Eq. 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.learning.lyapunov import deviation_bound, learn_lyapunov, rising_share, stretched
from skillctl.learning.options import LearnOptions
from skillctl.learning.parameters import skill_of
from skillctl.learning.preprocess import TrainingData, align, embedded, training_data
from skillctl.learning.select import component_limit, select_components
from skillctl.learning.solve import ProgressCallback, solve
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.seds import SedsSkill

BOUND_SHARE = 0.01  # warn when V keeps the motion off its path by more than this share of its extent


@dataclass(frozen=True, eq=False, slots=True)
class Fit:
    """What learning gives.

    Attributes:
        skill: The stable skill.
        demonstrations: The training demonstrations as an artifact keeps them: rests trimmed, at most 200
            points each, each ending exactly at the attractor.
        objective: Value of the objective at the end, in the learner's units.
        log_likelihood: Mean log p(ξ, ξ̇) of the initial or final constrained mixture, learner's units.
        deviation_bound: Mean distance from the demonstrations that no motion with this P gets below, in
            the unit of the space.
        rising_share: Share of the demonstrated path on which V would have to grow.
        warnings: Sentences a user should read.
    """

    skill: SedsSkill
    demonstrations: DemonstrationSet
    objective: float
    log_likelihood: float
    deviation_bound: float
    rising_share: float
    warnings: tuple[str, ...]


def fit(
    demonstrations: DemonstrationSet,
    options: LearnOptions | None = None,
    *,
    lyapunov: FloatArray | None = None,
    progress: ProgressCallback | None = None,
) -> Fit:
    """Learn a stable skill from demonstrations of one motion.

    Every A_k satisfies −½(P A_k + A_kᵀ P) ≻ ε P at every iterate and in the result, with ε the slowest rate.
    The same demonstrations and options give the same numbers, whatever the number of BLAS threads.

    Args:
        demonstrations: At least one; each is translated to the mean end point, which becomes ξ*.
        options: See ``LearnOptions``.
        lyapunov: Use this P (d, d) instead of what ``options.metric`` says.
        progress: Called as learning proceeds.

    Raises:
        InputDataError: Demonstrations that do not move.
        UsageError: More components than the data can carry, or a P of another dimension.
        FitError: No fit could be represented as a skill.

    References:
        Eq. 5 and 6; rollout residuals, the learned P and the interior-point solver are ours.
    """
    options = options or LearnOptions()
    with threadpool_limits(1):
        return _fit(demonstrations, options, lyapunov, progress or (lambda _: None))


def learned_metric(sets: Sequence[DemonstrationSet]) -> FloatArray:
    """Return one P (d, d) fitted to the demonstrations of several motions at once."""
    motions = []
    with threadpool_limits(1):
        for demonstrations in sets:
            aligned, attractor = align(demonstrations)
            motions.append(training_data(aligned, attractor, _samples(aligned, LearnOptions())).positions)
        return learn_lyapunov(motions)


def _fit(
    demonstrations: DemonstrationSet,
    options: LearnOptions,
    lyapunov: FloatArray | None,
    progress: ProgressCallback,
) -> Fit:
    aligned, attractor = align(demonstrations)
    data = training_data(aligned, attractor, _samples(aligned, options))
    metrics = _metrics(aligned, data, options, lyapunov)
    n_components = _n_components(aligned, data, metrics[0], options, progress)
    solutions = [solve(data, metric, n_components, options, progress) for metric in metrics]
    solution, metric = min(zip(solutions, metrics, strict=True), key=lambda pair: pair[0].objective)
    bound = deviation_bound(metric, data.positions) * data.length_scale
    share = rising_share(metric, data.positions)
    return Fit(
        skill=skill_of(solution.field, solution.density, data, metric, demonstrations.space),
        demonstrations=embedded(aligned),
        objective=solution.objective,
        log_likelihood=solution.log_likelihood,
        deviation_bound=bound,
        rising_share=share,
        warnings=_warnings(demonstrations, bound, share, options),
    )


def _samples(demonstrations: DemonstrationSet, options: LearnOptions) -> int:
    return options.effort.samples_of(len(demonstrations))


def _n_components(
    aligned: DemonstrationSet,
    data: TrainingData,
    lyapunov: FloatArray,
    options: LearnOptions,
    progress: ProgressCallback,
) -> int:
    limit = component_limit(aligned)
    if options.n_components is None:
        return min(options.effort.components, limit)
    if options.n_components == "auto":
        return select_components(data, lyapunov, options, limit, progress)
    if options.n_components > limit:
        raise UsageError(
            f"components: {options.n_components} is more than these demonstrations can carry ({limit}).",
            hint=f"Use --components {limit} or fewer, or give more demonstrations.",
        )
    return options.n_components


def _metrics(
    aligned: DemonstrationSet, data: TrainingData, options: LearnOptions, lyapunov: FloatArray | None
) -> list[FloatArray]:
    """Return the Lyapunov matrices to choose from.

    It is one, unless the motion contradicts even the learned one: then a longer one may do better, which
    shows only when both have been learned with.
    """
    if lyapunov is not None:
        if lyapunov.shape != (data.dimension, data.dimension):
            raise UsageError(f"lyapunov: expected {data.dimension} x {data.dimension}, got {lyapunov.shape}.")
        return [lyapunov]
    if options.metric == "euclidean":
        return [np.eye(data.dimension)]
    learned = learn_lyapunov([data.positions])
    if options.objective != "reproduction":  # only rollouts tell which of two metrics is the better
        return [learned]
    contradicted = deviation_bound(learned, data.positions) * data.length_scale > BOUND_SHARE * aligned.extent
    return [learned, stretched(learned)] if contradicted else [learned]


def _warnings(
    demonstrations: DemonstrationSet, bound: float, share: float, options: LearnOptions
) -> tuple[str, ...]:
    if bound <= BOUND_SHARE * demonstrations.extent:
        return ()
    hint = " --metric learned may fit better." if options.metric == "euclidean" else ""
    return (
        f"on {share:.0%} of the demonstrated path V would have to grow, which a quadratic V forbids: "
        f"the motion stays at least {bound:.2g} {demonstrations.space.unit} off it on average.{hint}",
    )
