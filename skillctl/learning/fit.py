"""Learning a provably stable SEDS skill from demonstrations (Section 2, Eq. 6)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.geometry import extent
from skillctl.learning.blocks import Sizes
from skillctl.learning.lyapunov import deviation_bound, learn_lyapunov, rising_share, stretched
from skillctl.learning.needs import require_affordable
from skillctl.learning.objective import reproduction_error
from skillctl.learning.options import Coordinates, LearnOptions, Preset
from skillctl.learning.outcome import Result, StageResult
from skillctl.learning.parameters import skill_of
from skillctl.learning.preprocess import TrainingData, align, embedded, resample, training_data
from skillctl.learning.select import CANDIDATES, component_limit, select_components
from skillctl.learning.shears import BENDING, learn_shears, samples_of
from skillctl.learning.solve import solve
from skillctl.model.coordinates.chain import IDENTITY, Chain, Link, OnPosition
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.pose import Pose
from skillctl.model.seds import SedsSkill
from skillctl.model.space import Space
from skillctl.progress import Progress
from skillctl.workers.blas import one_blas_thread

STRAIGHT = 0.001  # shears are learned if V keeps a motion off its path by more than this share of its extent
BOUND_SHARE = 0.01  # warn when V keeps the motion off its path by more than this share of its extent
LATE_GAIN = 0.02  # warn when the last steps took more off the cost; of distances that is about half as much
WORTH_SAYING = 60.0  # [s]: an estimated time that is shown before a fit begins
MORE_WORK: dict[Preset, Preset] = {"fast": "default", "default": "quality"}


@dataclass(frozen=True, eq=False, slots=True)
class Distance:
    """How the distance from the target is measured: V = φᵀ P φ of y = φ(ξ − ξ*).

    Attributes:
        lyapunov: P, shape (d, d).
        coordinates: φ, in the unit of the space.
    """

    lyapunov: FloatArray
    coordinates: Chain = IDENTITY


@dataclass(frozen=True, eq=False, slots=True)
class Fit:
    """A learned skill, and what is known of how well it was learned.

    Attributes:
        skill: The stable skill.
        demonstrations: The training demonstrations as an artifact keeps them: rests trimmed, at most 200
            points each, each ending exactly at the attractor.
        objective: Value of the objective at the end, in the learner's units.
        log_likelihood: Mean log p(ξ, ξ̇) of the initial or final constrained mixture, learner's units.
        deviation_bound: Lower bound of the mean distance from the demonstrations of any motion with this V,
            in the unit of the space; about that with learned coordinates.
        rising_share: Share of the demonstrated path on which V would have to grow.
        results: How the stages of learning ended, in their order: ``coordinates`` and ``metric`` where they
            were learned, then ``mixture`` (likelihood) or ``polish`` and perhaps ``refine``.
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
    distance: Distance | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Learn a stable skill from demonstrations of one motion.

    Every A_k satisfies −½(P A_k + A_kᵀ P) ≻ ε P at every iterate and in the result, with ε the slowest rate.
    The same demonstrations and options give the same numbers, whatever the number of BLAS threads.

    Args:
        demonstrations: At least one; each is translated to the median of the ends, which becomes ξ*.
        options: See ``LearnOptions``.
        distance: Use this P and these coordinates instead of what ``options`` says.
        progress: Called with (stage, done, total) as learning proceeds.

    Raises:
        InputDataError: Demonstrations that do not move.
        UsageError: More components than the data can carry, or a P of another dimension.
        FitError: No fit could be represented as a skill.
        ResourceError: It would take more memory or time than may be used (see ``needs``).

    References:
        Eq. 5 and 6; rollout residuals, the learned P and the interior-point solver are ours.
    """
    options = options or LearnOptions()
    with one_blas_thread():
        return _fit(demonstrations, options, distance, progress or (lambda *_: None))


def learned_distance(sets: Sequence[DemonstrationSet], coordinates: Coordinates = "auto") -> Distance:
    """Return one P, and coordinates if they are needed, fitted to the demonstrations of several motions."""
    options = LearnOptions(coordinates=coordinates)
    with one_blas_thread():
        aligned = [align(demonstrations) for demonstrations in sets]
        data = [training_data(a, goal, options.effort.samples_of(len(a))) for a, goal in aligned]
        blocks = data[0].blocks
        unit = float(np.sqrt(np.mean([each.length_scale**2 for each in data])))
        motions = [each.positions * (each.length_scale / unit) for each in data]
        metric, _ = _metric(motions, options, blocks)
        if not _shears_wanted(motions, metric, coordinates, blocks):
            return Distance(metric)
        link, _ = _bent([_dense(*pair) / unit for pair in aligned], BENDING[0], blocks)
        bent = [link.forward(each.reshape(-1, each.shape[-1])).reshape(each.shape) for each in motions]
        return Distance(_metric(bent, options, blocks)[0], Chain((link.in_unit(unit),)))


def _fit(
    demonstrations: DemonstrationSet,
    options: LearnOptions,
    distance: Distance | None,
    progress: Progress,
) -> Fit:
    aligned, attractor = align(demonstrations)
    most = _most_components(component_limit(aligned), options)
    seconds = require_affordable(aligned.dimension, most, len(aligned), options)
    if seconds > WORTH_SAYING:
        progress(f"this takes about {seconds / 60:.0f} minutes", 0, 1)
    data = training_data(aligned, attractor, options.effort.samples_of(len(aligned)))
    choices, learned = _measured(aligned, data, options, distance)
    n_components = most
    if options.n_components == "auto":
        n_components = select_components(*choices[0], options, most, progress)
    solutions = [solve(each, metric, n_components, options, progress) for each, metric in choices]
    best = 0
    if len(choices) > 1:  # only the motions tell which is the better: objectives of other coordinates differ
        best = int(
            np.argmin([reproduction_error(d, s.field) for (d, _), s in zip(choices, solutions, strict=True)])
        )
    solution, (data, metric) = solutions[best], choices[best]
    bound = _bound(metric, data)
    first = data.blocks[0]
    share = rising_share(metric[:first, :first], data.moved.positions[..., :first])
    results = (*learned[best], *solution.results)
    skill = skill_of(solution.field, solution.density, data, metric, demonstrations.space)
    if distance is not None:  # as given, to the last bit: skills that are to be merged must agree
        skill = replace(skill, coordinates=distance.coordinates)
    return Fit(
        skill=skill,
        demonstrations=embedded(aligned, attractor),
        objective=solution.objective,
        log_likelihood=solution.log_likelihood,
        deviation_bound=bound,
        rising_share=share,
        results=results,
        warnings=(
            *_contradictions(demonstrations, bound, share, options),
            *_turned_back(data, demonstrations.space),
            *_unfinished(results[-1], options.preset),
        ),
    )


def _most_components(limit: int, options: LearnOptions) -> int:
    """Return the number of components, of those that are tried the largest, if the data can carry it."""
    if options.n_components is None:
        return min(options.effort.components, limit)
    if options.n_components == "auto":
        return min(max(CANDIDATES), limit)
    if options.n_components > limit:
        raise UsageError(
            f"components: {options.n_components} is more than these demonstrations can carry ({limit}).",
            hint=f"Use --components {limit} or fewer, or give more demonstrations.",
        )
    return options.n_components


Choice: TypeAlias = tuple[TrainingData, FloatArray]  # the data in their coordinates, and P


def _measured(
    aligned: DemonstrationSet, data: TrainingData, options: LearnOptions, distance: Distance | None
) -> tuple[list[Choice], list[tuple[StageResult, ...]]]:
    """Return the ways to measure distance that are to be tried, and how learning each of them ended.

    There is one, unless the motion contradicts even the learned P, or needs shears. Then a more stretched P,
    or shears that bend more, may do better, and only learning with each shows whether it does.
    """
    if distance is not None:
        if distance.lyapunov.shape != (data.dimension, data.dimension):
            raise UsageError(
                f"lyapunov: expected {data.dimension} x {data.dimension}, got {distance.lyapunov.shape}."
            )
        coordinates = distance.coordinates.in_unit(1 / data.length_scale)
        return [(replace(data, coordinates=coordinates), distance.lyapunov)], [()]
    metric, results = _metric([data.positions], options, data.blocks)
    rollouts = options.objective == "reproduction"  # only they show which of two choices is the better
    if not _shears_wanted([data.positions], metric, options.coordinates, data.blocks):
        metrics = [metric]
        if options.metric == "learned" and rollouts and _bound(metric, data) > BOUND_SHARE * aligned.extent:
            metrics.append(_with_first(metric, stretched, data.blocks[0]))
        return [(data, each) for each in metrics], [results] * len(metrics)
    dense = _dense(aligned, data.attractor) / data.length_scale
    choices, ended = [], []
    for bending in BENDING if rollouts else BENDING[:1]:
        link, bent = _bent([dense], bending, data.blocks)
        each = replace(data, coordinates=Chain((link,)))
        metric, results = _metric([each.moved.positions], options, data.blocks)
        choices.append((each, metric))
        ended.append((bent, *results))
    return choices, ended


def _metric(
    motions: Sequence[FloatArray], options: LearnOptions, blocks: Sizes
) -> tuple[FloatArray, tuple[StageResult, ...]]:
    """Return P for motions (D, T, d) at rms distance about one, and how learning it ended, if it is.

    Only the first block of P, that of positions, is learned; the others are the identity.
    """
    metric = np.eye(motions[0].shape[-1])
    if options.metric == "euclidean":
        return metric, ()
    positions, _ = _first_block(motions, blocks)
    metric[: blocks[0], : blocks[0]], result = learn_lyapunov(positions)
    return metric, (result,)


def _first_block(motions: Sequence[FloatArray], blocks: Sizes) -> tuple[list[FloatArray], float]:
    """Return the coordinates of the first block, at rms distance one, and that distance before.

    With one block they are the motions themselves, which are at rms distance about one.
    """
    if len(blocks) == 1:
        return list(motions), 1.0
    positions = [motion[..., : blocks[0]] for motion in motions]
    scale = float(np.sqrt(np.mean(np.concatenate([(x**2).sum(axis=-1).ravel() for x in positions])))) or 1.0
    return [x / scale for x in positions], scale


def _with_first(metric: FloatArray, change: Callable[[FloatArray], FloatArray], first: int) -> FloatArray:
    """Return P with its first block changed."""
    changed = metric.copy()
    changed[:first, :first] = change(metric[:first, :first])
    return changed


def _bent(motions: Sequence[FloatArray], bending: float, blocks: Sizes) -> tuple[Link, StageResult]:
    """Return shears of the first block of motions (D, T, d), and how learning them ended."""
    positions, scale = _first_block(motions, blocks)
    shears, result = learn_shears(positions, bending)
    return (shears if len(blocks) == 1 else OnPosition(shears.in_unit(scale), blocks[0])), result


def _shears_wanted(
    motions: Sequence[FloatArray], metric: FloatArray, coordinates: Coordinates, blocks: Sizes
) -> bool:
    """Return whether shears are to be learned; there are none in one dimension."""
    d = blocks[0]
    motions, metric = _first_block(motions, blocks)[0], metric[:d, :d]
    if coordinates != "auto" or d == 1:
        return coordinates == "shears" and d > 1
    limits = [STRAIGHT * extent(motion.reshape(-1, d)) for motion in motions]
    return any(deviation_bound(metric, motion) > limit for motion, limit in zip(motions, limits, strict=True))


def _dense(aligned: DemonstrationSet, attractor: FloatArray) -> FloatArray:
    """Return demonstrations (D, T, d) relative to their target, with the samples that shears want."""
    samples = samples_of(len(aligned))
    positions = np.stack([resample(demonstration, samples).positions for demonstration in aligned])
    anchor = aligned.space.anchor(attractor)
    positions[:, -1] = anchor
    return positions - anchor


def _bound(metric: FloatArray, data: TrainingData) -> float:
    """Return about the least mean distance of any motion with this P from the demonstrations, in their unit.

    A distance in y is at most the stretch of φ times that in the state; the stretch on the path is taken.
    """
    moved, first = data.moved, data.blocks[0]
    factors = data.factors(moved.states)
    stretch = 1.0
    if factors is not None:
        stretch = 1 / float(np.linalg.svd(factors[:, :first, :first], compute_uv=False)[:, -1].min())
    bound = deviation_bound(metric[:first, :first], moved.positions[..., :first])
    return bound * data.length_scale / stretch


def _turned_back(data: TrainingData, space: Space) -> tuple[str, ...]:
    """Return the warning about orientations whose angle from the target grows on the way."""
    if not isinstance(space, Pose):
        return ()
    turns = data.positions[..., space.positions :] * data.length_scale
    bound = deviation_bound(np.eye(3), turns) / space.length
    reach = float(np.linalg.norm(turns, axis=-1).max()) / space.length
    if bound <= BOUND_SHARE * reach:
        return ()
    return (
        "the angle from the final orientation grows on the way, which the proof forbids: the motion stays at "
        f"least {np.degrees(bound):.2g}° off it on average.",
    )


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
