"""Fitting to a task in charted states: what is found there is said of poses."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skillctl.adapt.charted import charted, uncharted
from skillctl.adapt.task import fit_to_task
from skillctl.adapt.weights import most_helpful
from skillctl.compose.merge import merge
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.rollout import rollout


@pytest.fixture(scope="module")
def parts(make_pose_skill):
    rng = np.random.default_rng(0)
    return [make_pose_skill(rng, rate=1.0, length=0.2) for _ in range(3)]


@pytest.fixture(scope="module")
def task(parts):
    """Motions of a merger of the first two parts, moved elsewhere and turned, in a space of another ℓ."""
    skill = merge(parts[:2], part_weights=[0.3, 0.7])
    offsets = np.array([[0.15, 0.05, 0.0, 0.02, 0.0, 0.0], [0.1, 0.1, 0.05, 0.0, 0.02, 0.0]])
    starts = skill.space.placed(offsets, skill.attractor)
    paths = rollout(skill, starts, duration=20.0, period=0.01)
    space = make_other(skill.space)
    motions = tuple(
        Demonstration.from_positions(*paths.trajectory(i), f"motion {i}", space) for i in range(len(starts))
    )
    there = np.array([-0.2, 0.3, 0.1, 2.0, 0.0, 1.0])
    return DemonstrationSet(motions, space).carried(skill.attractor, there), there


def make_other(space):
    return type(space)(length=0.35)


def test_a_skill_moves_as_that_of_its_charted_states(parts, task):
    motions, _ = task
    (flat, *_), seen = charted(parts[:1], motions)
    states = np.hstack([np.random.default_rng(1).normal(0.3, 0.1, (20, 3)), Rotation.random(20).as_rotvec()])
    y, step = parts[0].charted(states), 1e-6
    ahead = parts[0].charted(parts[0].advanced(states, step))
    assert np.abs((ahead - y) / step - flat.velocity(y)).max() <= 1e-8  # rounding of y, over the step
    assert [motion.positions[-1].tolist() for motion in seen] == [parts[0].anchor.tolist()] * len(motions)
    back = uncharted(flat, parts[0].space, parts[0].attractor)
    assert (back.velocity(states) == parts[0].velocity(states)).all()


def test_weights_are_found_again(parts, task):
    motions, there = task
    fitted = fit_to_task(parts, motions, np.eye(6))
    assert np.allclose(fitted.skill.attractor, there, rtol=0, atol=2e-3)  # motions end within 1 mm
    assert fitted.used[:2] == (0, 1)
    assert fitted.skill.shares[:2] == pytest.approx([0.3, 0.7], abs=0.05)
    assert fitted.errors.fitted < 0.25 * min(fitted.errors.best_single, fitted.errors.equal)
    assert fitted.skill.space == parts[0].space


def test_a_target_may_leave_the_orientation_to_the_task(parts, task):
    motions, there = task
    fitted = fit_to_task(parts[:2], motions, np.eye(6), target=(0.0, 0.0, 0.5))
    assert fitted.skill.attractor[:3].tolist() == [0.0, 0.0, 0.5]
    turn = Rotation.from_rotvec(fitted.skill.attractor[3:].copy()).inv() * Rotation.from_rotvec(there[3:])
    assert turn.magnitude() < 0.02  # [rad]


def test_parts_that_help_are_found(parts, task):
    assert set(most_helpful(parts, task[0], 2)) == {0, 1}
