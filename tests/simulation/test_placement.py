from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillctl.errors import UsageError
from skillctl.model.seds import SedsSkill
from skillctl.model.space import Euclidean
from skillctl.simulation.arms import ARMS
from skillctl.simulation.placement import Placement, placements
from skillctl.simulation.scenario import Scenario

MakeLinear = Callable[..., SedsSkill]
PANDA = ARMS["panda"]
EPS = np.finfo(np.float64).eps
metres = st.floats(-1, 1, width=16)


def placed(skill: SedsSkill, **options: object) -> Placement:
    return placements(skill, PANDA, Scenario(**options))[0]


@given(x=metres, y=metres, scale=st.floats(0.5, 4, width=16))
def test_a_position_in_the_plane_comes_from_the_state_it_stands_for(x: float, y: float, scale: float) -> None:
    placement = Placement(np.eye(3)[:, [1, 2]], np.array([0.5, -0.25, 0.75]), scale, "yz")

    position = placement.to_workspace(np.array([x, y]))

    assert position[0] == 0.5
    # One product and one sum each way; magnitudes stay below 8.
    assert placement.to_state(position) == pytest.approx([x, y], abs=8 * 4 * EPS / scale)


def test_a_3d_skill_is_used_where_it_was_recorded(reach: SedsSkill) -> None:
    placement = placed(reach)
    assert (placement.to_workspace(reach.means) == reach.means).all()
    assert (placement.to_state(reach.means) == reach.means).all()


def test_a_small_2d_skill_fills_the_room_in_front_of_the_arm(stroke: SedsSkill) -> None:
    start = (-0.08, 0.05)
    placement = placed(stroke, start=start)
    corners = placement.to_workspace(np.vstack([stroke.means, stroke.attractor, start]))
    assert placement.plane == "xy"
    assert 0.1 < np.ptp(corners, axis=0).max() <= 0.3
    assert np.linalg.norm(corners[:, :2] - PANDA.reach_centre[:2], axis=1).max() < 0.3
    assert np.ptp(corners[:, 2]) == 0


def test_a_2d_skill_is_brought_to_the_middle_wherever_it_was_recorded(linear: MakeLinear) -> None:
    skill = linear((3.0, -2.0), spread=0.01)
    placement = placed(skill, plane="yz")
    # A box of 4 standard deviations becomes 0.3 m; sums of some 30 m are rounded.
    assert placement.scale == pytest.approx(7.5, rel=EPS)
    assert placement.to_workspace(skill.attractor) == pytest.approx(PANDA.reach_centre, abs=64 * EPS)


def test_a_2d_skill_of_the_arms_own_size_keeps_it(linear: MakeLinear) -> None:
    assert placed(linear((0.0, 0.0), spread=0.06)).scale == 1.0


def test_coordinate_names_choose_the_plane(linear: MakeLinear) -> None:
    for names in (("x", "y"), ("x", "z"), ("y", "z")):
        skill = linear((0.0, 0.0), space=Euclidean(names))
        placement = placed(skill)
        assert placement.plane == "".join(names)
        axes = ["xyz".index(name) for name in names]
        assert (placement.axes == np.eye(3)[:, axes]).all()


def test_given_values_are_taken_literally(stroke: SedsSkill) -> None:
    placement = placed(stroke, plane="yz", scale=2.5, origin=(0.4, 0.1, 0.6))
    assert placement.to_workspace(np.array([0.02, -0.04])) == pytest.approx([0.4, 0.15, 0.5], abs=1e-15)


def test_the_pull_to_the_plane_leaves_the_skill_alone(stroke: SedsSkill) -> None:
    placement = placed(stroke, plane="yz", scale=2.0, origin=(0.5, 0.0, 0.5))
    velocity = placement.lift(np.array([0.03, -0.01]), np.array([0.6, 0.2, 0.3]))
    assert velocity[1:] == pytest.approx([0.06, -0.02], abs=1e-15)
    assert velocity[0] < 0  # from 0.6 back to 0.5


@pytest.mark.parametrize(
    "space",
    [Euclidean(("x",)), Euclidean.cartesian(4), Euclidean(("q1", "q2", "q3"), unit="rad")],
    ids=["1-D", "4-D", "joints"],
)
def test_what_is_no_hand_position_is_refused(linear: MakeLinear, space: Euclidean) -> None:
    skill = linear((0.0,) * space.dimension, space=space)
    with pytest.raises(UsageError) as refusal:
        placed(skill)
    assert str(space.dimension) in str(refusal.value)
    assert refusal.value.hint


def test_a_plane_for_a_3d_skill_is_refused(reach: SedsSkill) -> None:
    with pytest.raises(UsageError, match="plane"):
        placed(reach, plane="xy")


def test_a_fast_skill_needs_no_more_room_than_a_slow_one(linear: MakeLinear) -> None:
    """At 200 /s, Euler steps of the preview's usual period would grow threefold each."""
    start = Scenario(start=(0.1, 0.05))
    slow, fast = (placements(linear((0.0, 0.0), rate=rate), ARMS["panda"], start) for rate in (2.0, 200.0))
    assert [one.scale for one in fast] == [one.scale for one in slow]
