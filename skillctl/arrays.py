"""Frozen, shape-checked arrays: the values that skills and demonstrations are made of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from skillctl.errors import InvalidModelError
from skillctl.exact import clearly_definite

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

SMALLEST, LARGEST = 1e-100, 1e100  # of a number that acts
UNCLEAR = 1e-10  # an eigenvalue beside ones that rounding, about 1e-14 for ten dimensions, may not decide


class Frozen:
    """A frozen dataclass over read-only arrays: copies and pickles of it are made by its constructor.

    Without this they would hold writable arrays beside values computed from them: a velocity and a proof
    that speak of different numbers.
    """

    __slots__ = ()

    def __reduce__(self) -> tuple[Any, ...]:
        given = {field.name: getattr(self, field.name) for field in fields(self) if field.init}  # type: ignore[arg-type]
        plain = {k: dict(v) if isinstance(v, MappingProxyType) else v for k, v in given.items()}
        return _constructed, (type(self), plain)


def _constructed(kind: type, given: dict[str, Any]) -> Any:
    return kind(**given)


def frozen_array(name: str, value: npt.ArrayLike, shape: Sequence[int | None]) -> FloatArray:
    """Return a read-only float64 copy of ``value``, checked to be finite and of ``shape``.

    Args:
        name: What the array is called in the error message.
        value: Anything NumPy can read as numbers.
        shape: Expected length per axis; None accepts any length of at least one.

    Raises:
        InvalidModelError: Not numbers, not finite, or of another shape.
    """
    try:
        array = np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise InvalidModelError(f"{name}: not an array of numbers.") from error
    fits = array.ndim == len(shape) and all(
        found == wanted or (wanted is None and found > 0)
        for found, wanted in zip(array.shape, shape, strict=True)
    )
    if not fits:
        wanted_text = " x ".join("any" if n is None else str(n) for n in shape)
        raise InvalidModelError(f"{name}: expected shape ({wanted_text}), got {array.shape}.")
    if not np.isfinite(array).all():
        raise InvalidModelError(f"{name}: must be finite.")
    array.setflags(write=False)
    return array


def length(vector: FloatArray) -> float:
    """Return the Euclidean length of a vector (n,); for short ones several times as fast as NumPy's norm."""
    return math.sqrt(vector.dot(vector))


def require_spd(name: str, matrices: FloatArray) -> None:
    """Raise InvalidModelError unless every matrix in a stack (..., d, d) is symmetric and clearly definite.

    M is clearly definite if M − 2⁻⁴⁶ diag(M) ≻ 0: then Cholesky's factor and the inverse of M can be computed
    in float64, whatever the units of its axes. That is decided exactly, by integers where eigenvalues of the
    matrix with a diagonal of ones are too near to zero to tell.
    """
    transposed = matrices.swapaxes(-1, -2)  # eigvalsh reads one triangle only
    if (matrices != transposed).any():
        raise InvalidModelError(f"{name}: must be symmetric.")
    diagonals = np.diagonal(matrices, axis1=-2, axis2=-1)
    if (diagonals <= 0).any():
        raise InvalidModelError(f"{name}: must be positive definite.")
    roots = np.sqrt(diagonals)
    with np.errstate(over="ignore"):
        scaled = matrices / roots[..., :, None] / roots[..., None, :]
    lowest = np.full(roots.shape[:-1], -1.0)
    sane = (np.abs(scaled) <= 2).all(axis=(-2, -1))  # off the diagonal a definite one has less than 1
    lowest[sane] = np.linalg.eigvalsh(scaled[sane])[..., 0]
    for place in zip(*np.nonzero(np.atleast_1d(lowest) <= UNCLEAR), strict=True):
        low = float(np.atleast_1d(lowest)[place])
        if low < -UNCLEAR or not clearly_definite(matrices[place] if lowest.ndim else matrices):
            raise InvalidModelError(f"{name}: must be positive definite, and not nearly singular.")


def require_moderate(name: str, array: FloatArray) -> None:
    """Raise InvalidModelError unless every number is zero, or of a size from 1e-100 to 1e100.

    Products of a few of them neither overflow nor underflow, so what acts is what is proved.
    """
    sizes = np.abs(array[array != 0])
    if sizes.size and not (sizes.min() >= SMALLEST and sizes.max() <= LARGEST):
        raise InvalidModelError(f"{name}: must be zero or of a size from {SMALLEST:g} to {LARGEST:g}.")


def require_positive(name: str, value: float) -> None:
    """Raise InvalidModelError unless ``value`` is a positive, finite number."""
    if not (math.isfinite(value) and value > 0):
        raise InvalidModelError(f"{name}: must be a positive number, got {value!r}.")


def require_simplex(name: str, weights: FloatArray) -> None:
    """Raise InvalidModelError unless all weights are positive and they sum to one."""
    # Rounding of a normalised sum of n terms stays below n * eps; 8 leaves room for one more division.
    tolerance = 8 * weights.size * np.finfo(np.float64).eps
    if weights.min() <= 0 or abs(weights.sum() - 1) > tolerance:
        raise InvalidModelError(f"{name}: must be positive and sum to one.")
