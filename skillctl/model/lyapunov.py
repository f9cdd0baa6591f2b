"""V as an object: its value, and how fast linear components make it fall. Estimates, never proofs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray, Frozen, frozen_array, require_moderate, require_spd
from skillctl.geometry import squared_norms


@dataclass(frozen=True, eq=False, slots=True)
class QuadraticForm(Frozen):
    r"""V(y) = yᵀ P y for the offset y of a state from the attractor, in the skill's coordinates.

    Attributes:
        matrix: P, symmetric positive definite, shape (d, d).

    References:
        Eq. 5 is the case P = I; other P, rates and periods are ours (theory page, stability).
    """

    matrix: FloatArray

    def __post_init__(self) -> None:
        matrix = frozen_array("lyapunov", self.matrix, (None, None))
        object.__setattr__(self, "matrix", frozen_array("lyapunov", matrix, (len(matrix),) * 2))
        require_spd("lyapunov", self.matrix)
        require_moderate("lyapunov", self.matrix)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, QuadraticForm) and bool(np.array_equal(self.matrix, other.matrix))

    def __hash__(self) -> int:
        return hash(self.matrix.tobytes())

    def value(self, offsets: FloatArray) -> FloatArray:
        """Return V for offsets (n, d). Shape (n,)."""
        return squared_norms(offsets, self.matrix)

    def distance(self, offsets: FloatArray) -> FloatArray:
        """Return the P-norm √V of offsets (n, d). Shape (n,)."""
        return np.asarray(np.sqrt(self.value(offsets)))

    def rates(self, matrices: FloatArray, period: float = 0.0) -> FloatArray:
        r"""Return the rate at which each component ẏ = Aₖ y shrinks the P-norm of y.

        rₖ = λ_min(−½(P Aₖ + Aₖᵀ P), P), the largest r with V̇ ≤ −2 r V. With a period Δt, what steps
        y⁺ = y + Δt Aₖ y leave of it: Δt Aₖᵀ P Aₖ is added to P Aₖ + Aₖᵀ P. Rounding may turn a rate of about
        1e-15 ‖Aₖ‖ into the wrong sign: ``skillctl.stability`` proves.

        Args:
            matrices: Aₖ, shape (K, d, d), [1/s].
            period: Δt ≥ 0, [s].

        Returns:
            Shape (K,), [1/s]; zero or less where V can grow.

        Raises:
            LinAlgError: P is singular to working precision.
        """
        return _rates(self._whitened(matrices), period)

    def periods(self, matrices: FloatArray) -> FloatArray:
        r"""Return the longest step Δt for which y⁺ = y + Δt Aₖ y does not increase V.

        With B = Lᵀ A L⁻ᵀ and P = L Lᵀ: P A + Aᵀ P + Δt Aᵀ P A ≺ 0 exactly when B⁻¹ + B⁻ᵀ ≺ −Δt I, so
        Δt = −λ_max(B⁻¹ + B⁻ᵀ): twice the decay rate of the inverse.

        Args:
            matrices: Aₖ, shape (K, d, d), [1/s].

        Returns:
            Shape (K,), [s]; zero where V grows for every step.
        """
        whitened = self._whitened(matrices)
        periods = np.zeros(len(whitened))
        contracting = _rates(whitened) > 0  # such a matrix is Hurwitz, hence invertible
        inverses = np.asarray(np.linalg.inv(whitened[contracting]), dtype=np.float64)
        periods[contracting] = np.maximum(2 * _rates(inverses), 0.0)
        return periods

    def _whitened(self, matrices: FloatArray) -> FloatArray:
        """Return Lᵀ Aₖ L⁻ᵀ: the same components in coordinates in which P is the identity."""
        factor = np.linalg.cholesky(self.matrix)
        return np.asarray(factor.T @ matrices @ np.linalg.inv(factor).T)


def _rates(whitened: FloatArray, period: float = 0.0) -> FloatArray:
    transposed = whitened.swapaxes(1, 2)
    changes = whitened + transposed
    if period > 0:  # zero times the square of a very large number is no number
        changes = changes + period * (transposed @ whitened)
    return np.asarray(-np.linalg.eigvalsh(0.5 * changes)[:, -1])
