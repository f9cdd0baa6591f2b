"""The compliant arm: what a push does to it, what it does afterwards, and that it stays within its limits."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from skillctl.simulation.arm import ArmBody, ArmState, LiveArm
from skillctl.simulation.arms import ARMS
from skillctl.simulation.ik import Kinematics
from skillctl.simulation.position import PositionArm
from skillctl.simulation.torque import DAMPING, TorqueArm

RATE, CAP = 2.5, 0.3  # of the straight motion to the target: [1/s], [m/s]
AtRest = tuple[TorqueArm, np.ndarray]
Begin = Callable[..., AtRest]


@pytest.fixture(params=ARMS)
def begin(request: pytest.FixtureRequest) -> Iterator[Begin]:
    """Return a maker of an arm at rest, its hand ``away`` from the target that is returned with it."""
    model = ARMS[request.param]
    with ArmBody(model, 0.0, shapes="none") as twin, ArmBody(model, 0.0, shapes="collision") as body:

        def make(away: tuple[float, float, float] = (0, 0, 0), hand: str = "horizontal") -> AtRest:
            kinematics = Kinematics(twin, hand, 0.0)
            target = np.add(model.reach_centre, [0.05, 0.0, 0.0])
            found = kinematics.search(target + away)
            assert found.accepted
            return TorqueArm(body, found.joints, kinematics), target

        yield make


def straight(hand: np.ndarray, target: np.ndarray) -> np.ndarray:
    velocity = RATE * (target - hand)
    return velocity * min(1.0, CAP / max(float(np.linalg.norm(velocity)), 1e-12))


def run(arm: LiveArm, target: np.ndarray, duration: float, push: object = None) -> list[ArmState]:
    """Move towards the target, with a constant push all the time."""
    states = []
    for _ in range(round(duration / arm.period)):
        hand = arm.state.hand
        arm.drive(straight(hand, target), None if push is None else np.array(push, dtype=float))
        states.append(arm.state)
    return states


def kinetic_energy(arm: TorqueArm) -> float:
    """Half the sum of m v² and ω·I ω over all links, [J]: from the links' states, not from a mass matrix."""
    bullet, body = arm.body.bullet, arm.body.body
    total = 0.0
    for link in range(bullet.getNumJoints(body)):
        state = bullet.getLinkState(body, link, computeLinkVelocity=1)
        dynamics = bullet.getDynamicsInfo(body, link)
        turn = np.array(bullet.getMatrixFromQuaternion(state[1])).reshape(3, 3)
        linear, angular = np.array(state[6]), turn.T @ np.array(state[7])
        total += 0.5 * (dynamics[0] * linear @ linear + np.array(dynamics[2]) @ angular**2)
    return total


def distances(states: list[ArmState], target: np.ndarray) -> np.ndarray:
    return np.linalg.norm([state.hand - target for state in states], axis=1)


def test_the_hand_yields_in_proportion_and_always_returns(begin: Begin) -> None:
    arm, target = begin()
    reached = []
    for force in (10.0, 20.0, 40.0):
        pushed = run(arm, target, 0.5, (0.0, force, 0.0))
        reached.append(distances(pushed, target).max())
        away = pushed[-1].hand - target
        assert away[1] > 0.95 * np.linalg.norm(away)  # the way it was pushed, in the world
        after = run(arm, target, 2.5)
        assert distances(after, target)[-1] < 2e-3
    # Below the speed cap hand and skill are linear: a damper D against f = −2.5 /s (x − x*).
    assert reached[1] / reached[0] == pytest.approx(2.0, rel=0.1)
    assert reached[2] / reached[1] == pytest.approx(2.0, rel=0.1)
    # A massless hand would reach F/(D r) (1 − exp(−r t)); mass, and turning the hand, change some of it.
    massless = 20.0 / (80.0 * RATE) * (1 - np.exp(-RATE * 0.5))
    assert reached[1] == pytest.approx(massless, rel=0.2)


def test_the_limits_hold_however_hard_the_push(begin: Begin) -> None:
    arm, target = begin()
    model = arm.body.model
    states = []
    for force in ((0.0, 150.0, 0.0), (0.0, 0.0, -400.0)):
        states += run(arm, target, 0.3, force) + run(arm, target, 0.5)
    for state in states:
        assert (state.joints > model.lower).all()
        assert (state.joints < model.upper).all()
        assert (np.abs(state.velocities) <= model.max_velocity).all()
        assert (np.abs(state.torques) <= model.max_torque).all()


def test_a_push_leaves_no_energy_behind(begin: Begin) -> None:
    arm, target = begin()
    run(arm, target, 0.5)
    assert kinetic_energy(arm) < 1e-6  # at rest it stays at rest

    def energies(steps: int, push: object) -> list[float]:
        after = []
        for _ in range(steps):
            run(arm, target, 0.05, push)
            after.append(kinetic_energy(arm))
        return after

    pushed, returning = energies(10, (0.0, 40.0, 0.0)), energies(60, None)
    assert max(returning) < max(pushed)
    assert returning[-1] < 1e-4 * max(pushed)


def test_a_free_motion_obeys_the_skill(begin: Begin) -> None:
    arm, target = begin(away=(0.0, -0.15, 0.05))
    away = distances(states := run(arm, target, 3.0), target)
    assert away[-1] < 1e-3
    line = np.array([0.0, -0.15, 0.05]) / np.linalg.norm([0.0, -0.15, 0.05])
    offsets = np.array([state.hand - target for state in states])
    beside = np.linalg.norm(offsets - np.outer(offsets @ line, line), axis=1)
    assert beside.max() < 0.1 * away[0]  # it has mass and no reference: near the line, not on it


def test_the_hand_keeps_its_orientation_while_it_is_pushed(begin: Begin) -> None:
    arm, target = begin()
    run(arm, target, 0.5, (0.0, 20.0, 0.0))
    wanted = arm.kinematics.orientation(arm.state.hand)
    assert abs(np.dot(arm.orientation, wanted)) > np.cos(0.5 * 0.1)  # within 0.1 rad


def test_a_free_hand_is_held_by_its_posture_alone(begin: Begin) -> None:
    arm, target = begin(hand="free")
    start = run(arm, target, 1.0)[-1].joints
    run(arm, target, 0.3, (0.0, 20.0, 0.0))
    after = run(arm, target, 2.5)
    assert distances(after, target)[-1] < 1e-3
    assert np.abs(after[-1].joints - start).max() < 0.1


def test_a_load_that_the_arm_is_told_of_moves_no_hand(begin: Begin) -> None:
    arm, target = begin()
    sagged = distances(run(arm, target, 3.0, (0.0, 0.0, -5.0)), target)[-1]
    arm.load = 5.0
    held = distances(run(arm, target, 3.0, (0.0, 0.0, -5.0)), target)[-1]
    # A weight W that it is not told of shifts the hand to about where damping times rate times distance is W;
    # the posture of an arm has a say in it.
    assert sagged == pytest.approx(5.0 / (DAMPING * RATE), rel=0.2)
    assert held < 1e-3


def test_a_posture_that_follows_is_that_of_a_stiff_arm(begin: Begin) -> None:
    arm, target = begin((0.0, 0.15, 0.0))
    arm.posture_follows = True
    stiff = arm.state.joints
    for _ in range(round(3.0 / arm.period)):
        arm.drive(straight(arm.state.hand, target))
        stiff = arm.kinematics.follow(arm.state.hand, stiff).joints
    assert np.abs(arm.state.joints - stiff).max() < 0.02


def test_joints_at_their_limit_slow_the_hand_down(begin: Begin) -> None:
    arm, _ = begin()
    share = arm.drive(np.array([0.0, 20.0, 0.0]))
    assert 0 < share < 0.5


def test_a_push_moves_no_position_motor() -> None:
    model = ARMS["panda"]
    with ArmBody(model, 0.0, shapes="none") as twin, ArmBody(model, 0.0, shapes="collision") as body:
        kinematics = Kinematics(twin, "horizontal", 0.0)
        start = kinematics.home
        arm = PositionArm(body, start, kinematics)
        target = arm.state.hand
        states = run(arm, target, 0.3) + run(arm, target, 0.3, (0.0, 50.0, 0.0))
        assert distances(states, target).max() < 1e-3
        hard = run(arm, target, 0.3, (0.0, 0.0, -300.0)) + run(arm, target, 1.0)
        assert distances(hard, target).max() > 0.01  # the wrist gives way
        for state in hard:
            assert (np.abs(state.velocities) <= model.max_velocity).all()
            assert (state.joints > model.lower).all()
            assert (state.joints < model.upper).all()
