"""Definiteness decided exactly: every float64 is a rational number, so no tolerance is needed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt

IntegerArray = npt.NDArray[np.object_]  # Python integers: they do not overflow
FLOAT64 = np.finfo(np.float64)
# An estimate is good to about 1e-14 times the condition of P, so one of the first factors passes; halving
# covers matrices so near singular that the estimate is noise.
SHRINKS = (1 - 2.0**-40, 1 - 2.0**-30, 1 - 2.0**-20, 1 - 2.0**-10, *(2.0**-n for n in range(1, 80)))


@dataclass(frozen=True, eq=False, slots=True)
class Dyadic:
    """Numbers ``integers / denominator`` with one power of two below them all; sums and products are exact.

    Attributes:
        integers: Python integers in an object array of any shape.
        denominator: A power of two.
    """

    integers: IntegerArray
    denominator: int

    @classmethod
    def of(cls, values: npt.ArrayLike) -> Dyadic:
        """Return the exact values of finite float64 numbers."""
        array = np.asarray(values, dtype=np.float64)
        ratios = [value.as_integer_ratio() for value in array.ravel().tolist()]
        denominator = max(below for _, below in ratios)
        integers = np.empty(array.size, dtype=object)
        integers[:] = [above * (denominator // below) for above, below in ratios]
        return cls(integers.reshape(array.shape), denominator)

    @property
    def T(self) -> Dyadic:  # noqa: N802 - as NumPy writes it
        """The transpose."""
        return Dyadic(self.integers.T, self.denominator)

    def block(self, rows: slice) -> Dyadic:
        """Return the rows and columns of a matrix that belong together."""
        return Dyadic(self.integers[rows, rows], self.denominator)

    def __add__(self, other: Dyadic) -> Dyadic:
        common = max(self.denominator, other.denominator)
        left = self.integers * (common // self.denominator)
        return Dyadic(left + other.integers * (common // other.denominator), common)

    def __neg__(self) -> Dyadic:
        return Dyadic(-self.integers, self.denominator)

    def __mul__(self, other: Dyadic) -> Dyadic:
        return Dyadic(self.integers * other.integers, self.denominator * other.denominator)

    def __matmul__(self, other: Dyadic) -> Dyadic:
        return Dyadic(self.integers @ other.integers, self.denominator * other.denominator)


def leading_minors(symmetric: IntegerArray) -> Iterator[int]:
    """Yield the leading principal minors of a symmetric integer matrix (d, d), from order 1 on.

    Bareiss' fraction-free elimination: every division is exact and every pivot is a minor. Stops after a
    minor that is zero; larger ones would need row exchanges.

    References:
        E. H. Bareiss, Mathematics of Computation 22 (1968) 565–578, one-step method.
    """
    rows: list[list[Any]] = symmetric.tolist()
    size = len(rows)
    previous = 1
    for k in range(size):
        top = rows[k]
        pivot: int = top[k]
        yield pivot
        if pivot == 0:
            return
        for i in range(k + 1, size):
            row, factor = rows[i], top[i]  # symmetric: rows[i][k] is top[i]
            for j in range(i, size):
                row[j] = (pivot * row[j] - factor * top[j]) // previous
        previous = pivot


def is_positive_definite(symmetric: Dyadic) -> bool:
    """Decide S ≻ 0 by Sylvester's criterion: all leading principal minors are positive."""
    return all(minor > 0 for minor in leading_minors(symmetric.integers))


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
