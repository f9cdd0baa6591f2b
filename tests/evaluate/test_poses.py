"""Skills of poses are compared in millimetres and degrees apart, and followed from where they were taught."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skillctl.errors import UsageError
from skillctl.evaluate.comparison import compare_behaviour, leaf_differences
from skillctl.evaluate.coverage import coverage, demonstrated_starts, same_targets, with_regions
from skillctl.evaluate.place import at
from skillctl.model.combined import CombinedSkill
from skillctl.model.retarget import retargeted
from skillctl.stability.certificate import certify

TURN = 0.3  # [rad]


@pytest.fixture(scope="module")
def grasp(make_grasp):
    return make_grasp()


def compared(a, b, motions):
    return compare_behaviour(a, b, tuple(motions), 1e-9, 1e-9)


def turned_by(skill, angle):
    """Return the skill with its target turned by an angle about the hand's z axis."""
    turned = Rotation.from_rotvec(skill.attractor[3:].copy()) * Rotation.from_rotvec([0, 0, angle])
    return retargeted(skill, [*skill.attractor[:3], *turned.as_quat()])


def test_a_skill_is_like_itself_and_a_quaternions_sign_is_no_difference(grasp, make_grasp_motions):
    target = grasp.space.given(grasp.attractor)
    other_side = retargeted(grasp, [*target[:3], *(-value for value in target[3:])])
    behaviour = compared(grasp, other_side, make_grasp_motions(grasp))
    assert behaviour.same
    assert behaviour.grid.points == 3**6
    assert behaviour.attractors_angle <= 1e-12


def test_attractors_and_motions_are_apart_in_metres_and_in_radians(grasp, make_grasp_motions):
    motions = make_grasp_motions(grasp)
    other = turned_by(grasp, TURN)
    behaviour = compared(grasp, other, motions)
    assert not behaviour.same
    assert behaviour.attractors == 0
    assert behaviour.attractors_angle == pytest.approx(TURN)
    (leaf,) = leaf_differences(grasp, other)
    assert leaf.attractor == 0
    assert leaf.attractor_angle == pytest.approx(TURN)
    # The motions start in the same orientations, and end in those of their targets.
    assert behaviour.rollouts_angle == pytest.approx(TURN, rel=0.05)
    further = retargeted(grasp, grasp.attractor + 0.02 * np.eye(6)[0])
    behaviour = compared(grasp, further, motions)
    assert behaviour.attractors == pytest.approx(0.02)
    assert behaviour.attractors_angle <= 1e-12


def test_a_field_that_only_turns_faster_differs_in_turning_only(grasp, make_grasp_motions):
    matrices = grasp.system_matrices.copy()
    matrices[:, 3:, 3:] *= 1.5
    faster = replace(grasp, system_matrices=matrices)
    field = compared(grasp, faster, make_grasp_motions(grasp)).demonstrations
    assert field.greatest == 0
    assert field.greatest_turn == pytest.approx(0.5 * field.turn)
    assert not field.within


def test_positions_have_no_angles(make_skill):
    skill = make_skill(np.random.default_rng(0))
    behaviour = compared(skill, skill, ())
    assert behaviour.attractors_angle is behaviour.grid.greatest_turn is None


def test_starts_are_laid_out_around_targets_where_they_are_now(grasp, make_grasp_motions):
    motions = make_grasp_motions(grasp)
    moved = retargeted(grasp, [0.1, 0.2, 0.3, 0.0, 0.6, 0.0, 0.8])
    starts = demonstrated_starts(moved, [motions])
    taught = np.stack([motion.positions[0] for motion in motions])
    expected = grasp.space.offsets(taught, grasp.attractor)
    assert np.abs(moved.space.offsets(starts, moved.attractor) - expected).max() < 1e-12


def test_parts_that_end_in_other_orientations_keep_their_starts(make_grasp, make_grasp_motions):
    parts = make_grasp(), make_grasp((0.2, 0.4, 0.3, 0.0, 1.0, 0.0))
    taught = [make_grasp_motions(part, 4) for part in parts]
    skill = with_regions(CombinedSkill(parts, np.array([0.5, 0.5])), taught)
    assert [(part.selected, part.kept) for part in coverage(skill, taught)] == [(1.0, 1.0)] * 2
    for index, motions in enumerate(taught):
        starts = np.stack([motion.positions[0] for motion in motions])
        assert (skill.part_at(starts) == index).all()


def test_only_other_places_are_nearly_one_target(make_grasp):
    first = make_grasp()
    turned, near = turned_by(first, TURN), retargeted(first, [0.505, -0.1, 0.3])
    halves = np.array([0.5, 0.5])
    assert same_targets(CombinedSkill((first, turned), halves)) == ()
    ((one, other, gap),) = same_targets(CombinedSkill((first, near), halves))
    assert (one, other) == (1, 2)
    assert gap == pytest.approx(0.005)


def test_a_place_is_given_as_a_target_is(grasp):
    certificate = certify(grasp, digest="sha256:0")
    quaternion = Rotation.from_euler("xyz", [150, 10, 0], degrees=True).as_quat()
    found = at(grasp, [0.3, 0.1, 0.5, *quaternion], certificate)
    assert found.arrives
    assert found.given == pytest.approx((0.3, 0.1, 0.5, *quaternion))
    assert found.velocity == pytest.approx(grasp.velocity(np.array(found.position)))
    alone = at(grasp, [0.3, 0.1, 0.5], certificate)
    assert alone.position[3:] == tuple(grasp.attractor[3:])


def test_a_place_of_another_size_is_refused_with_an_example(grasp):
    with pytest.raises(UsageError, match="expected 3 or 6 or 7 finite numbers") as refused:
        at(grasp, [1.0, 2.0], certify(grasp, digest="sha256:0"))
    assert "--at 0.5,-0.1,0.3," in refused.value.hint
