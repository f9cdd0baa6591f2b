"""Learning skills of poses: position and orientation each contract by themselves, seen by the same gates."""

import numpy as np
import pytest

from skillctl import rotations
from skillctl.errors import InputDataError
from skillctl.evaluate.errors import report_errors
from skillctl.learning.barrier import StabilityBarrier
from skillctl.learning.field import Field, heun_rollouts
from skillctl.learning.fit import Fit, fit, learned_distance
from skillctl.learning.moments import VelocityMoments
from skillctl.learning.options import LearnOptions
from skillctl.learning.preprocess import align
from skillctl.learning.sensitivity import RolloutSlopes
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.pose import Pose

FAST = LearnOptions(preset="fast", n_components=3)
TARGET = np.array([0.4, -0.2, 0.3, 2.0, 1.5, -1.0])  # its rotation vector is 2.7 rad long
RATE = 1.5  # [1/s]
SMALL = 1e-6  # step of central differences: they are wrong by about its square and by rounding over it
BLOCKS = (3, 2)


def shown(offsets, space: Pose, times) -> DemonstrationSet:
    made = [
        Demonstration.from_positions(times, space.placed(x, TARGET), f"motion {i + 1}", space)
        for i, x in enumerate(offsets)
    ]
    return DemonstrationSet(tuple(made), space)


def straight(length: float = 0.4, unit: float = 1.0) -> DemonstrationSet:
    """Return motions that fall at one rate, in position and in orientation, to the target."""
    times = np.linspace(0, 6, 300)
    starts = np.array([[0.5, 0.2, 0.1, 0.3, -0.2, 0.1], [0.5, 0.1, 0.2, 0.2, -0.3, 0.1]]) * unit
    falling = (np.exp(-RATE * times) - np.exp(-RATE * times[-1]))[:, None]
    return shown([falling * start for start in starts], Pose(length=length * unit), times)


def curved(length: float = 0.3, bend: float = 1.0) -> DemonstrationSet:
    """Return motions that bend in position while they turn."""
    times = np.linspace(0, 3, 200)
    s = (1 - times / 3)[:, None] ** 2
    paths = []
    for shift in (-0.02, 0.0, 0.02):
        position = np.hstack([0.4 * s, bend * (0.3 + shift) * s * (1 - s), (0.2 + shift) * s])
        paths.append(np.hstack([position, length * np.hstack([0.8 * s**2, 0.5 * s * (1 - s), -0.4 * s])]))
    return shown(paths, Pose(length=length), times)


@pytest.fixture(scope="module")
def learned() -> Fit:
    return fit(curved(), FAST)


def test_a_linear_motion_is_learned_as_it_is() -> None:
    skill = fit(straight(), LearnOptions(n_components=1)).skill
    np.testing.assert_allclose(skill.attractor[:3], TARGET[:3], atol=1e-12)
    assert rotations.angles(skill.attractor[3:], TARGET[3:]) < 1e-7
    offset = np.array([0.2, 0.06, 0.06, 0.1, -0.1, 0.04])
    velocity = skill.velocity(skill.space.placed(offset, skill.attractor)[None])[0]
    # Displaced and distant copies, and a time grid of 60 samples, leave a few per cent.
    np.testing.assert_allclose(velocity[:3], -RATE * offset[:3], atol=0.05 * RATE * 0.22)


@pytest.mark.parametrize("options", [FAST, LearnOptions(objective="mse", preset="fast", n_components=3)])
def test_position_and_orientation_do_not_drive_each_other(options) -> None:
    skill = fit(curved(), options).skill
    assert (skill.system_matrices[:, :3, 3:] == 0).all()
    assert (skill.system_matrices[:, 3:, :3] == 0).all()
    np.testing.assert_array_equal(skill.lyapunov[3:], np.eye(6)[3:])
    np.testing.assert_array_equal(skill.lyapunov[:, 3:], np.eye(6)[:, 3:])
    symmetric = skill.lyapunov @ skill.system_matrices
    assert (np.linalg.eigvalsh(symmetric + symmetric.swapaxes(1, 2)) < 0).all()


def test_shears_bend_the_position_alone() -> None:
    options = LearnOptions(preset="fast", n_components=3, coordinates="shears")
    skill = fit(curved(bend=8.0), options).skill  # farther from the target half-way than at the start
    x = np.random.default_rng(0).standard_normal((20, 6)) * 0.1
    y = skill.coordinates.forward(x)
    np.testing.assert_array_equal(y[:, 3:], x[:, 3:])
    assert np.abs(y[:, :3] - x[:, :3]).max() > 1e-4
    np.testing.assert_array_equal(skill.lyapunov[3:], np.eye(6)[3:])


def test_motions_are_repeated_in_position_and_orientation(learned) -> None:
    reports = report_errors(learned.skill, learned.demonstrations)
    assert all(report.arrived for report in reports)
    assert max(report.dtw for report in reports) < 0.02 * curved().extent
    assert 0 < max(report.dtw_angle for report in reports) < np.radians(2)
    assert max(report.turning_rmse for report in reports) < 0.2  # [rad/s], of about 1


def test_the_orientations_of_errors_are_said_apart(learned) -> None:
    """A skill whose target is turned by 0.2 rad errs by that, and not in position."""
    skill, motions = learned.skill, learned.demonstrations
    turn = np.concatenate(
        [np.zeros(3), rotations.turned(np.array([0.2, 0, 0]), rotations.quaternions(TARGET[3:]))]
    )
    goal = skill.space.displace(skill.attractor, turn)
    ends = [goal] * len(motions)
    for moved in report_errors(skill, motions, ends=ends):
        assert moved.moved == 0
        assert moved.moved_angle == pytest.approx(0.2, abs=1e-9)
        assert moved.end_error < 1e-3


def test_a_motion_that_is_carried_to_another_pose_gives_the_same_skill(learned) -> None:
    goal = np.array([1.0, 2.0, -3.0, -0.3, 0.4, 2.2])
    there = fit(curved().carried(TARGET, goal), FAST).skill
    np.testing.assert_allclose(there.system_matrices, learned.skill.system_matrices, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(there.attractor[:3], goal[:3], atol=1e-9)
    assert rotations.angles(there.attractor[3:], goal[3:]) < 1e-7


def test_the_unit_of_length_changes_nothing() -> None:
    here, there = (fit(straight(unit=unit), FAST).skill for unit in (1.0, 100.0))
    np.testing.assert_allclose(there.system_matrices, here.system_matrices, rtol=1e-4, atol=1e-4)


def test_ends_are_averaged_without_the_one_that_differs() -> None:
    motions = curved()
    there = TARGET + np.array([0, 0, 0.2, 0, 0.5, 0])
    apart = motions.carried(TARGET, there).demonstrations[0]
    _, end = align(DemonstrationSet((*motions.demonstrations, apart), motions.space))
    np.testing.assert_allclose(end[:3], TARGET[:3], atol=1e-12)
    assert rotations.angles(end[3:], TARGET[3:]) < 1e-3


def test_a_motion_that_turns_by_half_a_turn_and_more_is_refused() -> None:
    times = np.linspace(0, 3, 100)
    turning = np.hstack([0.1 * (3 - times)[:, None], np.zeros((100, 4)), 0.4 * (3 - times)[:, None]])
    with pytest.raises(InputDataError, match=r"motion 1: at sample \d+ it has turned 180°"):
        fit(shown([turning], Pose(length=0.3), times), FAST)  # 0.4 · 3 / 0.3 = 4 rad


def test_one_distance_for_several_motions_has_blocks_too() -> None:
    distance = learned_distance([curved(), straight(length=0.3)])
    np.testing.assert_array_equal(distance.lyapunov[3:], np.eye(6)[3:])
    assert (fit(curved(), FAST, distance=distance).skill.lyapunov == distance.lyapunov).all()


def blocked(generator) -> Field:
    matrices = -np.eye(5) + 0.3 * generator.standard_normal((2, 5, 5))
    matrices[:, :3, 3:] = matrices[:, 3:, :3] = 0
    return Field(matrices, 0.3 * generator.standard_normal((2, 21)), BLOCKS)


def differences(function, count: int):
    """Return the derivatives of an array-valued function at zero, by central differences; the last axis."""
    steps = SMALL * np.eye(count)
    return np.stack([(function(step) - function(-step)) / (2 * SMALL) for step in steps], axis=-1)


def test_derivatives_of_a_field_in_blocks_are_those_of_differences() -> None:
    generator = np.random.default_rng(1)
    field, points = blocked(generator), generator.standard_normal((5, 40))
    assert field.n_parameters == 2 * (9 + 4) + 2 * 21
    slopes = differences(
        lambda step: field.stepped(step).velocities(points), field.n_parameters
    )  # (5, 40, p)
    half = generator.standard_normal((40, 5, 5))
    for metric in (None, half @ half.swapaxes(1, 2)):
        moments = VelocityMoments(points, generator.uniform(0.5, 1, 40), metric)
        at = moments.linearised(field)
        weighed = np.stack([moments.weighed(column) for column in np.moveaxis(slopes, 2, 0)], axis=2)
        expected = np.einsum("inp,inq->pq", slopes, weighed)
        np.testing.assert_allclose(moments.normal(at), expected, atol=1e-7 * np.abs(expected).max())
    forces = generator.standard_normal((5, 40))
    expected = np.einsum("inp,in->p", slopes, forces)
    np.testing.assert_allclose(at.pull_back(forces), expected, atol=1e-7 * np.abs(expected).max())


def test_sensitivities_of_rollouts_in_blocks_are_those_of_differences() -> None:
    generator = np.random.default_rng(2)
    field, starts, steps = blocked(generator), generator.standard_normal((5, 3)), np.array([0.1, 0.12, 0.08])
    states, predicted = heun_rollouts(field, starts, steps, 6)
    table = RolloutSlopes(field, states, predicted, steps).at_nodes(3)
    by_step = differences(
        lambda step: heun_rollouts(field.stepped(step), starts, steps, 6)[0], field.n_parameters
    )
    np.testing.assert_allclose(table, by_step[[3, 6]].transpose(0, 2, 1, 3), atol=1e-7)


def test_derivatives_of_the_barrier_in_blocks_are_those_of_differences() -> None:
    field = blocked(np.random.default_rng(3))
    barrier = StabilityBarrier(np.diag([1.2, 0.9, 1.0, 1.0, 1.0]), 0.01, 0.02, BLOCKS)
    zeros = np.zeros(field.logits.size)

    def moved(step):
        return field.stepped(np.append(step, zeros)).matrices

    gradient, hessian = barrier.derivatives(field.matrices)
    slopes = differences(lambda step: barrier.value(moved(step)).sum(), 26)
    np.testing.assert_allclose(gradient.ravel(), slopes, atol=1e-6 * np.abs(slopes).max())
    curvatures = differences(lambda step: barrier.derivatives(moved(step))[0], 26)
    for k in range(2):
        own = curvatures[k][:, 13 * k : 13 * k + 13]
        np.testing.assert_allclose(hessian[k], own, atol=1e-6 * np.abs(own).max())
