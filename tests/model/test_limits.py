"""Limits of acceleration and jerk: they hold whatever happens, and V falls at the place of rest."""

from __future__ import annotations

import json
import math
from copy import deepcopy
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from skillctl.errors import UsageError
from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.controller import Controller
from skillctl.model.coordinates.bodies import Ball, Box
from skillctl.model.coordinates.chain import Chain
from skillctl.model.kept_out import kept_out
from skillctl.model.limits import Limits
from skillctl.model.merged import MergedSkill
from skillctl.model.space import Euclidean
from skillctl.model.stepper import Stepper

EPS = np.finfo(float).eps
PERIOD = 0.01
KINDS = ["learned", "bent", "merged", "latched", "instantaneous", "chain", "pose", "bent pose"]
SOFT = Limits(speed=0.3, acceleration=0.8, turn=0.8, turn_acceleration=2.0)
SOFTER = replace(SOFT, jerk=8.0, turn_jerk=15.0)


@pytest.fixture
def make_kind(make_skill, make_pose_skill, make_shears):
    """Return a maker of a skill of a kind, and a start."""

    def make(kind, seed):
        rng = np.random.default_rng(seed)
        if kind.endswith("pose"):
            skill = make_pose_skill(rng, bent=kind == "bent pose")
            return skill, skill.attractor + np.array([0.3, -0.2, 0.2, 0.5, -0.4, 0.3])
        d = int(rng.integers(2, 5))
        goals = rng.normal(0, 0.3, (2, d))
        parts = tuple(make_skill(rng, dimension=d, attractor=goal) for goal in goals)
        aligned = (parts[0], replace(parts[1], attractor=goals[0]))
        kinds = {
            "learned": lambda: parts[0],
            "bent": lambda: replace(parts[0], coordinates=Chain((make_shears(rng, d, scale=0.3),))),
            "merged": lambda: MergedSkill(aligned, [0.4, 0.6]),
            "latched": lambda: CombinedSkill(parts, [0.5, 0.5]),
            "instantaneous": lambda: CombinedSkill(aligned, [0.5, 0.5], gate="instantaneous"),
            "chain": lambda: ChainedSkill(parts, [1e-3, 1e-4], ((), ("wait 0.1",))),
        }
        return kinds[kind](), rng.normal(0, 0.6, d)

    return make


def sizes(space, vectors):
    """Return the sizes of the parts of vectors (n, d) that have limits of their own, one array each."""
    moving, turning = space.magnitudes(vectors)
    return [moving] if turning is None else [moving, turning]


def assert_kept(space, commands, limits, period=PERIOD):
    """Assert that commands (n, d), before which the robot is at rest, keep limits, but for rounding."""
    u = np.concatenate([np.zeros((2, space.dimension)), commands])
    speed = max(map(np.max, sizes(space, u)))
    for order, name in enumerate(["speed", "acceleration", "jerk"]):
        names = (name, f"turn_{name}" if order else "turn")
        differences = np.diff(u, n=order, axis=0) / period**order
        # Means of some dozen commands are rounded by as many eps of their size.
        slack = 100 * EPS * (2 / period) ** order * max(speed, 1.0)
        for name, found in zip(names, sizes(space, differences), strict=False):
            assert found.max() <= getattr(limits, name) + slack, name


def drive(controller, x, steps, before=lambda step, x: x):
    """Return the states (n + 1, d) and commands (n, d) of a robot that follows; ``before`` may push it."""
    states, commands = [x], []
    for step in range(steps):
        x = before(step, x)
        commands.append(controller.step(x))
        x = controller.skill.space.displace_at(x, PERIOD * commands[-1])
        states.append(x)
    return np.array(states), np.array(commands)


def rest_of(controller, x):
    """Return where a robot at x (d,) comes to rest if the controller brakes from now on."""
    controller = deepcopy(controller, {id(controller.skill): controller.skill})
    while not controller.resting:
        x = controller.skill.space.displace_at(x, PERIOD * controller.brake())
    return x


@pytest.mark.parametrize("limits", [SOFT, SOFTER], ids=["acceleration", "jerk"])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(2))
def test_limits_hold_at_every_step_whatever_happens(make_kind, kind, limits, seed):
    skill, start = make_kind(kind, seed)
    rng = np.random.default_rng(seed)
    controller = Controller(skill, PERIOD, limits=limits)
    space = skill.space

    def before(step, x):
        if rng.random() < 0.05:  # a push; every fifth is as far as the motion is long
            far = 0.5 if rng.random() < 0.2 else 0.02
            x = space.displace_at(x, rng.normal(0, far, space.dimension))
        if rng.random() < 0.02:  # another target
            moved = rng.normal(0, 0.2, space.positions)
            controller.follow(controller.skill.translated(moved))
        return space.displace_at(x, rng.normal(0, 1e-4, space.dimension))

    _, commands = drive(controller, start, 400, before)
    assert_kept(space, commands, limits)


@pytest.mark.parametrize("limits", [SOFT, SOFTER], ids=["acceleration", "jerk"])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(2))
def test_it_arrives_and_comes_to_rest(make_kind, kind, limits, seed):
    skill, start = make_kind(kind, seed)
    controller, x = Controller(skill, PERIOD, limits=limits), start
    for _ in range(3000):
        command = controller.step(x)
        x = skill.space.displace_at(x, PERIOD * command)
        away = float(np.min(skill.space.distance(skill.attractors, x)))
        if away < 1e-3 and max(skill.space.speeds(command)) < 2e-3:
            break
    else:
        pytest.fail(f"it is {away} away after 30 s")


@pytest.mark.parametrize("limits", [SOFT, SOFTER], ids=["acceleration", "jerk"])
@pytest.mark.parametrize("kind", ["learned", "bent", "merged", "pose", "bent pose"])
@pytest.mark.parametrize("seed", range(2))
def test_v_never_rises_at_the_place_of_rest(make_kind, kind, limits, seed):
    if limits.jerk < math.inf and kind.endswith("pose"):
        pytest.skip("turns do not commute: the place of rest is then only nearly the one that is used")
    skill, x = make_kind(kind, seed)
    controller = Controller(skill, PERIOD, limits=limits)
    values: list[list[float]] = [[]]
    for step in range(300):
        if step in (30, 120):  # a push at speed, after which all begins anew
            x = skill.space.displace_at(x, np.full(skill.dimension, 0.1))
            values.append([])
        values[-1].append(skill.v_distance_at(rest_of(controller, x)))
        x = skill.space.displace_at(x, PERIOD * controller.step(x))
    # Each is the end of some dozen rounded sums.
    assert all(after <= before + 1000 * EPS for each in values for before, after in pairwise(each))
    assert values[-1][-1] < values[-1][0]


@pytest.mark.parametrize(("kind", "limits"), [("learned", SOFTER), ("bent pose", SOFT)])
def test_the_place_of_rest_is_the_one_that_is_used(make_kind, kind, limits):
    skill, x = make_kind(kind, 1)
    controller = Controller(skill, PERIOD, limits=limits)
    for step in range(200):
        x = skill.space.displace_at(x, PERIOD * controller.step(x))
        if step % 20 == 0:
            ramp = controller._ramp
            used = ramp._moved(ramp.ahead(x), ramp._commands[0], ramp._steps(ramp._commands[0]) - 1)
            assert skill.space.distance_at(used, rest_of(controller, x)) < 1000 * EPS


def straight(rate=2.0):
    """Return a skill that moves straight to zero in the plane, as ẋ = −rate x."""
    from skillctl.model.mixture import GaussianMixture
    from skillctl.model.seds import SedsSkill

    one, unit = np.ones(1), np.eye(2)[None]
    return SedsSkill(
        priors=one,
        means=np.zeros((1, 2)),
        covariances=unit,
        system_matrices=-rate * unit,
        residual_covariances=unit,
        attractor=np.zeros(2),
        lyapunov=unit[0],
        density=GaussianMixture(one, np.zeros((1, 2)), unit),
        space=Euclidean.cartesian(2),
    )


def test_a_straight_motion_is_a_ramp_and_as_late_as_a_ramp_is():
    limits = Limits(speed=0.5, acceleration=1.0, jerk=10.0)
    start = np.array([3.0, 0.0])
    _, commands = drive(Controller(straight(), PERIOD, limits=limits), start, 2000)
    speeds = np.linalg.norm(commands, axis=1)
    # 0.2 s = 2a/j of averages over a ramp of 0.5 s: at first quadratic, as of the jerk j/2, then linear.
    times = PERIOD * np.arange(1, len(speeds) + 1)
    assert np.abs(speeds[:20] - 0.5 * 5.0 * times[:20] * (times[:20] + PERIOD)).max() < 1e-12
    assert np.abs(np.diff(speeds[20:50]) - PERIOD).max() < 1e-12
    assert np.abs(speeds[70:300] - 0.5).max() < 1e-12
    peak = int(speeds.argmax())
    assert (np.diff(speeds[: peak + 1]) >= -4 * EPS).all()
    assert (np.diff(speeds[peak:]) <= 4 * EPS).all()
    # At cruise it is behind by the v²/2a of a ramp and the v a/j of the averages, less half a period of each.
    free, _ = drive(Controller(straight(), PERIOD, limits=Limits(speed=0.5)), start, 200)
    slow, _ = drive(Controller(straight(), PERIOD, limits=limits), start, 200)
    behind = 0.5**2 / 2 + 0.5 * 0.1 - 0.5 * PERIOD
    assert slow[200, 0] - free[200, 0] == pytest.approx(behind, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(2))
def test_the_command_does_not_chatter(make_kind, kind, seed):
    skill, start = make_kind(kind, seed)
    _, commands = drive(Controller(skill, PERIOD, limits=SOFT), start, 700)
    changes = np.diff(commands[:, : skill.space.positions], axis=0)
    large = (0.3 * SOFT.acceleration * PERIOD) ** 2
    reversals = np.flatnonzero((changes[1:] * changes[:-1]).sum(axis=1) < -large)
    # In a sharp curve the robot brakes and then speeds up again: once, not every few periods.
    assert (np.diff(reversals) >= 5).all()


def test_without_disturbance_and_with_room_the_path_stays(make_skill):
    skill, start = make_skill(np.random.default_rng(3)), np.array([0.4, -0.3])
    limits = Limits(speed=0.2, acceleration=2.0)
    free, _ = drive(Controller(skill, PERIOD, limits=Limits(speed=0.2)), start, 1500)
    slow, _ = drive(Controller(skill, PERIOD, limits=limits), start, 1500)
    fine = np.concatenate([free[:-1] + share * np.diff(free, axis=0) for share in np.linspace(0, 1, 20)])
    apart = np.linalg.norm(slow[::10, None] - fine[None], axis=2).min(axis=1)
    # Euler's steps of two lengths along one field: they differ by its curvature times a step's length, 2 mm.
    assert apart.max() < 1e-3


@pytest.mark.parametrize(("limits", "seconds", "metres"), [(SOFT, 0.375, 0.05625), (SOFTER, 0.575, 0.08625)])
def test_braking_is_straight_and_as_short_as_said(limits, seconds, metres):
    controller = Controller(straight(), PERIOD, limits=limits)
    states, commands = drive(controller, np.array([3.0, 4.0]), 300)
    assert np.linalg.norm(commands[-1]) == pytest.approx(0.3, abs=1e-12)
    x, rest, braked = states[-1], [states[-1]], []
    while not controller.resting:
        braked.append(controller.brake())
        x = x + PERIOD * braked[-1]
        rest.append(x)
        assert np.abs(controller.next - x).max() < 16 * EPS
    # v/a and, with a jerk, 2a/j; v²/2a and v a/j; a period is the least that can be said.
    assert len(braked) == pytest.approx(seconds / PERIOD, abs=2)
    assert np.linalg.norm(rest[-1] - rest[0]) == pytest.approx(metres, abs=0.3 * PERIOD)
    assert np.abs(np.array(braked) @ [0.8, -0.6]).max() < 16 * EPS
    assert_kept(controller.skill.space, np.concatenate([commands, braked]), limits)
    assert (controller.brake() == 0).all()
    _, again = drive(controller, x, 3000)  # and it goes on from there
    assert_kept(controller.skill.space, np.concatenate([commands, braked, again]), limits)


def test_without_limits_nothing_changes_and_braking_is_at_once(make_skill):
    skill, start = make_skill(np.random.default_rng(1)), np.array([0.3, 0.2])
    plain = Controller(skill, PERIOD)
    assert plain.resting
    expected = drive(plain, start, 50)[1]
    assert (drive(Controller(skill, PERIOD, limits=Limits()), start, 50)[1] == expected).all()
    assert not plain.resting
    assert (plain.brake() == 0).all()
    assert plain.resting
    capped = [Controller(skill, PERIOD).step(start, max_speed=0.05)]
    capped += [Controller(skill, PERIOD, limits=Limits(speed=0.05)).step(start)]
    capped += [Controller(skill, PERIOD, limits=Limits(speed=0.05)).step(start, max_speed=9.0)]
    assert (np.array(capped) == capped[0]).all()


def test_a_lower_cap_is_reached_within_the_limits():
    controller = Controller(straight(), PERIOD, limits=SOFTER)
    states, commands = drive(controller, np.array([3.0, 4.0]), 300)
    x, slower = states[-1], []
    for _ in range(60):
        slower.append(controller.step(x, max_speed=0.1))
        x = x + PERIOD * slower[-1]
    assert_kept(controller.skill.space, np.concatenate([commands, slower]), SOFTER)
    assert np.linalg.norm(slower[-1]) == pytest.approx(0.1, abs=1e-12)


@pytest.mark.parametrize("limits", [SOFT, replace(SOFT, jerk=200.0)], ids=["acceleration", "jerk"])
def test_no_stop_is_in_a_body(make_skill, limits):
    body, rng = Ball("ball", (0.4, 0.02), 0.1), np.random.default_rng(2)
    met = 0
    for _ in range(3):
        skill = make_skill(rng, attractor=np.zeros(2))
        skill = replace(skill, system_matrices=skill.system_matrices - 2 * np.eye(2))
        for among, bodies in ((kept_out(skill, [body], margin=0.03), ()), (skill, [body])):
            controller = Controller(among, PERIOD, limits=limits, margin=None if bodies == () else 0.03)
            x = np.array([0.8, rng.normal(0, 0.05)])
            for step in range(400):
                x = x + PERIOD * controller.step(x, seen=bodies)
                for rest in (x, rest_of(controller, x) if step % 5 == 0 else x):
                    met += bool(np.linalg.norm(rest - body.centre) < 0.2)
                    # The averages cut corners by less than (v a/j)²/2r.
                    assert np.linalg.norm(rest - body.centre) >= 0.13 - 1e-5
                if controller.blocked:
                    break
    assert met > 100  # it went past the body


def test_before_a_wide_face_it_stops_softly():
    wall = Box("wall", (0.5, 0.0), (0.1, 1.0))
    controller = Controller(straight(), PERIOD, limits=SOFTER, margin=0.02)
    x, commands = np.array([1.5, 0.0]), []
    for _ in range(1500):
        commands.append(controller.step(x, seen=[wall]))
        x = x + PERIOD * commands[-1]
    assert 0.57 <= x[0] < 0.6
    assert np.linalg.norm(commands[-1]) < 1e-3
    assert_kept(controller.skill.space, np.array(commands), SOFTER)


def test_a_chain_goes_back_without_a_jump(make_kind):
    skill, start = make_kind("chain", 4)
    controller = Controller(skill, PERIOD, limits=SOFTER)

    def before(step, x):
        if step == 150:
            controller.go(0)
        return x

    _, commands = drive(controller, start, 3000, before)
    assert_kept(skill.space, commands, SOFTER)
    assert controller.done


def test_after_a_reset_the_robot_is_at_rest():
    controller = Controller(straight(), PERIOD, limits=SOFTER)
    states, commands = drive(controller, np.array([3.0, 4.0]), 200)
    controller.reset()
    assert controller.resting
    assert (drive(controller, states[0], 200)[1] == commands).all()
    assert not controller.resting


def test_the_memory_of_a_moving_robot_can_be_gone_on_with(make_kind):
    skill, start = make_kind("latched", 0)
    old, new = (Controller(skill, PERIOD, limits=SOFTER) for _ in range(2))
    states, _ = drive(old, start, 60)
    memory = json.loads(json.dumps(old.state()))
    new.restore(memory)
    assert new.resting
    new.restore(memory, moving=True)
    assert (drive(new, states[-1], 60)[1] == drive(old, states[-1], 60)[1]).all()
    with pytest.raises(UsageError, match="it is not that of a controller of this skill"):
        Controller(skill, PERIOD, limits=SOFT).restore(memory, moving=True)


def test_from_rest_it_takes_a_share_of_the_skills_own_step(make_kind):
    skill, start = make_kind("bent pose", 1)
    command = Controller(skill, PERIOD, limits=SOFT).step(start)
    own = Stepper(skill, PERIOD).step(start).command
    moving, turning = (found[0] for found in sizes(skill.space, own[None]))
    share = PERIOD * min(SOFT.acceleration / moving, SOFT.turn_acceleration / turning)
    assert share < 1
    # A straight share, but for how far the step is bent.
    assert np.abs(command - share * own).max() < 0.05 * np.linalg.norm(share * own)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan])
@pytest.mark.parametrize("name", ["speed", "acceleration", "jerk", "turn", "turn_acceleration", "turn_jerk"])
def test_a_limit_is_a_positive_number(name, bad):
    with pytest.raises(UsageError, match=f"{name}: must be a positive number"):
        Limits(**{"acceleration": 1.0, "turn_acceleration": 1.0, name: bad})


@pytest.mark.parametrize("prefix", ["", "turn_"])
def test_a_jerk_needs_an_acceleration(prefix):
    with pytest.raises(UsageError, match=f"{prefix}jerk: can only be kept together with an acceleration"):
        Limits(**{f"{prefix}jerk": 1.0})


def test_a_jerk_that_takes_ages_is_refused():
    with pytest.raises(UsageError, match="it takes 50 s to reach the acceleration"):
        Controller(straight(), PERIOD, limits=Limits(acceleration=5.0, jerk=0.1))
