"""Arrays of the model are checked once and cannot be changed afterwards."""

import numpy as np
import pytest

from skillctl.arrays import frozen_array, require_simplex, require_spd
from skillctl.errors import InvalidModelError

EPS = np.finfo(float).eps


def test_a_frozen_array_is_a_copy_that_cannot_be_written():
    original = np.arange(3)
    frozen = frozen_array("x", original, (3,))
    original[0] = 7
    assert frozen.tolist() == [0.0, 1.0, 2.0]
    assert frozen.dtype == np.float64
    with pytest.raises(ValueError, match="read-only"):
        frozen[0] = 1.0


@pytest.mark.parametrize(
    ("value", "shape", "words"),
    [
        (["a"], (1,), "not an array of numbers"),
        ([[1.0], [1.0, 2.0]], (2, None), "not an array of numbers"),
        ([1.0, np.nan], (2,), "must be finite"),
        ([1.0, -np.inf], (None,), "must be finite"),
        ([1.0, 2.0], (3,), r"expected shape \(3\), got \(2,\)"),
        ([1.0, 2.0], (2, None), r"expected shape \(2 x any\), got \(2,\)"),
        (np.zeros((0, 2)), (None, 2), r"got \(0, 2\)"),
    ],
)
def test_anything_else_is_refused_by_name(value, shape, words):
    with pytest.raises(InvalidModelError, match=f"x: .*{words}"):
        frozen_array("x", value, shape)


def test_spd_means_symmetric_to_the_last_bit_and_every_eigenvalue_positive():
    require_spd("p", np.eye(3)[None])
    with pytest.raises(InvalidModelError, match="symmetric"):
        require_spd("p", np.array([[1.0, EPS], [0.0, 1.0]]))
    with pytest.raises(InvalidModelError, match="positive definite"):
        require_spd("p", np.stack([np.eye(2), np.diag([1.0, -1e-9])]))


@pytest.mark.parametrize("weights", [[0.5, 0.5 + 1e-9], [1.0, 0.0], [1.5, -0.5]])
def test_weights_are_positive_and_sum_to_one(weights):
    with pytest.raises(InvalidModelError, match="positive and sum to one"):
        require_simplex("w", np.array(weights))


@pytest.mark.parametrize("count", [1, 3, 7, 300])
def test_normalised_weights_always_pass_as_weights(count):
    weights = np.random.default_rng(count).random(count) + 1e-3
    require_simplex("w", weights / weights.sum())
