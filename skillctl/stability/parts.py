"""The proof for one part: every component contracts under the part's Lyapunov matrix."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import ActingSkill
from skillctl.stability.exact import (
    FLOAT64,
    Dyadic,
    decays,
    is_positive_definite,
    largest_proved,
    steps_contract,
)
from skillctl.stability.report import ComponentCertificate, PartCertificate

MARGIN = 2.0**-40  # about 1e-12: far above float64 rounding of a velocity, far below any useful rate


def certify_part(number: int, part: ActingSkill, speed: float) -> PartCertificate:
    """Return what exact arithmetic proves of one part.

    With V = (ξ − ξ*)ᵀ P (ξ − ξ*), every convex combination of components that contract in the P-norm
    contracts in it, for any gates. The proof holds for the field as stored: speeds and matrices are
    multiplied as rational numbers, and weights sum to one.

    Args:
        number: Number of the part, counted from 1.
        part: A skill with one P and one attractor.
        speed: Factor of the combined skill around it, 1 without one.
    """
    lyapunov = Dyadic.of(part.lyapunov)
    acting = [
        (leaf_number, k + 1, Dyadic.of(matrix) * factor, Dyadic.of(MARGIN * np.abs(matrix).max()) * factor)
        for leaf_number, (leaf, factor) in enumerate(_leaves(part, Dyadic.of(speed)), start=1)
        for k, matrix in enumerate(leaf.system_matrices)
    ]
    matrices = [matrix for _, _, matrix, _ in acting]
    rates, periods, size = _estimates(part, speed)
    components = tuple(
        ComponentCertificate(leaf, k, decays(lyapunov, matrix, margin), float(r) if np.isfinite(r) else None)
        for (leaf, k, matrix, margin), r in zip(acting, rates, strict=True)
    )
    positive = is_positive_definite(lyapunov)
    if not (positive and all(component.proved for component in components)):
        return PartCertificate(number, positive, components, None, None, part.coordinates.check())
    rate = largest_proved(
        float(rates.min()), size, lambda r: all(decays(lyapunov, matrix, r) for matrix in matrices)
    )
    period = largest_proved(
        float(periods.min()),
        1 / size if size > 0 else float(FLOAT64.max),
        lambda t: all(steps_contract(lyapunov, matrix, t) for matrix in matrices),
    )
    return PartCertificate(number, positive, components, rate, period, part.coordinates.check())


def proved_rate(part: ActingSkill, speed: float, period: float) -> float | None:
    """Return r such that every step Δt up to a period shrinks the P-distance by e^(−rΔt) or more, [1/s].

    Args:
        part: A skill with one P and one attractor.
        speed: Factor of the combined skill around it, 1 without one.
        period: [s].

    Returns:
        None if nothing is proved, as where the period is longer than the certified one.
    """
    lyapunov, longest = Dyadic.of(part.lyapunov), Dyadic.of(period)
    matrices = [
        Dyadic.of(matrix) * factor
        for leaf, factor in _leaves(part, Dyadic.of(speed))
        for matrix in leaf.system_matrices
    ]
    estimate = float(part.form.rates(speed * part.component_matrices, period).min())
    return largest_proved(
        estimate, 0.0, lambda rate: all(decays(lyapunov, matrix, rate, longest) for matrix in matrices)
    )


def _leaves(skill: ActingSkill, speed: Dyadic) -> Iterator[tuple[SedsSkill, Dyadic]]:
    """Yield every leaf with the product of all speeds on the way to it."""
    speed = speed * Dyadic.of(skill.speed)
    if not skill.parts:
        yield from ((leaf, speed) for leaf in skill.leaves)
    for part in skill.parts:
        yield from _leaves(part, speed)


def _estimates(part: ActingSkill, speed: float) -> tuple[FloatArray, FloatArray, float]:
    """Return decay rates (K,), periods (K,) and the largest entry of all matrices, in floating point."""
    matrices = speed * part.component_matrices
    size = float(np.abs(matrices).max())
    try:
        with np.errstate(all="ignore"):  # near the limits of float64 they may be infinite, or no numbers
            return part.form.rates(matrices), part.form.periods(matrices), size
    except np.linalg.LinAlgError:  # P or a matrix is singular to working precision
        unknown = np.full(len(matrices), np.nan)
        return unknown, unknown, size
