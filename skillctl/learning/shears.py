"""Shears from demonstrations: coordinates in which every motion comes nearer all the time (ours).

Along any solution V falls. In the measured state that is asked of ellipses; most motions that bend back do
not obey. Shears bend the ellipses instead, before the components are learned: the less a motion strays from
the direction in which y = φ(ξ) shrinks, the more freely a mixture can follow it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray, IntArray
from skillctl.geometry import segment_lengths
from skillctl.learning.outcome import Result, StageResult
from skillctl.model.coordinates.shears import Shears
from skillctl.workers.blas import one_blas_thread

# All tuned on the 30 LASA motions.
BUMPS = 13  # of a shear
REACH = 2.6  # bumps lie within this many rms distances of the target
BENDING = (0.05, 0.02)  # prices of ∫‖a′‖² of a shear that are tried
COEFFICIENTS, LINEAR = 1e-4, 1e-2  # prices of the squared coefficients, and of an L other than the identity
SHARPNESS = 20.0  # of the bend of the softplus, per unit of the cosine
SLACK = 0.2  # the cosine of y and ẏ should be below minus this
STEPS = 150  # of L-BFGS at most
POINTS = 420  # of all demonstrations together, of which each has 15 to 60
SHORT = 1e-12  # squared lengths are kept above it

GOLDEN = 0.5 * (1 + 5**0.5)


def directions(dimension: int) -> FloatArray:
    """Return unit vectors evenly spread over all directions, opposite ones counted once. Shape (m, d).

    In the plane every 30 degrees, in space the axes of the icosahedron, in more dimensions the axes.
    """
    if dimension == 2:
        angles = np.pi / 6 * np.arange(6)
        return np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if dimension == 3:
        corners = [np.roll([0.0, 1.0, sign * GOLDEN], shift) for shift in range(3) for sign in (1, -1)]
        return np.asarray(np.stack(corners) / np.hypot(1, GOLDEN))
    return np.eye(dimension)


def learn_shears(motions: Sequence[FloatArray], bending: float = BENDING[0]) -> tuple[Shears, StageResult]:
    """Return φ that makes the demonstrations of one motion, or of several at once, come steadily nearer.

    It minimises, over L and the coefficients,

        Σₙ ωₙ softplus(cos∠(yₙ, Δyₙ) + μ) + λ Σᵢ ∫‖aᵢ′‖² + small squares

    over the segments Δyₙ of the demonstrations around their middles yₙ, ωₙ the share of path. Any result is
    invertible, so one short of the optimum only costs accuracy.

    Args:
        motions: One array (D, T, d) or more, d > 1, relative to their targets, at rms distance about one.
        bending: λ, the price of bending.

    Returns:
        φ, scaled so that the rms distance of all y is one, and how the search ended.
    """
    from scipy.optimize import minimize

    search = _Search(motions, bending)
    with one_blas_thread():  # SciPy brings a BLAS of its own, which may have been loaded only now
        found = minimize(
            search.cost_and_slope,
            np.zeros(search.size),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": STEPS},
        )
    result = Result.CONVERGED if found.status == 0 else Result.OUT_OF_STEPS
    return search.shears(found.x), StageResult("coordinates", result, int(found.nit))


def samples_of(count: int) -> int:
    """Return how many points of each of ``count`` demonstrations the search looks at."""
    return int(np.clip(POINTS // count, 15, 60))


@dataclass(frozen=True, eq=False, slots=True)
class _Layer:
    """What one shear computed on the way forward: ψ − ψ(0) and ψ′ (n, J), and the coefficients (J, d)."""

    values: FloatArray
    slopes: FloatArray
    coefficients: FloatArray


class _Search:
    """The objective of ``learn_shears`` and its slope, by hand: forward, then back through the shears.

    Parameters: log of the diagonal of L, the rest of its upper triangle, and coefficients (m, J, d − 1) in a
    basis of the directions across each w_i.
    """

    def __init__(self, motions: Sequence[FloatArray], bending: float) -> None:
        self.dimension = d = motions[0].shape[-1]
        self.points = np.concatenate([motion.reshape(-1, d) for motion in motions])
        lengths = np.concatenate([segment_lengths(motion).ravel() for motion in motions])
        self.shares = lengths / lengths.sum()
        self.first = _first_points(motions)
        self.directions = directions(d)
        self.across = np.stack([np.linalg.svd(w[None])[2][1:] for w in self.directions])  # (m, d − 1, d)
        self.centres = np.linspace(-REACH, REACH, BUMPS)
        self.spacing = self.centres[1] - self.centres[0]
        self.at_zero = bump_values(-self.centres / self.spacing)[0]
        self.bending = bending * _bending(BUMPS) / self.spacing
        self.upper = np.triu_indices(d, 1)
        self.linear = d + len(self.upper[0])
        self.shape = len(self.directions), BUMPS, d - 1
        self.size = self.linear + int(np.prod(self.shape))

    def split(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return L (d, d) and the coefficients across (m, J, d − 1)."""
        linear = np.diag(np.exp(parameters[: self.dimension]))
        linear[self.upper] = parameters[self.dimension : self.linear]
        return linear, parameters[self.linear :].reshape(self.shape)

    def forward(self, parameters: FloatArray) -> tuple[FloatArray, list[_Layer]]:
        """Return y of all points, shape (n, d), and what each shear computed."""
        linear, across = self.split(parameters)
        y, layers = self.points @ linear.T, []
        for w, c in zip(self.directions, across @ self.across, strict=True):
            values, slopes = bump_values((y @ w)[:, None] / self.spacing - self.centres / self.spacing)
            layers.append(_Layer(values - self.at_zero, slopes / self.spacing, c))
            y = y + layers[-1].values @ c
        return y, layers

    def cost_and_slope(self, parameters: FloatArray) -> tuple[float, FloatArray]:
        """Return the objective, and its derivative by the parameters (p,)."""
        y, layers = self.forward(parameters)
        cost, pull = self._turning(y)
        linear, across = self.split(parameters)
        bent = np.einsum("jk,mki->mji", self.bending, across) + COEFFICIENTS * across
        squares = parameters[: self.linear]
        cost += float((across * bent).sum()) + LINEAR * float(squares @ squares)
        by_across = 2 * bent
        for i in reversed(range(len(layers))):
            by_across[i] += layers[i].values.T @ (pull @ self.across[i].T)
            stretch = ((layers[i].slopes @ layers[i].coefficients) * pull).sum(axis=1)
            pull = pull + np.outer(stretch, self.directions[i])
        by_linear = pull.T @ self.points
        slopes = (by_linear.diagonal() * linear.diagonal(), by_linear[self.upper])
        return cost, np.concatenate([np.concatenate(slopes) + 2 * LINEAR * squares, by_across.ravel()])

    def _turning(self, y: FloatArray) -> tuple[float, FloatArray]:
        """Return the first sum of the objective, and its derivative by y (n, d)."""
        before, after = y[self.first], y[self.first + 1]
        middle, step = 0.5 * (before + after), after - before
        middle_squared = np.maximum((middle * middle).sum(axis=1), SHORT)[:, None]
        step_squared = np.maximum((step * step).sum(axis=1), SHORT)[:, None]
        lengths = np.sqrt(middle_squared * step_squared)
        cosine = (middle * step).sum(axis=1)[:, None] / lengths
        z = SHARPNESS * (cosine[:, 0] + SLACK)
        weight = (self.shares / (1 + np.exp(-z)))[:, None]
        by_middle = weight * (step / lengths - cosine / middle_squared * middle)
        by_step = weight * (middle / lengths - cosine / step_squared * step)
        pull = np.zeros_like(y)
        pull[self.first] += 0.5 * by_middle - by_step
        pull[self.first + 1] += 0.5 * by_middle + by_step
        return float(self.shares @ np.logaddexp(0, z)) / SHARPNESS, pull

    def shears(self, parameters: FloatArray) -> Shears:
        """Return φ of the parameters, scaled so that the rms distance of all y is one."""
        y, _ = self.forward(parameters)
        scale = 1 / float(np.sqrt(np.mean((y * y).sum(axis=1))))
        linear, across = self.split(parameters)
        m = len(self.directions)
        first, spacing = scale * self.centres[0], scale * self.spacing
        coefficients = scale * across @ self.across
        return Shears(scale * linear, self.directions, np.full(m, first), np.full(m, spacing), coefficients)


def _first_points(motions: Sequence[FloatArray]) -> IntArray:
    """Return the index of the first point of each segment, in all points stacked."""
    starts, offset = [], 0
    for motion in motions:
        index = offset + np.arange(motion.shape[0] * motion.shape[1]).reshape(motion.shape[:2])
        starts.append(index[:, :-1].ravel())
        offset += index.size
    return np.concatenate(starts)


def _bending(bumps: int) -> FloatArray:
    """Return ∫ ψ_i′ ψ_j′ of bumps one apart, shape (J, J): that of cubic B-splines in closed form."""
    row = np.zeros(bumps)
    row[:4] = [2 / 3, -1 / 8, -1 / 5, -1 / 120]
    return row[np.abs(np.subtract.outer(np.arange(bumps), np.arange(bumps)))]


def bump_values(places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the cubic B-spline and its slope at places, in spacings from its centre; in the same shape."""
    distance = np.abs(places)
    near, far = np.minimum(distance, 1.0), np.clip(2.0 - distance, 0.0, 1.0)
    values = np.where(distance < 1, (4 + near**2 * (3 * near - 6)) / 6, far**3 / 6)
    slopes = np.where(distance < 1, near * (1.5 * near - 2), -0.5 * far**2)
    return values, np.sign(places) * slopes
