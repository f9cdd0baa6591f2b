"""The convex search behind a common Lyapunov matrix: a log-det barrier method, in NumPy."""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray

GAP = 1e-2  # relative: a P within a hundredth of the best margin is good enough
RESOLUTION = 1e-9  # a margin below this share of the matrices' size counts as zero
GROWTH = 8.0  # of the barrier parameter between two centrings
NEWTON_STEPS = 50  # per centring; about ten are used


def minimise_largest_eigenvalue(matrices: FloatArray, period: float = 0.0) -> FloatArray | None:
    """Return P ≻ 0 with trace d and L(P) ≺ 0 for all k, nearly as far inside as possible, or None.

    L(P) = P Aₖ + Aₖᵀ P + Δt Aₖᵀ P Aₖ is linear in P. Minimises s subject to s I − L(P) ≻ 0 and P ≻ 0: for
    growing τ, Newton's method on τ s − Σ log det of both. Near a centre, s exceeds the optimum by at most
    (ν + √ν) / τ, ν = (K + 1) d, so a centre with s above that bound shows that there is no such P. The
    result is also None if the best margin is not larger than rounding errors.

    Args:
        matrices: Aₖ of size about 1, shape (K, d, d).
        period: Δt ≥ 0, in the time unit of the matrices.

    References:
        S. Boyd & L. Vandenberghe, Convex Optimization (2004), section 11.6.
    """
    constant, directions = _inequalities(matrices, period)
    point = np.zeros(len(directions))
    point[0] = 1.0 + float(np.linalg.eigvalsh(-constant[:-1]).max())  # strictly feasible with P = I
    order = constant.shape[0] * constant.shape[1]
    tau = float(order)
    while True:
        try:
            point = _centred(point, tau, constant, directions)
        except np.linalg.LinAlgError:  # rounding stops the search: the point reached so far is the answer
            gap = 0.0
        else:
            gap = (order + np.sqrt(order)) / tau
        s = float(point[0])
        if s < 0 and gap < max(GAP * -s, RESOLUTION):
            return np.asarray((constant + np.tensordot(point, directions, axes=1))[-1])
        if s > gap or gap < RESOLUTION:
            return None
        tau *= GROWTH


def _inequalities(matrices: FloatArray, period: float) -> tuple[FloatArray, FloatArray]:
    """Return C (K+1, d, d) and D (n, K+1, d, d): the inequalities are C + Σᵢ xᵢ Dᵢ ≻ 0.

    x₀ = s; the others are coordinates of P − I in a basis of the symmetric matrices without trace.
    """
    d = matrices.shape[1]
    basis = _traceless_symmetric(d)
    identity = np.eye(d)
    transposed = matrices.swapaxes(1, 2)
    constant = np.concatenate([-(matrices + transposed + period * (transposed @ matrices)), identity[None]])
    products = basis[:, None] @ matrices  # (n - 1, K, d, d)
    changes = products + products.swapaxes(2, 3) + period * (transposed @ products)
    directions = np.concatenate([-0.5 * (changes + changes.swapaxes(2, 3)), basis[:, None]], axis=1)
    slack = np.concatenate([np.tile(identity, (len(matrices), 1, 1)), np.zeros((1, d, d))])
    return constant, np.concatenate([slack[None], directions])


def _traceless_symmetric(d: int) -> FloatArray:
    """Return a basis of the symmetric (d, d) matrices without trace. Shape (d(d+1)/2 − 1, d, d)."""
    basis = []
    for i in range(d):
        for j in range(i + 1, d):
            element = np.zeros((d, d))
            element[i, j] = element[j, i] = np.sqrt(0.5)
            basis.append(element)
    for i in range(1, d):
        element = np.zeros((d, d))
        element[range(i), range(i)] = 1.0
        element[i, i] = -i
        basis.append(element / np.linalg.norm(element))
    return np.array(basis).reshape(-1, d, d)


def _centred(point: FloatArray, tau: float, constant: FloatArray, directions: FloatArray) -> FloatArray:
    """Return the minimiser of τ x₀ − Σ log det (C + Σ xᵢ Dᵢ), to a Newton decrement of 0.1.

    Raises LinAlgError where rounding keeps it from getting there.
    """
    for _ in range(NEWTON_STEPS):
        factors = np.linalg.inv(np.linalg.cholesky(constant + np.tensordot(point, directions, axes=1)))
        whitened = factors @ directions @ factors.swapaxes(1, 2)  # (n, K+1, d, d)
        gradient = -np.trace(whitened, axis1=2, axis2=3).sum(axis=1)
        gradient[0] += tau
        rows = whitened.reshape(len(point), -1)
        step = -np.linalg.solve(rows @ rows.T, gradient)
        if -float(gradient @ step) < 0.1**2:
            return point
        eigenvalues = np.linalg.eigvalsh(np.tensordot(step, whitened, axes=1))
        point = point + _step_length(tau * float(step[0]), eigenvalues.ravel()) * step
    raise np.linalg.LinAlgError("Newton's method stalled.")


def _step_length(slope: float, eigenvalues: FloatArray) -> float:
    """Return the minimiser over t > 0 of slope · t − Σ log(1 + t λ), by bisection of its derivative."""
    low, high = 0.0, 1.0 / max(-float(eigenvalues.min()), 1e-12)
    for _ in range(20):
        middle = 0.5 * (low + high)
        descending = slope < float((eigenvalues / (1.0 + middle * eigenvalues)).sum())
        low, high = (middle, high) if descending else (low, middle)
    return low
