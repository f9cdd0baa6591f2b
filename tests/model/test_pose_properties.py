"""What holds of skills of poses on their way: rotations stay rotations, however they are written."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from skillctl import rotations
from skillctl.model.controller import Controller
from skillctl.model.skill import contraction_period

EPS = float(np.finfo(float).eps)


@pytest.fixture(scope="module")
def skill(make_pose_skill):
    return make_pose_skill(np.random.default_rng(0), lyapunov=np.diag([1.0, 2.0, 0.5]), rate=0.5)


def angle_to_target(skill, states):
    """By SciPy: the angle between an orientation and the target's, [rad]."""
    target = Rotation.from_rotvec(skill.attractor[3:].copy())
    return (target.inv() * Rotation.from_rotvec(states[..., 3:])).magnitude()


axes = st.tuples(*[st.floats(-1, 1, width=16)] * 3).filter(lambda axis: np.linalg.norm(axis) > 1e-3)


@given(axis=axes, angle=st.floats(0, np.pi), share=st.floats(1e-4, 1), place=axes)
@settings(deadline=None, max_examples=200)
def test_no_command_turns_the_hand_away(skill, axis, angle, share, place):
    """From anywhere, in any orientation, at any period up to the longest that contracts."""
    turn = angle * np.array(axis) / np.linalg.norm(axis)
    state = skill.space.placed(np.array([*place, *(skill.space.length * turn)]), skill.attractor)
    controller = Controller(skill, share * (1 - 1e-9) * contraction_period(skill))
    before = angle_to_target(skill, state)
    for _ in range(20):
        state = skill.space.displace(state, controller.period * controller.step(state))
        after = angle_to_target(skill, state)
        # Some ten roundings of angles of up to π in each step.
        assert after <= before + 64 * EPS
        before = after


def test_orientations_stay_rotations_over_a_million_steps(skill):
    """A thousand poses make a thousand steps each; now and then they are turned, so that none arrives."""
    rng = np.random.default_rng(1)
    states = np.hstack([rng.normal(size=(1000, 3)), Rotation.random(1000, random_state=rng).as_rotvec()])
    for step in range(1000):
        states = skill.advanced(states, 0.9 * contraction_period(skill))
        if step % 50 == 0:
            kicks = np.hstack([np.zeros((1000, 3)), Rotation.random(1000, random_state=rng).as_rotvec()])
            states = skill.space.displace(states, kicks)
    assert np.linalg.norm(states[:, 3:], axis=1).max() <= np.pi * (1 + EPS)
    q = rotations.quaternions(states[:, 3:])
    assert np.abs(np.linalg.norm(q, axis=1) - 1).max() <= 4 * EPS
    r = rotations.matrices(states[:, 3:])
    assert np.abs(r @ r.swapaxes(1, 2) - np.eye(3)).max() <= 16 * EPS


def test_a_controller_keeps_measured_quaternions_unit(skill):
    """A robot that turns by each command for the period: ten thousand quaternions, multiplied by SciPy."""
    controller = Controller(skill, 1e-3)
    position, turn = np.array([0.1, 0.1, 0.1]), Rotation.from_rotvec([0.5, -2.0, 1.0])
    for _ in range(10_000):
        command = controller.step([*position, *turn.as_quat()])
        position = position + 1e-3 * command[:3]
        turn = Rotation.from_rotvec(1e-3 * command[3:]) * turn
    matrix = turn.as_matrix()
    assert np.abs(matrix @ matrix.T - np.eye(3)).max() <= 16 * EPS
    assert np.abs(np.linalg.norm(rotations.quaternions(controller.next[3:])) - 1) <= 4 * EPS
    assert skill.space.distance_at(np.array([*position, *turn.as_rotvec()]), controller.next) <= 1e-12


def test_nothing_jumps_where_numbers_do(skill):
    """Half a turn from the base, not from the target, the numbers of an orientation jump; no command does."""
    base = np.array([0.3, 0.1, 0.2])
    axis = np.array([1.0, 2.0, 2.0]) / 3
    angles = np.linspace(np.pi - 0.01, np.pi + 0.01, 41)
    turns = Rotation.from_rotvec(angles[:, None] * axis)
    vectors, q = turns.as_rotvec(), turns.as_quat()
    assert np.linalg.norm(np.diff(vectors, axis=0), axis=1).max() > 6  # they do jump
    assert angle_to_target(skill, np.hstack([np.tile(base, (41, 1)), vectors])).max() < 3
    ways = [
        [[*base, *vector] for vector in vectors],
        [[*base, *(angle * axis)] for angle in angles],
        [[*base, *quaternion] for quaternion in q],
        [[*base, *-quaternion] for quaternion in q],
    ]
    commands = [[Controller(skill, 0.01).step(state) for state in way] for way in ways]
    size = np.abs(commands[0]).max()
    for other in commands[1:]:
        assert np.abs(np.array(other) - commands[0]).max() <= 1e4 * EPS * size
    assert np.abs(np.diff(commands[0], axis=0)).max() < 0.01 * size
    one = Controller(skill, 0.01)
    followed = np.array([one.step(state) for state in ways[0]])
    assert np.abs(followed - commands[0]).max() <= 1e4 * EPS * size
