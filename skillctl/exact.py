"""Numbers as they are stored: every float64 is a rational number, so definiteness needs no tolerance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

IntegerArray = npt.NDArray[np.object_]  # Python integers: they do not overflow


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


def clearly_definite(symmetric: npt.NDArray[np.float64]) -> bool:
    """Decide M − 2⁻⁴⁶ diag(M) ≻ 0 for a symmetric M (d, d)."""
    exact = Dyadic.of(symmetric)
    lowered = exact.integers * 2**46 - np.diag(np.diag(exact.integers))
    return is_positive_definite(Dyadic(lowered, exact.denominator))
