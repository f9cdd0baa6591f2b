"""Merging, combining and turning skills that move poses; rotations are checked against SciPy's."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skillctl.compose.combine import combine
from skillctl.compose.lyapunov import common_lyapunov_of, conflicting_parts
from skillctl.compose.merge import NoCommonLyapunovError, merge
from skillctl.compose.parts import in_one_space, prepared
from skillctl.errors import UsageError
from skillctl.model.combined import CombinedSkill
from skillctl.model.gates import MERGE_GATES
from skillctl.model.merged import MergedSkill
from skillctl.model.mixture import GaussianMixture
from skillctl.model.retarget import retargeted, turned
from skillctl.stability.certificate import certify

OTHER = (0.1, 0.5, 0.2, 1.0, 0.3, 0.0)
GOAL = np.array([0.2, 0.2, 0.5, -0.5, 0.0, 1.5])
CLOSE = {"rtol": 1e-9, "atol": 1e-11}  # logits of some hundred, good to a few units, decide the weights


def random_p(rng):
    root = rng.normal(size=(3, 3))
    p = root @ root.T + 0.5 * np.eye(3)
    return 0.5 * (p + p.T)


def poses(rng, count=40):
    return np.hstack([rng.normal(0.3, 0.2, (count, 3)), Rotation.random(count, random_state=rng).as_rotvec()])


def turn_between(before, after):
    """Q with R_after = Q R_before."""
    return Rotation.from_rotvec(np.array(after[3:])) * Rotation.from_rotvec(np.array(before[3:])).inv()


def moved_rigidly(states, turn, before, after):
    """States as one body with a target that is turned, and moved from one pose to another."""
    positions = turn.apply(states[:, :3] - before[:3]) + after[:3]
    return np.hstack([positions, (turn * Rotation.from_rotvec(states[:, 3:])).as_rotvec()])


def twists_turned(twists, turn):
    return np.hstack([turn.apply(twists[:, :3]), turn.apply(twists[:, 3:])])


@pytest.mark.parametrize("bent", [False, True])
def test_a_skill_turns_with_its_target_as_one_body(make_pose_skill, bent):
    rng = np.random.default_rng(0)
    skill = make_pose_skill(rng, lyapunov=random_p(rng), bent=bent)
    goal, states = GOAL, poses(rng)
    after = retargeted(skill, goal, turn=True)
    turn = turn_between(skill.attractor, goal)
    there = moved_rigidly(states, turn, skill.attractor, goal)
    assert np.allclose(after.velocity(there), twists_turned(skill.velocity(states), turn), **CLOSE)
    assert np.allclose(after.v_distance(there), skill.v_distance(states), **CLOSE)
    density = skill.density.log_density(skill.charted(states))
    assert np.allclose(after.density.log_density(after.charted(there)), density, **CLOSE)
    before, now = certify(skill), certify(after)
    assert now.scope == "global"
    assert now.rate == pytest.approx(before.rate, rel=1e-9)
    assert now.period == pytest.approx(before.period, rel=1e-9)
    assert [type(link) for link in after.coordinates.links] == [
        type(link) for link in skill.coordinates.links
    ]


def test_without_turning_the_way_stays_and_the_orientation_at_its_end_changes(make_pose_skill):
    rng = np.random.default_rng(1)
    skill, states = make_pose_skill(rng, bent=True), poses(rng)
    after = retargeted(skill, GOAL)
    turn = turn_between(skill.attractor, GOAL)
    there = states.copy()
    there[:, :3] += GOAL[:3] - skill.attractor[:3]
    there[:, 3:] = (turn * Rotation.from_rotvec(states[:, 3:])).as_rotvec()
    expected = skill.velocity(states)
    expected[:, 3:] = turn.apply(expected[:, 3:])
    assert np.allclose(after.velocity(there), expected, **CLOSE)
    assert certify(after).rate == certify(skill).rate  # no number of the proof has changed
    kept = retargeted(skill, GOAL[:3])
    assert (kept.attractor == [*GOAL[:3], *skill.attractor[3:]]).all()
    same = retargeted(skill, [*GOAL[:3], *skill.attractor[3:]], turn=True)
    assert (same.velocity(there) == kept.velocity(there)).all()


def test_a_target_may_have_a_quaternion(make_pose_skill):
    skill = make_pose_skill(np.random.default_rng(2))
    q = Rotation.from_rotvec(GOAL[3:]).as_quat()
    for quaternion in (q, -q, 1.004 * q):
        assert np.allclose(retargeted(skill, [*GOAL[:3], *quaternion]).attractor, GOAL, rtol=0, atol=1e-14)
    beyond = [*GOAL[:3], 0.0, 0.0, 1.5 * np.pi]
    assert np.allclose(retargeted(skill, beyond).attractor[3:], [0, 0, -0.5 * np.pi], rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("target", "cause"),
    [
        ([0, 0, 0, 0, 0, 1, 1], "the quaternion has length 1.41, not 1"),
        ([0, 0, 0, 0, 0, 0, 0], "expected 3 or 6 or 7 finite numbers"),
        ([0, 0], "expected 3 or 6 or 7 finite numbers, got 2"),
        ([0, 0, 0, 1], "expected 3 or 6 or 7 finite numbers, got 4"),
        ([0, np.nan, 0], "finite"),
    ],
)
def test_targets_that_are_none(make_pose_skill, target, cause):
    with pytest.raises(UsageError, match=cause):
        retargeted(make_pose_skill(np.random.default_rng(2)), target)


def test_a_skill_of_positions_has_nothing_to_turn_with(make_skill):
    with pytest.raises(UsageError, match="no orientation to turn with"):
        retargeted(make_skill(np.random.default_rng(0), dimension=3), [0, 0, 1], turn=True)


@pytest.mark.parametrize("gate", [gate.name for gate in MERGE_GATES])
@pytest.mark.parametrize("bent", [False, True])
def test_what_is_turned_and_merged_is_what_is_merged_and_turned(make_pose_skill, gate, bent):
    rng = np.random.default_rng(3)
    p = random_p(rng)
    one = make_pose_skill(rng, lyapunov=p, bent=bent)
    other = replace(make_pose_skill(rng, lyapunov=p), coordinates=one.coordinates)
    options = {"part_weights": [0.3, 0.7], "gate": gate}
    merged = retargeted(merge([one, other], **options), GOAL, turn=True)
    parts = [retargeted(part, GOAL, turn=True) for part in (one, other)]
    states = poses(rng)
    assert np.allclose(merge(parts, **options).velocity(states), merged.velocity(states), **CLOSE)
    assert certify(merged).scope == "global"


def test_what_is_turned_and_combined_is_what_is_combined_and_turned(make_pose_skill):
    rng = np.random.default_rng(4)
    parts = [make_pose_skill(rng) for _ in range(2)]
    regions = tuple(GaussianMixture(part.priors, part.means, part.covariances) for part in parts)
    combined = replace(combine(parts, align=True), regions=regions)
    after, states = retargeted(combined, GOAL, turn=True), poses(rng)
    turn = turn_between(parts[0].attractor, GOAL)
    there = moved_rigidly(states, turn, parts[0].attractor, GOAL)
    assert (after.part_at(there) == combined.part_at(states)).all()
    assert 0 < combined.part_at(states).sum() < len(states)
    assert np.allclose(after.velocity(there), twists_turned(combined.velocity(states), turn), **CLOSE)


def test_the_characteristic_length_is_a_unit(make_pose_skill):
    """Another ℓ moves nothing, and changes densities by the volume of its unit alone."""
    rng = np.random.default_rng(5)
    short = make_pose_skill(rng, length=0.1, bent=True)
    long = make_pose_skill(rng, length=0.4)
    (one, other), states = in_one_space([short, long]), poses(rng)
    assert one.space == other.space
    assert one.space.length == pytest.approx(0.2, rel=1e-15)
    for before, after in ((short, one), (long, other)):
        assert np.allclose(after.velocity(states), before.velocity(states), **CLOSE)
        assert (after.system_matrices == before.system_matrices).all()
        assert certify(after).rate == certify(before).rate
        ratio = after.space.length / before.space.length
        residual, unit = before.residual_covariances, np.array([1.0] * 3 + [ratio] * 3)
        assert np.allclose(after.residual_covariances, unit[:, None] * residual * unit, rtol=1e-14, atol=0)
        volume = 3 * np.log(ratio)
        expected = before.density.log_density(before.charted(states)) - volume
        assert np.allclose(after.density.log_density(after.charted(states)), expected, **CLOSE)
    same = in_one_space([short, short])
    assert same[0] is short


def test_a_merger_of_different_lengths_moves_as_its_parts(make_pose_skill):
    rng = np.random.default_rng(6)
    parts = [make_pose_skill(rng, length=length) for length in (0.1, 0.4)]
    merged, states = merge(parts, part_weights=[1, 3]), poses(rng)
    expected = 0.25 * parts[0].velocity(states) + 0.75 * parts[1].velocity(states)
    assert np.allclose(merged.velocity(states), expected, **CLOSE)
    assert certify(merged).scope == "global"


def test_the_common_p_is_found_by_blocks(make_pose_skill):
    rng = np.random.default_rng(7)
    parts = [make_pose_skill(rng, lyapunov=np.diag(d), rate=2.0) for d in ([1.0, 1.2, 1.0], [1.1, 1.0, 1.0])]
    with pytest.raises(NoCommonLyapunovError):
        merge(parts)
    p = common_lyapunov_of(parts)
    assert (p[3:, 3:] == np.eye(3)).all()
    assert not p[:3, 3:].any()
    assert certify(merge(parts, lyapunov=p)).scope == "global"
    spinning = parts[0].system_matrices.copy()
    spinning[0, 3:, 3:] = [[-1, 9, 0], [0, -1, 0], [0, 0, -1]]  # stable, but not in the Euclidean norm
    broken = replace(parts[0], system_matrices=spinning)
    assert common_lyapunov_of([broken, parts[1]]) is None
    assert conflicting_parts([parts[1], broken]) == (1,)


def test_parts_that_turn_are_turned_before_a_p_is_sought(make_pose_skill):
    rng = np.random.default_rng(8)
    p = np.diag([1.0, 1.3, 1.0])
    parts = [
        make_pose_skill(rng, lyapunov=p, rate=2.0),
        make_pose_skill(rng, lyapunov=p, rate=2.0, target=OTHER),
    ]
    ready = prepared(parts, None, GOAL, turn=True)
    common = common_lyapunov_of(ready)
    assert (common != ready[0].leaves[0].lyapunov).any()  # one P, turned in two ways, is two
    merged = merge(ready, target=GOAL, turn=True, lyapunov=common)
    assert certify(merged).scope == "global"
    states = poses(rng)
    expected = 0.5 * sum(retargeted(part, GOAL, turn=True).velocity(states) for part in parts)
    assert np.allclose(merged.velocity(states), expected, **CLOSE)


def test_without_a_target_parts_meet_in_the_mean_pose(make_pose_skill):
    rng = np.random.default_rng(9)
    parts = [make_pose_skill(rng), make_pose_skill(rng, target=OTHER)]
    merged = merge(parts, part_weights=[0.25, 0.75])
    ends = np.stack([part.attractor for part in parts])
    mean = Rotation.from_rotvec(ends[:, 3:].copy()).mean([0.25, 0.75]).as_rotvec()
    assert np.allclose(merged.attractor, [*(np.array([0.25, 0.75]) @ ends[:, :3]), *mean], rtol=0, atol=1e-14)
    assert np.allclose(merge(parts, target=GOAL[:3], part_weights=[1, 3]).attractor, [*GOAL[:3], *mean])


def test_parts_that_are_combined_keep_their_orientations_in_one_place(make_pose_skill):
    rng = np.random.default_rng(10)
    parts = [make_pose_skill(rng), make_pose_skill(rng, target=OTHER)]
    combined = combine(parts, align=True, target=GOAL[:3])
    assert (combined.part_attractors[:, :3] == GOAL[:3]).all()
    assert (combined.part_attractors[:, 3:] == [part.attractor[3:] for part in parts]).all()
    assert certify(combined).scope == "global"
    moved = retargeted(combined, OTHER[:3])
    assert (moved.part_attractors[:, :3] == OTHER[:3]).all()
    assert (moved.part_attractors[:, 3:] == combined.part_attractors[:, 3:]).all()
    with pytest.raises(UsageError, match="2 attractors"):
        retargeted(combined, GOAL)
    assert combine(parts, align=True, target=GOAL).aligned
    assert combine(parts, align=True, gate="instantaneous").aligned


def test_poses_and_positions_do_not_mix(make_pose_skill, make_skill):
    rng = np.random.default_rng(11)
    pose, position = make_pose_skill(rng), make_skill(rng, dimension=3)
    for put in (merge, combine):
        with pytest.raises(UsageError, match="skill 2 moves positions, skill 1 poses") as caught:
            put([pose, position])
        assert caught.value.hint == "Learn the one that moves poses again with --position-only."
    elsewhere = replace(pose, space=replace(pose.space, frame="table"))
    with pytest.raises(UsageError, match="frame of skill 2: table; of skill 1: base"):
        merge([pose, elsewhere])


def test_a_tree_turns_as_a_whole(make_pose_skill):
    rng = np.random.default_rng(12)
    one, other = make_pose_skill(rng), make_pose_skill(rng)
    tree = MergedSkill((MergedSkill((one, other), [0.5, 0.5], "density"), other), [0.4, 0.6])
    turn, states = Rotation.random(random_state=1), poses(rng)
    after = turned(CombinedSkill((tree, one), [0.5, 0.5]), turn.as_matrix())
    before = CombinedSkill((tree, one), [0.5, 0.5])
    about = np.array([*one.attractor[:3], 0, 0, 0])
    there = states.copy()  # orientations relative to the target stay, and the target's stays, too
    there[:, :3] = turn.apply(states[:, :3] - about[:3]) + about[:3]
    expected = before.velocity(states)
    expected[:, :3] = turn.apply(expected[:, :3])
    assert np.allclose(after.velocity(there), expected, **CLOSE)
