"""What a picture shows: an arm on a floor, its scene and cups, posed as an episode says."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import TracebackType

import numpy as np

from skillctl.arrays import FloatArray, IntArray
from skillctl.simulation.arm import ArmBody, ArmModel
from skillctl.simulation.camera import Camera, View
from skillctl.simulation.scenario import Cup, Shelf, Table
from skillctl.simulation.scene import Box, boxes

ARM_RADIUS = 0.07  # [m]: links are this thick around their frames, for framing
FLOOR_SIZE = 4.0  # [m]
FLOOR = (0.90, 0.91, 0.93, 1.0)
WOOD, PANEL = (0.88, 0.76, 0.58, 1.0), (0.91, 0.89, 0.85, 1.0)
POST = 0.04  # [m]
CUP_COLOUR = (0.22, 0.42, 0.72, 1.0)
CUP_SIDES = 40
CUP_FOOT, CUP_RIM, CUP_FLOOR = 0.84, 0.88, 0.06  # radius below, radius inside, and height, as shares


class Stage:
    """A world to be looked at: nothing moves in it but what is posed. Usable as a context manager."""

    def __init__(self, model: ArmModel, base_yaw: float, scene: Shelf | Table | None) -> None:
        """Args: the arm; its base's turn about the vertical, [rad]; what stands in front of it."""
        self._arm = ArmBody(model, base_yaw)
        size = np.array([FLOOR_SIZE, FLOOR_SIZE, 0.0])
        self.floor = self._box(-size - (0, 0, 0.02), size, FLOOR)
        self.corners = np.zeros((0, 3))
        parts = boxes(scene)
        for box in (*parts, *_supports(parts)):
            self._box(box.lower, box.upper, PANEL if box.name in ("rear panel", "post") else WOOD)
            self.corners = np.vstack([self.corners, _corners(box)])

    def __enter__(self) -> Stage:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._arm.__exit__(kind, error, trace)

    def add_cup(self, cup: Cup, colour: tuple[float, float, float, float] = CUP_COLOUR) -> int:
        """Add a cup, and return the number by which it is moved."""
        vertices, normals, indices = _cup_mesh(cup.radius, cup.height)
        bullet, client = self._arm.bullet, self._arm.client
        shape = bullet.createVisualShape(
            bullet.GEOM_MESH,
            vertices=vertices.tolist(),
            normals=normals.tolist(),
            indices=indices.tolist(),
            rgbaColor=colour,
            specularColor=(0, 0, 0),
            physicsClientId=client,
        )
        return int(bullet.createMultiBody(0, -1, shape, physicsClientId=client))

    def place(self, number: int, pose: FloatArray) -> None:
        """Put a cup's middle at a position and orientation q_xyzw, together (7,)."""
        self._arm.bullet.resetBasePositionAndOrientation(
            number, pose[:3].tolist(), pose[3:].tolist(), physicsClientId=self._arm.client
        )

    def pose(self, joints: FloatArray, fingers: FloatArray) -> None:
        """Pose the arm: joints (n,) [rad], and each finger (m,) [m]."""
        self._arm.pose(joints)
        for (joint, _), place in zip(self._arm.model.fingers, fingers.tolist(), strict=False):
            self._arm.bullet.resetJointState(self._arm.body, joint, place, physicsClientId=self._arm.client)

    def arm_extent(self) -> FloatArray:
        """Return points (m, 3) around the arm as it is posed."""
        links = np.vstack([self._arm.links(), np.zeros(3)])
        return np.vstack([links - ARM_RADIUS, links + ARM_RADIUS])

    def seen_by(self, camera: Camera) -> View:
        """Return the picture of all this."""
        return camera.render(self._arm)

    def _box(self, lower: FloatArray, upper: FloatArray, colour: tuple[float, float, float, float]) -> int:
        bullet, client = self._arm.bullet, self._arm.client
        shape = bullet.createVisualShape(
            bullet.GEOM_BOX,
            halfExtents=(0.5 * (upper - lower)).tolist(),
            rgbaColor=colour,
            specularColor=(0, 0, 0),
            physicsClientId=client,
        )
        middle = (0.5 * (lower + upper)).tolist()
        return int(bullet.createMultiBody(0, -1, shape, middle, physicsClientId=client))


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
    for i in range(len(profile) - 1):  # each band has its own normals, so that edges stay sharp
        out, up = heights[i + 1] - heights[i], profile[i] - profile[i + 1]
        for j in (i, i + 1):
            vertices.append(np.column_stack([profile[j] * ring, np.full(CUP_SIDES, heights[j])]))
            normals.append(np.column_stack([out * ring, np.full(CUP_SIDES, up)]) / math.hypot(out, up))
        low = 2 * i * CUP_SIDES + np.arange(CUP_SIDES)
        on = np.roll(low, -1)
        indices.append(np.stack([low, on, on + CUP_SIDES, low, on + CUP_SIDES, low + CUP_SIDES], axis=1))
    return np.vstack(vertices), np.vstack(normals), np.concatenate(indices).ravel()


def _supports(parts: Sequence[Box]) -> list[Box]:
    """Return what holds the parts of a scene up in a picture: posts behind a panel, legs under a table.

    Nothing can touch them. They stand where the arm does not get, so that they hide nothing.
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
