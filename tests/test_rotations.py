"""Rotations agree with SciPy's, which shares no code with ours."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skillctl import rotations

EPS = float(np.finfo(float).eps)
CLOSE = 64 * EPS  # some tens of roundings of numbers about one


@pytest.fixture
def random() -> Rotation:
    return Rotation.random(200, random_state=7)


def same(ours: np.ndarray, theirs: Rotation) -> bool:
    return float((Rotation.from_rotvec(ours).inv() * theirs).magnitude().max()) <= CLOSE


def test_vectors_and_quaternions_agree(random):
    vectors = random.as_rotvec()
    assert same(rotations.vectors(random.as_quat()), random)
    assert same(rotations.vectors(-random.as_quat()), random)  # the double cover
    assert same(rotations.vectors(3 * random.as_quat()), random)
    # SciPy's quaternion of a rotation vector has either sign.
    signs = np.sign(np.sum(rotations.quaternions(vectors) * random.as_quat(), axis=1))[:, None]
    assert np.abs(rotations.quaternions(vectors) - signs * random.as_quat()).max() <= CLOSE
    assert np.linalg.norm(rotations.vectors(random.as_quat()), axis=1).max() <= np.pi


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-12, 1e-5, 0.9999 * np.pi, np.pi])
def test_extreme_angles_keep_their_digits(angle):
    axis = np.array([2.0, -1.0, 2.0]) / 3
    back = rotations.vectors(rotations.quaternions(angle * axis))
    scalar = rotations.vector_of(*rotations.quaternion_of(*(angle * axis)))
    for found in (back, np.array(scalar)):
        assert np.abs(found - angle * axis).max() <= 8 * EPS * angle


def test_products_turns_and_matrices_agree(random):
    a, b = random[:100], random[100:]
    product = rotations.product(a.as_quat(), b.as_quat())
    assert same(rotations.vectors(product), a * b)
    points = np.random.default_rng(1).normal(size=(100, 3))
    assert np.abs(rotations.turned(points, a.as_quat()) - a.apply(points)).max() <= CLOSE
    assert np.abs(rotations.matrices(a.as_rotvec()) - a.as_matrix()).max() <= CLOSE
    assert (
        np.abs(rotations.angles(a.as_rotvec(), b.as_rotvec()) - (a.inv() * b).magnitude()).max() <= 1e-15 * 64
    )


def test_one_rotation_agrees_with_many(random):
    a, b = random.as_quat()[0].tolist(), random.as_quat()[1].tolist()
    assert np.abs(rotations.product_of(a, b) - rotations.product(np.array(a), np.array(b))).max() <= CLOSE
    point = (0.3, -0.2, 0.9)
    expected = rotations.turned(np.array(point), np.array(a))
    assert np.abs(rotations.turned_of(point, a) - expected).max() <= CLOSE
    vector = random.as_rotvec()[0]
    assert np.abs(rotations.quaternion_of(*vector) - rotations.quaternions(vector)).max() <= CLOSE


def test_a_motion_through_half_turns_is_continuous():
    angles = np.linspace(0.0, 1.9 * np.pi, 400)
    wrapped = Rotation.from_rotvec(angles[:, None] * np.array([0.0, 0.6, 0.8])).as_rotvec()
    assert np.abs(np.diff(wrapped, axis=0)).max() > 3  # SciPy's jump where the angle passes π
    assert np.abs(rotations.continuous(wrapped) - angles[:, None] * np.array([0.0, 0.6, 0.8])).max() <= CLOSE


def test_a_continuous_motion_takes_the_nearest_of_all_turns():
    # A hand that tumbles with a turning axis, past half a turn: each vector is the nearest of those that
    # differ by whole turns to the one before.
    t = np.linspace(0.0, 1.0, 500)[:, None]
    axis = np.hstack([np.cos(2 * t), np.sin(2 * t), 0.5 - t])
    smooth = 5.0 * np.sin(3 * t) * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    wrapped = Rotation.from_rotvec(smooth).as_rotvec()
    expected = [wrapped[0]]
    for vector in wrapped[1:]:
        length = np.linalg.norm(vector)
        several = [vector * (1 + 2 * np.pi * turn / length) for turn in range(-3, 4)] if length else [vector]
        expected.append(min(several, key=lambda each: np.linalg.norm(each - expected[-1])))
    assert np.abs(rotations.continuous(wrapped) - expected).max() <= CLOSE
    assert np.abs(rotations.continuous(wrapped) - smooth).max() <= CLOSE
    assert (rotations.continuous(smooth) == smooth).all()


def test_the_mean_agrees_and_knows_no_signs(random):
    near = Rotation.from_rotvec([0.5, 3.0, 0.2]) * Rotation.from_rotvec(0.3 * random.as_rotvec()[:20])
    weights = np.linspace(1.0, 2.0, 20)
    assert same(rotations.mean(near.as_rotvec(), weights), near.mean(weights))


def test_roll_pitch_and_yaw_turn_about_fixed_axes(random):
    found = rotations.roll_pitch_yaw(random.as_rotvec())
    assert same(Rotation.from_euler("xyz", found).as_rotvec(), random)  # small letters: fixed axes
    assert np.abs(found[:, 1]).max() <= np.pi / 2


@pytest.mark.parametrize("pitch", [90.0, -90.0])
def test_upright_there_is_no_yaw(pitch):
    upright = Rotation.from_euler("xyz", [20.0, pitch, -50.0], degrees=True)
    roll, _, yaw = rotations.roll_pitch_yaw(upright.as_rotvec())
    assert yaw == 0
    found = Rotation.from_euler("xyz", [roll, np.radians(pitch), 0.0])
    assert (found.inv() * upright).magnitude() <= rotations.UPRIGHT
