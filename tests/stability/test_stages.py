"""The proof of chains: levels and times by hand, stages that do not lead on, and random chains."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.controller import Controller
from skillctl.model.coordinates.chain import Chain
from skillctl.model.mixture import GaussianMixture
from skillctl.stability.certificate import certify
from skillctl.stability.stages import level_within, over_within

CHAINS = Path(__file__).parents[1] / "torture" / "chains.py"
P = np.array([[2.0, 1.0], [1.0, 2.0]])  # eigenvalues 1 and 3


def line_skill(make_skill, *, end=0.0, rate=2.0):
    """ξ̇ = −rate (ξ − end) with V = (ξ − end)², taught within 1 of 3: two standard deviations of 0.5."""
    skill = make_skill(np.random.default_rng(0), dimension=1, n_components=1, attractor=[end])
    taught = GaussianMixture(np.ones(1), np.array([[3.0]]), np.array([[[0.25]]]))
    return replace(skill, system_matrices=np.array([[[-rate]]]), density=taught)


def sphere(rng, count, d):
    directions = rng.normal(size=(count, d))
    return directions / np.linalg.norm(directions, axis=1)[:, None]


# --------------------------------------------------------------------------- where a stage is over


def test_the_level_is_the_largest_whose_set_lies_within_the_distance(make_skill):
    skill = make_skill(np.random.default_rng(0), lyapunov=P)  # λ_min = 1: {V ≤ c} reaches √c
    level = level_within(skill, 0.1)
    assert 0.01 * (1 - 1e-9) <= level <= 0.01
    assert 0.1 * (1 - 1e-9) <= over_within(skill, level) <= 0.1
    assert over_within(skill, 0.01) >= 0.1


@pytest.mark.parametrize("dimension", [2, 3])
def test_in_bent_coordinates_no_state_beyond_the_distance_is_at_the_level(make_skill, make_shears, dimension):
    rng = np.random.default_rng(1)
    for _ in range(2):
        p = np.eye(dimension) * rng.uniform(0.5, 2)
        plain = make_skill(rng, dimension=dimension, lyapunov=p, attractor=rng.normal(size=dimension))
        skill = replace(plain, coordinates=Chain((make_shears(rng, dimension, scale=0.3),)))
        level = level_within(skill, 0.02)
        away = (
            sphere(rng, 4000, dimension)
            * 0.02
            * (1 + np.concatenate([np.zeros(2000), rng.exponential(1, 2000)]))[:, None]
        )
        squares = skill.v_distance(skill.attractor + away) ** 2
        assert squares.min() > level
        assert level > 0.25 * squares.min()  # not much smaller than it has to be
        assert over_within(skill, level) <= 0.02


@pytest.mark.parametrize("bent", [False, True])
def test_angles_of_poses_count_by_the_characteristic_length(make_pose_skill, bent):
    rng = np.random.default_rng(2)
    skill = make_pose_skill(rng, length=0.2, lyapunov=np.diag([2.0, 3.0, 5.0]), bent=bent)
    level = level_within(skill, 0.02)
    states = skill.space.placed(
        sphere(rng, 4000, 6) * rng.uniform(0.02, 0.05, 4000)[:, None], skill.attractor
    )
    assert skill.space.distance(states, skill.attractor).min() >= 0.02 * (1 - 1e-9)
    assert (skill.v_distance(states) ** 2).min() > level * (1 - 1e-9)
    if not bent:  # P of the orientation is the identity, the smallest: turned by 0.1 rad, V is (0.2 · 0.1)²
        assert level == pytest.approx(4e-4, rel=1e-9)


def test_of_a_combined_stage_every_part_is_within_the_distance(make_skill):
    rng = np.random.default_rng(3)
    parts = (make_skill(rng, lyapunov=P), make_skill(rng, lyapunov=0.5 * np.eye(2)))
    assert level_within(CombinedSkill(parts, [0.5, 0.5]), 0.1) == level_within(parts[1], 0.1)


# ------------------------------------------------------------------------------------ by when it is


def test_the_bounds_are_those_computed_by_hand(make_skill):
    """Starts from 2 to 4, V₀ = 16; stage 2 begins within 0.1 of 0, so at most 1.1 from its end, V₀ = 1.21."""
    parts = line_skill(make_skill), line_skill(make_skill, end=1.0, rate=4.0)
    chain = ChainedSkill(parts, [0.01, 0.0025], [("close", "wait 0.25"), ("wait 1",)])
    certificate = certify(chain, period=0.1)
    course = certificate.course
    assert (certificate.verdict, certificate.scope, certificate.failures) == ("stable", "global", ())
    assert (course.low, course.high, course.period) == ((2.0,), (4.0,), 0.1)
    first, second = course.stages
    assert [first.within, second.within] == pytest.approx([0.1, 0.05], rel=1e-9)
    assert [first.highest, second.highest] == pytest.approx([16.0, 1.21], rel=1e-9)
    assert first.arrival == pytest.approx(math.log(4 / 0.1) / 2, rel=1e-9)
    assert second.arrival == pytest.approx(math.log(1.1 / 0.05) / 4, rel=1e-9)
    # A step ξ⁺ = (1 − rΔt) ξ is proved to shrink |ξ| by e^(−(r − r²Δt/2)Δt): rates 1.8 and 3.2.
    assert [first.steps, second.steps] == [math.ceil(math.log(40) / 0.18), math.ceil(math.log(22) / 0.32)]
    assert [first.waits, second.waits] == [0.25, 1.0]
    assert course.arrival == pytest.approx(first.arrival + second.arrival + 1.25, rel=1e-12)
    assert course.steps == first.steps + second.steps + 1 + 3 + 10
    assert certificate.rate == pytest.approx(2.0, rel=1e-9)
    assert certificate.period == pytest.approx(0.5, rel=1e-9)  # of ξ̇ = −4ξ: |1 − 4Δt| < 1


def test_a_controller_is_done_within_the_steps_with_all_events(make_skill):
    """From 4: 0.8^17 · 4 = 0.09; four steps of events; then 0.6^6 (1 − 0.09 · 0.8⁴) = 0.045."""
    parts = line_skill(make_skill), line_skill(make_skill, end=1.0, rate=4.0)
    chain = ChainedSkill(parts, [0.01, 0.0025], [("close", "wait 0.25"), ("wait 1",)])
    controller, state, steps = Controller(chain, 0.1), np.array([4.0]), 0
    while not controller.done:
        state = state + 0.1 * controller.step(state)
        steps += 1
    assert steps - 1 == 17 + 4 + 6 + 10  # the last call finds that all is over
    assert steps - 1 <= certify(chain, period=0.1).course.steps


def test_a_stage_that_begins_at_its_end_takes_no_time(make_skill):
    skill = line_skill(make_skill)
    course = certify(ChainedSkill((skill, skill), [0.01, 0.011], [(), ()])).course
    assert course.stages[1].arrival == course.stages[1].steps == 0


def test_a_stage_begins_wherever_a_part_of_the_stage_before_may_end(make_skill):
    """Two targets, at −2 and 2: the next stage, which ends at 1, begins up to 3.1 away from it."""
    ends = line_skill(make_skill, end=-2.0), line_skill(make_skill, end=2.0)
    both = CombinedSkill(ends, [0.5, 0.5])
    course = certify(ChainedSkill((both, line_skill(make_skill, end=1.0)), [0.01, 0.01], [(), ()])).course
    assert course.stages[0].parts == (1, 2)
    assert course.stages[0].highest == pytest.approx(36.0, rel=1e-9)  # from −2 to 4, farther than from 2
    assert course.stages[1].highest == pytest.approx(3.1**2, rel=1e-9)


def test_a_part_that_provably_does_not_begin_is_left_out(make_skill):
    def at(place):
        skill = line_skill(make_skill, end=place)
        return replace(skill, density=GaussianMixture(np.ones(1), np.array([[place]]), np.array([[[0.01]]])))

    both = CombinedSkill((at(0.0), at(5.0)), [0.5, 0.5])
    course = certify(ChainedSkill((at(0.0), both), [0.01, 0.01], [(), ()])).course
    assert course.stages[1].parts == (2,)


def test_a_period_that_is_not_proved_has_no_steps(make_skill):
    chain = ChainedSkill((line_skill(make_skill),) * 2, [0.01, 0.01], [(), ()])
    course = certify(chain, period=1.1).course
    assert course.steps is None
    assert course.arrival is not None


# ------------------------------------------------------------------- stages that do not lead on


def test_a_stage_that_is_not_proved_makes_the_chain_unproved(make_skill):
    good = line_skill(make_skill)
    bad = replace(good, system_matrices=np.array([[[0.1]]]))
    certificate = certify(ChainedSkill((good, bad), [0.01, 0.01], [(), ()]))
    assert (certificate.verdict, certificate.scope, certificate.course) == ("not proved", "none", None)
    assert certificate.rate is certificate.period is None
    assert certificate.failures[0].startswith("part 2: leaf 1, component 1:")


@pytest.mark.parametrize(("turn", "proved"), [(3.0, True), (math.pi - 0.11, True), (math.pi - 0.09, False)])
def test_a_stage_may_begin_turned_by_less_than_half_a_turn(make_pose_skill, turn, proved):
    """The level 4e-4 is that of 0.02 m, which is 0.1 rad with ℓ = 0.2 m/rad."""
    rng = np.random.default_rng(4)
    parts = [make_pose_skill(rng, target=[0.4, 0, 0.3, 0, 0, z], length=0.2) for z in (0, turn)]
    certificate = certify(ChainedSkill(tuple(parts), [4e-4, 4e-4], [(), ()]))
    assert (certificate.verdict == "stable") == proved
    if proved:
        bound = 4e-4 + (0.2 * (turn + 0.1)) ** 2  # position within 0.02 m, orientation within turn + 0.1 rad
        assert certificate.course.stages[1].highest == pytest.approx(bound, rel=0.01)
    else:
        (reason,) = certificate.failures
        assert "stage 2: its target is turned by 174.8°" in reason
        assert "within 5.73°" in reason


def test_poses_start_turned_anyhow(make_pose_skill):
    rng = np.random.default_rng(4)
    parts = tuple(make_pose_skill(rng, length=0.2) for _ in range(2))
    first, _ = certify(ChainedSkill(parts, [4e-4, 4e-4], [(), ()])).course.stages
    assert first.highest > (0.2 * math.pi) ** 2


def coupled(make_pose_skill, target):
    """Position and orientation contract together, not by themselves, with P = I: proved from within ℓπ."""
    skill = make_pose_skill(np.random.default_rng(5), target=target, length=0.2, n_components=1)
    across = np.zeros((6, 6))
    across[0, 3], across[3, 0] = 0.1, -0.1  # skew, so that −½(A + Aᵀ) stays
    return replace(skill, system_matrices=skill.system_matrices + across)


@pytest.mark.parametrize(("away", "proved"), [(0.5, True), (0.7, False)])
def test_a_stage_that_is_proved_nearby_only_must_begin_there(make_pose_skill, away, proved):
    targets = [0.0, 0, 0, 0, 0, 0], [away, 0, 0, 0, 0, 0]
    parts = tuple(coupled(make_pose_skill, target) for target in targets)
    certificate = certify(ChainedSkill(parts, [4e-4, 4e-4], [(), ()]))
    assert certificate.verdict == "inconclusive"
    assert certificate.scope == ("local" if proved else "none")
    assert (certificate.course is not None) == proved
    if not proved:
        assert "stage 2: it may begin up to 0.72" in certificate.failures[-1]
        assert "from within 0.628 m" in certificate.failures[-1]


# -------------------------------------------------------------------------- jumps, and many chains


@pytest.mark.parametrize("on_jump", ["stay", "back"])
def test_after_finitely_many_jumps_the_chain_ends_at_the_last_target(make_skill, on_jump):
    rng = np.random.default_rng(6)
    parts = tuple(make_skill(rng, attractor=rng.normal(size=2), rate=1.0) for _ in range(3))
    chain = ChainedSkill(parts, [1e-4] * 3, [("close",), ("wait 0.05",), ()], on_jump, 0.05)
    certificate = certify(chain, period=0.01)
    assert any(
        {"stay": "goes on from where", "back": "begun so far"}[on_jump] in s for s in certificate.proof
    )
    controller, state, stages = Controller(chain, 0.01, allow_unproved=True), np.zeros(2), [0]
    jumps = [(1, 0), (2, 1), (2, 0)]  # once a stage acts, to a place that another was taught
    for _ in range(10_000):
        if jumps and stages[-1] == jumps[0][0]:
            state = parts[jumps.pop(0)[1]].density.means[0]
        state = state + 0.01 * controller.step(state)
        stages.append(controller.stage)
        if controller.done:
            break
    assert controller.done
    assert not jumps
    assert np.linalg.norm(state - parts[-1].attractor) <= certificate.course.stages[-1].within
    assert [stage for stage in np.diff(stages) if stage < 0] == ([-1, -1, -2] if on_jump == "back" else [])


def test_random_chains_end_at_the_last_target_within_their_bounds():
    command = [sys.executable, CHAINS, "12", "20", "7"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "12 chains x 20 starts, 0 at fault" in done.stdout
