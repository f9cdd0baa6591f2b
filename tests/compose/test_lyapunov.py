"""The search for one P: against closed-form conditions, a convex solver, and its own symmetries."""

from dataclasses import replace

import cvxpy
import numpy as np
import pytest

from skillctl.compose.lyapunov import common_lyapunov, conflicting_parts
from skillctl.errors import InvalidModelError
from skillctl.model.lyapunov import QuadraticForm


def hurwitz(rng, d, loss=0.3):
    """Return a stable matrix with a random quadratic V of its own."""
    root, half, turn = rng.normal(size=(3, d, d))
    p = root @ root.T + 0.2 * np.eye(d)
    return np.linalg.solve(p, -loss * half @ half.T - 0.05 * np.eye(d) + turn - turn.T)


def family(rng, d, k, loss=0.05):
    """Return matrices that share a P, and that P."""
    root = rng.normal(size=(d, d))
    p = root @ root.T + 0.1 * np.eye(d)
    half, turn = rng.normal(size=(2, k, d, d))
    losses = half @ half.swapaxes(1, 2) + loss * np.eye(d)
    return np.linalg.solve(p, -losses + 2 * (turn - turn.swapaxes(1, 2))), 0.5 * (p + p.T)


def contracts(p, matrices):
    return (p == p.T).all() and QuadraticForm(p).rates(matrices).min() > 0


@pytest.mark.parametrize("excess", [1e-1, 1e-3, 1e-5, 1e-6])
def test_the_border_of_a_known_pair_is_found_from_both_sides(excess):
    # Dayawansa and Martin (1999): a common P exists exactly for 1/b < a < b, b = 3 + √8.
    border = 3 + np.sqrt(8)

    def pair(a):
        return np.array([[[-1.0, -1.0], [1.0, -1.0]], [[-1.0, -a], [1 / a, -1.0]]])

    found = common_lyapunov(pair(border * (1 - excess)))
    assert found is not None
    assert contracts(found, pair(border * (1 - excess)))
    assert common_lyapunov(pair(border * (1 + excess))) is None


def test_random_planar_pairs_agree_with_the_closed_form_condition():
    # Shorten and Narendra (2002): A, B (2 x 2, Hurwitz) have a common P exactly when neither A B nor A B⁻¹
    # has a negative real eigenvalue.
    rng = np.random.default_rng(0)
    answers = []
    for _ in range(300):
        a, b = hurwitz(rng, 2), hurwitz(rng, 2)
        eigenvalues = np.concatenate([np.linalg.eigvals(a @ b), np.linalg.eigvals(a @ np.linalg.inv(b))])
        real = np.abs(eigenvalues.imag) < 1e-9 * np.abs(eigenvalues)
        expected = not (real & (eigenvalues.real < 0)).any()
        found = common_lyapunov(np.stack([a, b]))
        assert (found is not None) == expected
        answers.append(expected)
        if found is not None:
            assert contracts(found, np.stack([a, b]))
    assert 30 < sum(answers) < 270


def test_random_families_agree_with_a_convex_solver():
    rng = np.random.default_rng(1)
    answers = []
    for _ in range(100):
        d, k = int(rng.integers(2, 6)), int(rng.integers(2, 6))
        spread = rng.uniform(0.1, 1.5)
        shared, _ = family(rng, d, k, loss=0.3)
        matrices = shared + spread * np.stack([hurwitz(rng, d) for _ in range(k)])
        if np.linalg.eigvals(matrices).real.max() >= 0:
            continue
        p, t = cvxpy.Variable((d, d), symmetric=True), cvxpy.Variable()
        scaled = matrices / np.linalg.norm(matrices, 2, axis=(1, 2)).max()
        constraints = [p >> 0, cvxpy.trace(p) == d]
        constraints += [-(p @ a + a.T @ p) >> t * np.eye(d) for a in scaled]
        cvxpy.Problem(cvxpy.Maximize(t), constraints).solve(solver=cvxpy.CLARABEL)
        if abs(t.value) < 1e-6:  # the other solver's own accuracy does not decide these
            continue
        found = common_lyapunov(matrices)
        assert (found is not None) == (t.value > 0)
        answers.append(t.value > 0)
        if found is not None:
            assert contracts(found, matrices)
    assert len(answers) > 40
    assert 10 < sum(answers) < len(answers) - 10


@pytest.mark.parametrize("d", [1, 2, 3, 5, 7])
@pytest.mark.parametrize("k", [1, 10, 40])
def test_a_family_that_shares_a_p_gets_one(d, k):
    rng = np.random.default_rng(100 * d + k)
    matrices, p = family(rng, d, k)
    assert contracts(p, matrices)
    found = common_lyapunov(matrices)
    assert contracts(found, matrices)
    assert np.trace(found) == pytest.approx(d, rel=1e-12)


def test_a_known_p_is_never_made_worse():
    rng = np.random.default_rng(2)
    matrices, p = family(rng, 4, 8)
    alone = QuadraticForm(p).rates(matrices).min()
    found = common_lyapunov(matrices, known=[np.eye(4), p])
    assert QuadraticForm(found).rates(matrices).min() >= alone * (1 - 1e-9)


def test_units_of_length_and_time_do_not_decide():
    rng = np.random.default_rng(3)
    feasible, _ = family(rng, 3, 6)
    border = 3 + np.sqrt(8)
    pair = np.array([[[-1.0, -1.0], [1.0, -1.0]], [[-1.0, -1.01 * border], [1 / (1.01 * border), -1.0]]])
    for matrices, exists in ((feasible, True), (pair, False)):
        d = matrices.shape[1]
        for time in (1e-6, 1.0, 1e6):
            for axes in (np.ones(d), 10.0 ** rng.uniform(-4, 4, d)):
                scaled = time * matrices * axes[:, None] / axes
                found = common_lyapunov(scaled)
                assert (found is not None) == exists
                if found is not None:
                    # In the original units it proves the original matrices.
                    assert QuadraticForm(found * np.outer(axes, axes)).rates(matrices).min() > 0


def test_a_component_that_is_not_stable_alone_has_no_p():
    assert common_lyapunov(np.array([-np.eye(2), np.diag([-1.0, 0.0])])) is None
    assert common_lyapunov(np.array([-np.eye(2), np.diag([-1.0, 0.5])])) is None


def test_arrays_that_are_no_matrices_are_refused():
    with pytest.raises(InvalidModelError, match="system_matrices"):
        common_lyapunov(np.eye(2))
    with pytest.raises(InvalidModelError, match="known"):
        common_lyapunov(-np.eye(2)[None], known=[-np.eye(2)])


def test_the_smallest_conflicting_group_is_named(make_skill):
    rng = np.random.default_rng(4)

    def skill(*matrices):
        return replace(make_skill(rng, n_components=len(matrices)), system_matrices=np.array(matrices))

    round_, mild, long = (
        np.array([[-1.0, -a], [1 / a, -1.0]]) for a in (1.0, 2.0, 9.0)
    )  # 1 and 9 are too far apart, 2 goes with either
    assert conflicting_parts([skill(round_), skill(mild)]) == ()
    assert conflicting_parts([skill(round_), skill(mild), skill(long)]) == (0, 2)
    assert conflicting_parts([skill(mild), skill(round_, long)]) == (1,)
    # Every pair of these rotated ellipses has a common P; the three together have none.
    turns = [
        np.array([[np.cos(t), -np.sin(t)], [np.sin(t), np.cos(t)]]) for t in (0, np.pi / 3, 2 * np.pi / 3)
    ]
    star = next(
        [turn @ ellipse @ turn.T for turn in turns]
        for ellipse in (np.array([[-1.0, -a], [1 / a, -1.0]]) for a in np.arange(2.0, 6.0, 0.05))
        if common_lyapunov(np.stack([turn @ ellipse @ turn.T for turn in turns])) is None
    )
    assert conflicting_parts([skill(m) for m in star]) == (0, 1, 2)


def test_one_matrix_keeps_a_period_exactly_when_its_steps_have_spectral_radius_below_one():
    rng = np.random.default_rng(11)
    answers = []
    for _ in range(150):
        d = int(rng.integers(2, 6))
        matrix = hurwitz(rng, d)
        period = 10 ** rng.uniform(-2, 0.5)
        radius = np.abs(1 + period * np.linalg.eigvals(matrix)).max()
        if abs(radius - 1) < 1e-3:
            continue
        found = common_lyapunov(matrix[None], period=period)
        assert (found is not None) == (radius < 1)
        answers.append(radius < 1)
        if found is not None:
            assert contracts(found, matrix[None])
            assert QuadraticForm(found).periods(matrix[None])[0] > period
    assert 20 < sum(answers) < len(answers) - 20


def test_families_keep_a_period_wherever_a_convex_solver_finds_one():
    rng = np.random.default_rng(12)
    answers = []
    for _ in range(40):
        d, k = int(rng.integers(2, 4)), int(rng.integers(2, 5))
        matrices, known = family(rng, d, k, loss=0.3)
        period = rng.uniform(0.3, 3) * QuadraticForm(known).periods(matrices).min()
        p, t = cvxpy.Variable((d, d), symmetric=True), cvxpy.Variable()
        size = np.linalg.norm(matrices, 2, axis=(1, 2)).max()
        scaled, step = matrices / size, period * size
        constraints = [p >> 0, cvxpy.trace(p) == d]
        constraints += [-(p @ a + a.T @ p + step * a.T @ p @ a) >> t * np.eye(d) for a in scaled]
        cvxpy.Problem(cvxpy.Maximize(t), constraints).solve(solver=cvxpy.CLARABEL)
        if abs(t.value) < 1e-5:
            continue
        found = common_lyapunov(matrices, period=period)
        assert (found is not None) == (t.value > 0)
        answers.append(t.value > 0)
        assert found is None or QuadraticForm(found).periods(matrices).min() > period
    assert 5 < sum(answers) < len(answers) - 3
