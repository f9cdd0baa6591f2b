"""What contracts, decided exactly on the numbers as they are stored."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction

import numpy as np

from skillctl.exact import Dyadic, is_positive_definite, leading_minors

FLOAT64 = np.finfo(np.float64)
# An estimate is good to about 1e-14 times the condition of P, so one of the first factors passes; halving
# covers matrices so near singular that the estimate is noise.
SHRINKS = (1 - 2.0**-40, 1 - 2.0**-30, 1 - 2.0**-20, 1 - 2.0**-10, *(2.0**-n for n in range(1, 80)))


def decays(lyapunov: Dyadic, matrix: Dyadic, rate: Dyadic, period: Dyadic | None = None) -> bool:
    """Decide −½(P A + Aᵀ P + Δt Aᵀ P A) − r P ≻ 0: the P-norm shrinks faster than e^(−rt).

    That holds for ξ̇ = A ξ; with a period also for steps ξ⁺ = ξ + Δt A ξ up to it, because Aᵀ P A is positive
    semi-definite and 1 − 2rΔt ≤ e^(−2rΔt).

    Args:
        lyapunov: P ≻ 0, shape (d, d).
        matrix: A, shape (d, d), [1/s].
        rate: r, a scalar, [1/s].
        period: Δt ≥ 0, a scalar, [s]; None: zero.
    """
    product = lyapunov @ matrix
    change = product + product.T + lyapunov * (rate + rate)
    return is_positive_definite(-(change if period is None else change + matrix.T @ product * period))


def steps_contract(lyapunov: Dyadic, matrix: Dyadic, period: Dyadic) -> bool:
    """Decide −(P A + Aᵀ P + Δt Aᵀ P A) ≻ 0: steps ξ⁺ = ξ + Δt A ξ up to this period shrink the P-norm."""
    return decays(lyapunov, matrix, Dyadic.of(0.0), period)


def largest_proved(estimate: float, fallback: float, passes: Callable[[Dyadic], bool]) -> float | None:
    """Return the first value at or below the estimate that passes an exact test; None below float64's range.

    Args:
        estimate: In floating point; not trusted.
        fallback: Where to start if the estimate is not a positive number.
        passes: What it accepts it accepts for all smaller values too.
    """
    start = min(estimate if estimate > 0 else fallback, float(FLOAT64.max))
    for shrink in SHRINKS:
        value = start * shrink
        if value < FLOAT64.tiny:
            return None
        if passes(Dyadic.of(value)):
            return value
    return None


def inverse_diagonal(symmetric: Dyadic) -> list[Fraction]:
    """Return the diagonal of P⁻¹ for P ≻ 0, (d, d), exactly: (P⁻¹)ᵢᵢ = det(P without i) / det P."""
    indices = range(len(symmetric.integers))
    found = []
    for i in indices:
        order = [*(j for j in indices if j != i), i]
        *smaller, determinant = leading_minors(symmetric.integers[np.ix_(order, order)])
        found.append(Fraction(symmetric.denominator * (smaller[-1] if smaller else 1), determinant))
    return found


def rounded_up(value: Fraction) -> float:
    """Return the smallest float64 at or above a number; infinite above them all."""
    try:
        nearest = float(value)
    except OverflowError:
        return math.inf if value > 0 else -float(FLOAT64.max)
    return nearest if Fraction(nearest) >= value else math.nextafter(nearest, math.inf)


def root_above(value: Fraction) -> float:
    """Return a float64 at or above √value, and hardly more, for value ≥ 0."""
    root = math.sqrt(rounded_up(value))
    while root < math.inf and Fraction(root) ** 2 < value:
        root = math.nextafter(root, math.inf)
    return root
