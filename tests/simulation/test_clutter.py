"""Bottles stand beside the cup, leave the last way to it free, and must not be touched."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("pydantic")

from skillctl.errors import UsageError
from skillctl.model.seds import SedsSkill
from skillctl.simulation.clutter import FREE
from skillctl.simulation.draws import drawn
from skillctl.simulation.scenario import CylinderObstacle, Sampling, Scenario, Shelf
from skillctl.simulation.scenario_file import to_toml
from skillctl.toml_files import parse_toml

SHELF, NONE = Shelf(), np.zeros((0, 3))
POST = {"kind": "cylinder", "name": "post", "position": (0.5, 0.0, 0.57), "radius": 0.04, "height": 0.3}


def cluttered(**sampling: object) -> Scenario:
    ranges = {"cup_x_range": (0.55, 0.68), "cup_y_range": (-0.42, 0.42), "boards": ("top", "bottom")}
    return Scenario(
        scene=SHELF, target="cup", seed=3, sampling=Sampling(**{"bottles": 2, **ranges, **sampling})
    )


def test_bottles_stand_upright_on_the_cups_board_and_leave_the_way_along_x_to_it_free() -> None:
    (front, back), half = SHELF.x_range, 0.5 * SHELF.width
    for episode in range(200):
        scene = drawn(cluttered(), episode, NONE)
        assert scene.cup is not None
        assert [bottle.name for bottle in scene.obstacles] == ["bottle 1", "bottle 2"]
        surface = SHELF.boards[0 if scene.cup.board == "bottom" else 1]
        for bottle in scene.obstacles:
            assert isinstance(bottle, CylinderObstacle)
            x, y, z = bottle.position
            assert z - bottle.height / 2 == pytest.approx(surface, abs=1e-12)
            assert surface + bottle.height < SHELF.boards[1] - SHELF.thickness or scene.cup.board == "top"
            assert front <= x - bottle.radius < x + bottle.radius <= back
            assert abs(y) + bottle.radius <= half
            assert abs(y - scene.cup.place[1]) - bottle.radius >= FREE - 1e-12
            assert math.dist((x, y), scene.cup.place) < 0.3  # beside it
        first, second = scene.obstacles
        assert isinstance(first, CylinderObstacle)
        assert isinstance(second, CylinderObstacle)
        assert math.dist(first.position[:2], second.position[:2]) >= first.radius + second.radius


def test_bottles_are_drawn_by_the_seed_and_change_nothing_else_that_is_drawn() -> None:
    one, again, other = (drawn(cluttered(), episode, NONE) for episode in (4, 4, 5))
    plain = drawn(cluttered(bottles=None), 4, NONE)
    assert one.obstacles == again.obstacles != other.obstacles
    assert (plain.cup, plain.seed, plain.obstacles) == (one.cup, one.seed, ())
    assert Scenario(**parse_toml(to_toml(one).encode())) == one  # so that one episode can be run alone


def test_more_bottles_than_there_is_room_for_are_refused() -> None:
    with pytest.raises(UsageError, match="no room for 20 beside the cup"):
        drawn(cluttered(bottles=20), 0, NONE)


def test_touching_a_loose_obstacle_is_a_failure_of_its_own(linear: Callable[..., SedsSkill]) -> None:
    pytest.importorskip(
        "pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only"
    )
    from skillctl.simulation.run import simulate

    scenario = Scenario(scene={"kind": "table"}, start=(0.5, 0.3, 0.6), avoid=False)
    skill = linear((0.5, -0.3, 0.6))
    fixed = simulate(skill, scenario.changed(obstacles=[POST]))
    loose = simulate(skill, scenario.changed(obstacles=[{**POST, "mass": 0.5}]))
    assert fixed.outcome == "shelf_contact"
    assert loose.outcome == "bottle_contact"
    assert "touched the post" in loose.detail


def test_a_bottle_stands_still_until_it_is_touched() -> None:
    pytest.importorskip(
        "pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only"
    )
    from skillctl.simulation.arm import ArmBody
    from skillctl.simulation.arms import ARMS
    from skillctl.simulation.scene import SceneBodies

    scenario = drawn(cluttered(), 0, NONE)
    with ArmBody(ARMS["panda"], 0.0, shapes="collision") as body:
        SceneBodies(body, scenario)
        count = body.bullet.getNumBodies()
        bottles = range(count - 3, count - 1)  # before the cup, which is the last
        before = [np.array(body.bullet.getBasePositionAndOrientation(i)[0]) for i in bottles]
        assert np.array(before) == pytest.approx(np.array([o.position for o in scenario.obstacles]))
        for _ in range(480):
            body.bullet.stepSimulation()
        after = [np.array(body.bullet.getBasePositionAndOrientation(i)[0]) for i in bottles]
        assert np.array(after) == pytest.approx(np.array(before), abs=2e-3)
        body.bullet.applyExternalForce(
            bottles[0], -1, (0, 500.0, 0), before[0].tolist(), body.bullet.WORLD_FRAME
        )
        for _ in range(20):
            body.bullet.stepSimulation()
        moved = np.array(body.bullet.getBasePositionAndOrientation(bottles[0])[0])
        assert np.linalg.norm(moved - after[0]) > 0.01
