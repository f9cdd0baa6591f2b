"""The stability constraint as a log-det barrier, and the constrained regression it makes convex.

With V = ξᵀPξ, component k is stable at rate ε, and stays so under a controller of period Δt, when
S_k = −½(P A_k + A_kᵀ P + Δt A_kᵀ P A_k) − ε P ≻ 0 (ours; Δt = 0 is the continuous condition). The set of
such A_k is convex, and the barrier −Σ_k log det S_k is finite exactly there, so every iterate that has a
finite objective is stable.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skillctl.arrays import BoolArray, FloatArray
from skillctl.learning.blocks import Sizes, filled, free, free_spans, spans

CLEARANCE = 0.99  # share of the way from −I to the wall at which Newton's method may start
KEPT = 0.01  # share of its slack that a Newton step leaves at least
RIDGE = 1e-13  # of a scaled Hessian; far below what a well conditioned problem would notice
ROUNDING = 1e-13  # an eigenvalue this small beside the largest may be zero or negative
DONE = 1e-3  # Newton decrement, in units of the barrier's weight, at which a level of the path is left


class StabilityBarrier:
    """−Σ_k log det S_k(A) with S_k = −½(P A_k + A_kᵀ P + Δt A_kᵀ P A_k) − ε P, and its derivatives.

    Args:
        lyapunov: P, shape (d, d).
        rate: ε ≥ 0, in 1 / time.
        period: Δt ≥ 0, in time.
        blocks: Sizes of the blocks of A_k, and of P, whose entries are free; default: one block.
    """

    def __init__(self, lyapunov: FloatArray, rate: float, period: float = 0.0, blocks: Sizes = ()) -> None:
        self.lyapunov = lyapunov
        self.blocks = blocks or (len(lyapunov),)
        self.rate = rate
        self.period = period

    def slack(self, matrices: FloatArray) -> FloatArray:
        """Return S_k for matrices (..., d, d), in the same shape."""
        product = self.lyapunov @ matrices
        step = self.period * (matrices.swapaxes(-1, -2) @ product)
        return np.asarray(-0.5 * (product + product.swapaxes(-1, -2) + step) - self.rate * self.lyapunov)

    def value(self, matrices: FloatArray) -> FloatArray:
        """Return −log det S_k, infinite where S_k is not clearly positive definite. Shape (...)."""
        slack = self.slack(matrices)
        eigenvalues = np.linalg.eigvalsh(slack)
        inside = eigenvalues[..., 0] > ROUNDING * np.abs(eigenvalues[..., -1])
        logs = np.log(np.where(inside[..., None], eigenvalues, 1.0)).sum(axis=-1)
        return np.where(inside, -logs, np.inf)

    def feasible_share(self, matrices: FloatArray, direction: FloatArray) -> float:
        """Return a share of the direction that keeps every S_k ≻ 0: all of it, or 0.9 of what fits."""
        if np.isfinite(self.value(matrices + direction)).all():
            return 1.0
        share = 1.0
        for _ in range(60):
            share *= 0.7
            if np.isfinite(self.value(matrices + share * direction)).all():
                break
        return 0.9 * share

    def derivatives(self, matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return gradient (K, m) and Hessian (K, m, m) with respect to the free entries of each A_k.

        dS = −½(BᵀU + UᵀB) with B = P(I + Δt A), d²S = −Δt UᵀPU. So the gradient is B S⁻¹, and
        D²[U, U] = tr(S⁻¹ dS S⁻¹ dS) + Δt tr(S⁻¹ UᵀPU).
        """
        k, d, _ = matrices.shape
        inverse = np.linalg.inv(self.slack(matrices))
        inverse = 0.5 * (inverse + inverse.swapaxes(1, 2))
        factor = self.lyapunov @ (np.eye(d) + self.period * matrices)
        gradient = factor @ inverse
        double = gradient @ factor.swapaxes(1, 2) + 2 * self.period * self.lyapunov
        # ½ [ (B S⁻¹ Bᵀ + 2 Δt P)_{ia} (S⁻¹)_{jb} + (B S⁻¹)_{ib} (B S⁻¹)_{aj} ] for the pair U_ij, U_ab
        slopes = free(gradient, self.blocks)
        hessian = np.zeros((*slopes.shape, slopes.shape[1]))
        for span, place in zip(spans(self.blocks), free_spans(self.blocks), strict=True):
            size = place.stop - place.start
            outer, inner, mixed = (each[:, span, span] for each in (double, inverse, gradient))
            block = 0.5 * (
                np.einsum("kia,kjb->kijab", outer, inner) + np.einsum("kib,kaj->kijab", mixed, mixed)
            )
            hessian[:, place, place] = block.reshape(k, size, size)
        return slopes, hessian


def strictly_inside(matrices: FloatArray, barrier: StabilityBarrier) -> FloatArray:
    """Return the matrices, each moved towards −I until it is clearly inside the barrier.

    The set is convex and holds −I (in the learner's units), so that some share of the way from −I is inside;
    a little less of it is inside by a margin from which Newton's method can start.
    """
    centre = -np.eye(matrices.shape[-1])
    share = np.ones(matrices.shape[:-2])
    for _ in range(60):
        inside = np.isfinite(barrier.value(centre + share[..., None, None] * (matrices - centre)))
        if inside.all():
            break
        share = np.where(inside, share, 0.8 * share)
    share = CLEARANCE * share
    return np.asarray(centre + share[..., None, None] * (matrices - centre))


def constrained_regression(
    gram: FloatArray,
    cross: FloatArray,
    precisions: FloatArray,
    barrier: StabilityBarrier,
    *,
    start: FloatArray | None = None,
    final_weight: float = 1e-5,
) -> FloatArray:
    """Return argmin_A ½ Σ_i w_i (v_i − A x_i)ᵀ C⁻¹ (v_i − A x_i) over stable A, for K problems at once.

    A log-det barrier Newton method: the barrier's weight falls by ten until ``final_weight``; each
    iterate stays strictly stable.

    Args:
        gram: Σ w x xᵀ, shape (K, d, d), positive definite.
        cross: Σ w v xᵀ, shape (K, d, d).
        precisions: C⁻¹, shape (K, d, d).
        barrier: The constraint.
        start: Strictly stable A to start from; default: the unconstrained solution, shifted inside.
        final_weight: Weight of the barrier at the end, relative to the trace of ``gram`` per dimension.

    Returns:
        A, shape (K, d, d), strictly stable.
    """
    d, blocks = gram.shape[1], barrier.blocks
    linear = free(precisions @ cross, blocks)
    if start is None:
        unbound = np.asarray(np.linalg.solve(gram, cross.swapaxes(1, 2)).swapaxes(1, 2), dtype=np.float64)
        start, first_level = unbound * filled(np.ones(linear.shape[1]), blocks), -1
    else:  # an earlier solution is near the central path at a lower weight already
        first_level = -3
    matrices = strictly_inside(start, barrier)
    quadratic = free(np.einsum("kia,kjb->kabij", precisions, gram), blocks)
    quadratic = free(quadratic.transpose(0, 3, 1, 2), blocks)
    scale = np.trace(gram @ precisions, axis1=1, axis2=2) / d

    def cost(candidates: FloatArray, weight: FloatArray) -> FloatArray:
        flat = free(candidates, blocks)
        smooth = 0.5 * np.einsum("ki,kij,kj->k", flat, quadratic, flat) - np.einsum("ki,ki->k", linear, flat)
        return np.asarray(smooth + weight * barrier.value(candidates))

    for level in 10.0 ** np.arange(first_level, np.log10(final_weight) - 0.5, -1):
        weight = level * scale
        value = cost(matrices, weight)
        for _ in range(8):
            gradient, hessian = barrier.derivatives(matrices)
            slope = np.einsum("kij,kj->ki", quadratic, free(matrices, blocks)) - linear
            slope = slope + weight[:, None] * gradient
            # Newton's decrement, slopeᵀ Hessian⁻¹ slope, is twice the gain that the quadratic model promises.
            step = -_solved(quadratic + weight[:, None, None] * hessian, slope)
            decrement = -np.einsum("ki,ki->k", slope, step)
            active = decrement > DONE * weight
            if not active.any():
                break
            matrices, value = _line_search(
                cost, barrier, matrices, value, filled(step, blocks), decrement, active, weight
            )
    return matrices


def _solved(curvatures: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return H⁻¹ slope of K positive definite matrices, (K, m, m) and (K, m).

    Near the wall of a badly conditioned P entries of H differ by ten orders of magnitude and more. With a
    diagonal of ones (Jacobi's scaling) and ``RIDGE`` added to it, H is never singular.
    """
    roots = np.sqrt(np.diagonal(curvatures, axis1=1, axis2=2))
    scaled = curvatures / (roots[:, :, None] * roots[:, None]) + RIDGE * np.eye(roots.shape[1])
    return np.asarray(np.linalg.solve(scaled, (slopes / roots)[..., None])[..., 0] / roots)


def _line_search(
    cost: Callable[[FloatArray, FloatArray], FloatArray],
    barrier: StabilityBarrier,
    matrices: FloatArray,
    value: FloatArray,
    step: FloatArray,
    decrement: FloatArray,
    active: BoolArray,
    weight: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return each problem's matrices and cost after backtracking along its Newton step.

    No step takes more than all but ``KEPT`` of the slack in any direction, or iterates could jump next to the
    wall, from where Newton's method cannot get away.
    """
    length, kept = np.ones(len(matrices)), KEPT * barrier.slack(matrices)
    for _ in range(20):
        trial = matrices + length[:, None, None] * step
        trial_value = cost(trial, weight)
        clear = np.linalg.eigvalsh(barrier.slack(trial) - kept)[:, 0] > 0
        better = clear & (trial_value <= value - 0.1 * length * decrement)
        if (better | ~active).all():
            break
        length = np.where(better, length, 0.5 * length)
    taken = better & active
    return np.where(taken[:, None, None], trial, matrices), np.where(taken, trial_value, value)
