from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from skillctl.simulation.arms import ARMS
from skillctl.simulation.camera import Camera, blurred_within
from skillctl.simulation.picture import SCENE_DIRECTION
from skillctl.simulation.scenario import Cup, Scenario, Shelf, Table
from skillctl.simulation.scene import boxes
from skillctl.simulation.stage import Stage, _cup_mesh

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def test_a_cup_is_seen_where_it_is_placed() -> None:
    place = np.array([0.6, -0.2, 0.76])
    with Stage(ARMS["panda"], 0.0, Scenario(scene=Shelf())) as stage:
        cup = stage.add_cup(Cup())
        stage.put(cup, np.array([*place, *UPRIGHT]))
        camera = Camera(
            place + 0.2 * np.array([[-1, -1, -1], [1, 1, 1]]), np.array(SCENE_DIRECTION), 480, 400
        )
        view = camera.render(stage)
    rows, columns = np.nonzero(view.surface == cup)
    corners = place + np.array(
        [[0.032 * np.cos(a), 0.032 * np.sin(a), z] for a in np.arange(0, 6.3, 0.05) for z in (-0.06, 0.06)]
    )
    expected = camera.project(corners)[0] * (480, 400)
    # The rim is the cylinder's; below, a cup is narrower: only left, right and upper ends are its own.
    assert columns.min() == pytest.approx(expected[:, 0].min(), abs=1.5)
    assert columns.max() + 1 == pytest.approx(expected[:, 0].max(), abs=1.5)
    assert rows.min() == pytest.approx(expected[:, 1].min(), abs=1.5)


def test_an_arm_that_is_seen_through_hides_nothing() -> None:
    place = np.array([0.45, 0.0, 0.3])
    with Stage(ARMS["panda"], 0.0, Scenario()) as stage:
        stage.show(np.array(ARMS["panda"].home), np.zeros(2))
        cup = stage.add_cup(Cup())
        stage.put(cup, np.array([*place, *UPRIGHT]))
        camera = Camera(np.vstack([stage.arm_extent(), place]), np.array([0.05, 0.0, 1.0]), 480, 400)
        opaque = camera.render(stage)
        with stage.without_arm():
            bare = camera.render(stage)
        again = camera.render(stage)
    assert (again.depths == opaque.depths).all()
    arm = opaque.surface == stage.body
    assert arm.any()
    assert not (bare.surface == stage.body).any()
    seen = opaque.through(stage.body, bare, 0.25)
    assert (seen.depths == bare.depths).all()
    assert (seen.colours[~arm] == bare.colours[~arm]).all()
    mixed = 0.25 * opaque.colours[arm] + 0.75 * bare.colours[arm]
    assert np.abs(seen.colours[arm] - mixed).max() <= 0.5  # rounded to whole levels
    (head,) = camera.hidden(place[None] + (0.0, 0.0, 0.06), opaque)
    assert head
    assert not camera.hidden(place[None] + (0.0, 0.0, 0.06), seen)[0]


def test_a_cup_is_open_and_no_wider_than_its_cylinder() -> None:
    vertices, normals, indices = _cup_mesh(0.03, 0.10)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)
    assert np.hypot(vertices[:, 0], vertices[:, 1]).max() == pytest.approx(0.03)
    assert (vertices[:, 2].min(), vertices[:, 2].max()) == pytest.approx((-0.05, 0.05))
    triangles = vertices[indices.reshape(-1, 3)]
    edges = triangles[:, 1:] - triangles[:, :1]
    crossed = np.cross(edges[:, 0], edges[:, 1])
    # Every triangle is seen from where its normal points to: renderers drop those seen from behind.
    turned = (crossed * normals[indices.reshape(-1, 3)].mean(axis=1)).sum(axis=1)
    assert (turned > -1e-15).all()
    # What a cup holds: no triangle closes it above its floor (ring around the axis, near the top).
    top = triangles[(triangles[:, :, 2] > 0.04).all(axis=1)]
    assert np.hypot(top[:, :, 0], top[:, :, 1]).min() > 0.02


@pytest.mark.parametrize("scene", [Shelf(), Shelf(walls=True), Table()])
def test_all_of_a_scene_is_framed_and_stands_on_the_floor(scene: Shelf | Table) -> None:
    with Stage(ARMS["panda"], 0.0, Scenario(scene=scene)) as stage:
        corners = stage.corners
    for box in boxes(scene):
        for corner in (box.lower, box.upper):
            assert np.abs(corners - corner).max(axis=1).min() == 0.0
    assert corners[:, 2].min() == 0.0


def test_shadows_are_softened_within_a_surface_and_not_beyond() -> None:
    areas = np.zeros((60, 80), dtype=np.int64)
    areas[:, 40:] = 7
    shares = np.where(areas == 7, 1.0, 0.6)
    # An edge between two surfaces stays sharp; 8-bit layers round by less than 1/255.
    np.testing.assert_allclose(blurred_within(shares, areas), shares, atol=1 / 255)
    shares[30:] -= 0.4
    soft = blurred_within(shares, areas)
    steps = np.abs(np.diff(soft[:, 10]))
    assert 0.02 < steps.max() < 0.1  # a step of 0.4 before
    assert soft[:, 10].mean() == pytest.approx(shares[:, 10].mean(), abs=0.01)
