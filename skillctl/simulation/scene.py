"""The furniture in front of the arm, made of boxes, and the cup; and the contacts of the arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.simulation.arm import ArmBody
from skillctl.simulation.obstacles import add_obstacle, mass_of
from skillctl.simulation.options import BOARDS, Board
from skillctl.simulation.scenario import Cup, Scenario, Shelf, Table

PANEL_GAP = 0.01  # [m] between a shelf's boards and the panel behind them
SHELF_ROOM = 0.35  # [m], from the upper board to the top of panel and walls
CONTACT_FORCE, CONTACT_DEPTH = 1e-3, 5e-4  # [N], [m]: more than either is a contact
FOOT = 5e-3  # [m]: a cup's foot this near to a board's surface is on it
CLEARANCE_RANGE = 0.2  # [m]: distances beyond are not measured
NO_CUP = np.full(7, np.nan)


@dataclass(frozen=True, eq=False, slots=True)
class Box:
    """A part of a scene, from its lower to its upper corner (3,), [m]."""

    name: str
    lower: FloatArray
    upper: FloatArray


def boxes(scene: Shelf | Table | None) -> tuple[Box, ...]:
    """Return the boxes of a scene, in the workspace frame."""
    if scene is None:
        return ()
    (front, back), half = scene.x_range, 0.5 * scene.width
    if isinstance(scene, Table):
        return (_box("table", (front, back), (-half, half), (scene.height - scene.thickness, scene.height)),)
    depth, top = scene.thickness, scene.boards[1] + SHELF_ROOM
    bottom = scene.boards[0] - depth
    panel = back + PANEL_GAP
    parts = [
        _box(f"{name} board", (front, back), (-half, half), (height - depth, height))
        for name, height in zip(("lower", "upper"), scene.boards, strict=True)
    ]
    parts.append(_box("rear panel", (panel, panel + depth), (-half, half), (bottom, top)))
    if scene.walls:
        parts.append(_box("left wall", (front, panel), (half, half + depth), (bottom, top)))
        parts.append(_box("right wall", (front, panel), (-half - depth, -half), (bottom, top)))
    return tuple(parts)


def _box(name: str, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Box:
    lower, upper = np.array([x, y, z]).T
    return Box(name, lower, upper)


def board_height(scene: Shelf | Table, board: Board) -> float:
    """Return the height of the surface that a cup stands on, [m]."""
    return scene.height if isinstance(scene, Table) else scene.boards[0 if board == "bottom" else 1]


def cup_middle(scenario: Scenario) -> FloatArray:
    """Return the middle of the scenario's cup, its grasp point. Shape (3,), [m].

    Raises:
        ValueError: There is no cup.
    """
    if scenario.cup is None or scenario.scene is None:
        raise ValueError("this scenario has no cup")
    height = board_height(scenario.scene, scenario.cup.board) + 0.5 * scenario.cup.height
    return np.array([*scenario.cup.place, height])


def set_down_at(scenario: Scenario) -> FloatArray:
    """Return the middle of the cup where a chain shall set it down. Shape (3,), [m].

    Raises:
        ValueError: There is no such place.
    """
    if scenario.cup is None or scenario.place is None or scenario.scene is None:
        raise ValueError("this scenario has no place to set a cup down")
    height = board_height(scenario.scene, scenario.place.board) + 0.5 * scenario.cup.height
    return np.array([*scenario.place.place, height])


@dataclass(frozen=True, slots=True)
class Contact:
    """A link of the arm touches a part of the scene, or the cup; ``loose``: an obstacle that can be moved."""

    link: str
    thing: str
    loose: bool = False


class SceneBodies:
    """The scene and the cup as bodies in an arm's world, for contacts only; they are not visible."""

    def __init__(self, arm: ArmBody, scenario: Scenario) -> None:
        """Args: the arm, in its world; the scenario."""
        self._arm, self._scenario = arm, scenario
        self._names = {self._add_box(box): box.name for box in boxes(scenario.scene)}
        standing = {add_obstacle(arm.bullet, obstacle): obstacle for obstacle in scenario.obstacles}
        self._names |= {body: obstacle.name for body, obstacle in standing.items()}
        self._loose = {body for body, obstacle in standing.items() if mass_of(obstacle)}
        self.cup: int | None = None
        if scenario.cup is not None:
            self.cup = self._add_cup(scenario.cup, cup_middle(scenario))
        self._links = dict(enumerate(["base", *arm.link_names()], start=-1))

    def cup_pose(self) -> FloatArray:
        """Return position and orientation q_xyzw of the cup's middle, shape (7,); NaN without a cup."""
        if self.cup is None:
            return NO_CUP
        position, orientation = self._arm.bullet.getBasePositionAndOrientation(self.cup)
        return np.array([*position, *orientation])

    def stands(self, cup: FloatArray) -> bool:
        """Return whether the foot of an upright cup of this pose (7,) is on a board."""
        scene, own = self._scenario.scene, self._scenario.cup
        if scene is None or own is None:
            return False
        foot = float(cup[2]) - 0.5 * own.height
        return any(abs(foot - board_height(scene, board)) < FOOT for board in BOARDS)

    def move_cup(self, offset: FloatArray) -> None:
        """Move the cup by ``offset`` (3,) [m], upright and at rest; without a cup do nothing."""
        if self.cup is None:
            return
        position = self.cup_pose()[:3] + offset
        upright = (0.0, 0.0, 0.0, 1.0)
        self._arm.bullet.resetBasePositionAndOrientation(self.cup, position.tolist(), upright)

    def contacts(self) -> list[Contact]:
        """Return the contacts of the arm with the scene or the cup, one per contact point."""
        if not self._names:
            return []
        points = self._arm.bullet.getContactPoints(bodyA=self._arm.body)
        return [
            Contact(self._links[point[3]], self._names.get(point[2], "cup"), point[2] in self._loose)
            for point in points
            if point[2] != self._arm.body and (point[9] > CONTACT_FORCE or point[8] < -CONTACT_DEPTH)
        ]

    def contacts_now(self) -> list[Contact]:
        """Return the contacts before any time has passed; these have depths, but no forces yet."""
        self._arm.bullet.performCollisionDetection()
        return self.contacts()

    def clearance(self) -> float:
        """Return the distance of the arm to the scene without the cup, [m]; NaN without a scene."""
        if not self._names:
            return np.nan
        nearest = CLEARANCE_RANGE
        for body in self._names:
            points = self._arm.bullet.getClosestPoints(self._arm.body, body, nearest)
            nearest = min([nearest, *(point[8] for point in points)])
        return nearest

    def _add_box(self, box: Box) -> int:
        bullet, half = self._arm.bullet, (0.5 * (box.upper - box.lower)).tolist()
        shape = bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=half)
        return int(bullet.createMultiBody(0.0, shape, -1, (0.5 * (box.lower + box.upper)).tolist()))

    def _add_cup(self, cup: Cup, middle: FloatArray) -> int:
        bullet = self._arm.bullet
        shape = bullet.createCollisionShape(bullet.GEOM_CYLINDER, radius=cup.radius, height=cup.height)
        body = int(bullet.createMultiBody(cup.mass, shape, -1, middle.tolist()))
        across = cup.mass * (3 * cup.radius**2 + cup.height**2) / 12  # a solid cylinder's
        inertia = (across, across, 0.5 * cup.mass * cup.radius**2)
        bullet.changeDynamics(body, -1, lateralFriction=cup.friction, localInertiaDiagonal=inertia)
        return body
