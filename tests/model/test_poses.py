"""Skills of poses: the chart, the field as a twist, steps, and the seam half a turn from the target."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm, logm
from scipy.spatial.transform import Rotation

from skillctl.errors import StateError, UsageError
from skillctl.model.combined import CombinedSkill
from skillctl.model.controller import Controller
from skillctl.model.merged import MergedSkill
from skillctl.model.mixture import GaussianMixture
from skillctl.model.pose import Pose
from skillctl.model.retarget import retargeted
from skillctl.model.rollout import rollout
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import Skill, contraction_period
from skillctl.model.space import Euclidean
from skillctl.model.stepper import Stepper

EPS = float(np.finfo(float).eps)
LENGTH = 0.25
SPACE = Pose(length=LENGTH)
TARGET = np.array([0.5, -0.1, 0.4, *Rotation.from_euler("xyz", [170, 10, 40], degrees=True).as_rotvec()])


def block(rng: np.random.Generator) -> np.ndarray:
    """Return a 3 × 3 matrix whose symmetric part is negative definite."""
    free = rng.normal(size=(3, 3))
    return -(np.eye(3) + 0.2 * free @ free.T) + 0.8 * (free - free.T)


def pose_skill(seed: int = 0, target: np.ndarray = TARGET) -> SedsSkill:
    """Return a skill of four components, every block of which contracts in the Euclidean norm."""
    rng, k = np.random.default_rng(seed), 4
    matrices = np.zeros((k, 6, 6))
    for matrix in matrices:
        matrix[:3, :3], matrix[3:, 3:] = block(rng), block(rng)
    anchor = np.array([*target[:3], 0, 0, 0])
    covariances = np.stack([np.diag(rng.uniform(0.01, 0.04, 6)) for _ in range(k)])
    means = anchor + rng.normal(scale=0.2, size=(k, 6))
    return SedsSkill(
        priors=np.full(k, 1 / k),
        means=means,
        covariances=covariances,
        system_matrices=matrices,
        residual_covariances=np.stack([np.eye(6)] * k),
        attractor=target,
        lyapunov=np.eye(6),
        density=GaussianMixture(np.full(k, 1 / k), means, covariances),
        space=SPACE,
    )


def poses(count: int, seed: int = 3) -> np.ndarray:
    rng = np.random.default_rng(seed)
    turns = Rotation.random(count, random_state=seed).as_rotvec()
    return np.hstack([rng.uniform(-0.5, 1.0, size=(count, 3)), turns])


def angle_to(states: np.ndarray, target: np.ndarray = TARGET) -> np.ndarray:
    return np.asarray(
        (Rotation.from_rotvec(target[3:]).inv() * Rotation.from_rotvec(states[..., 3:])).magnitude()
    )


def test_offsets_are_positions_and_logarithms():
    states = poses(50)
    offsets = SPACE.offsets(states, TARGET)
    base = Rotation.from_rotvec(TARGET[3:]).as_matrix()
    for state, offset in zip(states, offsets, strict=True):
        log = logm(base.T @ Rotation.from_rotvec(state[3:]).as_matrix())
        turn = np.array([log[2, 1], log[0, 2], log[1, 0]]).real
        assert np.abs(offset[3:] - LENGTH * turn).max() <= 1e-12  # logm is good to about that
        assert (offset[:3] == state[:3] - TARGET[:3]).all()
        assert np.abs(SPACE.offset_at(state, TARGET) - offset).max() <= 64 * EPS
        assert np.abs(SPACE.placed_at(offset, TARGET) - SPACE.placed(offset, TARGET)).max() <= 64 * EPS
    assert angle_to(SPACE.placed(offsets, TARGET), TARGET) == pytest.approx(angle_to(states), abs=64 * EPS)
    assert SPACE.distance(SPACE.placed(offsets, TARGET), states).max() <= 64 * EPS


def test_differences_are_twists_in_the_base_frame():
    starts, ends = poses(40), poses(40, seed=4)
    twists = SPACE.difference(ends, starts)
    for start, end, twist in zip(starts, ends, twists, strict=True):
        turned = expm(np.cross(twist[3:], np.eye(3)).T)
        expected = Rotation.from_rotvec(end[3:]).as_matrix()
        assert np.abs(turned @ Rotation.from_rotvec(start[3:]).as_matrix() - expected).max() <= 1e-12
        assert np.abs(SPACE.difference_at(end, start) - twist).max() <= 64 * EPS
        assert SPACE.distance_at(end, start) == pytest.approx(float(SPACE.distance(end, start)), rel=1e-14)
        assert SPACE.distance(SPACE.displace_at(start, twist), end) <= 64 * EPS
    assert SPACE.distance(SPACE.displace(starts, twists), ends).max() <= 64 * EPS


def test_the_velocity_is_the_twist_of_the_mixtures_motion():
    skill, states = pose_skill(), poses(60)
    step = 1e-6
    ahead = Stepper(skill, step).step_many(states).states
    twists = SPACE.difference(ahead, states) / step
    # A difference over one step is off by half a second derivative, and by rounding over the step.
    assert np.abs(skill.velocity(states) - twists).max() <= 100 * step + 64 * EPS / step
    single = np.stack([skill.velocity(state) for state in states])
    assert np.abs(single - skill.velocity(states)).max() <= 1e4 * EPS * np.abs(single).max()


@pytest.mark.parametrize("seed", range(5))
def test_neither_distance_ever_grows(seed):
    skill = pose_skill(seed)
    stepper = Stepper(skill, contraction_period(skill))
    states = poses(200, seed)
    for _ in range(60):
        ahead = stepper.step_many(states).states
        assert (angle_to(ahead) <= angle_to(states) + 64 * EPS).all()
        moved = [np.linalg.norm(each[:, :3] - TARGET[:3], axis=1) for each in (ahead, states)]
        assert (moved[0] <= moved[1] + 64 * EPS).all()
        states = ahead


def test_every_start_arrives():
    runs = rollout(pose_skill(), poses(100), duration=30.0, period=0.02)
    assert runs.arrived.all()
    moved, turned = SPACE.apart(runs.positions[:, -1], TARGET)
    assert moved.max() < 1e-3
    assert np.degrees(turned).max() < 1


def test_a_controller_follows_what_a_rollout_does():
    skill, start = pose_skill(), poses(1)[0]
    controller, state = Controller(skill, 0.02), start
    for _ in range(100):
        command = controller.step(state)
        state = SPACE.displace(state, 0.02 * command)
        assert SPACE.distance_at(state, controller.next) <= 64 * EPS
    path = rollout(skill, start[None], duration=2.0, period=0.02, arrival_distance=0).positions[0]
    assert SPACE.distance_at(state, path[100]) <= 1e-12


def test_a_pose_is_also_taken_with_a_quaternion():
    skill, state = pose_skill(), poses(1)[0]
    quaternion = Rotation.from_rotvec(state[3:]).as_quat()
    plain = Controller(skill, 0.01).step(state)
    for sign in (1, -1):
        command = Controller(skill, 0.01).step([*state[:3], *(sign * quaternion)])
        assert np.abs(command - plain).max() <= 1e4 * EPS * np.abs(plain).max()
    with pytest.raises(StateError, match="not zero"):
        Controller(skill, 0.01).step([*state[:3], 0, 0, 0, 0])


def test_caps_hold_for_both_parts_of_a_twist():
    skill = pose_skill()
    before = None
    for state in poses(50):
        command = Controller(skill, 0.01).step(state, max_speed=0.05, max_turn=0.2)
        moving, turning = np.linalg.norm(command[:3]), np.linalg.norm(command[3:])
        assert moving <= 0.05
        assert turning <= 0.2
        # One of them is what slows the motion down.
        assert moving >= 0.05 * (1 - 1e-9) or turning >= 0.2 * (1 - 1e-9)
        ahead = SPACE.displace(state, 0.01 * command)
        assert skill.v_distance(ahead[None]) < skill.v_distance(state[None])
        assert before is None or not np.array_equal(before, command)
        before = command


def test_at_the_seam_the_controller_keeps_its_side():
    skill = pose_skill()
    axis = np.array([0.0, 0.6, 0.8])

    def at(angle: float) -> np.ndarray:
        return SPACE.placed(np.array([0, 0, 0, *(LENGTH * angle * axis)]), TARGET)

    controller = Controller(skill, 1e-3)
    first = controller.step(at(np.pi - 1e-3))
    # Noise of the measurement takes the hand past half a turn: a memoryless field would turn back at once.
    second = controller.step(at(np.pi + 1e-3))
    assert np.linalg.norm(second - first) < 0.05 * np.linalg.norm(first)
    fresh = Controller(skill, 1e-3).step(at(np.pi + 1e-3))
    assert np.linalg.norm(fresh - first) > np.linalg.norm(first)


@pytest.mark.parametrize("make", ["learned", "merged", "combined"])
def test_a_rigidly_moved_target_moves_the_motion_likewise(make):
    skill: Skill = pose_skill()
    if make == "merged":
        skill = MergedSkill((pose_skill(), pose_skill(1)), np.array([0.3, 0.7]), gate="density")
    if make == "combined":
        skill = CombinedSkill((pose_skill(), pose_skill(1)), np.array([0.3, 0.7]))
    goal = poses(1, seed=9)[0]
    moved = retargeted(skill, goal)
    states = poses(40)
    carried = SPACE.carried(states, TARGET, goal)
    velocities, others = skill.velocity(states), moved.velocity(carried)
    turn = Rotation.from_rotvec(goal[3:]) * Rotation.from_rotvec(TARGET[3:]).inv()
    scale = np.abs(velocities).max()
    assert np.abs(others[:, :3] - velocities[:, :3]).max() <= 1e6 * EPS * scale
    assert np.abs(others[:, 3:] - turn.apply(velocities[:, 3:])).max() <= 1e6 * EPS * scale
    kept = retargeted(skill, goal[:3])
    assert (kept.attractors[0] == [*goal[:3], *TARGET[3:]]).all()
    with pytest.raises(UsageError, match="3 or 6 or 7"):
        retargeted(skill, goal[:5])


def test_parts_with_different_orientations_are_charted_apart():
    other = poses(1, seed=12)[0]
    parts = (pose_skill(), pose_skill(1, other))
    combined = CombinedSkill(parts, np.array([0.5, 0.5]))
    states = poses(50)
    expected = np.stack([part.density.log_density(part.charted(states)) for part in parts]).argmax(axis=0)
    assert (combined.part_at(states) == expected).all()
    assert [combined.selected(state) for state in states] == expected.tolist()
    runs = rollout(combined, states, duration=30.0, period=0.02)
    assert runs.arrived.all()
    ends = np.stack([TARGET, other])[runs.parts]
    assert SPACE.distance(runs.positions[:, -1], ends).max() < 1e-3


def test_a_pose_has_six_coordinates_and_a_length():
    assert Pose().dimension == 6
    assert Pose().blocks == (3, 3)
    assert Euclidean.cartesian(3).blocks == (3,)
    with pytest.raises(Exception, match="length"):
        Pose(length=0.0)
    with pytest.raises(Exception, match="6 coordinates"):
        Pose(names=("x", "y", "z"))
    assert replace(pose_skill(), speed=2.0).velocity(TARGET) == pytest.approx(np.zeros(6))
