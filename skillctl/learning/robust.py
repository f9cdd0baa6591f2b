"""Robust least squares of few unknowns: small enough to spare every command the import of SciPy's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray

FIRST_DAMPING, EASED, REFUSED = 1e-2, 0.2, 5.0
TRIALS = 10  # dampings tried in one step
TOLERANCE = 1e-8  # share of the cost; a step that gains less is the last

Linearise = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, eq=False, slots=True)
class RobustFit:
    """Where the search ended.

    Attributes:
        parameters: Shape (m,).
        cost: The least ``soft_loss`` found.
        steps: Number of linearisations.
        converged: Whether the last step gained next to nothing.
    """

    parameters: FloatArray
    cost: float
    steps: int
    converged: bool


def soft_loss(residuals: FloatArray, scale: float) -> float:
    """Return Σ scale² (√(1 + r²/scale²) − 1): quadratic below the scale and linear above."""
    return scale**2 * float((np.sqrt(1 + (residuals / scale) ** 2) - 1).sum())


def soft_least_squares(
    linearise: Linearise, start: FloatArray, scale: float, steps: int, longest: float
) -> RobustFit:
    """Minimise ``soft_loss`` by Levenberg–Marquardt with the loss's own curvature, (1 + r²/scale²)^(−3/2).

    Args:
        linearise: Returns residuals (n,) and their Jacobian (n, m).
        start: Shape (m,).
        scale: In the unit of the residuals.
        steps: At most this many linearisations.
        longest: Length of the longest step.
    """
    parameters, damping = start, FIRST_DAMPING
    residuals, jacobian = linearise(parameters)
    cost = soft_loss(residuals, scale)
    for count in range(1, steps):
        bend = 1 + (residuals / scale) ** 2
        slope = jacobian.T @ (residuals / np.sqrt(bend))
        normal = jacobian.T @ (jacobian / bend[:, None] ** 1.5)
        diagonal = normal.diagonal() + 1e-3 * normal.diagonal().mean() + 1e-12
        for _ in range(TRIALS):
            step = np.linalg.solve(normal + np.diag(damping * diagonal), slope)
            trial = parameters - step * min(1.0, longest / max(float(np.linalg.norm(step)), 1e-300))
            moved = linearise(trial)
            gain = cost - soft_loss(moved[0], scale)
            if gain > 0:
                break
            damping *= REFUSED
        if gain <= TOLERANCE * cost:
            return RobustFit(parameters, cost, count, True)
        parameters, (residuals, jacobian), cost = trial, moved, cost - gain
        damping *= EASED
    return RobustFit(parameters, cost, steps, False)
