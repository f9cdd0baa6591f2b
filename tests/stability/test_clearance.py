"""Which bodies a hand is proved clear of: those its coordinates know, and those it never comes to."""

from __future__ import annotations

import numpy as np

from skillctl.model.coordinates.bodies import Ball
from skillctl.model.kept_out import kept_out
from skillctl.stability.certificate import certify
from skillctl.stability.clearance import clearance
from skillctl.stability.reach import bound_reach

KNOWN = Ball("known", (0.5, 0.0), 0.1)
FAR, NEAR = Ball("far", (5.0, 0.0), 0.1), Ball("near", (0.0, 0.1), 0.05)


def test_a_hand_is_clear_of_what_it_goes_round_and_of_what_it_never_comes_to(make_skill):
    skill = kept_out(make_skill(np.random.default_rng(0)), [KNOWN], margin=0.02)
    others = [(FAR, "it is a mesh"), (NEAR, "the target is in it")]
    without = clearance(skill, [KNOWN], others, None)
    assert (without.clear, without.may_meet) == (("known",), ("far", "near"))
    assert "May meet far: it is a mesh." in without.proof
    reach = bound_reach(skill, certify(skill), [-0.2, -0.2], [0.2, 0.2])
    found = clearance(skill, [KNOWN], others, reach)
    assert (found.clear, found.may_meet) == (("known", "far"), ("near",))


def test_without_the_coordinates_nothing_is_proved_of_what_they_would_go_round(make_skill):
    found = clearance(make_skill(np.random.default_rng(1)), [KNOWN], [], None)
    assert found.clear == ()
