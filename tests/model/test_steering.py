"""Bodies that are seen at run time: the nearest velocity that enters none, and where that leads."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from skillctl.errors import UsageError
from skillctl.model.controller import Controller
from skillctl.model.coordinates.bodies import Ball, Box
from skillctl.model.coordinates.chain import Chain
from skillctl.model.space import Euclidean
from skillctl.model.steering import nearest

MARGIN = 0.02
PERIOD = 0.01


@pytest.mark.parametrize("d", [1, 2, 3])
def test_the_nearest_velocity_is_the_one_that_a_general_solver_finds(d):
    rng = np.random.default_rng(d)
    none = 0
    for _ in range(60):
        factor = rng.normal(size=(d, d))
        metric = factor @ factor.T + 0.1 * np.eye(d)
        wanted, rows = rng.normal(size=d), rng.normal(size=(4, d))
        bounds = rng.normal(0, 0.5, 4)
        found = nearest(wanted, metric, rows, bounds)
        solver: Any = minimize
        solved = solver(
            lambda v, f=wanted, m=metric: (v - f) @ m @ (v - f),
            wanted,
            jac=lambda v, f=wanted, m=metric: 2 * m @ (v - f),
            constraints=[
                {"type": "ineq", "fun": lambda v, a=rows, b=bounds: a @ v - b, "jac": lambda v, a=rows: a}
            ],
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 300},
        )
        if found is None:
            none += 1
            assert not solved.success or (rows @ solved.x - bounds).min() < -1e-6
        elif solved.success:
            np.testing.assert_allclose(found, solved.x, atol=1e-5)  # SLSQP's accuracy
    assert none < 60


def driven(controller, x, bodies, steps=4000):
    """Drive from a state (d,) among bodies; return the states, (n, d)."""
    states = [x]
    for _ in range(steps):
        x = x + PERIOD * controller.step(x, seen=bodies)
        states.append(x)
        if controller.blocked or np.linalg.norm(x) < 1e-3:
            break
    return np.array(states)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("bent", [False, True])
def test_balls_that_are_seen_are_passed_and_v_falls(make_skill, make_shears, d, bent):
    rng = np.random.default_rng(d)
    skill = make_skill(rng, dimension=d)
    if bent:
        skill = replace(skill, coordinates=Chain((make_shears(rng, d, size=0.02),)))
    for _ in range(6):
        centre = rng.normal(size=d)
        centre *= 0.25 / np.linalg.norm(centre)
        bodies = [Ball("ball", tuple(centre), 0.05), Ball("other", tuple(-centre), 0.04)]
        controller = Controller(skill, PERIOD, margin=MARGIN)
        states = driven(controller, 2.2 * centre + rng.normal(0, 0.02, d), bodies)
        assert controller.blocked == ()
        assert np.linalg.norm(states[-1]) < 1e-3
        assert (np.diff(skill.v_distance(states)) < 0).all()
        for body in bodies:
            shares = np.linspace(0, 1, 9)[:, None, None]
            chords = states[:-1] * (1 - shares) + states[1:] * shares  # the robot moves straight in between
            assert body.inflated(MARGIN).values(chords.reshape(-1, d)).min() >= 1 - 1e-12


def test_before_a_wide_wall_it_stops_and_says_so(make_skill):
    skill = replace(make_skill(np.random.default_rng(1), n_components=1), system_matrices=-np.eye(2)[None])
    controller = Controller(skill, PERIOD, margin=MARGIN)
    wall = Box("wall", (0.3, 0.0), (0.02, 1.0))
    states = driven(controller, np.array([0.5, 0.1]), [wall, Ball("far", (-0.5, 0.0), 0.1)])
    assert controller.blocked == ("wall",)
    np.testing.assert_allclose(states[-1], [0.33, 0.0], atol=5e-3)
    np.testing.assert_array_equal(controller.step(states[-1], seen=[wall]), [0.0, 0.0])
    assert controller.step(states[-1]).any()  # the wall has gone
    assert not controller.blocked


def test_known_and_seen_bodies_are_kept_out_of_together(make_skill):
    skill = make_skill(np.random.default_rng(2))
    known, seen = Ball("known", (0.3, 0.0), 0.05), Ball("seen", (0.0, 0.3), 0.05)
    for start in ([0.5, 0.02], [0.02, 0.5], [0.4, 0.4]):
        controller = Controller(skill, PERIOD, keep_out=[known], margin=MARGIN)
        states = driven(controller, np.array(start), [seen])
        assert np.linalg.norm(states[-1]) < 1e-3
        for body in (known, seen):
            assert body.inflated(MARGIN).values(states).min() >= 1 - 1e-12


def test_caps_are_kept_beside_bodies(make_skill):
    controller = Controller(make_skill(np.random.default_rng(3)), PERIOD, margin=MARGIN)
    command = controller.step([0.5, 0.0], max_speed=0.05, seen=[Ball("ball", (0.3, 0.0), 0.1)])
    assert 0 < np.linalg.norm(command) <= 0.05 * (1 + 1e-9)


def test_a_state_inside_a_known_body_is_led_out_at_the_capped_speed(make_skill):
    ball = Ball("ball", (0.3, 0.0), 0.05)
    controller = Controller(make_skill(np.random.default_rng(4)), PERIOD, keep_out=[ball], margin=MARGIN)
    x = np.array([0.34, 0.0])
    command = controller.step(x, max_speed=0.1)
    np.testing.assert_allclose(command, [0.1, 0.0], atol=1e-9)  # straight away from the pole
    assert controller.inside == ("ball",)
    for _ in range(60):
        x = x + PERIOD * controller.step(x, max_speed=0.1)
    assert not controller.inside


def test_a_body_that_moves_into_the_hand_pushes_it_away(make_skill):
    controller = Controller(make_skill(np.random.default_rng(5)), PERIOD, margin=MARGIN)
    ball = Ball("ball", (0.0, 0.35), 0.05)
    command = controller.step([0.0, 0.30], seen=[ball])  # below it, towards the target
    assert command[1] < 0


def test_bodies_need_a_margin_and_positions(make_skill):
    skill, ball = make_skill(np.random.default_rng(6)), Ball("ball", (0.3, 0.0), 0.05)
    with pytest.raises(UsageError, match="ball: a controller among bodies needs a margin"):
        Controller(skill, PERIOD, keep_out=[ball])
    with pytest.raises(UsageError, match="ball: a controller among bodies needs a margin"):
        Controller(skill, PERIOD).step([0.5, 0.0], seen=[ball])
    joints = replace(skill, space=Euclidean(("q1", "q2"), "rad"))
    with pytest.raises(UsageError, match="only a skill over positions"):
        Controller(joints, PERIOD, margin=MARGIN).step([0.5, 0.0], seen=[ball])
