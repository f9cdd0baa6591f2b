"""How fast linear components contract in a Lyapunov norm: floating-point estimates, never proofs."""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray


def decay_rates(lyapunov: FloatArray, matrices: FloatArray, period: float = 0.0) -> FloatArray:
    r"""Return the rate at which each component ξ̇ = Aₖ (ξ − ξ*) shrinks the P-norm of ξ − ξ*.

    rₖ = λ_min(−½(P Aₖ + Aₖᵀ P), P), the largest r with V̇ ≤ −2 r V for V = (ξ − ξ*)ᵀ P (ξ − ξ*).
    With a period Δt, what steps ξ⁺ = ξ + Δt Aₖ (ξ − ξ*) leave of it: Δt Aₖᵀ P Aₖ is added to P Aₖ + Aₖᵀ P.
    Rounding may turn a rate of about 1e-15 ‖Aₖ‖ into the wrong sign: ``skillctl.stability`` proves.

    Args:
        lyapunov: P ≻ 0, shape (d, d).
        matrices: Aₖ, shape (K, d, d), [1/s].
        period: Δt ≥ 0, [s].

    Returns:
        Shape (K,), [1/s]; zero or less where V can grow.

    References:
        Generalised eigenvalue form of the SEDS condition (Eq. 5); ours for P other than I.
    """
    return _rates(_whitened(lyapunov, matrices), period)


def contraction_periods(lyapunov: FloatArray, matrices: FloatArray) -> FloatArray:
    r"""Return the longest step Δt for which ξ⁺ = ξ + Δt Aₖ (ξ − ξ*) does not increase V.

    With B = Lᵀ A L⁻ᵀ and P = L Lᵀ: P A + Aᵀ P + Δt Aᵀ P A ≺ 0 exactly when B⁻¹ + B⁻ᵀ ≺ −Δt I, so
    Δt = −λ_max(B⁻¹ + B⁻ᵀ): twice the decay rate of the inverse.

    Args:
        lyapunov: P ≻ 0, shape (d, d).
        matrices: Aₖ, shape (K, d, d), [1/s].

    Returns:
        Shape (K,), [s]; zero where V grows for every step.

    References:
        Theory page, discrete time (ours).
    """
    whitened = _whitened(lyapunov, matrices)
    periods = np.zeros(len(whitened))
    contracting = _rates(whitened) > 0  # such a matrix is Hurwitz, hence invertible
    inverses = np.asarray(np.linalg.inv(whitened[contracting]), dtype=np.float64)
    periods[contracting] = np.maximum(2 * _rates(inverses), 0.0)
    return periods


def _whitened(lyapunov: FloatArray, matrices: FloatArray) -> FloatArray:
    """Return Lᵀ Aₖ L⁻ᵀ: the same components in coordinates in which P is the identity."""
    factor = np.linalg.cholesky(lyapunov)
    return np.asarray(factor.T @ matrices @ np.linalg.inv(factor).T)


def _rates(whitened: FloatArray, period: float = 0.0) -> FloatArray:
    transposed = whitened.swapaxes(1, 2)
    changes = whitened + transposed
    if period > 0:  # zero times the square of a very large number is no number
        changes = changes + period * (transposed @ whitened)
    return np.asarray(-np.linalg.eigvalsh(0.5 * changes)[:, -1])
