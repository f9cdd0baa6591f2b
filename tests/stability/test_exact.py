"""Exact definiteness against other exact methods: permutations, characteristic polynomials, fractions."""

from fractions import Fraction
from itertools import permutations

import numpy as np
import pytest

from skillctl.exact import Dyadic, is_positive_definite, leading_minors
from skillctl.stability.exact import decays, steps_contract

EPS = np.finfo(float).eps


def fractions(values):
    """Return float64 values as an object array of fractions."""
    array = np.asarray(values, dtype=np.float64)
    return np.array([Fraction(v) for v in array.ravel().tolist()], dtype=object).reshape(array.shape)


def value(dyadic):
    """Return what a Dyadic stands for, as fractions."""
    return np.vectorize(lambda n: Fraction(n, dyadic.denominator), otypes=[object])(dyadic.integers)


def definite_by_characteristic_polynomial(symmetric):
    """Decide S ≻ 0 by the signs of det(λ I − S), an exact method without elimination (Faddeev–LeVerrier).

    All roots are real, so all are positive exactly when the coefficients alternate strictly in sign.
    """
    common = max(entry.denominator for entry in symmetric.ravel())
    s = np.array([int(entry * common) for entry in symmetric.ravel()], dtype=object).reshape(symmetric.shape)
    d = len(s)
    identity = np.array([[int(i == j) for j in range(d)] for i in range(d)], dtype=object)
    auxiliary, coefficient = identity * 0, 1
    for k in range(1, d + 1):
        auxiliary = s @ auxiliary + coefficient * identity
        coefficient = -np.trace(s @ auxiliary) // k
        if coefficient * (-1) ** k <= 0:
            return False
    return True


def near_singular(rng, d):
    """Return a matrix of rank d − 1 up to the rounding of its entries: chance decides its definiteness."""
    factor = rng.normal(size=(d, d - 1))
    product = factor @ factor.T
    return 0.5 * (product + product.T)


@pytest.mark.parametrize("scale", [1.0, 1e-320, 1e-200, 1e300])
def test_dyadic_arithmetic_is_that_of_fractions(scale):
    rng = np.random.default_rng(0)
    a, b = scale * rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
    x, y = Dyadic.of(a), Dyadic.of(b)
    assert (value(x) == fractions(a)).all()
    assert (value(x + y) == fractions(a) + fractions(b)).all()
    assert (value(x @ y) == fractions(a) @ fractions(b)).all()
    assert (value(-x.T) == -fractions(a).T).all()
    assert (value(x * Dyadic.of(0.1)) == fractions(a) * Fraction(0.1)).all()


def test_leading_minors_are_sums_over_permutations():
    def determinant(m):
        total = 0
        for order in permutations(range(len(m))):
            inversions = sum(order[i] > order[j] for i in range(len(m)) for j in range(i + 1, len(m)))
            product = (-1) ** inversions
            for i, j in enumerate(order):
                product *= m[i, j]
            total += product
        return total

    rng = np.random.default_rng(1)
    for d in range(1, 6):
        m = rng.integers(-9, 10, (d, d)).astype(object)
        m = m + m.T
        found = list(leading_minors(m))
        expected = [determinant(m[:k, :k]) for k in range(1, d + 1)]
        assert found == expected[: len(found)]
        assert len(found) == d or found[-1] == 0


def test_a_vanishing_minor_ends_the_elimination():
    m = np.array([[1, 2, 0], [2, 4, 0], [0, 0, 1]], dtype=object)
    assert list(leading_minors(m)) == [1, 0]
    assert not is_positive_definite(Dyadic(m, 1))


def test_the_elimination_leaves_its_input_alone():
    m = np.array([[2, 1], [1, 3]], dtype=object)
    list(leading_minors(m))
    assert m.tolist() == [[2, 1], [1, 3]]


def on_the_border(rng, d):
    """Return an integer matrix as near to singular as one can be, exact as float64, and if it is definite.

    S = L D Lᵀ with L unit lower triangular: det S = det D, and S has as many positive eigenvalues as D has
    positive entries (Sylvester's law of inertia). One of those is −1, 0 or 1, the others are 1; entries of S
    go up to 2⁴⁸.
    """
    factor = np.tril(rng.integers(-(2**22), 2**22, (d, d)), -1).astype(object) + np.eye(d, dtype=int)
    signs = np.ones(d, dtype=object)
    signs[rng.integers(d)] = int(rng.integers(-1, 2))
    order = rng.permutation(d)  # in which the elimination meets rows and columns
    integers = ((factor * signs) @ factor.T)[np.ix_(order, order)]
    matrix = integers.astype(np.float64)
    assert all(int(entry) == exact for entry, exact in zip(matrix.ravel(), integers.ravel(), strict=True))
    return matrix, min(signs) > 0


def test_no_wrong_verdict_on_the_border_where_eigenvalues_fail_by_the_hundred():
    rng = np.random.default_rng(2)
    wrong_by_eigenvalues = definite = 0
    for d in np.repeat(range(2, 9), 300).tolist():
        matrix, truth = on_the_border(rng, d)
        assert is_positive_definite(Dyadic.of(matrix)) is truth
        wrong_by_eigenvalues += bool(np.linalg.eigvalsh(matrix)[0] > 0) != truth
        definite += truth
    # A third of 2100 is definite, 700 with a standard deviation of 22; the others are singular or indefinite.
    assert 700 - 6 * 22 < definite < 700 + 6 * 22
    assert wrong_by_eigenvalues > 500


@pytest.mark.parametrize("d", range(2, 9))
def test_no_wrong_verdict_where_rounding_of_the_entries_decides(d):
    # Unlike above, entries of many sizes; the characteristic polynomial costs more, so there are fewer.
    rng = np.random.default_rng(d)
    for _ in range(100):
        matrix = near_singular(rng, d)
        truth = definite_by_characteristic_polynomial(fractions(matrix))
        assert is_positive_definite(Dyadic.of(matrix)) is truth


@pytest.mark.parametrize("a", [1.0, 0.1, 3.0, 1e-30, 1e200])
def test_in_one_dimension_the_borders_are_exact(a):
    p, matrix = Dyadic.of([[7.0]]), Dyadic.of([[-a]])
    assert decays(p, matrix, Dyadic.of(np.nextafter(a, 0)))
    assert not decays(p, matrix, Dyadic.of(a))
    assert not decays(p, matrix, Dyadic.of(np.nextafter(a, np.inf)))


def test_the_longest_step_is_exact_where_it_is_a_float():
    p, matrix = Dyadic.of([[3.0]]), Dyadic.of([[-4.0]])
    assert steps_contract(p, matrix, Dyadic.of(np.nextafter(0.5, 0)))
    assert not steps_contract(p, matrix, Dyadic.of(0.5))


def test_both_conditions_are_those_of_fractions_next_to_their_borders():
    """Bracket each border to the last bit with the oracle's answer, then compare on both sides of it."""
    rng = np.random.default_rng(3)
    for d in (2, 3, 4):
        root = rng.normal(size=(d, d))
        p = root @ root.T + np.eye(d)
        p = 0.5 * (p + p.T)
        loss, turn = rng.normal(size=(2, d, d))
        a = np.linalg.solve(p, -loss @ loss.T - p + turn - turn.T)
        fp, fa = fractions(p), fractions(a)

        def rate_holds(r, fp=fp, fa=fa):
            return definite_by_characteristic_polynomial(-(fp @ fa + fa.T @ fp) - 2 * Fraction(r) * fp)

        def period_holds(t, fp=fp, fa=fa):
            return definite_by_characteristic_polynomial(
                -(fp @ fa + fa.T @ fp) - Fraction(t) * (fa.T @ fp @ fa)
            )

        for oracle, decide in ((rate_holds, decays), (period_holds, steps_contract)):
            low, high = 0.0, 1e3
            while np.nextafter(low, high) < high:
                middle = 0.5 * (low + high)
                low, high = (middle, high) if oracle(middle) else (low, middle)
            assert decide(Dyadic.of(p), Dyadic.of(a), Dyadic.of(low))
            assert not decide(Dyadic.of(p), Dyadic.of(a), Dyadic.of(high))
