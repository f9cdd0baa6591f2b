"""The search for a common P keeps the best P that it knows; where that is the optimum, it is the answer."""

import numpy as np
import pytest
from scipy.linalg import eigh

from skillctl.compose.lyapunov import common_lyapunov

EPS = np.finfo(float).eps


def rate(p, matrices):
    """Return the slowest decay rate −½ λ_max(P⁻¹ (P A + Aᵀ P)), by SciPy's generalised eigenvalues."""
    return min(-0.5 * eigh(p @ a + a.T @ p, p, eigvals_only=True)[-1] for a in matrices)


def optimal(rng, d, k, stretch):
    """Return matrices and the P under which all decay at 1/s; none can do better, as the trace shows.

    A = −I + S with S skew under P: P A + Aᵀ P = −2 P. Under any P the slowest rate is at most −tr A / d = 1.
    """
    root = rng.normal(size=(d, d)) @ np.diag(np.geomspace(1, stretch, d))
    p = root.T @ root + 0.1 * np.eye(d)
    p = 0.5 * (p + p.T) * d / np.trace(p)
    turn = rng.normal(size=(k, d, d))
    return -np.eye(d) + np.linalg.solve(p, turn - turn.swapaxes(1, 2)), p


@pytest.mark.parametrize("d", [2, 3, 6])
@pytest.mark.parametrize("stretch", [1.0, 30.0])
def test_an_optimal_p_among_those_known_is_the_answer(d, stretch):
    rng = np.random.default_rng(d)
    for _ in range(5):
        matrices, p = optimal(rng, d, 4, stretch)
        others = [np.eye(d), np.diag(np.geomspace(1, 1e3, d))]
        found = common_lyapunov(matrices, known=[others[0], p, others[1]])
        # Entries of A in the coordinates of P, where the rate is computed, are rounded in those of the data.
        slack = 64 * d * EPS * np.linalg.cond(p) * np.abs(matrices).max()
        assert 1 - slack <= rate(found, matrices) <= 1 + slack


def test_a_known_p_is_kept_where_the_search_ends_at_a_worse_one():
    # Both matrices are symmetric with eigenvalues −1 and −3, so P = I shows the best rate there can be, 1/s.
    # The search maximises a margin, for which a P that weighs the slow direction of the first is better.
    matrices = np.array([np.diag([-1.0, -3.0]), [[-2.0, 1.0], [1.0, -2.0]]])
    found = common_lyapunov(matrices, known=[np.eye(2)])
    assert rate(found, matrices) >= 1 - 8 * EPS
