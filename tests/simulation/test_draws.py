from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("pydantic")

from skillctl.errors import UsageError
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.seds import SedsSkill
from skillctl.simulation.disturbances import Knock
from skillctl.simulation.draws import Taught, batch_of, chosen, drawn, with_defaults
from skillctl.simulation.scenario import Cup, Sampling, Scenario, Shelf
from skillctl.simulation.taking import Destination

STARTS = np.array([[0.4, -0.2, 0.5], [0.4, 0.3, 0.6]])
NONE = np.zeros((0, 3))
MANY = 400


def shelf(**sampling: object) -> Scenario:
    return Scenario(scene=Shelf(), target="cup", seed=5, sampling=Sampling(**sampling))


def test_ranges_are_filled_evenly() -> None:
    scenario = shelf(cup_x_range=(0.55, 0.65), cup_y_range=(-0.4, 0.4), mass_range=(0.1, 0.5))
    cups = [drawn(scenario, i, NONE).cup for i in range(MANY)]
    assert None not in cups
    for values, low, high in (
        ([cup.position[0] for cup in cups], 0.55, 0.65),
        ([cup.position[1] for cup in cups], -0.4, 0.4),
        ([cup.mass for cup in cups], 0.1, 0.5),
    ):
        assert low <= min(values) < max(values) <= high
        # A uniform mean has the standard deviation (high − low)/√(12 n); five of them are not exceeded.
        assert np.mean(values) == pytest.approx((low + high) / 2, abs=5 * (high - low) / np.sqrt(12 * MANY))
    # Independent of each other: the correlation of n pairs has the standard deviation 1/√n.
    places = np.array([cup.position for cup in cups])
    assert abs(np.corrcoef(places.T)[0, 1]) < 5 / np.sqrt(MANY)


def test_what_is_drawn_for_one_thing_does_not_depend_on_what_else_is_drawn() -> None:
    plain = drawn(shelf(cup_y_range=(-0.4, 0.4)), 7, STARTS)
    more = drawn(shelf(cup_y_range=(-0.4, 0.4), start_scatter=0.02, friction_range=(0.2, 0.6)), 7, STARTS)
    assert plain.cup is not None
    assert more.cup is not None
    assert plain.cup.position == more.cup.position
    assert plain.seed == more.seed
    assert plain.cup.friction != more.cup.friction


def test_episodes_and_seeds_differ() -> None:
    scenario = shelf(cup_y_range=(-0.4, 0.4), start_scatter=0.02)
    drawn_ones = [drawn(scenario.changed(seed=seed), i, STARTS) for seed in (0, 1) for i in range(20)]
    assert len({one.start for one in drawn_ones}) == 40
    assert len({one.cup.position for one in drawn_ones if one.cup}) == 40
    assert len({one.seed for one in drawn_ones}) == 40


def test_nothing_is_left_to_draw() -> None:
    one = drawn(shelf(cup_y_range=(-0.4, 0.4)), 3, NONE)
    assert (one.sampling, one.episodes) == (Sampling(), 1)


def test_starts_lie_around_those_of_the_demonstrations() -> None:
    scenario = shelf(start_scatter=0.02)
    starts = np.array([drawn(scenario, i, STARTS).start for i in range(MANY)])
    first = starts[:, 1] < 0.05
    # Either demonstration with probability ½: the share has the standard deviation 1/(2 √n).
    assert first.mean() == pytest.approx(0.5, abs=5 / (2 * np.sqrt(MANY)))
    for picked, start in ((first, STARTS[0]), (~first, STARTS[1])):
        # Five standard deviations of a mean and of a standard deviation.
        n = picked.sum()
        np.testing.assert_allclose(starts[picked].mean(axis=0), start, atol=5 * 0.02 / np.sqrt(n))
        np.testing.assert_allclose(starts[picked].std(axis=0), 0.02, atol=5 * 0.02 / np.sqrt(2 * n))


def test_a_box_of_starts_is_filled() -> None:
    box = shelf(start_x_range=(0.36, 0.44), start_y_range=(-0.2, 0.2), start_z_range=(0.48, 0.6))
    starts = np.array([drawn(box, i, NONE).start for i in range(50)])
    assert (starts.min(axis=0) >= [0.36, -0.2, 0.48]).all()
    assert (starts.max(axis=0) <= [0.44, 0.2, 0.6]).all()
    assert (np.ptp(starts, axis=0) > [0.06, 0.3, 0.09]).all()


def test_scatter_needs_demonstrations() -> None:
    with pytest.raises(UsageError, match="carries no demonstrations") as refusal:
        drawn(shelf(start_scatter=0.01), 0, NONE)
    assert "start_x_range" in refusal.value.hint


def test_what_is_not_given_is_drawn_by_default() -> None:
    sampling = with_defaults(Scenario(scene=Shelf(), target="cup"), STARTS, 0.4).sampling
    assert (sampling.cup_x_range, sampling.cup_y_range) == ((0.55, 0.68), (-0.42, 0.42))
    assert sampling.start_scatter == 0.02


def test_what_is_given_is_not_drawn() -> None:
    fixed = Scenario(scene=Shelf(), target="cup", cup=Cup(position=(0.6, 0.0)), start=(0.4, 0.0, 0.6))
    assert with_defaults(fixed, STARTS, 0.4) == fixed
    own = shelf(mass_range=(0.1, 0.2))
    assert with_defaults(own, STARTS, 0.4) == own


def test_a_small_motion_is_scattered_less() -> None:
    assert with_defaults(Scenario(), STARTS, 0.05).sampling.start_scatter == 0.005


def test_all_that_is_drawn_is_independent() -> None:
    unit = (0.55, 0.65)
    box = {f"start_{axis}_range": unit for axis in "xyz"}
    scenario = shelf(cup_x_range=unit, cup_y_range=unit, mass_range=unit, friction_range=unit, **box)
    scenario = scenario.changed(scene=Shelf(width=2.0))
    table = []
    for episode in range(MANY):
        one = drawn(scenario, episode, NONE)
        assert one.cup is not None
        assert one.cup.position is not None
        assert one.start is not None
        table.append([*one.cup.position, one.cup.mass, one.cup.friction, *one.start, one.seed / 2**63])
    correlations = np.corrcoef(np.array(table).T) - np.eye(8)
    # The correlation of n independent pairs has the standard deviation 1/√n.
    assert np.abs(correlations).max() < 5 / np.sqrt(MANY)


def test_one_range_more_changes_nothing_else() -> None:
    fewer = drawn(shelf(cup_y_range=(-0.4, 0.4), friction_range=(0.2, 0.6)), 7, NONE).cup
    more = drawn(
        shelf(
            cup_x_range=(0.55, 0.65),
            cup_y_range=(-0.4, 0.4),
            mass_range=(0.1, 0.5),
            friction_range=(0.2, 0.6),
        ),
        7,
        NONE,
    ).cup
    assert fewer is not None
    assert more is not None
    assert fewer.place[1] == more.place[1]
    assert fewer.friction == more.friction
    assert fewer.mass != more.mass


def test_a_board_is_drawn_from_those_named_each_as_likely_as_the_next() -> None:
    scenario = shelf(cup_y_range=(-0.4, 0.4), boards=("bottom", "top"))
    cups = [drawn(scenario, i, NONE).cup for i in range(MANY)]
    on_top = [cup is not None and cup.board == "top" for cup in cups]
    # A share of ½ has the standard deviation 1/(2 √n).
    assert np.mean(on_top) == pytest.approx(0.5, abs=5 / (2 * np.sqrt(MANY)))
    # Independent of the place, which is the same as without.
    places = [cup.position[1] for cup in cups if cup is not None and cup.position is not None]
    assert abs(np.corrcoef(places, on_top)[0, 1]) < 5 / np.sqrt(MANY)
    plain = drawn(shelf(cup_y_range=(-0.4, 0.4)), 3, NONE).cup
    assert plain is not None
    assert plain.board == "top"
    assert plain.position == cups[3].position
    only = drawn(shelf(cup_y_range=(-0.4, 0.4), boards=("bottom",)), 3, NONE).cup
    assert only is not None
    assert only.board == "bottom"


TARGET = (0.5, 0.0, 0.5)


@pytest.fixture
def skill(linear: Callable[..., SedsSkill]) -> SedsSkill:
    return linear(TARGET)


@pytest.fixture
def taught(skill: SedsSkill) -> Taught:
    """Two demonstrations of one leaf, 0.25 and 0.125 m long, and a leaf that carries none."""
    times = np.linspace(0.0, 1.0, 5)
    ways = [np.linspace(start, TARGET, 5) for start in ((0.25, 0.0, 0.5), (0.5, 0.125, 0.5))]
    shown = [Demonstration.from_positions(times, way, "one.csv") for way in ways]
    return [None, DemonstrationSet(tuple(shown), skill.space)]


def test_a_run_begins_where_a_demonstration_did(skill: SedsSkill, taught: Taught) -> None:
    run = chosen(skill, taught, Scenario(), demo=1, episode=None)
    assert run.start == (0.5, 0.125, 0.5)
    moved = Scenario(target=(0.75, 0.0, 1.0))
    assert chosen(skill, taught, moved, demo=1, episode=None).start == (0.75, 0.125, 1.0)
    cup = Scenario(scene=Shelf(), target="cup")  # which moves no start
    assert chosen(skill, taught, cup, demo=0, episode=None).start == (0.25, 0.0, 0.5)


@pytest.mark.parametrize("demo", [-1, 2])
def test_a_demonstration_that_does_not_exist_is_told(skill: SedsSkill, taught: Taught, demo: int) -> None:
    with pytest.raises(UsageError, match=f"demonstration {demo} does not exist; the skill carries 2"):
        chosen(skill, taught, Scenario(), demo=demo, episode=None)


def test_two_starts_are_one_too_many(skill: SedsSkill, taught: Taught) -> None:
    with pytest.raises(UsageError, match="given twice, by --start and by --demo"):
        chosen(skill, taught, Scenario(start=TARGET), demo=0, episode=None)


def test_an_episode_is_drawn_from_what_was_taught(skill: SedsSkill, taught: Taught) -> None:
    batch, starts = batch_of(skill, taught, Scenario(seed=5))
    assert starts.tolist() == [[0.25, 0.0, 0.5], [0.5, 0.125, 0.5]]
    assert batch.sampling.start_scatter == 0.01  # a tenth of the shortest way, to one digit
    assert chosen(skill, taught, Scenario(seed=5), demo=None, episode=3) == drawn(batch, 3, starts)
    assert chosen(skill, taught, Scenario(seed=5), demo=None, episode=None) == Scenario(seed=5)
    with pytest.raises(UsageError, match="counted from 0, got -1"):
        chosen(skill, taught, Scenario(), demo=None, episode=-1)


def test_a_skill_without_demonstrations_has_no_starts(skill: SedsSkill) -> None:
    batch, starts = batch_of(skill, [None], Scenario())
    assert (batch, starts.shape) == (Scenario(), (0, 3))


def test_places_and_knocks_are_drawn_and_change_nothing_else() -> None:
    knock = Knock(time=9.0, offset=(0.1, 0.0, 0.0))
    scenario = shelf(cup_y_range=(-0.4, 0.4)).changed(
        place=Destination(board="bottom"), disturbances=(knock,)
    )
    ranges = {"place_x_range": (0.55, 0.6), "place_y_range": (-0.3, 0.3), "knock_time_range": (1.0, 2.0)}
    sampling = Sampling(cup_y_range=(-0.4, 0.4), **ranges)
    for index in range(20):
        plain, more = (drawn(each, index, NONE) for each in (scenario, scenario.changed(sampling=sampling)))
        assert (plain.place, plain.disturbances) == (
            Destination(board="bottom", position=(0.62, 0.0)),
            (knock,),
        )
        assert more.place is not None
        assert more.place.board == "bottom"
        assert 0.55 <= more.place.place[0] <= 0.6
        assert -0.3 <= more.place.place[1] <= 0.3
        (drawn_knock,) = more.disturbances
        assert isinstance(drawn_knock, Knock)
        assert 1.0 <= drawn_knock.time <= 2.0
        assert drawn_knock.offset == knock.offset
        assert (more.cup, more.start, more.seed) == (plain.cup, plain.start, plain.seed)
