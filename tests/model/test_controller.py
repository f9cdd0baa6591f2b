"""The robot's door: what a controller is told, what it refuses, and what it then remembers."""

from dataclasses import replace

import numpy as np
import pytest

from skillctl.errors import StateError, UsageError
from skillctl.model.combined import CombinedSkill
from skillctl.model.controller import Controller
from skillctl.model.merged import MergedSkill
from skillctl.model.skill import contraction_period
from skillctl.stability.certificate import certify

EPS = np.finfo(float).eps


@pytest.fixture
def kinds(make_skill):
    """A learned, a merged and a combined skill of the same parts."""
    rng = np.random.default_rng(5)
    parts = tuple(make_skill(rng, attractor=[0.0, 0.0]) for _ in range(2))
    merged = MergedSkill(parts, [0.4, 0.6])
    return {"learned": parts[0], "merged": merged, "combined": CombinedSkill(parts, [0.5, 0.5])}


KINDS = ["learned", "merged", "combined"]
SHAPES = [[0.1], [0.1, 0.2, 0.3], 0.1, [[0.1, 0.2]], []]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("state", SHAPES, ids=str)
def test_a_state_of_another_shape_is_refused_alike_by_all_kinds(kinds, kind, state):
    with pytest.raises(StateError, match=r"state: (expected shape|one at a time)"):
        Controller(kinds[kind], 1e-3).step(state)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("state", [[0.1], [[0.1]], [[[0.1, 0.2]]], "here"], ids=str)
def test_a_velocity_is_asked_for_with_the_right_shape(kinds, kind, state):
    with pytest.raises(StateError, match=r"state: (expected shape|not an array of numbers)"):
        kinds[kind].velocity(state)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e101, -1e308])
def test_a_measurement_that_is_no_number_changes_nothing(kinds, kind, bad):
    disturbed, untouched = Controller(kinds[kind], 1e-3), Controller(kinds[kind], 1e-3)
    for controller in (disturbed, untouched):
        controller.step([0.5, 0.4])
    with pytest.raises(StateError, match="must be finite"):
        disturbed.step([0.5, bad])
    assert disturbed.part == untouched.part
    assert (disturbed.step([0.5, 0.4]) == untouched.step([0.5, 0.4])).all()


def test_a_first_measurement_that_is_no_number_selects_no_part(kinds):
    controller = Controller(kinds["combined"], 1e-3)
    with pytest.raises(StateError):
        controller.step([np.nan, 0.0])
    assert controller.part is None


@pytest.mark.parametrize("cap", [0.0, -1.0, np.nan, np.inf])
def test_a_cap_is_a_positive_number(kinds, cap):
    controller = Controller(kinds["learned"], 1e-3)
    with pytest.raises(UsageError, match="max_speed: must be a positive number"):
        controller.step([0.5, 0.4], max_speed=cap)


@pytest.mark.parametrize("kind", KINDS)
def test_a_cap_shortens_the_command_and_keeps_its_direction(kinds, kind):
    free = Controller(kinds[kind], 1e-3).step([0.5, 0.4])
    speed = float(np.linalg.norm(free))
    capped = Controller(kinds[kind], 1e-3).step([0.5, 0.4], max_speed=0.25 * speed)
    assert np.abs(capped - 0.25 * free).max() <= 4 * EPS * speed
    assert (Controller(kinds[kind], 1e-3).step([0.5, 0.4], max_speed=2 * speed) == free).all()


@pytest.mark.parametrize("kind", KINDS)
def test_the_proved_period_is_accepted_and_a_longer_one_refused(kinds, kind):
    skill = kinds[kind]
    proved = certify(skill).period
    Controller(skill, proved)
    # The certificate rounds the estimate down by less than 2^-30 of it.
    assert proved <= contraction_period(skill) <= proved * (1 + 2.0**-29)
    with pytest.raises(UsageError, match=r"period: .* s is too long"):
        Controller(skill, 1.001 * proved)
    assert Controller(skill, 1.001 * proved, allow_unproved=True).period == 1.001 * proved


def test_an_unstable_skill_has_no_proved_period(kinds):
    skill = replace(kinds["learned"], system_matrices=-kinds["learned"].system_matrices)
    with pytest.raises(UsageError, match="no period is proved for this skill"):
        Controller(skill, 1e-6)
    assert np.isfinite(Controller(skill, 1e-6, allow_unproved=True).step([0.1, 0.1])).all()


def test_the_speed_of_the_whole_counts_for_the_period(kinds):
    slow, fast = (replace(kinds["combined"], speed=speed) for speed in (1.0, 4.0))
    assert contraction_period(fast) == pytest.approx(contraction_period(slow) / 4, rel=64 * EPS)
