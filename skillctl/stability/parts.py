"""The proof for one part: every component contracts under the part's Lyapunov matrix."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import ActingSkill
from skillctl.stability.exact import Dyadic, decays, is_positive_definite, steps_contract
from skillctl.stability.report import ComponentCertificate, PartCertificate

MARGIN = 2.0**-40  # about 1e-12: far above float64 rounding of a velocity, far below any useful rate
# An estimate is good to about 1e-14 times the condition of P, so one of the first factors passes; halving
# covers matrices so near singular that the estimate is noise.
SHRINKS = (1 - 2.0**-40, 1 - 2.0**-30, 1 - 2.0**-20, 1 - 2.0**-10, *(2.0**-n for n in range(1, 80)))
FLOAT64 = np.finfo(np.float64)


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
    rate = _largest_proved(
        float(rates.min()), size, lambda r: all(decays(lyapunov, matrix, r) for matrix in matrices)
    )
    period = _largest_proved(
        float(periods.min()),
        1 / size if size > 0 else float(FLOAT64.max),
        lambda t: all(steps_contract(lyapunov, matrix, t) for matrix in matrices),
    )
    return PartCertificate(number, positive, components, rate, period, part.coordinates.check())


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


def _largest_proved(estimate: float, fallback: float, passes: Callable[[Dyadic], bool]) -> float | None:
    """Return the first value at or below the estimate that passes the exact test; None below float64's range.

    Args:
        estimate: In floating point; not trusted.
        fallback: Where to start if the estimate is not a positive number.
        passes: Exact test; what it accepts it accepts for all smaller values too.
    """
    start = min(estimate if estimate > 0 else fallback, float(FLOAT64.max))
    for shrink in SHRINKS:
        value = start * shrink
        if value < FLOAT64.tiny:
            return None
        if passes(Dyadic.of(value)):
            return value
    return None
