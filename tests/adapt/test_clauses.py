"""Margins of clauses against cases solved by hand, and by brute force over many points."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from skillctl.adapt.clauses import (
    Approach,
    Paths,
    SpeedLimit,
    StayIn,
    Target,
    TimeLimit,
    Via,
)
from skillctl.adapt.keep_out import KeepOutBall, KeepOutBox, KeepOutCylinder, KeepOutEllipsoid
from skillctl.model.space import Euclidean


def straight(*corners, samples=11, step=0.1, tolerance=0.01, hand=0.0):
    """A motion along straight lines at constant speed between corners, in so many samples each."""
    points = [np.linspace(a, b, samples) for a, b in itertools.pairwise(corners)]
    states = np.concatenate([points[0], *[p[1:] for p in points[1:]]])[None]
    target = np.array(corners[-1], dtype=float)
    space = Euclidean.cartesian(states.shape[-1])
    return Paths(states, np.array([step]), target, space, tolerance, hand)


def one(clause, paths):
    (margin,) = clause.margins(paths)
    return float(margin)


def test_target_counts_the_end():
    paths = straight((1.0, 0.0), (0.0, 0.0))
    moved = Paths(paths.states + np.array([0.0, 0.004]), paths.steps, paths.target, paths.space, 0.01)
    assert one(Target(position=(0.0, 0.0), tolerance=0.01), moved) == pytest.approx(0.006, abs=1e-15)


def test_a_point_is_passed_between_two_samples():
    # Samples lie at x = 0, 0.1, …; the point beside x = 0.35 is 0.02 off the line, and 0.054 off any sample.
    via = Via(point=(0.35, 0.02), within=0.03)
    assert one(via, straight((0.0, 0.0), (1.0, 0.0))) == pytest.approx(0.01, abs=1e-15)


def test_a_ball_is_missed_by_the_distance_of_the_line_less_half_a_step_at_most():
    # y = 0 passes a ball around (0.5, 0.3) with radius 0.1 at 0.2; the hand takes 0.05, the clearance 0.02.
    ball = KeepOutBall(kind="ball", centre=(0.5, 0.3), radius=0.1, clearance=0.02)
    fine = one(ball, straight((0.0, 0.0), (1.0, 0.0), samples=10_001, hand=0.05))
    assert fine == pytest.approx(0.13, abs=0.5 * 1e-4)  # half of a step of 1e-4
    coarse = one(ball, straight((0.0, 0.0), (1.0, 0.0), samples=8, hand=0.05))
    assert 0.13 - 0.5 / 7 <= coarse <= 0.13  # never more than what is true between the samples


def test_a_body_between_two_samples_is_met():
    ball = KeepOutBall(kind="ball", centre=(0.5, 0.0), radius=0.1)
    assert one(ball, straight((0.0, 0.0), (1.0, 0.0), samples=2)) < 0


def test_stay_in_is_the_least_distance_to_a_face():
    box = StayIn(low=(-0.1, -0.3), high=(1.2, 0.05))
    assert one(box, straight((0.0, 0.0), (1.0, 0.0))) == pytest.approx(0.05, abs=1e-15)
    assert one(box, straight((0.0, 0.0), (1.3, 0.0))) == pytest.approx(-0.1, abs=1e-15)


def test_approach_is_about_the_last_way_only():
    # First up, then along x: only within 0.4 of the target does the direction count.
    bent = straight((0.0, -1.0), (0.0, 0.0), (1.0, 0.0))
    along = Approach(**{"direction": (2.0, 0.0), "within-deg": 20.0, "from": 0.45})
    assert one(along, bent) == pytest.approx(20.0, abs=1e-5)  # arccos near 1 loses half of the digits
    early = Approach(**{"direction": (2.0, 0.0), "within-deg": 20.0, "from": 1.2})
    assert one(early, bent) == pytest.approx(20.0 - 90.0, abs=1e-5)
    tilted = Approach(**{"direction": (1.0, 1.0), "within-deg": 20.0, "from": 0.45})
    assert one(tilted, bent) == pytest.approx(20.0 - 45.0, abs=1e-5)


def test_limits_of_speed_and_time():
    paths = straight((0.0, 0.0), (1.0, 0.0))  # 0.1 m each 0.1 s
    assert one(SpeedLimit(most=1.5), paths) == pytest.approx(0.5, abs=1e-12)
    assert one(TimeLimit(most=1.5), paths) == pytest.approx(0.5, abs=1e-12)
    passing = straight((1.0, 0.0), (-1.0, 0.0), (0.0, 0.0))  # runs through the target once before
    assert one(TimeLimit(most=1.5), passing) == pytest.approx(1.5 - 2.0, abs=1e-12)


@pytest.mark.parametrize(
    "body",
    [
        KeepOutBall(kind="ball", centre=(0.1, 0.2, 0.3), radius=0.2),
        KeepOutBox(kind="box", centre=(0.1, 0.2, 0.3), size=(0.2, 0.4, 0.1), turn=(0.3, -0.4, 0.5)),
        KeepOutCylinder(kind="cylinder", centre=(0.1, 0.2, 0.3), radius=0.1, height=0.3),
        KeepOutEllipsoid(
            kind="ellipsoid", centre=(0.1, 0.2, 0.3), radii=(0.1, 0.3, 0.2), turn=(0.0, 0.0, 1.0)
        ),
    ],
    ids=lambda body: body.kind,
)
def test_distances_agree_with_the_nearest_of_many_points_of_the_body(body):
    """Points of the body are those where the signed distance is not positive, found without its formula."""
    rng = np.random.default_rng(0)
    local = rng.uniform(-1, 1, (400_000, 3))
    if body.kind == "ball":
        local = local[np.linalg.norm(local, axis=1) <= 1] * body.radius
    elif body.kind == "box":
        local = local * 0.5 * np.array(body.size)
    elif body.kind == "cylinder":
        local = local[np.hypot(local[:, 0], local[:, 1]) <= 1] * [body.radius, body.radius, 0.5 * body.height]
    else:
        local = local[np.linalg.norm(local, axis=1) <= 1] * np.array(body.radii)
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec(getattr(body, "turn", ()) or (0.0, 0.0, 0.0))
    inside = turn.apply(local) + np.array(body.centre)
    assert (body.distances(inside) <= 1e-9).all()
    outside = np.array(body.centre) + rng.normal(size=(60, 3)) * 0.6
    outside = outside[body.distances(outside) > 0.05]
    nearest = np.array([np.linalg.norm(inside - point, axis=1).min() for point in outside])
    found = body.distances(outside)
    assert (found <= nearest + 1e-12).all()
    spacing = 0.03  # of the points, near edges and corners at most
    assert (found >= nearest - spacing).all()


def test_a_small_change_of_a_motion_changes_no_margin_by_more():
    rng = np.random.default_rng(3)
    states = np.cumsum(rng.normal(0, 0.02, (50, 40, 3)), axis=1)
    change = rng.normal(size=states.shape)
    change *= 0.01 / np.linalg.norm(change, axis=-1, keepdims=True)
    space, target = Euclidean.cartesian(3), np.zeros(3)
    before, after = (Paths(s, np.full(50, 0.1), target, space, 0.01) for s in (states, states + change))
    for clause in (
        Via(point=(0.1, 0.0, 0.0), within=0.1),
        StayIn(low=(-1.0, -1.0, -1.0), high=(1.0, 1.0, 1.0)),
        Target(position=(0.0, 0.0, 0.0)),
    ):
        assert np.abs(clause.margins(after) - clause.margins(before)).max() <= 0.01 * (1 + math.ulp(8))
