"""The contents of a picture: an arm on a floor, its scene, and cups."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeAlias

import numpy as np

from skillctl.arrays import FloatArray, IntArray
from skillctl.simulation.arm import ArmBody
from skillctl.simulation.arms import ArmModel
from skillctl.simulation.obstacles import add_obstacle
from skillctl.simulation.scenario import Cup, Scenario
from skillctl.simulation.scene import Box, boxes

Tint: TypeAlias = tuple[float, float, float, float]  # red, green, blue, opacity, from 0 to 1

ARM_RADIUS = 0.07  # [m]: links are this thick around their frames, for framing
FLOOR_SIZE = 4.0  # [m]
FLOOR: Tint = (0.90, 0.91, 0.93, 1.0)
WOOD: Tint = (0.88, 0.76, 0.58, 1.0)
PANEL: Tint = (0.91, 0.89, 0.85, 1.0)
STONE: Tint = (0.66, 0.70, 0.76, 1.0)
OUT_OF_SIGHT = (0.0, 0.0, -100.0)  # [m]: below the floor, and behind the far end of every camera
POST = 0.04  # [m]
CUP_COLOUR: Tint = (0.22, 0.42, 0.72, 1.0)
CUP_SIDES = 40
CUP_FOOT, CUP_RIM, CUP_FLOOR = 0.84, 0.88, 0.06  # radius below, radius inside, and height, as shares


class Stage(ArmBody):
    """A world for pictures, without physics.

    Attributes:
        floor: Bullet's number of the floor.
        corners: Corners of all boxes of the scene, and around all obstacles, shape (n, 3), [m].
    """

    def __init__(self, model: ArmModel, base_yaw: float, scenario: Scenario) -> None:
        """Args: the arm; turn of its base about the vertical, [rad]; the scenario, for what stands around."""
        super().__init__(model, base_yaw)
        size = np.array([FLOOR_SIZE, FLOOR_SIZE, 0.0])
        self.floor = self._add_box(Box("floor", -size - (0, 0, 0.02), size), FLOOR)
        self.corners = np.zeros((0, 3))
        parts = boxes(scenario.scene)
        for box in (*parts, *_supports(parts)):
            self._add_box(box, PANEL if box.name in ("rear panel", "post") else WOOD)
            self.corners = np.vstack([self.corners, _corners(box)])
        for obstacle in scenario.obstacles:
            lower, upper = self.bullet.getAABB(add_obstacle(self.bullet, obstacle, STONE))
            corners = _corners(Box(obstacle.name, np.array(lower), np.array(upper)))
            self.corners = np.vstack([self.corners, corners])

    def add_cup(self, cup: Cup, colour: Tint = CUP_COLOUR) -> int:
        """Add a cup, and return Bullet's number of it."""
        vertices, normals, indices = (part.tolist() for part in _cup_mesh(cup.radius, cup.height))
        mesh = {"vertices": vertices, "normals": normals, "indices": indices}
        return self._add(self.bullet.GEOM_MESH, colour, (0.0, 0.0, 0.0), mesh)

    def put(self, cup: int, pose: FloatArray) -> None:
        """Put the middle of a cup at a position and orientation q_xyzw, together (7,)."""
        self.bullet.resetBasePositionAndOrientation(cup, pose[:3].tolist(), pose[3:].tolist())

    def show(self, joints: FloatArray, fingers: FloatArray) -> None:
        """Pose the arm: joints (n,) [rad], and each finger (m,) [m]."""
        self.pose(joints)
        for (joint, _), place in zip(self.model.fingers, fingers.tolist(), strict=False):
            self.bullet.resetJointState(self.body, joint, place)

    @contextmanager
    def without_arm(self) -> Iterator[None]:
        """Have the arm out of sight."""
        place, turn = self.bullet.getBasePositionAndOrientation(self.body)
        self.bullet.resetBasePositionAndOrientation(self.body, OUT_OF_SIGHT, turn)
        yield
        self.bullet.resetBasePositionAndOrientation(self.body, place, turn)

    def arm_extent(self) -> FloatArray:
        """Return points (m, 3) around the arm in its present posture."""
        links = np.vstack([self.links(), np.zeros(3)])
        return np.vstack([links - ARM_RADIUS, links + ARM_RADIUS])

    def _add_box(self, box: Box, colour: Tint) -> int:
        half, middle = 0.5 * (box.upper - box.lower), 0.5 * (box.lower + box.upper)
        return self._add(self.bullet.GEOM_BOX, colour, middle.tolist(), {"halfExtents": half.tolist()})

    def _add(self, kind: int, colour: Tint, place: Sequence[float], geometry: dict[str, Any]) -> int:
        dull = (0, 0, 0)
        shape = self.bullet.createVisualShape(kind, rgbaColor=colour, specularColor=dull, **geometry)
        return int(self.bullet.createMultiBody(0, -1, shape, place))


def _corners(box: Box) -> FloatArray:
    picks = np.array([[i >> k & 1 for k in range(3)] for i in range(8)])
    return np.where(picks, box.upper, box.lower)


def _cup_mesh(radius: float, height: float) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return vertices (n, 3), normals (n, 3) and triangles (3 m,) of an open cup around its middle."""
    half, floor = 0.5 * height, (CUP_FLOOR - 0.5) * height
    profile = radius * np.array([0.0, CUP_FOOT, 1.0, CUP_RIM, CUP_RIM * CUP_FOOT, 0.0])
    heights = np.array([-half, -half, half, half, floor, floor])
    turn = math.tau * np.arange(CUP_SIDES) / CUP_SIDES
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    vertices, normals, indices = [], [], []
    for i in range(len(profile) - 1):  # each band has its own normals, for sharp edges
        out, up = heights[i + 1] - heights[i], profile[i] - profile[i + 1]
        for j in (i, i + 1):
            vertices.append(np.column_stack([profile[j] * ring, np.full(CUP_SIDES, heights[j])]))
            normals.append(np.column_stack([out * ring, np.full(CUP_SIDES, up)]) / math.hypot(out, up))
        low = 2 * i * CUP_SIDES + np.arange(CUP_SIDES)
        on = np.roll(low, -1)
        indices.append(np.stack([low, on, on + CUP_SIDES, low, on + CUP_SIDES, low + CUP_SIDES], axis=1))
    return np.vstack(vertices), np.vstack(normals), np.concatenate(indices).ravel()


def _supports(parts: Sequence[Box]) -> list[Box]:
    """Return the supports of a scene in a picture: posts behind a panel, legs under a table.

    They are only drawn, out of the arm's reach, where they hide nothing.
    """
    if not parts:
        return []
    named = {box.name: box for box in parts}
    box = named.get("rear panel", parts[0])
    (x0, y0, _), (x1, y1, top) = box.lower, box.upper
    if box.name == "rear panel":
        corners = [(x1, y0 + POST), (x1, y1 - 2 * POST)]
    else:
        top = box.lower[2]
        corners = [(x, y) for x in (x0, x1 - POST) for y in (y0, y1 - POST)]
    return [Box("post", np.array([x, y, 0.0]), np.array([x + POST, y + POST, top])) for x, y in corners]
