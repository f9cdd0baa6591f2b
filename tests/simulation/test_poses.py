"""Skills that turn the hand: a hand-made one, whose motion and end are known in closed form."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")
from PIL import Image

from skillctl.errors import UsageError
from skillctl.model.combined import CombinedSkill
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.mixture import GaussianMixture
from skillctl.model.pose import Pose
from skillctl.model.seds import SedsSkill
from skillctl.simulation.arm import ArmBody
from skillctl.simulation.arms import ARMS
from skillctl.simulation.check import check
from skillctl.simulation.disturbances import Displace
from skillctl.simulation.draws import TURN_SCATTER, chosen
from skillctl.simulation.episode import Episode, RefusedError
from skillctl.simulation.ik import POSE_ANGLE, POSE_POSITION, Kinematics
from skillctl.simulation.picture import encode_picture
from skillctl.simulation.prepare import prepare
from skillctl.simulation.recording import encode_log
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import Cup, Sampling, Scenario, Shelf
from tests.simulation.test_ik import panda_hand

TARGET = (0.58, 0.2, 0.55)
START = (0.45, -0.15, 0.5)
TWO_DEGREES = math.radians(2.0)
MakeTurning = Callable[..., SedsSkill]


def ahead(yaw: float, pitch: float = 0.25) -> Rotation:
    """Return the orientation of a hand that points to a side and down, its finger axis horizontal."""
    return Rotation.from_euler("ZY", [yaw, pitch]) * Rotation.from_matrix([[0, 0, 1], [0, -1, 0], [1, 0, 0]])


@pytest.fixture(scope="module")
def turning() -> MakeTurning:
    """Return a maker of v = −a (p − p*), ω = −b log(R R*ᵀ)."""

    def make(yaw: float = 0.5, rate: float = 2.0, turn_rate: float = 2.0) -> SedsSkill:
        means, covariances = np.array([[*TARGET, 0.0, 0.0, 0.0]]), 0.01 * np.eye(6)[None]
        return SedsSkill(
            priors=np.ones(1),
            means=means,
            covariances=covariances,
            system_matrices=-np.diag([rate] * 3 + [turn_rate] * 3)[None],
            residual_covariances=1e-4 * np.eye(6)[None],
            attractor=np.array([*TARGET, *ahead(yaw).as_rotvec()]),
            lyapunov=np.eye(6),
            density=GaussianMixture(np.ones(1), means, covariances),
            space=Pose(length=0.2),
        )

    return make


@pytest.fixture(scope="module")
def episode(turning: MakeTurning) -> Episode:
    return simulate(turning(), Scenario(start=START))


def off(joints: np.ndarray, yaw: float) -> tuple[float, float]:
    """Return how far a Panda's hand is from the target, by the manufacturer's table: [m], [rad]."""
    pose = panda_hand(joints)
    turn = Rotation.from_matrix(pose[:3, :3]) * ahead(yaw).inv()
    return float(np.linalg.norm(pose[:3, 3] - TARGET)), float(turn.magnitude())


def test_the_hand_ends_where_and_as_the_skill_says(episode: Episode) -> None:
    assert episode.outcome == "reached"
    distance, angle = off(episode.series.joints[-1], 0.5)
    assert distance < 2e-3
    assert angle < TWO_DEGREES
    assert episode.metrics.final_error == pytest.approx(
        distance, abs=1e-5
    )  # a URDF's right angles are rounded
    assert episode.metrics.final_turn == pytest.approx(angle, abs=1e-3)


def test_success_needs_both_tolerances(turning: MakeTurning) -> None:
    slow = simulate(turning(turn_rate=0.8), Scenario(start=START))
    assert slow.outcome == "reached"
    places = [off(joints, 0.5) for joints in slow.series.joints[::24]]
    at_place = next(i for i, (distance, _) in enumerate(places) if distance < 2e-3)
    turned = next(i for i, (_, angle) in enumerate(places) if angle < TWO_DEGREES)
    assert turned > at_place + 5  # half a second later
    period = 24 / 240
    assert slow.metrics.time_to_target == pytest.approx(turned * period, abs=1.5 * period)
    hasty = simulate(turning(turn_rate=0.8), Scenario(start=START, max_duration=3.0))
    assert hasty.outcome == "timeout"
    assert "mm and" in hasty.detail
    lenient = simulate(turning(turn_rate=0.8), Scenario(start=START, turn_tolerance=1.0))
    assert lenient.metrics.time_to_target < slow.metrics.time_to_target - 5 * period


def test_the_hand_turns_no_faster_than_it_may(turning: MakeTurning) -> None:
    cap = 0.3
    run = simulate(turning(turn_rate=5.0), Scenario(start=(*START, *ahead(-0.5).as_quat()), max_turn=cap))
    assert run.outcome == "reached"
    turns = Rotation.from_quat(run.series.hand_turns)
    speeds = (turns[1:] * turns[:-1].inv()).magnitude() * 240
    assert 0.95 * cap < speeds.max() < 1.02 * cap  # motors follow with some ripple


def test_a_turning_push_is_made_good(turning: MakeTurning) -> None:
    push = Displace(time=1.5, offset=(0.0, 0.0, 0.05), turn=(math.radians(20), 0.0, 0.0))
    run = simulate(turning(), Scenario(start=START, disturbances=(push,)))
    assert run.outcome == "reached"
    turns = Rotation.from_quat(run.series.hand_turns)
    jump = (turns[1:] * turns[:-1].inv()).magnitude().max()
    assert jump == pytest.approx(math.radians(20), abs=0.02)  # and what a period adds


def test_only_a_taught_hand_is_turned(turning: MakeTurning, reach: SedsSkill) -> None:
    with pytest.raises(UsageError, match="turns the hand as taught, not down"):
        simulate(turning(), Scenario(hand="down"))
    with pytest.raises(UsageError, match="was taught positions only"):
        simulate(reach, Scenario(hand="taught"))
    push = Displace(time=1.0, offset=(0.0, 0.0, 0.0), turn=(0.1, 0.0, 0.0))
    with pytest.raises(UsageError, match="only a skill that was taught orientations"):
        simulate(reach, Scenario(disturbances=(push,)))
    with pytest.raises(UsageError, match="expected 3 or 6 or 7 numbers, got 4"):
        simulate(turning(), Scenario(start=(*START, 1.0)))
    far = (0.9, 0.0, 0.9, *ahead(0.0).as_quat())
    with pytest.raises(RefusedError, match=r"for the start \(0.900, 0.000, 0.900\) m; .* mm and \d+° away"):
        simulate(turning(), Scenario(start=far))


def test_the_log_has_orientations_and_those_of_positions_have_none(
    episode: Episode, reach: SedsSkill
) -> None:
    rows = list(csv.DictReader(io.StringIO(encode_log(episode).decode())))
    for name in ("ref", "hand", "target"):
        last = Rotation.from_quat([float(rows[-1][f"{name}_q{axis}"]) for axis in "xyzw"])
        assert (last * ahead(0.5).inv()).magnitude() < TWO_DEGREES
    plain = simulate(reach, Scenario(max_duration=0.1))
    assert b"hand_q" not in encode_log(plain)
    assert math.isnan(plain.metrics.final_turn)


def test_a_picture_shows_the_axes_of_the_hand(episode: Episode) -> None:
    pixels = np.asarray(Image.open(io.BytesIO(encode_picture(episode))).convert("RGB"), dtype=int)
    for red_green_blue in ((205, 45, 45), (40, 140, 60), (45, 85, 205)):
        assert (np.abs(pixels - red_green_blue).max(axis=2) < 8).sum() > 20


def test_manipulability_is_the_determinant_of_the_hands_jacobian() -> None:
    step = 1e-6
    with ArmBody(ARMS["panda"], 0.0, shapes="none") as body:
        for joints in np.random.default_rng(5).uniform(-1.5, 1.5, (5, 7)):
            columns = []
            for bump in step * np.eye(7):
                before, after = panda_hand(joints - bump), panda_hand(joints + bump)
                turn = Rotation.from_matrix(after[:3, :3] @ before[:3, :3].T).as_rotvec()
                columns.append(np.concatenate([after[:3, 3] - before[:3, 3], turn]) / (2 * step))
            jacobian = np.stack(columns, axis=1)
            expected = math.sqrt(np.linalg.det(jacobian @ jacobian.T))
            # Differences are exact to some 1e-9; the right angles of the URDF to 1e-3.
            assert body.manipulability(joints) == pytest.approx(expected, rel=5e-3, abs=1e-4)


def test_a_found_posture_holds_the_hand_as_asked() -> None:
    with ArmBody(ARMS["panda"], 0.0, shapes="none") as body:
        kinematics = Kinematics(body, "taught", 0.0)
        for yaw, pitch in ((0.0, 0.25), (0.6, 0.1), (-0.6, 0.5)):
            found = kinematics.search(np.array([0.55, 0.1, 0.5, *ahead(yaw, pitch).as_rotvec()]))
            assert found.accepted
            pose = panda_hand(found.joints)
            assert np.linalg.norm(pose[:3, 3] - [0.55, 0.1, 0.5]) < POSE_POSITION + 1e-5
            turn = Rotation.from_matrix(pose[:3, :3]) * ahead(yaw, pitch).inv()
            assert turn.magnitude() < POSE_ANGLE + 1e-3


def test_a_check_says_how_far_the_hand_is_turned(turning: MakeTurning) -> None:
    found = check(turning(), Scenario(start=START))
    assert found.reachable
    assert found.start_turn is not None
    assert found.target_turn is not None
    assert found.path_turn is not None
    assert max(found.start_turn, found.target_turn) < POSE_ANGLE
    assert found.path_turn < TWO_DEGREES
    over = check(turning(yaw=2.6), Scenario(start=START))
    assert not over.reachable
    assert "for the target" in over.reason


def test_a_drawn_start_is_turned_as_the_nearest_demonstrated_one(turning: MakeTurning) -> None:
    skill = turning()
    starts = [np.array([0.4, y, 0.5, *ahead(yaw).as_rotvec()]) for y, yaw in ((-0.2, -0.4), (0.2, 0.4))]
    times = np.array([0.0, 1.0])
    motions = [
        Demonstration.from_positions(times, np.stack([start, skill.attractor]), "test", skill.space)
        for start in starts
    ]
    taught = [DemonstrationSet(tuple(motions), skill.space)]
    box = Sampling(start_x_range=(0.4, 0.4), start_y_range=(-0.2, 0.2), start_z_range=(0.5, 0.5))
    turns = []
    for i in range(40):
        one = chosen(skill, taught, Scenario(sampling=box), demo=None, episode=i).start
        assert one is not None
        assert len(one) == 6
        nearest = ahead(0.4 if one[1] > 0 else -0.4)
        turns.append((Rotation.from_rotvec(one[3:]) * nearest.inv()).magnitude())
    assert max(turns) < 4.5 * TURN_SCATTER  # three normal coordinates: beyond that once in 10⁴
    assert np.mean(turns) == pytest.approx(TURN_SCATTER * math.sqrt(8 / math.pi), rel=0.25)  # of 40 draws
    fixed = chosen(skill, taught, Scenario(start=(0.4, 0.15, 0.5)), demo=None, episode=None).start
    assert fixed is not None
    assert (Rotation.from_rotvec(fixed[3:]) * ahead(0.4).inv()).magnitude() < 1e-12


def test_the_part_that_acts_turns_the_hand_for_the_cup_its_own_way(turning: MakeTurning) -> None:
    def part(yaw: float) -> SedsSkill:
        """Return a part that was taught motions in the direction of the hand."""
        skill = turning(yaw)
        means = skill.means - 0.1 * np.array([[math.cos(yaw), math.sin(yaw), 0.0, 0.0, 0.0, 0.0]])
        density = GaussianMixture(np.ones(1), means, skill.covariances)
        return replace(skill, means=means, density=density)

    skill = CombinedSkill((part(0.5), part(-0.5)), part_priors=np.array([0.5, 0.5]), gate="latched")
    start = (0.62 - 0.22 * math.cos(0.5), 0.1 - 0.22 * math.sin(0.5), 0.76, *ahead(0.4).as_quat())
    scenario = Scenario(scene=Shelf(), target="cup", cup=Cup(position=(0.62, 0.1)), start=start)
    run = simulate(skill, scenario)
    assert run.outcome == "grasped"
    at_cup = run.series.phases == 0
    turn = Rotation.from_quat(run.series.hand_turns[at_cup][-1]) * ahead(0.5).inv()
    assert turn.magnitude() < scenario.grasp.turn
    assert run.metrics.cup_moved < 2e-3


def test_the_whole_motion_turns_with_its_target(turning: MakeTurning) -> None:
    bent = turning()
    bent = replace(bent, system_matrices=-np.diag([2.0, 1.0, 2.0, 2.0, 2.0, 2.0])[None])
    target = (*TARGET, *ahead(0.9).as_quat().tolist())
    states = np.array([[*START, *ahead(0.1).as_rotvec()]])
    ways = {}
    for turn in (False, True):
        setup = prepare(bent, Scenario(start=START, target=target, turn=turn))
        assert np.allclose(setup.skill.attractors[0, 3:], ahead(0.9).as_rotvec(), rtol=0, atol=1e-12)
        ways[turn] = setup.skill.velocity(states)[0, :3]
    turned = Rotation.from_euler("Z", 0.9 - 0.5)
    offset = np.array(START) - TARGET
    assert np.allclose(ways[False], [-2, -1, -2] * offset, rtol=0, atol=1e-12)
    expected = turned.apply([-2, -1, -2] * turned.inv().apply(offset))
    assert np.allclose(ways[True], expected, rtol=0, atol=1e-12)
    with pytest.raises(UsageError, match="no target to turn with"):
        prepare(bent, Scenario(start=START, turn=True))
