"""JᵀJ of velocity errors against a Jacobian that is written out."""

from __future__ import annotations

import numpy as np
import pytest

from skillctl.learning.field import Field
from skillctl.learning.moments import VelocityMoments


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize(("d", "k"), [(1, 1), (1, 3), (2, 3), (3, 2), (4, 1)])
def test_the_moments_make_the_product_of_the_jacobian_with_itself(d: int, k: int, weighted: bool) -> None:
    generator = np.random.default_rng(d)
    field = Field(
        generator.standard_normal((k, d, d)), generator.standard_normal((k, 1 + d + d * (d + 1) // 2))
    )
    points, weights = generator.standard_normal((d, 6)), generator.uniform(0.5, 2, 6)
    factors = generator.standard_normal((6, d, d))
    metric = factors.swapaxes(1, 2) @ factors if weighted else None
    moments = VelocityMoments(points, weights, metric)
    at = moments.linearised(field)

    jacobian = np.stack([at.pull_back(force) for force in np.eye(6 * d).reshape(-1, d, 6)])
    jacobian = jacobian.reshape(d, 6, -1).swapaxes(0, 1)  # tested against finite differences elsewhere
    rows = factors @ jacobian if weighted else jacobian
    rows = np.sqrt(weights)[:, None, None] * rows
    expected = np.tensordot(rows, rows, ([0, 1], [0, 1]))
    # Sums of some tens of products of a size that the largest entry shows.
    np.testing.assert_allclose(moments.normal(at), expected, atol=1e-13 * np.abs(expected).max())

    errors = generator.standard_normal((d, 6))
    moved = errors if not weighted else np.einsum("nij,njk,kn->in", factors.swapaxes(1, 2), factors, errors)
    np.testing.assert_allclose(moments.weighed(errors), weights * moved, rtol=1e-12)
