"""Demonstrations hold a motion or say in one sentence why they do not."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skillctl.errors import InputDataError
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.pose import Pose
from skillctl.model.space import Euclidean

TIMES = np.linspace(0, 2, 201)


def test_velocities_are_derived_from_positions():
    motion = Demonstration.from_positions(TIMES, np.stack([np.sin(TIMES), TIMES**2], axis=1))
    # Central differences: error h²/6 of the third derivative (sine), none for a parabola
    inner = slice(1, -1)
    step = TIMES[1]
    assert np.abs(motion.velocities[inner, 0] - np.cos(TIMES[inner])).max() <= step**2 / 6 * (1 + 1e-6)
    assert np.abs(motion.velocities[inner, 1] - 2 * TIMES[inner]).max() <= 1e-12 / step
    assert (motion.duration, motion.dimension) == (2.0, 2)


def test_a_moved_demonstration_keeps_its_velocities():
    motion = Demonstration.from_positions(TIMES, np.sin(TIMES)[:, None])
    moved = motion.translated(np.array([3.0]))
    assert (moved.positions == motion.positions + 3.0).all()
    assert (moved.velocities == motion.velocities).all()


@pytest.mark.parametrize(
    ("times", "positions", "words"),
    [
        ([0.0], [[1.0]], "one point only"),
        ([0.0, 1.0, 1.0], [[1.0], [2.0], [3.0]], r"time does not increase at sample 3 \(t = 1 s\)"),
        ([0.0, 1.0], [[1.0, 2.0], [1.0, 2.0]], "all points are equal"),
        ([0.0, 1.0], [[1.0], [np.nan]], "positions: must be finite"),
        ([0.0, 1.0], [1.0, 2.0], "positions: expected shape"),
        ([0.0, 1.0, 2.0], [[1.0], [2.0]], "times: expected shape"),
    ],
)
def test_what_is_no_motion_is_refused_with_its_source(times, positions, words):
    with pytest.raises(InputDataError, match=f"run 4: .*{words}"):
        Demonstration.from_positions(times, positions, "run 4")


def test_a_set_has_one_space():
    flat = Demonstration.from_positions(TIMES, np.sin(TIMES)[:, None], "flat")
    with pytest.raises(InputDataError, match="flat: 1 dimensions, but flat has 2"):
        DemonstrationSet((flat,), Euclidean.cartesian(2))
    with pytest.raises(InputDataError, match="no demonstrations"):
        DemonstrationSet((), Euclidean.cartesian(2))


def test_the_extent_is_the_diagonal_of_the_box():
    motion = Demonstration.from_positions([0.0, 1.0, 2.0], [[0.0, 0.0], [3.0, 1.0], [1.0, 4.0]])
    both = DemonstrationSet((motion, motion), Euclidean.cartesian(2))
    assert both.extent == 5.0
    assert both.translated(np.array([9.0, 9.0])).extent == 5.0
    assert len(both) == len(list(both)) == 2


def test_names_of_a_cartesian_space():
    assert Euclidean.cartesian(3).names == ("x", "y", "z")
    assert Euclidean.cartesian(7).names[-1] == "q7"
    assert Euclidean.cartesian(2).dimension == 2


@pytest.mark.parametrize("turn", [False, True])
def test_motions_of_poses_move_with_their_target(turn):
    """With ``turn`` as one body; without, their positions are only moved. By SciPy's rotations."""
    space, rng = Pose(length=0.2), np.random.default_rng(0)
    states = np.hstack([rng.normal(size=(5, 3)), Rotation.random(5, random_state=0).as_rotvec()])
    states = space.continued(states)
    motion = Demonstration.from_positions(np.arange(5) / 4, states, "motion", space)
    target, goal = states[-1], np.array([1.0, 2.0, 3.0, 0.5, -1.0, 0.2])
    (after,) = DemonstrationSet((motion,), space).carried(target, goal, turn=turn)
    between = Rotation.from_rotvec(goal[3:]) * Rotation.from_rotvec(target[3:]).inv()
    offsets = states[:, :3] - target[:3]
    expected = goal[:3] + (between.apply(offsets) if turn else offsets)
    assert np.allclose(after.positions[:, :3], expected, rtol=0, atol=1e-14)
    there = Rotation.from_rotvec(after.positions[:, 3:].copy())
    turned = (between * Rotation.from_rotvec(states[:, 3:])).inv() * there
    assert turned.magnitude().max() <= 1e-14
    assert np.allclose(
        after.velocities[:, 3:], between.apply(motion.velocities[:, 3:].copy()), rtol=0, atol=1e-12
    )
