"""Golden motions: rollouts that any other implementation of a skill must come by, too."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from skillctl.errors import InvalidModelError
from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.controller import Controller
from skillctl.model.coordinates.chain import Chain
from skillctl.model.golden import MOTIONS, RECORDS, STRIDE, GoldenMotions, golden_motions
from skillctl.model.merged import MergedSkill

KINDS = ["learned", "bent", "merged", "latched", "instantaneous", "chain", "pose", "many"]


@pytest.fixture
def make_kind(make_skill, make_pose_skill, make_shears):
    """Return a maker of a skill of a kind."""

    def make(kind):
        rng = np.random.default_rng(7)
        if kind == "pose":
            return make_pose_skill(rng)
        parts = tuple(make_skill(rng, attractor=goal) for goal in rng.normal(0, 0.3, (9, 2)))
        aligned = (parts[0], replace(parts[1], attractor=parts[0].attractor))
        kinds = {
            "learned": lambda: parts[0],
            "bent": lambda: replace(parts[0], coordinates=Chain((make_shears(rng, 2, scale=0.3),))),
            "merged": lambda: MergedSkill(aligned, [0.4, 0.6]),
            "latched": lambda: CombinedSkill(parts[:2], [0.5, 0.5]),
            "instantaneous": lambda: CombinedSkill(aligned, [0.5, 0.5], gate="instantaneous"),
            "chain": lambda: ChainedSkill(parts[:2], [1e-3, 1e-4], ((), ("wait 0.1",))),
            "many": lambda: CombinedSkill(parts, np.full(9, 1 / 9)),
        }
        return kinds[kind]()

    return make


def test_states_are_those_of_steps_written_out(make_kind):
    skill = make_kind("learned")
    golden = golden_motions(skill)
    period = golden.times[1] / 4
    for states in golden.states:
        x = states[0]
        for step in range(1, STRIDE * RECORDS + 1):
            densities = [
                prior * multivariate_normal(mean, covariance).pdf(x)
                for prior, mean, covariance in zip(skill.priors, skill.means, skill.covariances, strict=True)
            ]
            matrix = np.einsum("k,kij->ij", densities, skill.system_matrices) / sum(densities)
            x = x + period * skill.speed * matrix @ (x - skill.attractor)
            if step % STRIDE == 0:
                # Densities are rounded more here than where they are compared as logarithms.
                assert np.abs(x - states[step // STRIDE]).max() < 1e-10


@pytest.mark.parametrize("kind", KINDS)
def test_a_controller_comes_by_the_same_states(make_kind, kind):
    skill = make_kind(kind)
    golden = golden_motions(skill)
    assert 1 <= len(golden.states) <= MOTIONS
    if kind == "chain":  # whose controller waits
        skill = replace(skill, events=((), ()))
    for states in golden.states:
        controller = Controller(skill, golden.times[1] / STRIDE)
        x = states[0]
        for step in range(1, STRIDE * RECORDS + 1):
            controller.step(x)
            x = controller.next
            if step % STRIDE == 0:
                assert skill.space.distance_at(x, states[step // STRIDE]) < 1e-10


@pytest.mark.parametrize("kind", KINDS)
def test_a_skill_agrees_with_its_own_and_another_one_does_not(make_kind, kind):
    skill = make_kind(kind)
    golden = golden_motions(skill)
    own = golden.compared(skill)
    assert (own.largest, own.agrees, own.states) == (0.0, True, golden.states[..., 0].size)
    assert 0 < own.allowed < 1e-7

    def changed(factor):
        return golden.compared(
            skill.with_leaves(lambda leaf: replace(leaf, system_matrices=factor * leaf.system_matrices))
        )

    assert changed(1 + 1e-14).agrees
    assert not changed(1 + 1e-5).agrees
    assert not changed(-1e3).agrees


def test_motions_that_go_to_infinity_do_not_agree(make_kind):
    skill = make_kind("learned")
    golden = golden_motions(skill)
    with np.errstate(all="ignore"):
        wild = golden.compared(replace(skill, system_matrices=1e50 * skill.system_matrices))
    assert (wild.largest, wild.agrees) == (np.inf, False)


def test_none_are_recorded_where_no_period_is_proved(make_kind):
    skill = make_kind("learned")
    assert golden_motions(replace(skill, system_matrices=-skill.system_matrices)) is None


@pytest.mark.parametrize("times", [[0, 1, 3], [0, 0, 0], [1, 2, 3], [0, -1, -2], [0, np.nan, 1]])
def test_times_rise_from_zero_in_equal_steps(times):
    with pytest.raises(InvalidModelError, match="golden times"):
        GoldenMotions(times, np.zeros((1, 3, 2)))


def test_one_state_is_no_motion():
    with pytest.raises(InvalidModelError, match="golden times"):
        GoldenMotions([0.0], np.zeros((1, 1, 2)))
