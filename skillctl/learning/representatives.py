"""Which of many demonstrations are rolled out, in place of all."""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray, IntArray


def representatives(paths: FloatArray, most: int) -> tuple[IntArray, FloatArray]:
    """Return at most ``most`` demonstrations that stand for all, and the share of all that each stands for.

    First the one nearest to the mean of all, then, again and again, the one farthest from all chosen ones.
    Each of the others counts with the nearest chosen one.

    Args:
        paths: Demonstrations, sampled alike, shape (D, T, d).
        most: If there are no more, all stand for themselves.

    Returns:
        Indices, ascending, and shares, which sum to one.

    References:
        Gonzalez 1985, for the choice of the farthest.
    """
    count = len(paths)
    if count <= most:
        return np.arange(count), np.full(count, 1 / count)
    flat = paths.reshape(count, -1)
    first = int(((flat - flat.mean(axis=0)) ** 2).sum(axis=1).argmin())
    distances = [((flat - flat[first]) ** 2).sum(axis=1)]
    chosen = [first]
    while len(chosen) < most:
        chosen.append(int(np.min(distances, axis=0).argmax()))
        distances.append(((flat - flat[chosen[-1]]) ** 2).sum(axis=1))
    nearest = np.argmin(distances, axis=0)
    indices, shares = np.array(chosen), np.bincount(nearest, minlength=most) / count
    order = indices.argsort()
    return indices[order], shares[order]
