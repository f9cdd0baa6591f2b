"""The loop: what is commanded, when, and how it ends, whatever robot and user do."""

from __future__ import annotations

import os
import signal
import threading

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from skillctl.drivers import fake
from skillctl.drivers.driver import Measured, Setup
from skillctl.drivers.fake import LAG, FakeArm
from skillctl.drivers.loop import Loop, as_state, heeded
from skillctl.drivers.measures import timing_of
from skillctl.drivers.options import RunOptions
from skillctl.errors import GoalNotReachedError, NotFoundError, StateError, UsageError
from skillctl.model.chained import ChainedSkill
from skillctl.model.controller import Controller
from skillctl.model.limits import Limits
from skillctl.model.pose import Pose
from skillctl.model.space import Euclidean

START = (0.3, 0.2, 0.6)
PERIOD = 0.01
SPEED, ACCELERATION = 0.1, 0.5
# Sums of about ten rounded numbers.
ROUNDING = 1e-12


def test_the_fake_arm_moves_as_its_equation_says(positions):
    arm = FakeArm(Setup("", positions, start=np.array(START)))
    commands = np.random.default_rng(1).normal(0, 0.3, (8, 3))
    x, v = np.array(START), np.zeros(3)
    for step, told in enumerate(commands, start=1):
        arm.command(told.tolist())
        arm.wait(0.03 * step)

        def motion(_, y, told=told):
            return np.concatenate([y[3:], (told - y[3:]) / LAG])

        ended = solve_ivp(motion, (0, 0.03), np.concatenate([x, v]), rtol=1e-10, atol=1e-12).y[:, -1]
        x, v = ended[:3], ended[3:]
        np.testing.assert_allclose(arm.state().numbers, x, atol=1e-9)  # of the integrator


def test_the_hand_arrives_along_the_skill_and_rests_within_the_limits(lead, positions):
    run = lead(positions, START, max_speed=SPEED, max_acceleration=ACCELERATION)
    assert run.ending.outcome == "arrived"
    led = run.rows.resting == 0
    assert np.linalg.norm(run.loop.state - positions.attractor) < 0.002
    speeds = np.linalg.norm(run.rows.command, axis=1)
    assert (speeds <= SPEED * (1 + ROUNDING)).all()
    # It begins at rest and is brought to rest; no command differs from the one before by more than a Δt.
    changes = np.diff(run.rows.command, axis=0, prepend=0)
    assert (np.linalg.norm(changes, axis=1) <= ACCELERATION * PERIOD * (1 + ROUNDING)).all()
    assert (run.rows.command[-1] == 0).all()
    assert (run.driver.commands[-1] == 0).all()
    for state, command in zip(run.rows.state[led], run.rows.command[led], strict=True):
        wanted = positions.velocity(state)
        share = command @ wanted / (wanted @ wanted)
        assert 0 < share <= 1 + ROUNDING
        np.testing.assert_allclose(command, share * wanted, atol=ROUNDING)


def test_poses_keep_both_speeds_and_arrive_in_both(lead, make_grasp):
    skill = make_grasp()
    start = skill.space.placed(np.array([-0.2, 0.2, 0.1, 0.1, -0.1, 0.15]), skill.attractor)
    accelerations = {"max_acceleration": 0.5, "max_turn_acceleration": 0.8}
    run = lead(skill, start, max_speed=0.1, max_turn=0.3, **accelerations)
    assert run.ending.outcome == "arrived"
    moving, turning = skill.space.magnitudes(run.rows.command)
    assert moving.max() <= 0.1 * (1 + ROUNDING)
    assert turning.max() <= 0.3 * (1 + ROUNDING)
    changes = np.diff(run.rows.command, axis=0, prepend=0)
    moving, turning = skill.space.magnitudes(changes)
    assert moving.max() <= 0.5 * PERIOD * (1 + ROUNDING)
    assert turning.max() <= 0.8 * PERIOD * (1 + ROUNDING)
    moved, turned = skill.space.apart(run.loop.state, skill.attractor)
    assert (moved < 0.002, turned < 0.035) == (True, True)


def test_a_hand_that_is_there_is_not_moved(lead, positions):
    run = lead(positions, positions.attractor)
    assert (run.ending.outcome, len(run.rows.t)) == ("arrived", 0)
    assert [command.tolist() for command in run.driver.commands] == [[0, 0, 0]]


def test_what_takes_too_long_is_ended_at_rest(lead, positions):
    run = lead(positions, START, timeout=0.5)
    assert (run.ending.outcome, run.ending.detail) == ("timeout", "not there after 0.5 s")
    assert run.rows.t[run.rows.resting == 0].max() == pytest.approx(0.5, abs=PERIOD)  # by one rounding
    assert (run.driver.commands[-1] == 0).all()


@pytest.mark.parametrize(("axis", "side"), [("z", 1), ("x", -1)])  # the way leads down, and to larger x
@pytest.mark.parametrize(("acceleration", "jerk"), [(0.2, None), (5.0, None), (1.0, 10.0)])
def test_the_hand_comes_to_rest_within_its_box(monkeypatch, positions, axis, side, acceleration, jerk):
    monkeypatch.setattr(fake, "LAG", 1e-9)  # the way that a robot lags behind is its own
    arm = FakeArm(Setup("", positions, start=np.array(START)))
    ranges = dict.fromkeys("xyz", (-9.0, 9.0)) | {axis: (0.45, 9.0) if side > 0 else (-9.0, 0.45)}
    limits = RunOptions(box=tuple(ranges.values()), max_acceleration=acceleration, max_jerk=jerk)
    # Not connected, which would refuse the target: it is outside the box.
    loop = Loop(arm, positions, limits)
    assert loop.drive([]).outcome == "left the box"
    arm.wait(arm.now() + 1.0)
    index = "xyz".index(axis)
    within = side * (loop.rows.state[:, index] - 0.45)
    assert within.min() >= 0
    # And not much before: by the margin, and by as much as the place of rest moves by one command.
    fastest = 0.25 + acceleration * PERIOD + (acceleration**2 / jerk if jerk else 0.0)
    assert 0 <= side * (arm.state().numbers[index] - 0.45) < 4 * PERIOD * fastest


@pytest.mark.parametrize("jerk", [np.inf, 10.0])
@pytest.mark.parametrize("steps", [1, 5, 60])
def test_the_place_of_rest_is_where_braking_leads(positions, jerk, steps):
    controller = Controller(positions, PERIOD, limits=Limits(0.25, 1.0, jerk))
    assert controller.rest is None
    state = np.array(START)
    for _ in range(steps):
        state = state + PERIOD * controller.step(state)
    rest = controller.rest
    while not controller.resting:
        state = state + PERIOD * controller.brake()
    np.testing.assert_allclose(rest, state, atol=ROUNDING)
    np.testing.assert_allclose(controller.rest, state, atol=ROUNDING)


def test_a_start_or_target_outside_the_box_moves_nothing(lead, positions):
    for box, named in (
        (((0.35, 1.0), (-1.0, 1.0), (0.0, 1.0)), "start"),
        (((0.0, 0.4), (-1.0, 1.0), (0.0, 1.0)), "target"),
    ):
        with pytest.raises(GoalNotReachedError, match=f"the {named} is outside the box; nothing moves"):
            lead(positions, START, box=box)
    with pytest.raises(UsageError, match="box: expected a range for each of x, y, z, got 1"):
        lead(positions, START, box=((0.0, 1.0),))


@pytest.mark.parametrize("bad", [(np.nan, 0.0, 0.0), (0.1, np.inf, 0.0), (0.1, 0.2), (0.1, 0.2, 0.3, 0.4)])
def test_a_state_that_cannot_be_used_ends_the_run_at_rest(lead, make_probe, positions, bad):
    spoilt = make_probe(measured=lambda step, m: Measured(m.stamp, bad) if step > 50 else m)
    run = lead(positions, START, hooks=spoilt)
    assert run.ending.outcome == "bad state"
    assert run.ending.detail.startswith("state: ")
    assert run.rows.resting.any()
    assert (run.driver.commands[-1] == 0).all()
    assert np.isfinite(run.rows.state).all()
    with pytest.raises(StateError):
        lead(positions, START, hooks=make_probe(measured=lambda step, m: Measured(0, bad)))


def test_a_robot_that_falls_silent_is_stopped(lead, make_probe, positions):
    silent = make_probe(measured=lambda step, m: Measured(min(m.stamp, 0.5), m.numbers))
    run = lead(positions, START, hooks=silent)
    assert run.ending.outcome == "no state"
    led = run.rows.t[run.rows.resting == 0]
    assert 0.6 - PERIOD <= led.max() <= 0.6 + PERIOD  # 0.1 s after the last one
    assert (run.driver.commands[-1] == 0).all()
    longer = lead(positions, START, hooks=silent, stale=0.3)
    assert longer.rows.t[longer.rows.resting == 0].max() == pytest.approx(led.max() + 0.2, abs=PERIOD)


def test_a_robot_that_never_speaks_is_not_waited_for(lead, make_probe, positions):
    with pytest.raises(NotFoundError, match="no state came from the robot within 5 s") as refused:
        lead(positions, START, hooks=make_probe(measured=lambda step, m: None))
    assert "first" in refused.value.hint


def test_what_the_robot_refuses_ends_the_run(lead, make_probe, positions):
    def refuse(step, measured):
        if step > 20:
            raise ConnectionError("the brakes are on")
        return measured

    run = lead(positions, START, hooks=make_probe(measured=refuse))
    assert (run.ending.outcome, run.ending.detail) == ("fault", "ConnectionError: the brakes are on")
    assert (run.driver.commands[-1] == 0).all()


def test_deadlines_are_absolute_and_late_steps_are_counted(lead, make_probe, positions):
    # Every pause is 2 ms too long, the fortieth 0.35 s: more than what is proved.
    run = lead(positions, START, hooks=make_probe(slept=lambda n: 0.35 if n == 40 else 0.002), stale=1.0)
    t, delay = run.rows.t, run.rows.delay
    np.testing.assert_allclose(t[1:40], PERIOD * np.arange(1, 40) + 0.002, atol=1e-9)  # nothing adds up
    assert delay[40] == pytest.approx(0.35)
    np.testing.assert_allclose(np.diff(t[41:60]), PERIOD, atol=1e-9)
    timing = timing_of(run.rows, PERIOD, 0.3)
    assert (timing.late, timing.missed) == (1, 1)
    assert timing.longest_step == pytest.approx(0.36 - 0.002)
    assert timing.worst_delay == pytest.approx(0.35)
    assert timing.late_share == 1 / len(t)
    assert timing_of(run.rows, PERIOD, None).late == len(t) - 1


def test_steps_of_exactly_what_is_proved_are_not_late(lead, positions):
    assert timing_of(lead(positions, START, period=0.03).rows, 0.03, 0.03).late == 0


@pytest.mark.parametrize(
    ("number", "outcome"),
    [(signal.SIGINT, "interrupted"), (signal.SIGTERM, "terminated"), (signal.SIGHUP, "terminated")],
)
def test_a_signal_slows_the_hand_down(lead, make_probe, positions, number, outcome):
    def interrupted(step, measured):
        if step == 60:
            os.kill(os.getpid(), number)
        return measured

    ours = signal.signal(number, signal.default_int_handler)  # nohup has SIGHUP ignored, and it stays so
    try:
        with heeded() as stopped:
            run = lead(positions, START, hooks=make_probe(measured=interrupted), stopped=stopped)
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, ours)
    assert run.ending.outcome == outcome
    resting = run.rows.resting == 1
    assert (~resting).sum() in (59, 60)  # the measurement before the loop was the first
    speeds = np.linalg.norm(run.rows.command, axis=1)
    assert speeds[~resting][-1] > 0.05
    assert (np.diff(speeds[resting]) < 0).all()
    assert (np.abs(np.diff(speeds))[~resting[:-1]] <= 1.0 * PERIOD * (1 + 1e-6)).all()
    assert speeds[-1] == 0


def test_who_asks_for_no_hangups_gets_none():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with heeded() as stopped:
            os.kill(os.getpid(), signal.SIGHUP)
        assert stopped == []
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_no_signal_is_heeded_outside_the_main_thread():
    seen = []

    def elsewhere():
        with heeded() as stopped:
            seen.append(stopped)

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert seen == [[]]


def test_a_second_signal_stops_at_once(lead, make_probe, positions):
    def interrupted(step, measured):
        if step in (60, 62):
            os.kill(os.getpid(), signal.SIGINT)
        return measured

    probe = make_probe(measured=interrupted)
    with pytest.raises(KeyboardInterrupt), heeded() as stopped:
        lead(positions, START, hooks=probe, stopped=stopped)
    assert (probe.last.commands[-1] == 0).all()
    assert len(probe.last.commands) < 64


def test_events_of_a_chain_go_to_the_robot(lead, make_probe, make_skill):
    rng = np.random.default_rng(3)
    ends = ([0.4, 0.0, 0.3], [0.5, 0.2, 0.3])
    stages = tuple(make_skill(rng, dimension=3, attractor=end) for end in ends)
    chain = ChainedSkill(stages, [1e-5, 1e-5], (("close", "wait 0.2"), ("open",)))
    probe = make_probe(busy=lambda calls: calls < 5)
    run = lead(chain, (0.3, 0.1, 0.4), hooks=probe)
    assert run.ending.outcome == "arrived"
    assert probe.events == ["close"] * 5 + ["open"]
    close, wait, opened = run.loop.events
    assert [(e.event, e.stage) for e in (close, wait, opened)] == [("close", 0), ("wait 0.2", 0), ("open", 1)]
    assert wait.time - close.time == pytest.approx(5 * PERIOD)
    led = run.rows.stage[run.rows.resting == 0]
    assert (np.diff(led) >= 0).all()
    assert set(led) == {0, 1}
    # The first stage acts until its events are over: 0.2 s of waiting are twenty periods.
    assert run.rows.t[led.searchsorted(1)] - wait.time == pytest.approx(0.2)


def test_a_pose_is_a_position_to_a_skill_of_positions_only():
    pose = (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0)
    assert as_state(Euclidean.cartesian(3), pose).tolist() == [0.1, 0.2, 0.3]
    assert as_state(Pose(), pose).tolist() == [0.1, 0.2, 0.3, 0.0, 0.0, 0.0]
    for space in (Euclidean.cartesian(2), Euclidean(("q1", "q2", "q3"), "rad")):
        with pytest.raises(StateError):
            as_state(space, pose)
    with pytest.raises(StateError):
        as_state(Pose(), pose[:3])
