from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from skillctl.learning.preprocess import (
    REST_SHARE,
    align,
    embedded,
    resample,
    training_data,
    trim_rests,
    without_spikes,
)
from skillctl.model.demonstration import Demonstration, DemonstrationSet

Curved = Callable[..., DemonstrationSet]


def test_rests_at_both_ends_are_trimmed_and_the_end_point_is_kept(curved: Curved) -> None:
    moving = curved(count=1).demonstrations[0]
    rest = 1.0
    times = np.concatenate([[0.0], moving.times + rest, [moving.times[-1] + 2 * rest]])
    positions = np.vstack([moving.positions[:1], moving.positions, moving.positions[-1:]])
    trimmed = trim_rests(Demonstration.from_positions(times, positions))

    # Minimum-jerk motion leaves the rest region within 20 % of its duration and enters it as late.
    assert 0.6 * moving.duration < trimmed.duration <= moving.duration
    np.testing.assert_array_equal(trimmed.positions[-1], moving.positions[-1])
    extent = np.linalg.norm(np.ptp(moving.positions, axis=0))
    assert np.linalg.norm(trimmed.positions[0] - moving.positions[0]) <= REST_SHARE * extent


@pytest.mark.parametrize("rate", [30, 100, 1000])
def test_no_motion_leaps_to_its_end(curved: Curved, rate: int) -> None:
    moving = curved(count=1, samples=2 * rate + 1).demonstrations[0]
    rested = Demonstration.from_positions(
        np.append(moving.times, moving.times[-1] + 1.0), np.vstack([moving.positions, moving.positions[-1:]])
    )
    trimmed = trim_rests(rested)
    speeds = np.linalg.norm(np.diff(trimmed.positions, axis=0), axis=1) / np.diff(trimmed.times)
    # It slows down to its end; what is left of the way is covered at the pace of the stretch before.
    assert speeds[-1] <= speeds[-max(3, rate // 10)]
    assert trimmed.times[-1] <= moving.duration


def test_a_pause_in_the_middle_is_not_a_rest_at_an_end(curved: Curved) -> None:
    moving = curved(count=1).demonstrations[0]
    times = moving.times + np.where(np.arange(len(moving.times)) > 60, 1.0, 0.0)
    paused = Demonstration.from_positions(times, moving.positions)

    assert trim_rests(paused).duration == pytest.approx(trim_rests(moving).duration + 1.0)


@pytest.mark.parametrize("width", [1, 2])
def test_a_spike_is_taken_back_to_the_path(curved: Curved, width: int) -> None:
    clean = curved(count=1).demonstrations[0]
    spiked = clean.positions.copy()
    spiked[50 : 50 + width] += [0.3, -0.2]
    repaired = without_spikes(Demonstration.from_positions(clean.times, spiked))
    # A chord over three samples of a motion of 0.5 m in 2 s at 60 Hz: the sagitta is below a millimetre.
    np.testing.assert_allclose(repaired.positions, clean.positions, atol=1e-3)


def test_nothing_else_is_touched(curved: Curved, lasa: Callable[[str], DemonstrationSet]) -> None:
    for demonstration in (*curved(), *lasa("Snake"), *lasa("Khamesh")):
        assert without_spikes(demonstration) is demonstration


def test_aligned_demonstrations_end_at_the_median_of_the_ends(curved: Curved) -> None:
    demonstrations = curved(count=5).demonstrations
    offsets = np.random.default_rng(1).standard_normal((5, 2))
    offsets[1] = 1e6  # one that ends elsewhere
    moved = tuple(d.translated(o) for d, o in zip(demonstrations, offsets, strict=True))

    aligned, attractor = align(DemonstrationSet(moved, curved().space))

    middle = sorted(offsets[:, 0])[len(offsets) // 2], sorted(offsets[:, 1])[len(offsets) // 2]
    np.testing.assert_allclose(attractor, middle, atol=1e-15)  # all ended at the origin
    for demonstration in aligned:
        # One addition of numbers of size one rounds by at most an ulp.
        np.testing.assert_allclose(demonstration.positions[-1], attractor, atol=4 * np.finfo(float).eps)


def test_resampled_velocities_match_the_closed_form(curved: Curved) -> None:
    phase = np.linspace(0, 1, 2001)
    positions = np.stack([np.sin(2 * phase), np.cos(2 * phase)], axis=1)
    sampled = resample(Demonstration.from_positions(3.0 * phase, positions), 60)

    exact = (2 / 3) * np.stack([np.cos(2 * sampled.times / 3), -np.sin(2 * sampled.times / 3)], axis=1)
    spacing = 3.0 / 59
    # Central difference over one spacing h: the error is h²/24 |x'''| inside, h/4 |x''| one-sided.
    np.testing.assert_allclose(
        sampled.velocities[1:-1], exact[1:-1], atol=spacing**2 / 24 * (2 / 3) ** 3 * 1.1
    )
    np.testing.assert_allclose(sampled.velocities, exact, atol=spacing / 4 * (2 / 3) ** 2 * 1.1)


def test_noise_faster_than_the_spacing_does_not_reach_the_velocities(curved: Curved) -> None:
    phase = np.linspace(0, 1, 2001)
    noise = 1e-3 * np.random.default_rng(0).standard_normal((2001, 1))
    sampled = resample(Demonstration.from_positions(phase, phase[:, None] + noise), 50)
    # Two noisy positions a spacing of 1/49 apart: standard deviation √2 · 1e-3 · 49 = 0.07; the raw
    # differences over one sample would have 1e-3 · √2 / 2 · 2000 = 1.4.
    assert np.std(sampled.velocities[1:-1] - 1.0) < 0.12


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_training_data_do_not_depend_on_the_unit(curved: Curved, unit: float) -> None:
    here = training_data(*align(curved()), samples=50)
    there = training_data(*align(curved(scale=unit)), samples=50)

    assert there.length_scale == pytest.approx(unit * here.length_scale, rel=1e-12)
    # Everything is a ratio of sums of a few hundred terms.
    np.testing.assert_allclose(there.positions, here.positions, atol=1e-12)
    np.testing.assert_allclose(there.velocities, here.velocities, atol=1e-11)


def test_embedded_demonstrations_are_short_and_keep_their_ends(curved: Curved) -> None:
    kept = embedded(curved(samples=1000), np.zeros(2))
    for short, full in zip(kept, curved(samples=1000), strict=True):
        assert len(short.times) == 200
        np.testing.assert_array_equal(short.positions[[0, -1]], full.positions[[0, -1]])
