"""Which entries of system matrices are free: those of square blocks along the diagonal.

A matrix (d, d) with blocks of sizes (b₁, b₂, …) has m = Σ b² free entries, which are counted block by block
and within a block row by row; all others are zero. One block of size d leaves all free.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import accumulate

import numpy as np

from skillctl.arrays import FloatArray, IntArray

Sizes = tuple[int, ...]


@lru_cache(maxsize=64)
def spans(sizes: Sizes) -> tuple[slice, ...]:
    """Return the coordinates of each block."""
    ends = list(accumulate(sizes))
    return tuple(slice(end - size, end) for size, end in zip(sizes, ends, strict=True))


@lru_cache(maxsize=64)
def free_spans(sizes: Sizes) -> tuple[slice, ...]:
    """Return where the entries of each block stand among all free ones."""
    return spans(tuple(size * size for size in sizes))


@lru_cache(maxsize=64)
def _entries(sizes: Sizes) -> IntArray:
    """Return the places of the free entries in a matrix that is written row by row. Shape (m,)."""
    places = np.arange(sum(sizes) ** 2).reshape(sum(sizes), -1)
    return np.concatenate([places[span, span].ravel() for span in spans(sizes)])


def free(matrices: FloatArray, sizes: Sizes) -> FloatArray:
    """Return the free entries (..., m) of matrices (..., d, d)."""
    flat = matrices.reshape(*matrices.shape[:-2], -1)
    return np.take(flat, _entries(sizes), axis=-1)


def filled(entries: FloatArray, sizes: Sizes) -> FloatArray:
    """Return the matrices (..., d, d) with these free entries (..., m)."""
    d = sum(sizes)
    flat = np.zeros((*entries.shape[:-1], d * d))
    flat[..., _entries(sizes)] = entries
    return flat.reshape(*entries.shape[:-1], d, d)
