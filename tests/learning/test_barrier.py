from __future__ import annotations

import cvxpy
import numpy as np
import pytest

from skillctl.learning.barrier import StabilityBarrier, constrained_regression, strictly_inside

RATE = 0.05


def random_spd(generator: np.random.Generator, d: int) -> np.ndarray:
    root = generator.standard_normal((d, d))
    return root @ root.T + 0.3 * np.eye(d)


def stable(generator: np.random.Generator, barrier: StabilityBarrier, k: int) -> np.ndarray:
    """Half-way between −I and something at most at the wall: inside by convexity."""
    d = len(barrier.lyapunov)
    return 0.5 * (strictly_inside(generator.standard_normal((k, d, d)), barrier) - np.eye(d))


@pytest.mark.parametrize("period", [0.0, 0.2])
@pytest.mark.parametrize("d", [1, 2, 3, 6])
def test_gradient_and_hessian_agree_with_finite_differences(d: int, period: float) -> None:
    generator = np.random.default_rng(d)
    barrier = StabilityBarrier(random_spd(generator, d), RATE, period)
    matrices = stable(generator, barrier, 3)
    gradient, hessian = barrier.derivatives(matrices)

    step = 1e-5
    for index in range(d * d):
        unit = np.zeros(d * d)
        unit[index] = step
        ahead, behind = matrices + unit.reshape(d, d), matrices - unit.reshape(d, d)
        numeric = (barrier.value(ahead) - barrier.value(behind)) / (2 * step)
        numeric_slope = (barrier.derivatives(ahead)[0] - barrier.derivatives(behind)[0]) / (2 * step)
        # Central differences: error step² times the third derivative, which grows as slack⁻³ ~ 10³.
        np.testing.assert_allclose(gradient[:, index], numeric, rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(hessian[:, :, index], numeric_slope, rtol=1e-4, atol=1e-3)


def test_the_barrier_is_infinite_outside() -> None:
    barrier = StabilityBarrier(np.eye(2), RATE)
    matrices = np.array([-np.eye(2), -0.9 * RATE * np.eye(2), np.eye(2)])
    assert np.isfinite(barrier.value(matrices)).tolist() == [True, False, False]


def test_inside_the_barrier_one_controller_step_contracts() -> None:
    # V(ξ + Δt A ξ) ≤ (1 − 2 ε Δt) V(ξ): the definition, written without the barrier's own algebra.
    generator = np.random.default_rng(5)
    period = 0.3
    barrier = StabilityBarrier(random_spd(generator, 3), RATE, period)
    states = generator.standard_normal((500, 3))
    for matrix in strictly_inside(3 * generator.standard_normal((20, 3, 3)), barrier):
        after = states + period * states @ matrix.T
        before_v = np.einsum("ni,ij,nj->n", states, barrier.lyapunov, states)
        after_v = np.einsum("ni,ij,nj->n", after, barrier.lyapunov, after)
        assert (after_v < (1 - 2 * RATE * period) * before_v).all()


def test_a_step_is_shortened_until_it_stays_inside() -> None:
    generator = np.random.default_rng(3)
    barrier = StabilityBarrier(random_spd(generator, 3), RATE, 0.1)
    matrices = stable(generator, barrier, 4)
    for scale in (1e-3, 1.0, 1e3):
        direction = scale * generator.standard_normal(matrices.shape)
        share = barrier.feasible_share(matrices, direction)
        assert 0 < share <= 1
        assert np.isfinite(barrier.value(matrices + share * direction)).all()
    assert barrier.feasible_share(matrices, np.zeros_like(matrices)) == 1.0


@pytest.mark.parametrize("d", [2, 3])
def test_constrained_regression_agrees_with_a_convex_solver(d: int) -> None:
    generator = np.random.default_rng(10 + d)
    lyapunov = random_spd(generator, d)
    lyapunov *= d / np.trace(lyapunov)
    barrier = StabilityBarrier(lyapunov, RATE)
    positions = generator.standard_normal((60, d))
    truth = generator.standard_normal((d, d))  # not stable in general: the constraint is active
    velocities = positions @ truth.T + 0.1 * generator.standard_normal((60, d))
    gram, cross = positions.T @ positions, velocities.T @ positions

    (ours,) = constrained_regression(gram[None], cross[None], np.eye(d)[None], barrier, final_weight=1e-7)

    unknown = cvxpy.Variable((d, d))
    product = lyapunov @ unknown
    constraint = -(product + product.T) / 2 - RATE * lyapunov >> 0
    problem = cvxpy.Problem(
        cvxpy.Minimize(cvxpy.sum_squares(positions @ unknown.T - velocities)), [constraint]
    )
    problem.solve(solver=cvxpy.CLARABEL)
    # A log-det barrier of weight w over d dimensions leaves a gap of at most w · d (here relative to the
    # trace of the Gram matrix), and the problem is strongly convex with the Gram matrix's smallest value.
    gap = 1e-7 * np.trace(gram) / d * d
    distance = np.sqrt(2 * gap / np.linalg.eigvalsh(gram)[0])
    np.testing.assert_allclose(ours, unknown.value, atol=distance + 1e-4)
    assert np.linalg.eigvalsh(barrier.slack(ours)).min() > 0


def test_an_inactive_constraint_leaves_ordinary_least_squares() -> None:
    generator = np.random.default_rng(4)
    truth = np.array([[-2.0, 0.5], [-0.5, -1.0]])
    positions = generator.standard_normal((200, 2))
    velocities = positions @ truth.T
    gram, cross = positions.T @ positions, velocities.T @ positions
    (ours,) = constrained_regression(
        gram[None], cross[None], np.eye(2)[None], StabilityBarrier(np.eye(2), RATE), final_weight=1e-8
    )
    # The barrier's pull: its weight times its gradient (about 1/slack ~ 2) over the Gram matrix.
    np.testing.assert_allclose(ours, truth, atol=1e-6)


@pytest.mark.parametrize("seed", [0, 2, 5, 12, 16])
def test_a_badly_conditioned_metric_does_not_end_next_to_the_wall(seed: int) -> None:
    generator = np.random.default_rng(seed)
    positions = generator.standard_normal((40, 3)) * [0.02, 0.3, 0.3]
    velocities = positions @ (20 * generator.standard_normal((3, 3))).T
    gram, cross = positions.T @ positions + 1e-3 * np.eye(3), velocities.T @ positions
    axes, _ = np.linalg.qr(generator.standard_normal((3, 3)))
    barrier = StabilityBarrier(axes @ np.diag([2e-5, 7e-3, 3.0]) @ axes.T, 0.03, 0.01)
    (matrix,) = constrained_regression(gram[None], cross[None], np.eye(3)[None], barrier, final_weight=1e-4)
    assert np.linalg.eigvalsh(barrier.slack(matrix)).min() > 0

    def error(candidate: np.ndarray) -> float:
        return float(((velocities - positions @ candidate.T) ** 2).sum())

    assert error(matrix) < error(-np.eye(3))  # which is inside whatever the metric
