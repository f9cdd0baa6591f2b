"""Learning a provably stable SEDS skill from demonstrations (Section 2, Eq. 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.learning.lyapunov import deviation_bound, learn_lyapunov, rising_share, stretched
from skillctl.learning.options import LearnOptions, Preset
from skillctl.learning.outcome import Result, StageResult
from skillctl.learning.parameters import skill_of
from skillctl.learning.preprocess import TrainingData, align, embedded, training_data
from skillctl.learning.select import component_limit, select_components
from skillctl.learning.solve import solve
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.seds import SedsSkill
from skillctl.progress import Progress
from skillctl.workers.blas import one_blas_thread

BOUND_SHARE = 0.01  # warn when V keeps the motion off its path by more than this share of its extent
LATE_GAIN = 0.02  # warn when the last steps took more off the cost; of distances that is about half as much
MORE_WORK: dict[Preset, Preset] = {"fast": "default", "default": "quality"}


@dataclass(frozen=True, eq=False, slots=True)
class Fit:
    """A learned skill, and what is known of how well it was learned.

    Attributes:
        skill: The stable skill.
        demonstrations: The training demonstrations as an artifact keeps them: rests trimmed, at most 200
            points each, each ending exactly at the attractor.
        objective: Value of the objective at the end, in the learner's units.
        log_likelihood: Mean log p(ξ, ξ̇) of the initial or final constrained mixture, learner's units.
        deviation_bound: Lower bound of the mean distance from the demonstrations of any motion with this P,
            in the unit of the space.
        rising_share: Share of the demonstrated path on which V would have to grow.
        results: How the stages of learning ended, in their order: ``metric`` where P was learned, then
            ``mixture`` (likelihood) or ``polish`` and perhaps ``refine``.
        warnings: Sentences for the user.
    """

    skill: SedsSkill
    demonstrations: DemonstrationSet
    objective: float
    log_likelihood: float
    deviation_bound: float
    rising_share: float
    results: tuple[StageResult, ...]
    warnings: tuple[str, ...]

    @property
    def converged(self) -> bool:
        """Whether the last stage, which gave the skill its numbers, converged. Stability does not need it."""
        return self.results[-1].result is Result.CONVERGED


def fit(
    demonstrations: DemonstrationSet,
    options: LearnOptions | None = None,
    *,
    lyapunov: FloatArray | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Learn a stable skill from demonstrations of one motion.

    Every A_k satisfies −½(P A_k + A_kᵀ P) ≻ ε P at every iterate and in the result, with ε the slowest rate.
    The same demonstrations and options give the same numbers, whatever the number of BLAS threads.

    Args:
        demonstrations: At least one; each is translated to the median of the ends, which becomes ξ*.
        options: See ``LearnOptions``.
        lyapunov: Use this P (d, d) instead of what ``options.metric`` says.
        progress: Called with (stage, done, total) as learning proceeds.

    Raises:
        InputDataError: Demonstrations that do not move.
        UsageError: More components than the data can carry, or a P of another dimension.
        FitError: No fit could be represented as a skill.

    References:
        Eq. 5 and 6; rollout residuals, the learned P and the interior-point solver are ours.
    """
    options = options or LearnOptions()
    with one_blas_thread():
        return _fit(demonstrations, options, lyapunov, progress or (lambda *_: None))


def learned_metric(sets: Sequence[DemonstrationSet]) -> FloatArray:
    """Return one P (d, d) fitted to the demonstrations of several motions at once."""
    motions = []
    with one_blas_thread():
        for demonstrations in sets:
            aligned, attractor = align(demonstrations)
            samples = LearnOptions().effort.samples_of(len(aligned))
            motions.append(training_data(aligned, attractor, samples).positions)
        return learn_lyapunov(motions)[0]


def _fit(
    demonstrations: DemonstrationSet,
    options: LearnOptions,
    lyapunov: FloatArray | None,
    progress: Progress,
) -> Fit:
    aligned, attractor = align(demonstrations)
    data = training_data(aligned, attractor, options.effort.samples_of(len(aligned)))
    metrics, learned = _metrics(aligned, data, options, lyapunov)
    n_components = _n_components(aligned, data, metrics[0], options, progress)
    solutions = [solve(data, metric, n_components, options, progress) for metric in metrics]
    solution, metric = min(zip(solutions, metrics, strict=True), key=lambda pair: pair[0].objective)
    bound = deviation_bound(metric, data.positions) * data.length_scale
    share = rising_share(metric, data.positions)
    results = (*learned, *solution.results)
    return Fit(
        skill=skill_of(solution.field, solution.density, data, metric, demonstrations.space),
        demonstrations=embedded(aligned),
        objective=solution.objective,
        log_likelihood=solution.log_likelihood,
        deviation_bound=bound,
        rising_share=share,
        results=results,
        warnings=(
            *_contradictions(demonstrations, bound, share, options),
            *_unfinished(results[-1], options.preset),
        ),
    )


def _n_components(
    aligned: DemonstrationSet,
    data: TrainingData,
    lyapunov: FloatArray,
    options: LearnOptions,
    progress: Progress,
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
) -> tuple[list[FloatArray], tuple[StageResult, ...]]:
    """Return the Lyapunov matrices to choose from, and how learning them ended, if they are learned.

    There is one, unless the motion contradicts even the learned one. Then a more stretched one may do better,
    and only learning a skill with each of them shows whether it does.
    """
    if lyapunov is not None:
        if lyapunov.shape != (data.dimension, data.dimension):
            raise UsageError(f"lyapunov: expected {data.dimension} x {data.dimension}, got {lyapunov.shape}.")
        return [lyapunov], ()
    if options.metric == "euclidean":
        return [np.eye(data.dimension)], ()
    learned, result = learn_lyapunov([data.positions])
    if options.objective != "reproduction":  # only rollouts show which of two metrics is the better
        return [learned], (result,)
    contradicted = deviation_bound(learned, data.positions) * data.length_scale > BOUND_SHARE * aligned.extent
    return [learned, stretched(learned)] if contradicted else [learned], (result,)


def _contradictions(
    demonstrations: DemonstrationSet, bound: float, share: float, options: LearnOptions
) -> tuple[str, ...]:
    if bound <= BOUND_SHARE * demonstrations.extent:
        return ()
    hint = " --metric learned may fit better." if options.metric == "euclidean" else ""
    return (
        f"on {share:.0%} of the demonstrated path V would have to grow, which a quadratic V forbids: "
        f"the motion stays at least {bound:.2g} {demonstrations.space.unit} off it on average.{hint}",
    )


def _unfinished(last: StageResult, preset: Preset) -> tuple[str, ...]:
    """Return the warning about a fit that more steps would improve.

    Most fits with the ``default`` preset use up their steps, but on none of the 30 LASA motions do the last
    steps gain more than ``LATE_GAIN``; with ``fast`` they do on a third.
    """
    if last.result is not Result.OUT_OF_STEPS or (last.late_gain is not None and last.late_gain <= LATE_GAIN):
        return ()
    if last.late_gain is None:
        return (f"EM had not converged after its {last.steps} steps.",)
    hint = f"; --preset {MORE_WORK[preset]} takes more" if preset in MORE_WORK else ""
    return (
        f"the optimiser used all of its {last.steps} steps, and the last three still lowered the objective "
        f"by {last.late_gain:.1%}{hint}.",
    )
