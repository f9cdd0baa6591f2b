from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from skillctl.geometry import phases
from skillctl.learning.augmentation import SLOW, displaced_paths, distant_samples
from skillctl.learning.preprocess import align, training_data
from skillctl.model.demonstration import DemonstrationSet

Curved = Callable[..., DemonstrationSet]


@pytest.mark.parametrize(("dimension", "count", "directions"), [(2, 4, 1), (3, 2, 2), (2, 1, 2)])
def test_copies_beside_the_demonstrations_move_as_their_velocities_say(
    curved: Curved, dimension: int, count: int, directions: int
) -> None:
    shown = training_data(*align(curved(dimension, count, samples=2000)), samples=400)
    moving = np.linalg.norm(shown.velocities, axis=2) >= SLOW
    positions, velocities = distant_samples(shown, (0.5, 1.0))
    copies = np.full((2, directions, 2, count, 400, dimension), np.nan)
    copies[..., moving, :] = positions.reshape(2, directions, 2, -1, dimension)

    left = 1 - phases(shown.positions)
    shifts = (copies - shown.positions) / np.maximum(left, 1e-9)[..., None] ** 2
    sizes = np.linalg.norm(shifts, axis=-1)[..., moving]
    np.testing.assert_allclose(sizes[0], 0.5)
    np.testing.assert_allclose(sizes[1], 1.0)
    np.testing.assert_allclose(shifts[:, :, 0], -shifts[:, :, 1])
    # What is left of the path is measured along chords, velocities over one sample spacing: differences over
    # two of 400 samples of a motion with speeds near one are good to about a hundredth.
    slopes = (copies[..., 2:, :] - copies[..., :-2, :]) / (2 * shown.steps[:, None, None])
    within = moving[:, 1:-1] & moving[:, 2:] & moving[:, :-2]
    found = np.full(copies.shape, np.nan)
    found[..., moving, :] = velocities.reshape(2, directions, 2, -1, dimension)
    np.testing.assert_allclose(found[..., 1:-1, :][..., within, :], slopes[..., within, :], atol=0.01)


@pytest.mark.parametrize(("dimension", "pairs"), [(2, 1), (3, 1), (6, 3)])
def test_displaced_copies_start_behind_and_beside_and_arrive(
    curved: Curved, dimension: int, pairs: int
) -> None:
    paths = training_data(*align(curved(dimension, 4)), samples=40).positions
    copies, weights = displaced_paths(paths, 0.1, 0.5)

    assert len(copies) == 4 + 8 * pairs
    np.testing.assert_array_equal(copies[:4], paths)
    np.testing.assert_array_equal(copies[:, -1], 0)
    assert weights[:4].sum() == pytest.approx(0.5)
    assert weights.sum() == pytest.approx(1)
    ahead = paths[:, 4] - paths[:, 0]
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    shifts = copies[4:, 0].reshape(pairs, 2, 4, dimension) - paths[:, 0]
    np.testing.assert_allclose((shifts * ahead).sum(axis=-1), -0.1)  # behind, by as much as
    aside = shifts + 0.1 * ahead
    np.testing.assert_allclose(np.linalg.norm(aside, axis=-1), 0.1)  # to the side
    np.testing.assert_allclose(aside[:, 0], -aside[:, 1])  # on both sides
    turned = np.einsum("pni,qni->npq", aside[:, 0], aside[:, 0])  # each pair to another side
    np.testing.assert_allclose(turned, np.broadcast_to(0.01 * np.eye(pairs), turned.shape), atol=1e-12)


def test_no_displacement_makes_no_copies(curved: Curved) -> None:
    paths = training_data(*align(curved()), samples=40).positions
    copies, weights = displaced_paths(paths, 0.0, 0.5)
    assert copies is paths
    np.testing.assert_allclose(weights, 0.25)
