from __future__ import annotations

import math

import pytest

from skillctl.errors import UsageError
from skillctl.simulation.arms import ARMS
from skillctl.simulation.scenario import Scenario


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("target", (0.5, math.nan, 0.5)),
        ("start", (0.5, math.inf, 0.5)),
        ("origin", (math.nan, 0.0, 0.0)),
        ("origin", (0.5, 0.0)),
        ("scale", 0.0),
        ("scale", math.nan),
        ("max_speed", -0.1),
        ("max_acceleration", math.inf),
        ("tolerance", 0.0),
        ("settle_time", math.nan),
        ("max_duration", 0.0),
        ("noise", -0.001),
        ("control", "speed"),
        ("episodes", 0),
        ("base_yaw", math.nan),
        ("seed", -1),
        ("arm", "crane"),
        ("plane", "zx"),
        ("hand", "up"),
    ],
)
def test_a_value_without_meaning_is_refused_by_name(field: str, value: object) -> None:
    with pytest.raises(UsageError, match=f"^{field}: "):
        Scenario(**{field: value})


def test_an_unknown_arm_is_answered_with_the_known_ones() -> None:
    with pytest.raises(UsageError) as refusal:
        Scenario(arm="crane")
    assert all(name in str(refusal.value) for name in ARMS)


def test_the_cup_as_target_brings_a_cup() -> None:
    scenario = Scenario(scene={"kind": "shelf"}, target="cup")
    assert scenario.grasping
    assert scenario.cup is not None
    assert scenario.cup.place == (0.62, 0.0)
    assert not Scenario(scene={"kind": "shelf"}).grasping


def test_a_scenario_cannot_be_changed_behind_its_back() -> None:
    scenario = Scenario()
    with pytest.raises(ValueError, match="frozen"):
        scenario.noise = 1.0
    assert scenario.changed(noise=0.5).noise == 0.5
    assert scenario.noise == 0.0
    with pytest.raises(UsageError, match="noise"):
        scenario.changed(noise=-1.0)
