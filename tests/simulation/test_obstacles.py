"""Boxes, cylinders and meshes of a scenario stand where they should, and the arm must not touch them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from skillctl.errors import InputDataError, UsageError
from skillctl.model.seds import SedsSkill
from skillctl.simulation.arm import ArmBody
from skillctl.simulation.arms import ARMS
from skillctl.simulation.check import check
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import MeshObstacle, Scenario
from skillctl.simulation.scenario_file import read_scenario, to_toml
from skillctl.simulation.scene import SceneBodies
from skillctl.simulation.stage import Stage

MakeLinear = Callable[..., SedsSkill]
CORNERS = list(itertools.product((0, 1), repeat=3))
FACES = [
    (0, 1, 3),
    (0, 3, 2),
    (4, 6, 7),
    (4, 7, 5),
    (0, 4, 5),
    (0, 5, 1),
    (2, 3, 7),
    (2, 7, 6),
    (0, 2, 6),
    (0, 6, 4),
    (1, 5, 7),
    (1, 7, 3),
]


def write_arch(path: Path) -> None:
    """Write an arch as OBJ: a beam 0.4 m above the ground on two posts, 1 m apart, around x = y = 0."""
    lines, count = [], 0
    for low, high in (
        ((-0.05, -0.55, 0.0), (0.05, -0.45, 0.4)),
        ((-0.05, 0.45, 0.0), (0.05, 0.55, 0.4)),
        ((-0.05, -0.55, 0.4), (0.05, 0.55, 0.5)),
    ):
        corners = [[(low, high)[pick][axis] for axis, pick in enumerate(corner)] for corner in CORNERS]
        lines += ["v " + " ".join(map(str, corner)) for corner in corners]
        lines += ["f " + " ".join(str(count + 1 + i) for i in face) for face in FACES]
        count += len(corners)
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture
def arch(tmp_path: Path) -> Path:
    path = tmp_path / "arch.obj"
    write_arch(path)
    return path


BOX = {
    "kind": "box",
    "name": "crate",
    "position": (0.5, 0.0, 0.2),
    "size": (0.4, 0.1, 0.2),
    "yaw": math.pi / 2,
}
POST = {"kind": "cylinder", "name": "post", "position": (0.5, 0.0, 0.3), "radius": 0.04, "height": 0.6}


@pytest.mark.parametrize(
    ("obstacle", "lower", "upper"),
    [
        (BOX, (0.45, -0.2, 0.1), (0.55, 0.2, 0.3)),  # a quarter turn swaps its edges
        (POST, (0.46, -0.04, 0.0), (0.54, 0.04, 0.6)),
        (
            {"kind": "mesh", "position": (0.5, 0.1, 0.2), "scale": 0.1},
            (0.495, 0.045, 0.2),
            (0.505, 0.155, 0.25),
        ),
    ],
)
def test_an_obstacle_stands_where_it_is_put(
    arch: Path, obstacle: dict[str, object], lower: tuple[float, ...], upper: tuple[float, ...]
) -> None:
    if obstacle["kind"] == "mesh":
        obstacle = {**obstacle, "file": str(arch)}
    with Stage(ARMS["panda"], 0.0, Scenario(obstacles=[obstacle])) as stage:
        # Bullet adds a margin of up to some centimetres around what can be touched.
        assert stage.corners.min(axis=0) == pytest.approx(lower, abs=0.045)
        assert stage.corners.max(axis=0) == pytest.approx(upper, abs=0.045)


@pytest.mark.parametrize(
    "obstacle",
    [
        {"kind": "box", "name": "wall", "position": (0.5, 0.0, 0.5), "size": (0.3, 0.04, 0.5)},
        {"kind": "cylinder", "name": "wall", "position": (0.5, 0.0, 0.5), "radius": 0.04, "height": 0.5},
    ],
)
def test_touching_an_obstacle_is_a_failure_that_the_check_tells(
    linear: MakeLinear, obstacle: dict[str, object]
) -> None:
    scenario = Scenario(start=(0.5, 0.3, 0.5), obstacles=[obstacle], avoid=False)
    skill = linear((0.5, -0.3, 0.5))
    told, happened = check(skill, scenario), simulate(skill, scenario)
    assert not told.reachable
    assert "would touch the wall with the hand at (0.500" in told.reason
    assert happened.outcome == "shelf_contact"
    assert "touched the wall" in happened.detail
    assert check(skill, scenario.changed(obstacles=())).reachable
    assert check(skill, scenario.changed(avoid=True)).reachable


def test_the_hand_may_go_through_an_arch_and_not_through_its_post(linear: MakeLinear, arch: Path) -> None:
    gate = {"kind": "mesh", "name": "arch", "file": str(arch), "position": (0.55, 0.0, 0.3)}
    skill = linear((0.6, 0.05, 0.5))
    through = simulate(skill, Scenario(start=(0.45, 0.0, 0.5), obstacles=[gate]))
    assert through.outcome == "reached"  # inside of its convex hull
    assert 0 < through.metrics.clearance < 0.2
    aside = {**gate, "position": (0.55, 0.5, 0.3)}
    assert simulate(skill, Scenario(start=(0.45, 0.0, 0.5), obstacles=[aside])).outcome == "shelf_contact"


def test_obstacles_stand_beside_furniture() -> None:
    scenario = Scenario(scene={"kind": "shelf"}, obstacles=[{**POST, "position": (0.0, 0.0, 0.5)}])
    with ArmBody(ARMS["panda"], 0.0, shapes="collision") as body:
        things = {contact.thing for contact in SceneBodies(body, scenario).contacts_now()}
    assert things == {"post"}  # the arm stands in it


def test_a_scenario_with_obstacles_reads_back(tmp_path: Path, arch: Path) -> None:
    path = tmp_path / "own.toml"
    mesh = {"kind": "mesh", "file": arch.name, "position": (1.0, 0.0, 0.0)}
    path.write_text(to_toml(Scenario(obstacles=[BOX, POST, mesh])))
    found = read_scenario(path)
    assert [obstacle.kind for obstacle in found.obstacles] == ["box", "cylinder", "mesh"]
    assert isinstance(found.obstacles[2], MeshObstacle)
    assert found.obstacles[2].file == str(arch)  # relative to the scenario, not to where one stands
    (tmp_path / "again.toml").write_text(to_toml(found))
    assert read_scenario(tmp_path / "again.toml") == found


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("lost.obj", None, "'lost.obj', which is missing"),
        ("bad.obj", "v 0 0 0\nv 1 0 0\nf 1 2 99999999\n", "bad.obj cannot be loaded"),  # crashes its reader
    ],
)
def test_a_bad_mesh_is_refused(
    linear: MakeLinear,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    content: str | None,
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    if content is not None:
        (tmp_path / name).write_text(content)
    scenario = Scenario(obstacles=[{"kind": "mesh", "file": name, "position": (1.0, 0.0, 0.0)}])
    with pytest.raises(InputDataError, match=said):
        simulate(linear((0.5, 0.0, 0.5)), scenario)


def test_an_obstacle_without_its_measures_is_refused() -> None:
    with pytest.raises(UsageError, match="size"):
        Scenario(obstacles=[{"kind": "box", "position": (0, 0, 0)}])
    with pytest.raises(UsageError, match="obstacles"):
        Scenario(obstacles=[{"kind": "sphere", "position": (0, 0, 0), "radius": 1}])
