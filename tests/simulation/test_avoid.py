"""The scene as the hand's point sees it, against Bullet's own geometry; and motions that go round it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from skillctl.errors import UsageError
from skillctl.model.chained import ChainedSkill
from skillctl.simulation.arm import ArmBody
from skillctl.simulation.arms import ARMS
from skillctl.simulation.avoid import MARGIN, avoidance, hand_shape
from skillctl.simulation.ik import Kinematics
from skillctl.simulation.motion import Motion, plan_motion
from skillctl.simulation.placement import Placement
from skillctl.simulation.prepare import among_scene
from skillctl.simulation.scenario import BoxObstacle, MeshObstacle, Scenario, Shelf
from skillctl.simulation.scene import SceneBodies, cup_middle

PANDA = ARMS["panda"]
HERE = Placement(np.eye(3), np.zeros(3), 1.0, None)
HAND_LINKS = (8, 9, 10)  # palm and fingers
START = np.array([0.40, 0.0, 0.55])


@pytest.fixture
def twin():
    with ArmBody(PANDA, 0.0, shapes="none") as body:
        yield Kinematics(body, "horizontal", 0.0)


def shelf(place=(0.62, 0.1), board="top", **others):
    return Scenario(scene=Shelf(), target="cup", cup={"position": place, "board": board}, **others)


def test_the_open_fingers_of_a_panda_are_eight_centimetres_apart():
    shape = hand_shape(PANDA)
    left, right = shape.fingers
    gap = max(shape.low[left, 1], shape.low[right, 1]) - min(shape.high[left, 1], shape.high[right, 1])
    assert gap == pytest.approx(0.08, abs=1e-3)
    assert shape.high[:, 2].max() == pytest.approx(0.008, abs=2e-3)  # the finger tips, ahead of the point
    assert len(hand_shape(ARMS["iiwa"]).low) >= 1
    assert hand_shape(ARMS["iiwa"]).fingers == ()


def touched(body, scene, kinematics, point, target):
    """What the hand touches at a point, oriented as at the target: the base is put where the hand then is."""
    bullet = body.bullet
    place, turn = body.hand()
    base = bullet.getBasePositionAndOrientation(body.body)
    back = bullet.multiplyTransforms(*bullet.invertTransform(place.tolist(), turn), *base)
    wanted = bullet.multiplyTransforms(point.tolist(), kinematics.orientation(target), *back)
    bullet.resetBasePositionAndOrientation(body.body, *wanted)
    names = set()
    for number, name in scene._names.items():
        for link in HAND_LINKS:
            if bullet.getClosestPoints(body.body, number, 0.0, link):
                names.add(name)
    return names


@pytest.mark.parametrize("board", ["top", "bottom"])
def test_a_hand_outside_the_bodies_touches_no_board(twin, board):
    scenario = shelf(
        board=board, obstacles=[BoxObstacle(position=(0.6, -0.4, 0.8), size=(0.1, 0.2, 0.2), yaw=0.5)]
    )
    target = cup_middle(scenario)
    bodies = avoidance(scenario, HERE, twin).bodies(target)
    gauges = {body.name: body.inflated(MARGIN) for body in bodies if body.name != "sides of the cup"}
    rng = np.random.default_rng(0)
    points = rng.uniform([0.35, -0.8, 0.3], [1.0, 0.8, 1.1], (400, 3))
    inside = {name: gauge.values(points) < 1 for name, gauge in gauges.items()}
    with ArmBody(PANDA, 0.0, shapes="collision") as body:
        scene = SceneBodies(body, scenario)
        met = 0
        for i, point in enumerate(points):
            names = touched(body, scene, twin, point, target)
            met += len(names)
            assert names <= {name for name in gauges if inside[name][i]}, point
    assert met > 40


def test_a_hand_beside_the_cup_touches_it_only_in_the_bodies_there(twin):
    scenario = shelf()
    target = cup_middle(scenario)
    sides = [b for b in avoidance(scenario, HERE, twin).bodies(target) if b.name == "sides of the cup"]
    assert len(sides) == 2
    rng = np.random.default_rng(1)
    points = target + rng.uniform([-0.05, -0.15, 0.0], [-0.002, 0.15, 0.04], (300, 3))
    with ArmBody(PANDA, 0.0, shapes="collision") as body:
        scene = SceneBodies(body, scenario)
        scene._names = {scene.cup: "cup"}
        met = [bool(touched(body, scene, twin, point, target)) for point in points]
        free = not touched(body, scene, twin, target, target)
    inside = np.any([side.inflated(MARGIN).values(points) < 1 for side in sides], axis=0)
    assert free
    assert sum(met) > 60
    assert not (np.array(met) & ~inside).any()


def test_a_straight_motion_goes_round_the_upper_board(twin, linear):
    scenario = shelf()
    target = cup_middle(scenario)
    skill = linear(tuple(target))
    avoid = avoidance(scenario, HERE, twin)
    gauges = [body.inflated(MARGIN) for body in avoid.admitted(skill, np.zeros(3))[0]]
    kept, straight = (plan_motion(skill, HERE, scenario, START, avoid=each) for each in (avoid, None))
    assert kept.arrived
    assert straight.arrived
    assert min(gauge.values(straight.positions).min() for gauge in gauges) < 1
    assert min(gauge.values(kept.positions).min() for gauge in gauges) >= 1
    assert np.linalg.norm(kept.positions - straight.positions[:1], axis=1).max() < 0.6


def test_what_is_kept_out_of_is_said(twin, linear):
    mesh = MeshObstacle(name="vase", position=(0.5, 0.5, 0.5), file="vase.stl")
    near = BoxObstacle(name="crate", position=(0.62, 0.1, 0.76), size=(0.1, 0.1, 0.1))
    scenario = shelf(obstacles=[mesh, near])
    said = avoidance(scenario, HERE, twin).said(linear(tuple(cup_middle(scenario))))
    assert said == (
        "the hand keeps out of: lower board, upper board, sides of the cup; not of: rear panel (it meets the "
        "lower board), crate (the target is in it, or next to it), vase (a mesh)."
    )


def test_a_hand_that_is_seen_badly_is_not_guided_along_the_cup(twin):
    for shaken in ({"noise": 0.003}, {"target_error": 0.003}):
        avoid = avoidance(shelf(**shaken), HERE, twin)
        names = [body.name for body in avoid.bodies(cup_middle(avoid.scenario))]
        assert names == ["lower board", "upper board", "rear panel"]


def test_boards_stay_and_the_cup_moves_with_the_target(twin, linear):
    scenario = shelf()
    motion = Motion(
        linear(tuple(cup_middle(scenario))), HERE, scenario, avoid=avoidance(scenario, HERE, twin)
    )
    links: list[Any] = [motion._controller.skill.leaves[0].coordinates.links[0]]
    motion.move(np.array([0.0, 0.05, 0.0]))
    links.append(motion._controller.skill.leaves[0].coordinates.links[0])
    first, second = (dict(zip(link.names, link.gauges, strict=True)) for link in links)
    # The skill is moved by moving what it is told of the hand: its own target stays where it was.
    low, high = (np.array([gauge.bounds()[0] for gauge in (each["lower board"], each["sides of the cup"])])
                 for each in (first, second))  # fmt: skip
    np.testing.assert_allclose(high[0] - low[0], [0.0, -0.05, 0.0], atol=0.01)  # seen from the hand's turn
    np.testing.assert_allclose(high[1] - low[1], [0.0, 0.0, 0.0], atol=0.01)


def test_it_is_only_for_skills_in_three_dimensions_at_their_own_scale(twin):
    flat = Placement(np.eye(3)[:, :2], np.zeros(3), 1.0, "xy")
    assert avoidance(shelf(), flat, twin) is None
    assert avoidance(shelf(avoid=False), HERE, twin) is None
    assert avoidance(Scenario(avoid=True), HERE, twin) is None
    with pytest.raises(UsageError, match="three dimensions at scale 1"):
        avoidance(shelf(avoid=True), flat, twin)


def test_a_skill_among_a_scene_is_at_its_target_and_in_its_coordinates(linear):
    scenario = shelf(place=(0.6, -0.2), board="bottom")
    among = among_scene(linear((0.5, 0.0, 0.5)), scenario)
    np.testing.assert_array_equal(among.skill.attractors[0], cup_middle(scenario))
    assert [body.name for body in among.avoided] == ["lower board", "upper board", *["sides of the cup"] * 2]
    assert [body.name for body, _ in among.others] == ["rear panel"]
    with pytest.raises(UsageError, match="nothing in it"):
        among_scene(linear((0.5, 0.0, 0.5)), Scenario())


def chain_of(linear, *targets):
    """Return a chain that closes the fingers after its first stage and opens them after the last but one."""
    events = (("close",), *[()] * (len(targets) - 3), ("open",), ())
    return ChainedSkill(parts=tuple(map(linear, targets)), levels=np.full(len(targets), 1e-4), events=events)


def test_a_cup_in_the_hand_is_kept_out_of_the_boards_too(twin, linear):
    bind = {"1": "cup", "3": "place"}
    scenario = Scenario(scene=Shelf(), cup={"position": (0.62, 0.1), "board": "bottom"}, bind=bind)
    cup, above = cup_middle(scenario), np.array([0.62, -0.2, 0.70 + 0.06 + 0.008])
    home = (0.4, 0.0, 0.55)
    chain = chain_of(linear, tuple(cup), home, tuple(above), home)
    kept = avoidance(scenario, HERE, twin).applied(chain, np.zeros(3))
    names = [part.coordinates.links[0].names for part in kept.parts]
    assert names[0] == ("lower board", "upper board", "sides of the cup", "sides of the cup")
    assert names[1] == ("upper board",)  # the cup stands on the lower one
    assert names[2] == names[3] == ("lower board", "upper board")
    # Fingers reach 1 cm ahead of the hand's point, the cup in them 3.2 cm: 8 + 3 mm stay free of either.
    before_edge = np.array([0.5 - 0.032 - 0.008 + 0.005, -0.2, 0.69])
    carrying, empty = (
        part.coordinates.links[0].gauges[1].values((before_edge - part.attractor)[None])[0]
        for part in kept.parts[2:]
    )
    assert carrying < 1 < empty
