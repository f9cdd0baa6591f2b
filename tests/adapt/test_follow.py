"""Weights fitted to whole motions: found where they are known, never at the cost of rate, period or proof."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skillctl.adapt import follow as module
from skillctl.adapt import task as task_module
from skillctl.adapt.follow import PERIOD, RATE_SHARE, follow, scaled_components
from skillctl.adapt.pace import paced, slowed
from skillctl.adapt.task import fit_to_task, task_distances
from skillctl.adapt.weights import WeightedMerger
from skillctl.compose.merge import merge as merge_skills
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.merged import MergedSkill
from skillctl.model.rollout import rollout
from skillctl.model.skill import contraction_period
from skillctl.model.space import Euclidean
from skillctl.stability.certificate import certify

STARTS = np.array([[0.4, 0.1], [-0.2, 0.3], [0.1, -0.4]])
WRITTEN = 1 - 1e-3  # periods and rates are certified in few digits, rounded down


@pytest.fixture
def parts(make_skill):
    rng = np.random.default_rng(1)
    return [make_skill(rng, n_components=k) for k in (2, 3, 4)]


def motions_of(skill, starts=STARTS, hurry=1.0):
    """Return what a skill does from starts, as demonstrations that take a ``hurry``-th of the time."""
    run = rollout(skill, starts, duration=20.0, period=0.002)
    assert run.arrived.all()
    shown = []
    for i in range(len(starts)):
        times, positions = run.trajectory(i)
        shown.append(Demonstration.from_positions(times[::5] / hurry, positions[::5]))
    return DemonstrationSet(tuple(shown), Euclidean.cartesian(2))


def factored(parts, seed):
    rng = np.random.default_rng(seed)
    return [scaled_components(p, rng.uniform(0.5, 2.0, p.n_components)) for p in parts]


def mean_error(skill, task):
    return float(task_distances(skill, task, skill.attractor).mean())


def test_known_weights_and_speed_are_found_from_equal_ones(parts, monkeypatch):
    monkeypatch.setattr(module, "STEPS", 2000)  # as fine as the truth is followed
    truth = merge_skills(parts, part_weights=[1, 3, 2], speed=0.8)
    task = motions_of(truth)
    found = follow(parts, task, np.ones(3), level="part")
    assert mean_error(found.skill, task) <= mean_error(truth, task)  # which is followed in steps, too
    # The pull towards equal weights
    assert found.skill.part_weights == pytest.approx(truth.part_weights, abs=0.05)
    assert found.skill.speed == pytest.approx(0.8, rel=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_factors_of_components_lead_nearer_than_weights_of_parts(parts, seed):
    task = motions_of(merge_skills(factored(parts, seed)))
    per_part, per_component = (
        mean_error(follow(parts, task, np.ones(3), level=level).skill, task)
        for level in ("part", "component")
    )
    assert per_component < 0.5 * per_part


def test_a_path_is_followed_at_the_speed_it_was_shown(parts):
    truth = merge_skills(parts, part_weights=[1, 3, 2])
    skills = [follow(parts, motions_of(truth, hurry=h), np.ones(3), level="part").skill for h in (1, 2)]
    assert skills[1].speed == pytest.approx(2 * skills[0].speed, rel=0.02)
    assert skills[1].part_weights == pytest.approx(skills[0].part_weights, abs=0.02)


@pytest.mark.parametrize("speed", [0.3, 2.5])
def test_a_merger_takes_as_long_as_the_demonstrations(parts, speed):
    truth = merge_skills(parts, part_weights=[1, 3, 2], speed=0.8)
    found = paced(replace(truth, speed=speed), [motions_of(truth)]).skill
    # A time is read off to a step, of which there are at least 200 in a demonstration.
    assert found.speed == pytest.approx(0.8, rel=0.02)
    assert found.part_weights.tolist() == truth.part_weights.tolist()


def test_a_merger_is_not_hurried_beyond_its_controller_period(parts):
    truth = merge_skills(parts)
    hasty = motions_of(truth, hurry=1e3)
    found = paced(truth, [hasty])
    assert found.late > 1
    assert contraction_period(found.skill) >= min(PERIOD, *(contraction_period(part) for part in parts))


def test_a_part_with_next_to_no_influence_is_left_out(parts):
    mixture = module._Mixture.of(tuple(parts), np.ones(3), "part")
    found = mixture.merged(np.array([1.5, 0.02, 0.5]), 3.0)
    assert [part.n_components for part in found.skill.parts] == [2, 4]
    assert found.weights == pytest.approx([0.5, 0.0, 0.5 / 3], rel=1e-15)
    assert found.skill.speed * found.skill.part_weights == pytest.approx([1.5, 0.5], rel=1e-15)


@pytest.mark.parametrize("level", ["part", "component"])
@pytest.mark.parametrize("seed", range(6))
def test_rate_and_period_are_kept_whatever_is_shown(make_skill, level, seed):
    rng = np.random.default_rng(seed)
    parts = [make_skill(rng, n_components=k) for k in (2, 3)]
    t = np.linspace(0, 1, 60)[:, None]
    wild = rng.normal(0, 0.3, 2) * (1 - t) + rng.normal(0, 0.3, 2) * np.sin(np.pi * t) * (1 - t)
    duration = 10.0 ** rng.uniform(-1.5, 1.5)  # far slower and far faster than the parts
    task = DemonstrationSet((Demonstration.from_positions(duration * t[:, 0], wild),), Euclidean.cartesian(2))
    found = follow(parts, task, np.ones(2), level=level).skill
    certificate, own = certify(found), [certify(part) for part in parts]
    assert certificate.verdict == "stable"
    assert certificate.period >= WRITTEN * min(PERIOD, *(c.period for c in own))
    share = RATE_SHARE if level == "component" else 1.0
    assert certificate.rate >= WRITTEN * share * found.speed * min(c.rate for c in own)


def test_parts_of_a_shorter_period_keep_theirs(parts):
    fast = [replace(part, speed=100.0) for part in parts]
    own = min(certify(part).period for part in fast)
    assert own < PERIOD
    task = motions_of(merge_skills(parts), hurry=300.0)
    for level in ("part", "component"):
        assert certify(follow(fast, task, np.ones(3), level=level).skill).period >= WRITTEN * own


def test_no_component_may_move_so_fast_that_its_steps_do_not_contract(parts):
    mixture = module._Mixture.of(tuple(parts), np.ones(3), "component")
    low, high = mixture.bounds(0.3 * mixture.periods.max())
    tight = mixture.periods < 0.3 * mixture.periods.max()
    assert tight.any()
    assert (high[~tight] > 1).all()
    assert high[tight] == pytest.approx(1.0, abs=2e-4)  # slower, and never faster than as it is
    contracting = np.minimum(5.0, mixture.periods / (0.3 * mixture.periods.max()))
    assert high[~tight] == pytest.approx(np.maximum(contracting, 1.0001)[~tight], rel=1e-12)
    assert (low < 1).all()


def test_a_merger_that_is_too_fast_for_the_controller_is_slowed_and_no_other(parts):
    merged = merge_skills(parts)
    assert slowed(merged).speed == merged.speed
    hasty = replace(merged, speed=1e4)
    assert WRITTEN * PERIOD <= certify(slowed(hasty)).period < 1.01 * PERIOD


def test_merged_parts_are_fitted_down_to_their_leaves(parts):
    nested = [merge_skills(parts[:2], gate="experts", parameters={"sharpness": 2.0}, speed=1.5), parts[2]]
    task = motions_of(merge_skills(nested, part_weights=[1, 2]))
    found = follow(nested, task, np.ones(2), level="component").skill
    assert isinstance(found.parts[0], MergedSkill)
    assert mean_error(found, task) < 0.2 * mean_error(merge_skills(nested), task)
    assert certify(found).verdict == "stable"


def test_the_search_begins_at_the_best_that_is_known_which_stays_slow_enough(parts, monkeypatch):
    seen = []

    def useless(members, shown, weights, *, level):
        seen.append(weights / weights.sum())
        return WeightedMerger(MergedSkill(members[:1], np.ones(1)), np.eye(3)[0])

    monkeypatch.setattr(task_module, "follow", useless)
    truth = merge_skills(parts, part_weights=[1, 6, 2])
    quick = fit_to_task(parts, motions_of(truth, hurry=1e3), np.eye(2), target=(0.0, 0.0))
    assert quick.choice == "weights per part"
    assert seen[0] == pytest.approx(truth.part_weights, abs=0.05)
    assert WRITTEN * PERIOD <= certify(quick.skill).period < 1.01 * PERIOD
    alone = fit_to_task(parts, motions_of(parts[1]), np.eye(2), target=(0.0, 0.0))
    assert seen[-1] == pytest.approx([0, 1, 0], abs=0.05)
    assert 1 in alone.used
