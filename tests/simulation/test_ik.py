from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from skillctl.simulation.arm import LIMIT_MARGIN, ArmBody
from skillctl.simulation.arms import ARMS
from skillctl.simulation.ik import ACCEPTED_JUMP, EASE, HAND_PITCH, POSE_ANGLE, POSE_POSITION, Kinematics

SINGLE = 1e-6  # [m]: URDF numbers carry six digits
URDF_ANGLE = 1e-3  # [rad]: but its right angles only three


def modified_dh(a: float, alpha: float, d: float, theta: float) -> np.ndarray:
    """Return the transform of Craig's convention: Rot_x(α) Trans_x(a) Rot_z(θ) Trans_z(d)."""
    ca, sa, ct, st = math.cos(alpha), math.sin(alpha), math.cos(theta), math.sin(theta)
    return np.array(
        [
            [ct, -st, 0, a],
            [st * ca, ct * ca, -sa, -d * sa],
            [st * sa, ct * sa, ca, d * ca],
            [0, 0, 0, 1],
        ]
    )


def panda_hand(joints: np.ndarray) -> np.ndarray:
    """Return the hand's pose from the manufacturer's Denavit-Hartenberg table: knows nothing of Bullet."""
    q, half = math.pi / 2, math.pi / 4
    table = [
        (0, 0, 0.333),
        (0, -q, 0),
        (0, q, 0.316),
        (0.0825, q, 0),
        (-0.0825, -q, 0.384),
        (0, q, 0),
        (0.088, q, 0),
    ]
    pose = np.eye(4)
    for (a, alpha, d), theta in zip(table, joints, strict=True):
        pose = pose @ modified_dh(a, alpha, d, theta)
    # Flange 0.107 m, hand turned by −45°, grasp point 0.105 m in front of the hand.
    return pose @ modified_dh(0, 0, 0.107, -half) @ modified_dh(0, 0, 0.105, 0)


def xarm6_hand(joints: np.ndarray) -> np.ndarray:
    """Return the hand's pose from the manufacturer's (standard) Denavit-Hartenberg table."""
    q, a2, offset = math.pi / 2, math.hypot(0.2845, 0.0535), math.atan2(0.2845, 0.0535)
    table = [
        (0.267, -q, 0, 0),
        (0, 0, a2, -offset),
        (0, -q, 0.0775, offset),
        (0.3425, q, 0, 0),
        (0, -q, 0.076, 0),
        (0.097, 0, 0, 0),
    ]
    pose = np.eye(4)
    for (d, alpha, a, turned), theta in zip(table, joints, strict=True):
        pose = pose @ modified_dh(0, 0, d, theta + turned) @ modified_dh(a, alpha, 0, 0)
    return pose


def approach_axis(point: Sequence[float]) -> list[float]:
    """Return where a horizontal hand points: half-way to radial, a quarter radian down."""
    yaw, pitch = 0.5 * math.atan2(point[1], point[0]), 0.25
    return [math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), -math.sin(pitch)]


OF_POSITIONS = [hand for hand in HAND_PITCH if hand != "taught"]


@pytest.fixture(params=list(itertools.product(ARMS, OF_POSITIONS)), ids=lambda pair: "-".join(pair))
def kinematics(request: pytest.FixtureRequest) -> Iterator[Kinematics]:
    arm, hand = request.param
    with ArmBody(ARMS[arm], 0.0) as body:
        yield Kinematics(body, hand, 0.0)


@pytest.fixture
def panda() -> Iterator[Kinematics]:
    with ArmBody(ARMS["panda"], 0.0) as body:
        yield Kinematics(body, "horizontal", 0.0)


def test_the_hand_is_where_the_manufacturers_table_says(panda: Kinematics) -> None:
    generator = np.random.default_rng(3)
    for joints in generator.uniform(panda.lower, panda.upper, (20, 7)):
        assert panda.forward(joints) == pytest.approx(panda_hand(joints)[:3, 3], abs=10 * SINGLE)


def test_the_hand_of_an_xarm6_is_where_its_manufacturers_table_says() -> None:
    with ArmBody(ARMS["xarm6"], 0.0, shapes="none") as body:
        kinematics = Kinematics(body, "horizontal", 0.0)
        for joints in np.random.default_rng(4).uniform(kinematics.lower, kinematics.upper, (20, 6)):
            assert kinematics.forward(joints) == pytest.approx(xarm6_hand(joints)[:3, 3], abs=10 * SINGLE)


def test_a_hand_without_redundancy_points_radially() -> None:
    point = np.array([0.35, 0.3, 0.45])
    with ArmBody(ARMS["xarm6"], 0.0, shapes="none") as body:
        found = Kinematics(body, "horizontal", 0.0).search(point)
    assert found.accepted
    x, y, _ = xarm6_hand(found.joints)[:3, 2]
    assert math.atan2(y, x) == pytest.approx(math.atan2(point[1], point[0]), abs=POSE_ANGLE)


def test_a_found_pose_is_the_wanted_one(panda: Kinematics) -> None:
    for point in itertools.product((0.5, 0.62), (-0.3, 0.0, 0.3), (0.5, 0.75)):
        found = panda.search(np.array(point))
        assert found.accepted
        pose = panda_hand(found.joints)
        assert np.linalg.norm(pose[:3, 3] - point) < POSE_POSITION + 10 * SINGLE
        assert pose[:3, 2] @ approach_axis(point) > math.cos(POSE_ANGLE + URDF_ANGLE)
        assert abs(pose[2, 1]) < math.sin(POSE_ANGLE + URDF_ANGLE)  # the finger axis is horizontal


def test_a_turned_base_turns_the_solution(panda: Kinematics) -> None:
    quarter = math.pi / 2
    with ArmBody(ARMS["panda"], quarter) as body:
        turned = Kinematics(body, "horizontal", quarter)
        joints = turned.search(np.array([-0.1, 0.55, 0.6])).joints
    # Turned back by a quarter, the same joints hold the hand at the point turned back.
    pose, point = panda_hand(joints), [0.55, 0.1, 0.6]
    assert pose[:3, 3] == pytest.approx(point, abs=POSE_POSITION + 10 * SINGLE)
    assert pose[:3, 2] @ approach_axis(point) > math.cos(POSE_ANGLE + URDF_ANGLE)


def test_following_is_exact_within_limits_and_without_jumps(kinematics: Kinematics) -> None:
    joints = kinematics.home
    point = kinematics.forward(joints)
    for _ in range(240):  # one second at 0.3 m/s, sideways and down
        point = point + 0.3 / 240 * np.array([0.0, 0.8, -0.6])
        solution = kinematics.follow(point, joints)
        assert solution.accepted
        assert solution.residual < 1e-4
        assert np.abs(solution.joints - joints).max() < ACCEPTED_JUMP
        assert (solution.joints >= kinematics.lower).all()
        assert (solution.joints <= kinematics.upper).all()
        joints = solution.joints
        assert kinematics.forward(joints) == pytest.approx(point, abs=1e-4)


def test_what_cannot_be_reached_is_not_accepted(kinematics: Kinematics) -> None:
    far = np.array([0.0, 2.0, 0.5])
    found = kinematics.search(far)
    assert not found.accepted
    assert found.residual > 0.5
    assert not kinematics.follow(far, kinematics.home).accepted
    assert not kinematics.follow(np.full(3, np.nan), kinematics.home).accepted


def test_a_search_depends_on_its_arguments_alone(panda: Kinematics) -> None:
    point = np.array([0.45, 0.35, 0.35])
    first = panda.search(point)
    panda.search(np.array([0.3, -0.5, 0.4]))
    assert (panda.search(point).joints == first.joints).all()


def test_the_ready_posture_holds_the_hand_as_asked(kinematics: Kinematics) -> None:
    point = kinematics.forward(kinematics.home)
    assert kinematics.search(point).joints == pytest.approx(kinematics.home, abs=1e-3)


def test_a_posture_at_a_limit_is_taken_only_without_one_that_has_more_room() -> None:
    home = ARMS["panda"].home_joints(HAND_PITCH["free"])
    upper = list(ARMS["panda"].upper)
    upper[3] = home[3] + LIMIT_MARGIN + 0.01  # the elbow at rest is 0.01 rad from its limit
    with ArmBody(replace(ARMS["panda"], upper=tuple(upper)), 0.0, shapes="none") as body:
        tight = Kinematics(body, "free", 0.0)
        point = tight.forward(tight.home)
        assert tight.margin(tight.home) == pytest.approx(0.01)
        found = tight.search(point)
        assert found.accepted
        assert tight.margin(found.joints) >= EASE
        assert tight.forward(found.joints) == pytest.approx(point, abs=1e-4)
