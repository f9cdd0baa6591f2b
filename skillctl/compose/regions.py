"""Where each part of a combined skill acts: regions that hold for starts nobody demonstrated, too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.model.mixture import GaussianMixture, joined, softmax
from skillctl.model.skill import extent

# Shares of a region: the path as it was taught, the places where motions start, and the far surroundings of
# those places and of the path. Tuned on left-out demonstrations of the 30 LASA motions and seven hand-guided
# sets; with equal shares as many starts select their part, of places along the path one in a hundred fewer.
PATH, STARTS, FAR_STARTS, FAR_PATH = 0.5, 0.4, 0.09, 0.01
# A start lies about this far from others, in extents of its skill: the median of those sets (0.5 to 5 %).
USUAL_WIDTH = 0.025
MOST_STARTS = 20  # of a part; more cost time at each selection and hardly move a border
STEPS, TOLERANCE = 200, 1e-6  # of the search for the width


def regions(
    densities: Sequence[GaussianMixture], starts: Sequence[FloatArray | None]
) -> tuple[GaussianMixture, ...]:
    """Return one mixture per part that says how likely a motion that the part should drive is at ξ.

    rᵢ(ξ) = 0.5 pᵢ(ξ) + 0.4 N̄(ξ; sᵢ, h) + 0.09 N̄(ξ; sᵢ, S) + 0.01 N̄(ξ; μᵢ, S), where N̄(ξ; c, h) is the mean of
    the isotropic Gaussians of width h around points c, sᵢ are the demonstrated starts of part i, μᵢ the means
    of its position density pᵢ, h is ``start_width`` and S the largest standard deviation of any pᵢ.

    Position densities alone are no guide for a new start: far from the data the widest Gaussian wins, however
    far it is, and a part whose motion ends somewhere claims that place from another that begins there. Here
    all parts have one width far out, so that the nearest part acts, and starts count as much as paths do.

    Args:
        densities: pᵢ.
        starts: sᵢ, shape (n, d), one array a part; None where they are not known, and means stand for them.

    References:
        Section 3.2 of the paper has pᵢ alone; the rest is ours.
    """
    known = [None if places is None else _fewer(places) for places in starts]
    usual = USUAL_WIDTH * min(map(extent, densities))
    width = start_width([places for places in known if places is not None and len(places) > 1], usual)
    widest = max(float(np.linalg.eigvalsh(density.covariances).max()) for density in densities) ** 0.5
    far = max(widest, width)
    found = []
    for density, places in zip(densities, known, strict=True):
        centres = density.means if places is None else places
        members = density, _around(centres, width), _around(centres, far), _around(density.means, far)
        found.append(joined(members, np.array([PATH, STARTS, FAR_STARTS, FAR_PATH])))
    return tuple(found)


def start_width(starts: Sequence[FloatArray], usual: float) -> float:
    """Return the h with which the starts of each part are most likely, each given the others of its part.

    It maximises Σᵢ Σⱼ log Σ_{l≠j} N(sⱼ; sₗ, h²) by expectation and maximisation. One imagined start that lies
    ``usual`` from its neighbour along each axis counts, too, so that parts of one demonstration have a width,
    and equal starts do not make it vanish.

    Args:
        starts: One array (n, d) of at least two starts a part; parts of which less is known are left out.
        usual: [unit].
    """
    dimension = starts[0].shape[1] if starts else 1
    squares = [_squares_to_others(places) for places in starts]
    count = 1 + sum(distances.shape[1] for distances in squares)
    variance = usual**2
    for _ in range(STEPS):
        total = dimension * usual**2
        total += sum(float((softmax(-0.5 * distances / variance) * distances).sum()) for distances in squares)
        before, variance = variance, total / (dimension * count)
        if abs(variance - before) <= TOLERANCE * before:
            break
    return float(np.sqrt(variance))


def _squares_to_others(places: FloatArray) -> FloatArray:
    """Return the squared distances from each place (n, d) to the others. Shape (n − 1, n)."""
    n = len(places)
    distances = ((places[:, None] - places) ** 2).sum(axis=2)
    return np.asarray(distances[~np.eye(n, dtype=np.bool_)].reshape(n, n - 1).T)


def _fewer(places: FloatArray) -> FloatArray:
    """Return at most ``MOST_STARTS`` of the places, evenly from first to last."""
    picked = np.linspace(0, len(places) - 1, min(len(places), MOST_STARTS)).round().astype(int)
    return np.asarray(places[picked])


def _around(centres: FloatArray, width: float) -> GaussianMixture:
    """Return N̄: equal isotropic Gaussians around centres (n, d)."""
    n, d = centres.shape
    return GaussianMixture(np.full(n, 1 / n), centres, np.tile(width**2 * np.eye(d), (n, 1, 1)))
