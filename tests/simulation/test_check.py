from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from skillctl.errors import UsageError
from skillctl.model.seds import SedsSkill
from skillctl.simulation.arms import ARMS
from skillctl.simulation.check import check
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import Scenario

MakeLinear = Callable[..., SedsSkill]
START = (0.42, -0.20, 0.45)


@pytest.mark.parametrize("arm", ARMS)
def test_what_is_told_beforehand_is_what_happens(arm: str, reach: SedsSkill) -> None:
    scenario = Scenario(arm=arm, start=START)
    told, happened = check(reach, scenario), simulate(reach, scenario)
    assert told.reachable
    assert told.reason == ""
    assert happened.success
    assert (told.hand, told.base_yaw) == (happened.setup.hand, happened.setup.base_yaw)
    assert told.start == START
    assert told.start_residual < 1e-4
    assert told.path_residual < 1e-4
    assert told.target_residual < 1e-4
    # The measured motion lags and overshoots the plan by what the motors allow: some mrad, some percent.
    assert told.joint_margin == pytest.approx(happened.metrics.joint_margin, abs=0.01)
    assert told.velocity_ratio == pytest.approx(happened.metrics.velocity_ratio, rel=0.1)
    margins = np.minimum(happened.series.joints - ARMS[arm].lower, ARMS[arm].upper - happened.series.joints)
    assert told.tightest_joint == margins.min(axis=0).argmin() + 1


@pytest.mark.parametrize("what", ["start", "target"])
def test_a_place_out_of_reach_is_an_answer(what: str, linear: MakeLinear) -> None:
    told = check(linear((0.5, 0.0, 0.5)), Scenario(**{what: (2.0, 0.0, 0.5)}))
    assert not told.reachable
    assert f"no posture of the panda arm was found for the {what} (2.000, 0.000, 0.500) m" in told.reason
    assert told.tip == "panda_grasptarget"
    assert told.path_residual is None


def test_a_path_through_the_base_is_lost_before_it(linear: MakeLinear) -> None:
    told = check(linear((-0.5, 0.0, 0.4)), Scenario(arm="iiwa", start=(0.5, 0.0, 0.4), base_yaw=0.0))
    assert not told.reachable
    assert "the path cannot be followed beyond" in told.reason
    assert told.target_residual < 1e-4  # the target itself could be reached
    assert -0.5 < told.lost_at[0] < 0.5
    assert told.lost_at[1:] == pytest.approx((0.0, 0.4), abs=1e-3)


def test_a_motion_faster_than_the_joints_is_told(linear: MakeLinear) -> None:
    options = {"start": (0.5, -0.3, 0.5), "max_acceleration": 10.0}
    skill = linear((0.5, 0.3, 0.5), rate=20.0)
    slow, fast = (check(skill, Scenario(max_speed=speed, **options)) for speed in (0.3, 3.0))
    assert slow.velocity_ratio < 1 < fast.velocity_ratio
    assert fast.reachable  # the arm slows it down on its path


def test_an_arm_too_weak_to_carry_itself_is_told(linear: MakeLinear, monkeypatch: pytest.MonkeyPatch) -> None:
    weak = replace(ARMS["panda"], max_torque=(87.0, 10.0, 87.0, 87.0, 12.0, 12.0, 12.0))
    monkeypatch.setitem(ARMS, "panda", weak)
    skill, scenario = linear((0.6, 0.0, 0.5)), Scenario(start=(0.5, 0.0, 0.5))
    told = check(skill, scenario)
    assert not told.reachable
    assert "joint 2 cannot carry the arm on this path" in told.reason
    assert "of its 10 Nm" in told.reason
    assert not simulate(skill, scenario).success


def test_reach_does_not_depend_on_the_seed(linear: MakeLinear) -> None:
    skill = linear((0.3, 0.5, 0.35))
    told = [check(skill, Scenario(arm="xarm6", start=(0.3, -0.5, 0.35), seed=seed)) for seed in (0, 1, 2)]
    assert told[0] == told[1] == told[2]


def test_a_skill_that_arrives_nowhere_is_told(linear: MakeLinear) -> None:
    told = check(linear((0.5, 0.05, 0.5), rate=-0.5), Scenario(start=(0.49, 0.04, 0.5)))
    assert not told.reachable


def test_a_start_of_another_dimension_is_refused(linear: MakeLinear) -> None:
    with pytest.raises(UsageError, match="start: expected 3"):
        check(linear((0.5, 0.0, 0.5)), Scenario(start=(0.5, 0.0)))
