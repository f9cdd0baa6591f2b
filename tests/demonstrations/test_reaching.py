"""The example reaches: reproducible to the byte, human in shape, and possible in front of the shelf."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skillctl.demonstrations import reaching
from skillctl.demonstrations.reaching import (
    LOW_STARTS,
    PLACES,
    STARTS,
    TASKS,
    Box,
    reaching_demonstrations,
    target_of,
)
from skillctl.demonstrations.reader import read_demonstrations
from skillctl.demonstrations.writing import write_csv
from skillctl.errors import StoreError, UsageError
from skillctl.model.demonstration import Demonstration

ROUNDING = 1e-5  # positions are rounded to 10 µm


def test_what_is_written_is_read_back_to_the_last_bit(tmp_path: Path) -> None:
    (demonstration,) = reaching_demonstrations("top-left", 1, seed=3)
    write_csv(demonstration, tmp_path / "reach.csv")
    result = read_demonstrations([tmp_path / "reach.csv"])
    (read,) = result.demonstrations
    assert (read.positions == demonstration.positions).all()
    assert (read.times == demonstration.times).all()
    assert (read.velocities == demonstration.velocities).all()
    assert result.notes == ()


@pytest.mark.parametrize("manner", [0.0, 0.15])
@pytest.mark.parametrize("place", PLACES)
def test_reaches_end_at_the_cup_after_ten_straight_centimetres(place: str, manner: float) -> None:
    target = target_of(place)
    for demonstration in reaching_demonstrations(place, 20, seed=1, manner=manner):
        x = demonstration.positions
        assert (x[-1] == target).all()
        entry = x[x[:, 0] >= target[0] - 0.1]
        # A finger's breadth is 20 mm; 3 mm off the line is straight.
        assert np.abs(entry[:, 1:] - target[1:]).max() < 0.003
        assert (np.diff(entry[:, 0]) >= 0).all()


@pytest.mark.parametrize("place", PLACES)
def test_a_turned_hand_points_from_the_shoulder_to_the_cup_and_moves_so(place: str) -> None:
    target = target_of(place)
    direction = np.array([target[0], target[1], 0.0]) / np.hypot(target[0], target[1])
    for demonstration in reaching_demonstrations(place, 10, seed=1, turned=True):
        x, turns = np.split(np.array(demonstration.positions), [3], axis=1)
        assert np.abs(x[-1] - target).max() <= ROUNDING
        axes = Rotation.from_rotvec(turns).as_matrix()
        assert axes[-1, :, 2] == pytest.approx(direction * np.cos(0.25) - [0, 0, np.sin(0.25)], abs=1e-12)
        assert axes[-1, 2, 1] == pytest.approx(0, abs=1e-12)  # the fingers are level
        assert np.abs(np.arctan2(axes[0, 1, 2], axes[0, 0, 2])) <= 0.10  # it began straight ahead
        entry = (x - target)[(x - target) @ direction >= -0.1]
        assert np.abs(entry - np.outer(entry @ direction, direction)).max() < 0.003  # as for other reaches
        still = Rotation.from_matrix(axes[-len(entry) :]) * Rotation.from_matrix(axes[-1]).inv()
        assert still.magnitude().max() < np.radians(1.0)  # it is turned before it moves in
        near = x[:, 0] > 0.5 - 0.03  # boards begin at 0.50
        for bottom, top in ((0.40, 0.42), (0.68, 0.70)):
            assert not (near & (x[:, 2] > bottom - 0.03) & (x[:, 2] < top + 0.03)).any()


def test_poses_are_written_and_read_back(tmp_path: Path) -> None:
    reaches = reaching_demonstrations("bottom-left", 1, turned=True)
    (demonstration,) = reaches
    write_csv(demonstration, tmp_path / "reach.csv", reaches.space)
    (read,) = read_demonstrations([tmp_path / "reach.csv"]).demonstrations
    assert (read.positions[:, :3] == demonstration.positions[:, :3]).all()
    turns = [Rotation.from_rotvec(np.array(each.positions[:, 3:])) for each in (read, demonstration)]
    assert (
        turns[0] * turns[1].inv()
    ).magnitude().max() < 2 * 2 * ROUNDING  # of four numbers; twice half the angle


@pytest.mark.parametrize("starts", [STARTS, LOW_STARTS])
@pytest.mark.parametrize("place", PLACES)
def test_reaches_keep_clear_of_the_boards(place: str, starts: Box) -> None:
    for demonstration in reaching_demonstrations(place, 20, seed=2, starts=starts):
        x, _, z = demonstration.positions.T
        near = x > 0.5 - 0.03  # boards begin at 0.50
        for bottom, top in ((0.40, 0.42), (0.68, 0.70)):
            assert not (near & (z > bottom - 0.03) & (z < top + 0.03)).any()


@pytest.mark.parametrize("place", PLACES)
def test_reaches_start_low_in_front_of_the_shelf_and_vary(place: str) -> None:
    demonstrations = reaching_demonstrations(place, 20, seed=3)
    starts = np.stack([d.positions[0] for d in demonstrations])
    assert (np.abs(starts - [0.4125, 0.0, 0.55]) <= [0.0275, 0.12, 0.03]).all()
    assert (np.ptp(starts, axis=0) > [0.03, 0.12, 0.03]).all()
    durations = [d.duration for d in demonstrations]
    assert 2.4 <= min(durations) < max(durations) <= 3.8
    underway = np.stack([d.positions[len(d.times) // 3] for d in demonstrations])
    assert (underway.std(axis=0) > 0.005).all()


@pytest.mark.parametrize("place", PLACES)
def test_low_starts_leave_every_reach_the_way_up(place: str) -> None:
    for demonstration in reaching_demonstrations(place, 20, seed=3, starts=LOW_STARTS):
        z = demonstration.positions[:, 2]
        assert 0.10 <= z[0] <= 0.20
        assert z[-1] - z[0] > 0.25


def test_a_manner_is_a_swing_to_the_side_and_a_lift_to_the_top() -> None:
    swings = {place: tuple(reaching._swing(place, 0.1)) for place in PLACES}
    assert swings["top-left"] == (0, 0.1, 0.1)
    assert swings["bottom-right"] == (0, -0.1, 0)
    assert swings["bottom-centre"] == (0, 0, 0)
    style = reaching._Style.drawn(np.random.default_rng(0))
    plain, mannered = (
        reaching._path(style, target_of("top-left"), np.array(swing)) for swing in ((0, 0, 0), (0, 0.1, 0.2))
    )
    peak = np.ptp(mannered - plain, axis=0)
    assert peak == pytest.approx((0, 0.1, 0.2), abs=1e-6)  # the path is sampled next to the peak


def test_without_variability_reaches_differ_by_their_starts_alone() -> None:
    def detours(variability: float):
        for i in range(8):
            stream = np.random.Generator(np.random.PCG64([4, 3, i]))
            style = reaching._Style.drawn(stream, STARTS, variability)
            yield np.hstack([style.entry, style.lateral_end, style.vertical_end, style.sway.ravel()])

    spreads = [np.ptp(list(detours(variability)), axis=0) for variability in (0.0, 0.5, 1.0)]
    assert spreads[0].max() <= 4 * np.finfo(float).eps
    assert spreads[1] == pytest.approx(0.5 * spreads[2], rel=1e-12)
    assert (spreads[2] > 0).all()


@pytest.mark.parametrize("place", PLACES)
def test_the_speed_follows_the_minimum_jerk_law(place: str) -> None:
    for demonstration in reaching_demonstrations(place, 4, seed=4):
        steps = np.linalg.norm(np.diff(demonstration.positions, axis=0), axis=1)
        t = demonstration.times / demonstration.duration
        law = 10 * t**3 - 15 * t**4 + 6 * t**5
        # Both ends of each of the at most 380 steps are rounded; a chord is shorter than its arc by less.
        assert np.abs(np.cumsum(steps) / steps.sum() - law[1:]).max() < 380 * 2 * ROUNDING / steps.sum()
        assert steps.max() * 100 == pytest.approx(1.875 * steps.sum() / demonstration.duration, rel=0.02)


def test_side_and_height_do_not_depend_on_each_other() -> None:
    # Relative to its target, a reach to the top left moves sideways as one to the bottom left, and upwards
    # as one to the top centre: with one style the three differ only in how fast the path is run through.
    style = reaching._Style.drawn(np.random.default_rng(0))
    left, top, both = (
        reaching._path(style, target_of(place), np.zeros(3)) - target_of(place)
        for place in ("bottom-left", "top-centre", "top-left")
    )
    eps = 4 * np.finfo(float).eps
    assert np.abs(both[:, 1] - left[:, 1]).max() <= eps
    assert np.abs(both[:, 2] - top[:, 2]).max() <= eps


def test_a_demonstration_depends_on_place_seed_and_index_alone() -> None:
    few, many = reaching_demonstrations("top-left", 2, 5), reaching_demonstrations("top-left", 4, 5)
    for one, other in zip(few, many, strict=False):
        assert (one.positions == other.positions).all()
    first = [reaching_demonstrations(p, 1, s).demonstrations[0] for p in TASKS for s in (0, 1)]
    assert len({d.positions[0].tobytes() for d in first}) == 2 * len(TASKS)


def test_sampling_is_even_and_at_rest_at_both_ends() -> None:
    (demonstration,) = reaching_demonstrations("bottom-right", 1)
    assert (demonstration.times == np.round(np.arange(len(demonstration.times)) / 100, 2)).all()
    ends = demonstration.velocities[[0, -1]]
    assert np.abs(ends).max() <= 2 * ROUNDING / 0.01


def test_what_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        UsageError, match="'middle' is none of bottom-left, bottom-centre, bottom-right, top-"
    ):
        target_of("middle")
    for count, seed in ((0, 0), (1, -1)):
        with pytest.raises(UsageError, match="at least 1 and 0"):
            reaching_demonstrations("top-left", count, seed)
    with pytest.raises(UsageError, match="variability: from 0 to 1, not 2"):
        reaching_demonstrations("top-left", variability=2.0)
    with pytest.raises(UsageError, match=r"manner: from 0 to 0\.15, not 1"):
        reaching_demonstrations("top-left", manner=1.0)
    (demonstration,) = reaching_demonstrations("top-left", 1)
    with pytest.raises(StoreError, match="cannot be written"):
        write_csv(demonstration, tmp_path / "missing" / "reach.csv")


def test_a_table_is_written_without_negative_zeros_and_with_line_feeds(tmp_path: Path) -> None:
    x = np.array([[-1e-9, 1.0], [2 / 3, -0.5]])
    write_csv(Demonstration.from_positions([0.0, 0.01], x), tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_bytes() == (
        b"t,x,y\n0.00000,0.00000,1.00000\n0.01000,0.66667,-0.50000\n"
    )
