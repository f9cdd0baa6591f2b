from __future__ import annotations

import numpy as np
import pytest

from skillctl.geometry import path_length
from skillctl.simulation.arm import CONTROL_PERIOD
from skillctl.simulation.arms import ARMS
from skillctl.simulation.episode import TimeSeries, distances_to_path, measure, thinned
from skillctl.simulation.motion import Plan

IIWA = ARMS["iiwa"]
EPS = np.finfo(np.float64).eps


def series_of(hand: np.ndarray, **changed: np.ndarray) -> TimeSeries:
    rows, joints = len(hand), np.zeros((len(hand), IIWA.n_joints))
    fields = {
        "times": CONTROL_PERIOD * np.arange(rows),
        "reference": hand,
        "hand": hand,
        "joints": joints,
        "velocities": joints,
        "torques": joints,
        "residuals": np.zeros(rows),
        "parts": np.zeros(rows, dtype=np.int64),
        "phases": np.zeros(rows, dtype=np.int64),
        "targets": np.tile(TARGET, (rows, 1)),
        "fingers": np.zeros((rows, 0)),
        "cups": np.full((rows, 7), np.nan),
        "contacts": np.zeros(rows, dtype=np.int64),
        "clearances": np.full(rows, np.nan),
        "manipulability": np.full(rows, np.nan),
        "hand_turns": np.full((rows, 4), np.nan),
        "reference_turns": np.full((rows, 4), np.nan),
        "target_turns": np.full((rows, 4), np.nan),
    }
    return TimeSeries(**{**fields, **changed})


def line(*values: float) -> np.ndarray:
    return np.array([[value, 0.0, 0.5] for value in values])


TARGET = np.array([0.0, 0.0, 0.5])
PLAN = Plan(line(0.3, 0.2, 0.1, 0.0), TARGET, True)


def test_distances_to_a_path_are_those_to_its_nearest_edge() -> None:
    corner = np.array(
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]]
    )  # one edge is a point
    points = np.array([[0.5, 0.2, 0.0], [1.3, 0.5, 0.4], [-3.0, 4.0, 0.0], [1.0, 0.0, 0.0], [2.0, 2.0, 0.0]])
    expected = [0.2, 0.5, 5.0, 0.0, 2**0.5]
    assert distances_to_path(points, corner) == pytest.approx(expected, abs=4 * EPS)
    assert distances_to_path(points[:1], points[:1]) == 0


def test_thinning_keeps_both_ends_and_the_length() -> None:
    angles = np.linspace(0, np.pi, 5001) ** 0.5  # slow at one end, as motions are
    circle = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    few = thinned(circle, 0.01)
    assert len(few) < 400
    assert (few[[0, -1]] == circle[[0, -1]]).all()
    # A chord of length c on the unit circle is short by c³/24.
    assert path_length(circle) - path_length(few) < len(few) * 0.02**3 / 24
    assert len(thinned(circle[:1], 0.01)) == 1


def test_figures_of_a_hand_that_reaches_the_target_late() -> None:
    hand = line(0.3, 0.0, 0.2, 0.0015, 0.001)
    figures = measure(series_of(hand), PLAN, IIWA, tolerance=0.002)
    assert figures.final_error == 0.001
    assert figures.time_to_target == 3 * CONTROL_PERIOD  # the visit at the second row was not the arrival
    assert figures.simulated_time == 4 * CONTROL_PERIOD
    assert figures.plan_deviation == pytest.approx(0, abs=EPS)
    assert figures.path_ratio == pytest.approx((0.3 + 0.2 + 0.199) / 0.3, rel=8 * EPS)
    assert figures.joint_margin == pytest.approx(np.radians(120), rel=EPS)


def test_a_target_not_kept_has_no_arrival_time() -> None:
    figures = measure(series_of(line(0.3, 0.0, 0.1)), PLAN, IIWA, tolerance=0.002)
    assert np.isnan(figures.time_to_target)


def test_tracking_and_deviation_are_told_apart() -> None:
    hand = line(0.3, 0.2, 0.1, 0.0) + np.array([0.0, 0.004, 0.0])
    reference = hand.copy()
    reference[-1, 2] += 0.002
    figures = measure(series_of(hand, reference=reference), PLAN, IIWA, tolerance=0.005)
    assert figures.plan_deviation == pytest.approx(0.004, rel=8 * EPS)
    assert figures.tracking_median == 0
    assert figures.tracking_rmse == pytest.approx(0.001, rel=1e3 * EPS)  # √(0.002² / 4); 0.502 − 0.5 rounds
    assert figures.tracking_p95 == pytest.approx(0.85 * 0.002, rel=1e3 * EPS)  # interpolated between rows


def test_ratios_are_to_the_real_arm_and_its_weakest_joint() -> None:
    hand = line(0.3, 0.0)
    velocities, torques, joints = (np.zeros((2, IIWA.n_joints)) for _ in range(3))
    velocities[1, 3], velocities[1, 6] = -IIWA.max_velocity[3], 0.5 * IIWA.max_velocity[6]
    torques[0, 0], torques[0, 6] = 40.0, -20.0
    joints[1, 5] = IIWA.upper[5] - 0.25
    series = series_of(
        hand, velocities=velocities, torques=torques, joints=joints, residuals=np.array([0, 0.006])
    )
    figures = measure(series, PLAN, IIWA, tolerance=0.002)
    assert figures.velocity_ratio == 1
    assert figures.torque_ratio == 0.5
    assert figures.joint_margin == pytest.approx(0.25, abs=4 * EPS)
    assert (figures.ik_residual, figures.ik_failures) == (0.006, 1)


def test_what_the_hand_does_after_the_grasp_is_no_error_of_the_skill() -> None:
    hand = line(0.3, 0.1, 0.0, 0.001, 0.5, 0.6)
    cups = np.tile([0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0], (6, 1))
    cups[1:, 1] += 0.003  # pushed aside before the fingers close
    cups[2:, 1] += 0.004  # and by them
    cups[4:, 2] += 0.08
    changed = {"phases": np.array([0, 0, 1, 1, 2, 3]), "cups": cups, "fingers": np.full((6, 2), 0.03)}
    figures = measure(series_of(hand, **changed), PLAN, IIWA, tolerance=0.006)
    assert figures.final_error == 0.001
    assert figures.time_to_target == 2 * CONTROL_PERIOD
    assert figures.cup_moved == pytest.approx(0.003, rel=8 * EPS)
    assert figures.cup_rise == pytest.approx(0.08, rel=16 * EPS)
    assert figures.grip_width == 0.06
    assert np.isnan(figures.clearance)


def test_the_smallest_clearance_counts_and_rows_without_one_do_not() -> None:
    clearances = np.array([0.2, np.nan, -0.001, np.nan, 0.1])
    figures = measure(series_of(line(0.3, 0.2, 0.1, 0.0, 0.0), clearances=clearances), PLAN, IIWA, 0.002)
    assert figures.clearance == -0.001
