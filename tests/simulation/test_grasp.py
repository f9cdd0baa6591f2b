"""Whole episodes at a shelf, and how each of them ends."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from skillctl.errors import UsageError
from skillctl.model.combined import CombinedSkill
from skillctl.model.seds import SedsSkill
from skillctl.simulation.arm import CONTROL_PERIOD
from skillctl.simulation.episode import PHASES, Episode, RefusedError
from skillctl.simulation.picture import _caption, _verdict
from skillctl.simulation.recording import encode_log
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import Scenario

MakeLinear = Callable[..., SedsSkill]
MIDDLE = 0.70 + 0.06  # height of the middle of a cup on the upper board, [m]
SHELF = {"kind": "shelf"}
BEFORE = (0.44, 0.0, MIDDLE)  # from here the straight way ends between the fingers


@pytest.fixture(scope="module")
def straight(linear: MakeLinear) -> SedsSkill:
    """Straight to the target, wherever it was taught."""
    return linear((0.5, 0.1, 0.6))


def at_the_shelf(**changes: object) -> Scenario:
    return Scenario(**{"scene": SHELF, "target": "cup", "start": BEFORE, **changes})


@pytest.fixture(scope="module")
def grasped(straight: SedsSkill) -> Episode:
    return simulate(straight, at_the_shelf())


def test_the_cup_is_lifted_and_held(grasped: Episode) -> None:
    assert (grasped.outcome, grasped.detail) == ("grasped", "")
    series, figures = grasped.series, grasped.metrics
    assert figures.cup_rise == pytest.approx(0.10, abs=0.005)
    assert figures.cup_moved < 1e-3
    assert figures.grip_width == pytest.approx(0.064, abs=0.003)  # a hard finger on a hard cup, 64 mm wide
    up = series.cups[:, 2] - series.cups[0, 2]
    assert (up[series.phases == PHASES.index("hold")] >= 0.05).all()


def test_the_phases_follow_each_other_as_long_as_they_should(grasped: Episode) -> None:
    phases = grasped.series.phases
    assert (np.diff(phases) >= 0).all()
    rows = np.bincount(phases)[1:]
    assert rows == pytest.approx(np.array([0.8, 1.2, 1.0]) * 240, abs=2)
    distance = np.linalg.norm(grasped.series.hand - grasped.target, axis=1)
    # The hand closes within 6 mm; it moves on by less than 2 mm until that is noticed.
    assert distance[phases == 1][0] < 0.006
    assert distance[phases == 0][-2] >= 0.006


def test_only_the_fingers_touch_and_only_the_cup(grasped: Episode) -> None:
    assert set(grasped.metrics.contacts) == {"panda_leftfinger - cup", "panda_rightfinger - cup"}
    assert (grasped.series.contacts == 0).all()
    assert grasped.metrics.clearance > 0.01
    measured = np.isfinite(grasped.series.clearances)
    assert (np.flatnonzero(measured) % 8 == 0).all()


def test_a_grasp_can_be_repeated_to_the_last_bit(grasped: Episode, straight: SedsSkill) -> None:
    simulate(straight, at_the_shelf(max_duration=0.3))  # what ran before does not matter
    again = simulate(straight, grasped.scenario)
    for kind in ("csv", "h5"):
        assert encode_log(again, kind) == encode_log(grasped, kind)


def test_a_cup_that_moves_is_followed_and_noise_is_borne(straight: SedsSkill) -> None:
    move = {"kind": "move-target", "time": 0.3, "offset": (0.0, 0.03, 0.0)}
    episode = simulate(straight, at_the_shelf(disturbances=[move], noise=0.003, target_error=0.002))
    assert episode.outcome == "grasped"
    assert episode.target == pytest.approx([0.62, 0.03, MIDDLE], abs=1e-12)
    assert episode.series.cups[100, 1] == pytest.approx(0.03, abs=1e-4)
    assert episode.metrics.cup_moved < 0.01  # its jump was not the hand's doing


def test_a_compliant_hand_lifts_as_high(straight: SedsSkill) -> None:
    episode = simulate(straight, at_the_shelf(control="torque"))
    assert episode.outcome == "grasped"
    # 0.1 kg on a damper of 80 Ns/m sinks with 12 mm/s; drawn back with 5 /s it stays 2.5 mm low.
    assert episode.metrics.cup_rise == pytest.approx(0.10, abs=0.005)


@pytest.mark.parametrize(
    ("changes", "outcome", "words"),
    [
        (
            {"start": (0.40, 0.0, 0.56), "avoid": False},
            "shelf_contact",
            r"panda_\w+ touched the upper board \d\.\d s into the approach",
        ),
        (
            {"cup": {}, "target": (0.62, 0.16, MIDDLE), "start": (0.44, 0.16, MIDDLE)},
            "missed",
            r"no finger touched the cup when the hand had closed; the cup had been moved 0 mm",
        ),
        (
            {"cup": {}, "target": (0.72, 0.0, MIDDLE + 0.05), "start": (0.44, 0.0, MIDDLE + 0.05)},
            "tipped",
            r"the cup fell .* \d\.\d s into the approach, pushed by panda_\w+",
        ),
        (
            {"cup": {"mass": 1.5}, "grasp": {"force": 5.0}},  # 2 · 0.5 · 5 N hold 0.5 kg
            "dropped",
            r"the cup was \d+ mm up after the lift",
        ),
        ({"max_duration": 0.3}, "timeout", r"the hand was \d+ mm from its target after 0\.3 s"),
    ],
    ids=["shelf", "beside", "push over", "heavy", "slow"],
)
def test_a_failure_has_a_class_and_words(
    straight: SedsSkill, changes: dict[str, object], outcome: str, words: str
) -> None:
    episode = simulate(straight, at_the_shelf(**changes))
    assert episode.outcome == outcome
    assert re.fullmatch(words, episode.detail), episode.detail
    assert not episode.success


def test_a_hand_that_is_taken_away_comes_back(linear: MakeLinear) -> None:
    away = {"kind": "displace", "time": 0.5, "offset": (0.0, 0.08, 0.05)}
    episode = simulate(
        linear((0.55, 0.0, 0.5)),
        Scenario(start=(0.45, 0.0, 0.5), disturbances=(away,)),
    )
    jump = np.linalg.norm(np.diff(episode.series.hand, axis=0), axis=1)
    assert jump.argmax() == 120 - 1  # between 0.5 s and the row before
    # Inverse kinematics is exact to 0.1 mm; in the row itself the hand has moved on for no time.
    assert jump.max() == pytest.approx(np.hypot(0.08, 0.05), abs=2e-3)
    assert episode.outcome == "reached"


def test_a_hand_cannot_be_taken_out_of_reach(linear: MakeLinear) -> None:
    away = {"kind": "displace", "time": 0.1, "offset": (2.0, 0.0, 0.0)}
    episode = simulate(
        linear((0.55, 0.0, 0.5)),
        Scenario(start=(0.45, 0.0, 0.5), disturbances=(away,)),
    )
    assert episode.outcome == "unreachable"
    assert re.fullmatch(r"no joints put the displaced hand at \(2\.\d\d, .*\) m", episode.detail)
    assert episode.metrics.simulated_time == pytest.approx(0.1 - CONTROL_PERIOD, rel=1e-12)  # its last row


def test_pictures_say_how_a_grasp_went(grasped: Episode) -> None:
    rows = [0, np.flatnonzero(grasped.series.phases == PHASES.index("lift"))[0]]
    first, lifting = (_caption(grasped, row) for row in rows)
    away = 1e3 * np.linalg.norm(grasped.series.hand[0] - grasped.series.targets[0])
    assert first == f"0.00 s   {away:.0f} mm to target"
    assert lifting == f"{grasped.series.times[rows[1]]:.2f} s   lift"
    assert _verdict(grasped) == f"grasped, lifted and held: {grasped.metrics.simulated_time:.1f} s"


def test_a_target_that_is_seen_wrong_is_missed_by_as_much(linear: MakeLinear) -> None:
    scenario = Scenario(start=(0.45, 0.0, 0.5), target_error=0.02, seed=3)
    episode = simulate(linear((0.55, 0.0, 0.5)), scenario)
    assert episode.outcome == "missed"
    off = 1e3 * episode.metrics.final_error
    assert episode.detail == f"the hand stopped {off:.0f} mm from its target, which it perceived there"
    assert 0.002 < episode.metrics.final_error < 0.08
    assert episode.target == pytest.approx([0.55, 0.0, 0.5], abs=1e-12)
    off = episode.series.hand[-1] - episode.target
    assert off[2] == pytest.approx(0, abs=1e-3)


def test_an_error_of_perception_within_the_tolerance_is_no_miss(linear: MakeLinear) -> None:
    scenario = Scenario(start=(0.45, 0.0, 0.5), target_error=0.02, seed=3)
    missed = simulate(linear((0.55, 0.0, 0.5)), scenario).metrics.final_error
    for factor, outcome in ((0.8, "missed"), (1.2, "reached")):
        wide = scenario.changed(tolerance=factor * missed)
        episode = simulate(linear((0.55, 0.0, 0.5)), wide)
        assert episode.outcome == outcome
        assert (episode.metrics.time_to_target < np.inf) == (outcome == "reached")


def test_a_start_in_the_shelf_is_refused(straight: SedsSkill) -> None:
    with pytest.raises(RefusedError, match=r"start: panda_\w+ would touch the upper board") as refusal:
        simulate(straight, at_the_shelf(start=(0.60, 0.0, 0.71)))
    assert refusal.value.outcome == "start_collision"


def test_a_cup_out_of_reach_is_refused(straight: SedsSkill) -> None:
    with pytest.raises(RefusedError, match=r"for the target \(0\.790") as refusal:
        simulate(straight, at_the_shelf(cup={"position": (0.79, 0.55)}))
    assert refusal.value.outcome == "unreachable"
    assert "--cup" in refusal.value.hint


def test_a_cup_needs_a_gripper_it_fits_in(straight: SedsSkill) -> None:
    with pytest.raises(UsageError, match="iiwa arm has no gripper"):
        simulate(straight, at_the_shelf(arm="iiwa"))
    with pytest.raises(UsageError, match=r"cup\.radius: a cup 90 mm wide"):
        simulate(straight, at_the_shelf(cup={"radius": 0.045}))


def test_several_targets_cannot_all_be_the_cup(linear: MakeLinear) -> None:
    parts = (linear((0.5, 0.3, 0.5)), linear((0.5, -0.3, 0.5)))
    with pytest.raises(UsageError) as refusal:
        simulate(CombinedSkill(parts, np.array([0.5, 0.5])), at_the_shelf())
    assert "--align" in refusal.value.hint


def test_without_a_start_the_hand_begins_before_the_scene(straight: SedsSkill) -> None:
    episode = simulate(straight, Scenario(scene={"kind": "table"}, target="cup"))
    assert episode.series.hand[0] == pytest.approx([0.35, 0.0, 0.55], abs=1e-3)
    assert episode.outcome == "grasped"


def test_a_2d_skill_takes_its_plane_to_the_cup(stroke: SedsSkill) -> None:
    episode = simulate(
        stroke,
        Scenario(scene={"kind": "table"}, target="cup", plane="xz", scale=1.0, start=(-0.08, 0.03)),
    )
    placement = episode.setup.placement
    assert placement.to_workspace(stroke.attractor) == pytest.approx([0.62, 0.0, 0.48], abs=1e-12)
    assert np.abs(episode.series.hand[:, 1]).max() < 1e-3
