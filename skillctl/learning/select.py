"""The number of components: the smallest that does as well on demonstrations left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.learning.em import log_likelihood
from skillctl.learning.objective import LearningObjective
from skillctl.learning.options import LearnOptions
from skillctl.learning.preprocess import EMBEDDED_POINTS, TrainingData
from skillctl.learning.solve import initial_mixtures, solve, stability_barrier
from skillctl.model.demonstration import DemonstrationSet
from skillctl.progress import Progress

# All tuned on the 30 LASA motions.
POINTS_PER_COORDINATE = 5  # points that a component needs per dimension
CANDIDATES = (1, 2, 3, 4, 5, 6, 7, 8, 10)
MOST_FOLDS = 4
TIE = 1.05  # a smaller K wins unless it costs more than this times the best


def component_limit(demonstrations: DemonstrationSet) -> int:
    """Return the largest K the data can carry: about five points per component and dimension.

    Of a long recording only ``EMBEDDED_POINTS`` count: more are too close together to add information.
    """
    points = sum(min(len(d.times), EMBEDDED_POINTS) for d in demonstrations)
    return max(1, points // (POINTS_PER_COORDINATE * demonstrations.dimension))


def select_components(
    data: TrainingData, lyapunov: FloatArray, options: LearnOptions, limit: int, progress: Progress
) -> int:
    """Return the K in 1 … 10, at most ``limit``, with the lowest error on demonstrations left out.

    Each fold leaves out every fourth demonstration (each one where there are four or fewer) and learns
    from the rest with the ``fast`` preset; the error is the objective on those left out. With one
    demonstration there is nothing to leave out, and K is chosen by BIC.
    """
    candidates = [k for k in CANDIDATES if k <= limit]
    score = _bic if len(data.positions) == 1 else _left_out_error
    quick = replace(options, preset="fast")
    scores = []
    for index, k in enumerate(candidates):
        scores.append(score(data, lyapunov, k, quick))
        progress("components", index + 1, len(candidates))
    if len(data.positions) == 1:
        return candidates[int(np.argmin(scores))]
    return next(k for k, s in zip(candidates, scores, strict=True) if s <= TIE * min(scores))


def _left_out_error(data: TrainingData, lyapunov: FloatArray, k: int, options: LearnOptions) -> float:
    """Return the mean objective on left-out demonstrations."""
    count = len(data.positions)
    folds = min(count, MOST_FOLDS)
    errors = []
    for fold in range(folds):
        out = np.arange(count) % folds == fold
        solution = solve(_subset(data, ~out), lyapunov, k, options, lambda *_: None)
        errors.append(LearningObjective(_subset(data, out)).evaluate(solution.field).cost)
    return float(np.mean(errors))


def _bic(data: TrainingData, lyapunov: FloatArray, k: int, options: LearnOptions) -> float:
    """Return the Bayesian information criterion of the constrained joint mixture."""
    barrier = stability_barrier(data, lyapunov, options)
    ((mixture, _), *_) = initial_mixtures(data, barrier, k, options, lambda *_: None)
    n, d = data.points[0].shape
    per_component = 1 + d + d * (d + 1) + d * d  # prior, mean, Σ and C, A
    likelihood = log_likelihood(mixture, *data.points)
    return float((k * per_component - 1) * np.log(n) - 2 * n * likelihood)


def _subset(data: TrainingData, keep: np.typing.NDArray[np.bool_]) -> TrainingData:
    return replace(
        data, positions=data.positions[keep], velocities=data.velocities[keep], steps=data.steps[keep]
    )
