"""Chains at other targets: the whole way is moved, or one stage of it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skillctl.errors import UsageError
from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.retarget import retargeted
from skillctl.model.rollout import rollout
from skillctl.model.skill import contraction_period

HALVES = np.array([0.5, 0.5])
ROUNDING = 1e-9  # of a motion of some thousand steps, whose numbers are of order one


@pytest.fixture
def chain(make_skill):
    """Stages to three places; the first is a combined skill with two targets."""
    rng = np.random.default_rng(5)
    one, two, three, four = (
        make_skill(rng, attractor=end) for end in ([0.0, 0.0], [0.2, 0.0], [1.0, 0.5], [-0.5, 0.8])
    )
    regions = (one.density, two.density)
    stages = (CombinedSkill((one, two), HALVES, regions=regions), three, four)
    return ChainedSkill(stages, np.full(3, 1e-4), ((), ("close",), ()))


@pytest.fixture
def poses(make_pose_skill):
    rng = np.random.default_rng(6)
    stages = [
        make_pose_skill(rng, target=end)
        for end in ([0.4, -0.1, 0.3, 0.0, 2.0, -1.0], [0.5, 0.2, 0.3, 0.3, 1.0, 0.0])
    ]
    return ChainedSkill(tuple(stages), np.full(2, 1e-3), ((), ()))


def motion(skill, starts):
    period = min(0.02, 0.9 * contraction_period(skill))
    return rollout(skill, starts, duration=60.0, period=period)


def test_the_whole_way_moves_with_the_last_target(chain):
    goal = np.array([1 / 3, -2.0])
    moved = retargeted(chain, goal)
    shift = goal - chain.attractors[0]
    starts = np.random.default_rng(0).uniform(-1, 1, (10, 2))
    before, after = motion(chain, starts), motion(moved, starts + shift)
    assert moved.attractors.tolist() == [goal.tolist()]  # to the last bit
    assert before.arrived.all()
    np.testing.assert_allclose(after.positions, before.positions + shift, atol=ROUNDING)
    assert (after.parts == before.parts).all()
    assert (moved.levels.tolist(), moved.events, moved.on_jump) == (
        chain.levels.tolist(), chain.events, chain.on_jump,
    )  # fmt: skip


def test_poses_turn_as_one_body_with_the_last_target(poses):
    last = np.array(poses.attractors[0])
    goal = np.array([0.1, 0.6, 0.2, -0.5, 0.2, 1.3])
    moved = retargeted(poses, goal, turn=True)
    base = Rotation.from_rotvec(goal[3:]) * Rotation.from_rotvec(last[3:]).inv()
    offsets = np.random.default_rng(1).normal(0, 0.2, (5, 6))
    starts = poses.space.placed(offsets, last)
    carried = np.array([turned(x, base, last, goal) for x in starts])
    before, after = motion(poses, starts), motion(moved, carried)
    assert before.arrived.all()
    for path, other in zip(before.positions, after.positions, strict=True):
        wanted = np.array([turned(x, base, last, goal) for x in path])
        np.testing.assert_allclose(other[:, :3], wanted[:, :3], atol=ROUNDING)
        assert poses.space.apart(other, wanted)[1].max() < ROUNDING
    unturned = retargeted(poses, goal)
    ends = [stage.attractors[0] for stage in unturned.parts]
    gap = poses.parts[0].attractors[0][:3] - last[:3]
    np.testing.assert_allclose(ends[0][:3] - ends[1][:3], gap, atol=ROUNDING)


def turned(x, base, last, goal):
    """One state, moved as a part of the body that the base turns: by SciPy's rotations."""
    turn = base * Rotation.from_rotvec(x[3:])
    return np.r_[goal[:3] + base.apply(x[:3] - last[:3]), turn.as_rotvec()]


def test_one_stage_can_be_moved_alone(chain):
    place = np.array([0.7, 0.7])
    moved = chain.with_stage(1, retargeted(chain.parts[1], place))
    ends = [stage.attractors.tolist() for stage in moved.parts]
    assert ends == [chain.parts[0].attractors.tolist(), [place.tolist()], chain.attractors.tolist()]
    result = motion(moved, [[0.5, 0.5]])
    assert result.arrived.all()
    assert np.linalg.norm(result.positions[0] - place, axis=1).min() < 0.02  # √1e-4, P is the identity


def test_a_stage_with_several_targets_does_not_turn(poses, make_pose_skill):
    other = make_pose_skill(np.random.default_rng(7), target=(0, 0, 0.5, 0, 0, 1))
    two = CombinedSkill((poses.parts[0], other), HALVES)
    with pytest.raises(UsageError, match="2 attractors"):
        retargeted(poses.with_stage(0, two), [0.1, 0.6, 0.2, -0.5, 0.2, 1.3], turn=True)
