from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.controller import Controller
from skillctl.model.seds import SedsSkill
from skillctl.simulation.arm import CONTROL_PERIOD
from skillctl.simulation.motion import Motion, plan_motion
from skillctl.simulation.placement import Placement
from skillctl.simulation.scenario import Scenario

MakeLinear = Callable[..., SedsSkill]
HERE = Placement(np.eye(3), np.zeros(3), 1.0, None)
EPS = np.finfo(np.float64).eps
ROUNDING = 4 * EPS / CONTROL_PERIOD  # [m/s]: speeds are read off positions below 1 m


def speeds_of(positions: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(positions, axis=0), axis=1) / CONTROL_PERIOD


def test_the_plan_keeps_to_speed_and_acceleration(linear: MakeLinear) -> None:
    rate, options = 8.0, Scenario()
    skill = linear((0.5, 0.0, 0.5), rate=rate)

    plan = plan_motion(skill, HERE, options, np.array([0.2, -0.4, 0.8]))

    speeds = speeds_of(plan.positions)
    changes = np.diff(np.concatenate([[0.0], speeds])) / CONTROL_PERIOD
    assert plan.arrived
    assert speeds.max() == pytest.approx(options.max_speed, abs=ROUNDING)
    assert changes.max() <= options.max_acceleration + ROUNDING / CONTROL_PERIOD
    # One period of delay where the skill's own slowing takes over from the brake.
    delay = rate**2 * options.max_speed * CONTROL_PERIOD
    assert -changes.min() <= options.max_acceleration + delay


def test_limits_change_the_timing_and_not_the_path(reach: SedsSkill) -> None:
    start = np.array([0.42, -0.20, 0.45])
    free = solve_ivp(lambda _, x: reach.velocity(x), (0, 10), start, rtol=1e-9, atol=1e-12, max_step=0.005)

    plan = plan_motion(reach, HERE, Scenario(max_speed=0.15), start)

    gaps = np.linalg.norm(plan.positions[::5, None] - free.y.T[None], axis=2).min(axis=1)
    one_step = 0.15 * CONTROL_PERIOD  # Euler's path is off by less than a step, as every step contracts
    between_samples = 0.5 * np.linalg.norm(np.diff(free.y, axis=1), axis=0).max()
    assert gaps.max() < one_step + between_samples


def test_a_2d_skill_moves_at_its_scale_and_into_its_plane(stroke: SedsSkill) -> None:
    placement = Placement(np.eye(3)[:, [1, 2]], np.array([0.5, 0.0, 0.5]), 3.0, "yz")
    plan = plan_motion(stroke, placement, Scenario(), np.array([0.4, -0.2, 0.6]))
    assert plan.arrived
    assert plan.target == pytest.approx([0.5, 0.0, 0.5], abs=EPS)
    assert plan.positions[-1] == pytest.approx(plan.target, abs=5e-4)  # a quarter of the tolerance
    # The way to the plane adds to the skill's own speed, and is capped with it.
    assert speeds_of(plan.positions).max() == pytest.approx(0.3, abs=ROUNDING)


def test_a_skill_that_runs_away_has_a_plan_that_ends(linear: MakeLinear) -> None:
    skill = linear((0.5, 0.0, 0.5), rate=-1.0)
    plan = plan_motion(skill, HERE, Scenario(), np.array([0.4, 0.0, 0.5]))
    assert not plan.arrived


@pytest.mark.parametrize("scale", [1.0, 4.0])
def test_a_capped_command_is_not_a_disturbance(linear: MakeLinear, scale: float) -> None:
    """At 50 /s the skill asks for 0.1 m per period: far more than the disturbance distance."""
    acting = linear((0.0, 0.0, 0.0), rate=50.0, centre=(0.5, 0.0, 0.0))
    waiting = linear((0.0, 0.5, 0.0), rate=50.0, centre=(0.25, 0.0, 0.0), spread=0.02)
    skill = CombinedSkill((acting, waiting), np.array([0.5, 0.5]), disturbance_distance=2e-3)
    assert skill.part_at([[0.5, 0.0, 0.0], [0.25, 0.0, 0.0]]).tolist() == [0, 1]  # the way crosses a region

    placement = Placement(np.eye(3), np.zeros(3), scale, None)

    plan = plan_motion(skill, placement, Scenario(), scale * np.array([0.5, 0.0, 0.0]))

    assert plan.arrived
    assert (plan.positions[:, 1:] == 0).all()  # the waiting part would turn off to y = 0.5


def test_after_a_shortened_step_the_hand_speeds_up_from_there(linear: MakeLinear) -> None:
    motion = Motion(linear((0.5, 0.0, 0.5)), HERE, Scenario())
    far = np.zeros(3)
    step = 1.5 * CONTROL_PERIOD  # what the acceleration adds in a period, [m/s]
    for count in range(1, 11):
        assert np.linalg.norm(motion.velocity(far)) == pytest.approx(count * step, rel=16 * EPS)
    motion.slowed(0.5)
    assert np.linalg.norm(motion.velocity(far)) == pytest.approx(6 * step, rel=16 * EPS)


def test_the_controller_shortens_but_does_not_turn(reach: SedsSkill) -> None:
    position = np.array([0.42, -0.20, 0.45])
    free = Controller(reach, CONTROL_PERIOD).step(position)
    capped = Controller(reach, CONTROL_PERIOD).step(position, max_speed=0.05)
    assert np.linalg.norm(free) > 0.05
    assert capped == pytest.approx(0.05 * free / np.linalg.norm(free), rel=8 * EPS)
    assert (Controller(reach, CONTROL_PERIOD).step(position, max_speed=1e3) == free).all()


@pytest.mark.parametrize(("gate", "ends"), [("latched", [0, 0]), ("instantaneous", [0, 1])])
def test_the_target_is_the_acting_parts_or_the_nearest(
    linear: MakeLinear, gate: str, ends: list[int]
) -> None:
    parts = linear((0.5, 0.3, 0.5)), linear((0.5, -0.3, 0.5))
    motion = Motion(CombinedSkill(parts, np.array([0.5, 0.5]), gate), HERE, Scenario())
    near_first, near_second = np.array([0.5, 0.2, 0.5]), np.array([0.5, -0.2, 0.5])
    motion.velocity(near_first)
    for place, end in zip((near_first, near_second), ends, strict=True):
        assert (motion.target(place) == parts[end].attractor).all()
    assert motion.distance_to_goals(near_second) == pytest.approx(0.1, rel=4 * EPS)


def test_a_hand_at_its_target_stays_there(linear: MakeLinear) -> None:
    motion = Motion(linear((0.5, 0.0, 0.5)), HERE, Scenario())
    assert (motion.velocity(np.array([0.5, 0.0, 0.5])) == 0).all()


def test_a_stage_begins_anew_where_a_hand_that_yields_was_pushed(linear: MakeLinear) -> None:
    left, right = (linear((0.5, 0.0, 0.5), centre=(0.4, y, 0.5), spread=0.1) for y in (0.2, -0.2))
    combined = CombinedSkill((left, right), np.array([0.5, 0.5]), disturbance_distance=0.05)
    chain = ChainedSkill(
        parts=(combined, linear((0.5, 0.5, 0.5))),
        levels=np.full(2, 1e-6),
        events=((), ()),
        disturbance_distance=0.05,
    )
    parts = {}
    for skill in (chain, combined):
        motion, position = Motion(skill, HERE, Scenario()), np.array([0.4, 0.04, 0.5])
        for _ in range(120):
            velocity = motion.velocity(position)
            position = position + CONTROL_PERIOD * (velocity - [0.0, 0.3, 0.0])  # steps of 1.3 mm: no jumps
        assert position[1] < -0.05
        parts[skill.kind] = motion.part
    assert parts == {"chain": 1, "combined": 0}


def test_a_hand_that_joints_slow_down_was_not_pushed(
    linear: MakeLinear, monkeypatch: pytest.MonkeyPatch
) -> None:
    targets = ((0.5, 0.0, 0.5), (0.5, 0.5, 0.5))
    chain = ChainedSkill(
        parts=tuple(map(linear, targets)),
        levels=np.full(2, 1e-6),
        events=((), ()),
        disturbance_distance=2e-3,
    )
    begun: list[int] = []
    monkeypatch.setattr(Controller, "go", lambda _, stage: begun.append(stage))
    motion, start = Motion(chain, HERE, Scenario()), np.array([0.1, 0.1, 0.5])
    position, asked = start, np.zeros(3)
    for _ in range(240):
        velocity = motion.velocity(position)
        motion.slowed(0.9)
        position, asked = (
            position + 0.9 * CONTROL_PERIOD * velocity,
            asked + CONTROL_PERIOD * velocity,
        )
    assert np.linalg.norm(start + asked - position) > 2e-3  # what it was not given is more than a jump
    assert begun == []
