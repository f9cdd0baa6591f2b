from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from skillctl.simulation.arm import ArmBody
from skillctl.simulation.arms import ARMS
from skillctl.simulation.scenario import Scenario, Shelf, Table
from skillctl.simulation.scene import SceneBodies, boxes, cup_middle

PANDA = ARMS["panda"]


def test_a_shelf_has_its_tops_edges_and_walls_where_it_says() -> None:
    parts = {box.name: box for box in boxes(Shelf(walls=True))}
    assert set(parts) == {"lower board", "upper board", "rear panel", "left wall", "right wall"}
    for name, top in (("lower board", 0.42), ("upper board", 0.70)):
        assert parts[name].upper == pytest.approx([0.80, 0.6, top], abs=1e-12)
        assert parts[name].lower == pytest.approx([0.50, -0.6, top - 0.02], abs=1e-12)
    assert parts["rear panel"].lower[0] > 0.80  # behind, and touching nothing
    assert parts["left wall"].lower[1] == 0.6
    assert parts["right wall"].upper[1] == -0.6
    assert boxes(None) == ()


def test_a_cup_stands_on_its_board() -> None:
    for scene, board, height in ((Shelf(), "top", 0.70), (Shelf(), "bottom", 0.42), (Table(), "top", 0.42)):
        scenario = Scenario(scene=scene, cup={"position": (0.6, 0.1), "board": board, "height": 0.1})
        assert cup_middle(scenario) == pytest.approx([0.6, 0.1, height + 0.05], abs=1e-12)


def test_the_cup_has_the_mass_and_inertia_of_a_solid_cylinder_and_stays_where_it_is() -> None:
    scenario = Scenario(scene=Shelf(), cup={"mass": 0.3, "radius": 0.03, "height": 0.1, "friction": 0.7})
    with ArmBody(PANDA, 0.0) as arm:
        scene = SceneBodies(arm, scenario)
        facts = arm.bullet.getDynamicsInfo(scene.cup, -1)
        across = 0.3 * (0.03**2 / 4 + 0.1**2 / 12)
        assert facts[0] == 0.3
        assert facts[1] == 0.7
        assert facts[2] == pytest.approx((across, across, 0.3 * 0.03**2 / 2), rel=1e-6)  # single precision
        arm.bullet.setGravity(0, 0, -9.81)
        before = scene.cup_pose()
        for _ in range(480):
            arm.bullet.stepSimulation()
        assert np.linalg.norm(scene.cup_pose()[:3] - before[:3]) < 5e-4
        scene.move_cup(np.array([0.0, 0.05, 0.0]))
        assert scene.cup_pose()[1] == pytest.approx(before[1] + 0.05, abs=5e-4)


def test_clearance_is_the_distance_of_the_nearest_parts() -> None:
    """A board above the arm's base, which is a flat-bottomed casting: the way down to it is known."""
    with ArmBody(PANDA, 0.0) as arm:
        arm.pose(np.array(PANDA.home_joints(0.0)))
        lowest = float(arm.bullet.getAABB(arm.body, 8)[0][2])  # the hand's
        scene = SceneBodies(arm, Scenario(scene=Table(height=lowest - 0.05, x_range=(0.3, 1.0))))
        # The box around the hand is a little larger than the hand, and the fingers reach below it by nothing.
        assert 0.02 < scene.clearance() < 0.08
        assert scene.contacts_now() == []
    with ArmBody(PANDA, 0.0) as arm:
        assert np.isnan(SceneBodies(arm, Scenario()).clearance())
        far = SceneBodies(arm, Scenario(scene=Table(x_range=(3.0, 4.0))))
        assert far.clearance() == 0.2


def test_who_touches_what_is_told_by_name() -> None:
    with ArmBody(PANDA, 0.0) as arm:
        arm.pose(np.array(PANDA.home_joints(0.0)))
        hand, _ = arm.hand()
        scene = SceneBodies(arm, Scenario(scene=Table(height=float(hand[2]), x_range=(0.4, 1.0))))
        found = {(contact.link, contact.thing) for contact in scene.contacts_now()}
    assert {thing for _, thing in found} == {"table"}
    assert "panda_leftfinger" in {link for link, _ in found}
