"""Rollouts and the controller: what happens over time."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from skillctl.errors import UsageError
from skillctl.model.combined import CombinedSkill
from skillctl.model.controller import Controller
from skillctl.model.mixture import GaussianMixture
from skillctl.model.retarget import retargeted
from skillctl.model.rollout import ARRIVAL_DISTANCE, arrival_distance_of, rollout
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import extent
from skillctl.model.space import Euclidean
from skillctl.model.stepper import CLOSE, _within

EPS = np.finfo(float).eps


def linear_skill(matrix, attractor):
    d = len(attractor)
    one = np.eye(d)[None]
    return SedsSkill(
        priors=[1.0],
        means=[attractor],
        covariances=one,
        system_matrices=[matrix],
        residual_covariances=one,
        attractor=attractor,
        lyapunov=np.eye(d),
        density=GaussianMixture([1.0], [attractor], one),
        space=Euclidean.cartesian(d),
    )


MATRIX = np.array([[-1.0, 2.0, 0.0], [-2.0, -1.5, 0.3], [0.0, -0.3, -0.8]])
GOAL = np.array([0.1, -0.2, 0.3])


def test_a_rollout_of_a_linear_system_is_the_power_of_its_step():
    start = np.array([1.0, 1.0, -1.0])
    result = rollout(linear_skill(MATRIX, GOAL), [start], duration=0.5, period=0.01)
    step = np.eye(3) + 0.01 * MATRIX
    expected = GOAL + np.stack([np.linalg.matrix_power(step, n) @ (start - GOAL) for n in range(51)])
    assert result.positions.shape == (1, 51, 3)
    # 50 steps, each right to a few ulps of the state
    assert np.abs(result.positions[0] - expected).max() <= 50 * 16 * EPS * np.abs(start).max()
    assert np.abs(result.times - 0.01 * np.arange(51)).max() == 0


def test_halving_the_period_halves_the_distance_to_the_exponential():
    start = np.array([1.0, 1.0, -1.0])
    exact = GOAL + expm(MATRIX) @ (start - GOAL)
    errors = [
        np.linalg.norm(
            rollout(linear_skill(MATRIX, GOAL), [start], duration=1.0, period=p).positions[0, -1] - exact
        )
        for p in (1 / 512, 1 / 1024)
    ]
    # Euler is of first order: the ratio differs from 2 by O(Δt ‖A‖)
    assert abs(errors[0] / errors[1] - 2) < 10 * np.linalg.norm(MATRIX, 2) / 512


def test_a_fine_rollout_follows_scipys_integrator(make_skill):
    skill = make_skill(np.random.default_rng(0), dimension=2, n_components=4)
    start = skill.means[0]
    reference = solve_ivp(lambda _, x: skill.velocity(x), (0.0, 1.0), start, rtol=1e-10, atol=1e-12).y[:, -1]
    coarse, fine = (
        rollout(skill, [start], duration=1.0, period=p).positions[0, -1] for p in (1 / 2000, 1 / 4000)
    )
    # Richardson: the error of the finer one is about the difference of the two
    assert np.linalg.norm(fine - reference) < 2 * np.linalg.norm(fine - coarse)


def test_arrival_is_the_first_time_within_the_distance():
    skill = linear_skill(-np.eye(1), [0.0])
    result = rollout(skill, [[1.0], [1e-4], [-8.0]], duration=4.0, period=0.5, arrival_distance=0.1)
    # 1, ½, ¼, ⅛, 1/16: the fourth step is the first below 0.1; −8 needs seven
    assert result.arrival_times.tolist() == [2.0, 0.0, 3.5]
    assert result.arrived.all()
    times, positions = result.trajectory(0)
    assert times.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert positions[:, 0].tolist() == [1.0, 0.5, 0.25, 0.125, 0.0625]
    assert len(result.times) == 8  # it ends when the last has arrived


def test_what_does_not_arrive_in_time_has_no_arrival():
    result = rollout(linear_skill(-np.eye(1), [0.0]), [[1.0]], duration=0.75, period=0.5)
    assert np.isnan(result.arrival_times).all()
    assert not result.arrived.any()
    assert result.trajectory(0)[0].tolist() == [0.0, 0.5, 1.0]  # the duration is covered


@pytest.mark.parametrize(
    "arguments",
    [
        {"starts": [0.0, 0.0, 0.0]},
        {"starts": [[0.0, 0.0]]},
        {"period": 0.0},
        {"period": np.nan},
        {"period": np.inf},
        {"duration": -1.0},
        {"duration": np.inf},
    ],
)
def test_a_rollout_needs_starts_of_the_dimension_and_a_positive_finite_time(arguments):
    with pytest.raises(UsageError):
        rollout(
            linear_skill(MATRIX, GOAL),
            **{"starts": [[0.0, 0.0, 0.0]], "period": 0.1, "duration": 1.0, **arguments},
        )


@pytest.fixture
def two_ways(make_skill):
    rng = np.random.default_rng(31)
    parts = tuple(make_skill(rng, attractor=place, rate=1.0) for place in ([0.0, 0.0], [1.0, 0.0]))
    wide = [
        replace(p, density=GaussianMixture([1.0], [p.attractor], [0.1 * np.eye(2)])) for p in parts
    ]  # equal Gaussians around both attractors: the border is the line x = ½
    return CombinedSkill(tuple(wide), [0.5, 0.5], disturbance_distance=0.05)


def test_a_latched_rollout_ends_at_the_attractor_its_start_selects(two_ways):
    starts = np.random.default_rng(1).uniform([-0.5, -1.0], [1.5, 1.0], (100, 2))
    result = rollout(two_ways, starts, duration=60.0, period=0.005)
    assert result.arrived.all()
    assert (result.parts == (starts[:, 0] > 0.5)).all()
    # Each trajectory moves on within 1 mm of its attractor until the last one arrives.
    ends = np.linalg.norm(result.positions[:, -1] - two_ways.attractors[result.parts], axis=1)
    assert ends.max() < ARRIVAL_DISTANCE


def test_a_latched_rollout_can_be_continued(two_ways):
    starts = np.random.default_rng(4).uniform([0.0, -1.0], [1.0, 1.0], (20, 2))
    whole = rollout(two_ways, starts, duration=0.5, period=0.01)
    first = rollout(two_ways, starts, duration=0.25, period=0.01)
    rest = rollout(two_ways, first.positions[:, -1], duration=0.25, period=0.01, parts=first.parts)
    assert (rest.positions[:, -1] == whole.positions[:, -1]).all()
    assert (rest.parts == whole.parts).all()


def test_a_controller_keeps_its_part_across_the_border(two_ways):
    controller = Controller(two_ways, period=0.01)
    x = np.array([0.49, 0.0])
    for _ in range(5):
        x = x + 0.01 * controller.step(x)
    assert controller.part == 0
    # Nudges below the disturbance distance carry it over the border without a new choice.
    for _ in range(20):
        x = x + 0.01 * controller.step(x) + [0.04, 0.0]
    assert x[0] > 0.55
    assert controller.part == 0
    assert (controller.step(x) == two_ways.velocity(x, np.array([0]))).all()


def test_a_jump_beyond_the_disturbance_distance_selects_again(two_ways):
    controller = Controller(two_ways, period=0.01)
    controller.step([0.2, 0.0])
    assert controller.part == 0
    controller.step([0.9, 0.0])
    assert controller.part == 1
    controller.step([0.9, 0.0] + 0.01 * two_ways.velocity([0.9, 0.0]) + [0.0, 0.051])
    assert controller.part == 1  # selected again, in the region of the same part


def test_a_reset_makes_the_next_step_a_start(two_ways):
    controller = Controller(two_ways, period=0.01)
    controller.step([0.49, 0.0])
    controller.reset()
    assert controller.part is None
    controller.step([0.51, 0.0])  # nearer than the disturbance distance, and yet a new choice
    assert controller.part == 1


def test_an_instantaneous_controller_chooses_at_every_step(two_ways):
    controller = Controller(replace(two_ways, gate="instantaneous"), period=0.01)
    for x, part in (([0.49, 0.0], 0), ([0.51, 0.0], 1), ([0.49, 0.0], 0)):
        velocity = controller.step(x)
        assert controller.part == part
        assert (velocity == two_ways.velocity(np.array(x), np.array([part]))).all()


@pytest.fixture
def crossed(two_ways):
    """Each part acts around the attractor of the other, so that every motion crosses the border."""
    left, right = two_ways.parts
    swapped = (replace(left, density=right.density), replace(right, density=left.density))
    return replace(two_ways, parts=swapped)


def test_a_step_of_its_own_is_no_disturbance_however_long(crossed):
    controller = Controller(crossed, period=0.05)
    x = np.array([0.9, 0.0])
    longest = 0.0
    for _ in range(60):
        step = 0.05 * controller.step(x)
        longest = max(longest, float(np.linalg.norm(step)))
        x = x + step
        assert controller.part == 0
    assert longest > crossed.disturbance_distance
    assert crossed.part_at([x]) == [1]  # a new choice would have been another one


def test_an_instantaneous_rollout_chooses_at_every_step(crossed):
    skill = replace(crossed, gate="instantaneous")
    starts = np.random.default_rng(2).uniform([0.3, -1.0], [0.7, 1.0], (20, 2))
    result = rollout(skill, starts, duration=0.2, period=0.01)
    x = starts
    for n in range(1, result.positions.shape[1]):
        x = x + 0.01 * skill.velocity(x)
        assert np.abs(result.positions[:, n] - x).max() <= 1e3 * EPS
    assert (skill.part_at(starts) != result.parts).any()


def test_a_long_rollout_keeps_a_bounded_number_of_states(make_skill):
    skill = make_skill(np.random.default_rng(0))
    start = skill.attractor + 0.5
    long = rollout(skill, [start], duration=4.5, period=1e-4, arrival_distance=1e-9)
    assert long.positions.shape[1] == len(long.times) == 1 + 45_000 // 3  # every third of 45,000 states
    assert np.abs(np.diff(long.times) - 3e-4).max() <= 45_000 * EPS
    assert long.times[-1] == pytest.approx(4.5, rel=45_000 * EPS)
    short = rollout(skill, [start], duration=1e-3, period=1e-4, arrival_distance=1e-9)
    assert np.abs(short.positions[0, 3] - long.positions[0, 1]).max() == 0


def test_a_small_motion_arrives_at_its_own_scale(make_skill):
    skill = make_skill(np.random.default_rng(0))
    small = replace(
        skill,
        means=1e-3 * skill.means,
        covariances=1e-6 * skill.covariances,
        attractor=1e-3 * skill.attractor,
        density=GaussianMixture(
            skill.density.priors, 1e-3 * skill.density.means, 1e-6 * skill.density.covariances
        ),
    )
    assert arrival_distance_of(skill) == 1e-3
    # Two standard deviations around the data, of which two hundredths: a thousandth of the large skill's.
    assert arrival_distance_of(small) == pytest.approx(0.02 * extent(small.density), rel=4 * EPS)
    assert arrival_distance_of(small) < 1e-3 * 0.02 * 1.01 * extent(skill.density)


def test_other_skills_need_no_memory(make_skill):
    skill = make_skill(np.random.default_rng(0))
    controller = Controller(skill, period=0.01)
    assert (controller.step([0.3, 0.1]) == skill.velocity([0.3, 0.1])).all()
    assert controller.part == 0


@pytest.mark.parametrize("period", [0.0, -1.0, np.nan, np.inf])
def test_a_controller_needs_a_period(make_skill, period):
    with pytest.raises(UsageError, match="period: must be a positive number"):
        Controller(make_skill(np.random.default_rng(0)), period)


def test_a_moved_aligned_skill_selects_the_same_parts(two_ways):
    aligned = replace(two_ways, parts=tuple(retargeted(p, [0.0, 0.0]) for p in two_ways.parts))
    moved = retargeted(aligned, [3.0, -2.0])
    starts = np.random.default_rng(3).uniform(-1, 1, (50, 2))
    assert (moved.part_at(starts + np.array([3.0, -2.0])) == aligned.part_at(starts)).all()


@pytest.mark.parametrize("full", [1 + 1e-9, 1.5, 42.0, 1e6])
@pytest.mark.parametrize("bend", [-0.4, -0.1, 0.0, 3.0])
def test_the_share_of_a_step_that_keeps_a_cap_is_found_in_a_few_trials(full, bend):
    """What a share s takes is full · s (1 + bend s) / (1 + bend), which rises."""
    tried = []

    def taken(share):
        tried.append(share)
        return full * share * (1 + bend * share) / (1 + bend)

    share = _within(taken)
    assert 1 - CLOSE <= taken(share) <= 1
    assert len(tried) <= 12  # bisection to one part in 10¹⁰ needs more than thirty
