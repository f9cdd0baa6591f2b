"""Obstacles of a scenario as bodies in a Bullet world: boxes, cylinders and meshes."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import Any

from skillctl.errors import InputDataError, printable
from skillctl.simulation import probe
from skillctl.simulation.bullet import World
from skillctl.simulation.meshes import find_mesh
from skillctl.simulation.scenario import BoxObstacle, CylinderObstacle, Obstacle
from skillctl.workers.child import Child, ChildDiedError
from skillctl.workers.limits import Limits

LIMITS = Limits(seconds=60.0, memory=2**32)  # to load a mesh


def add_obstacle(bullet: World, obstacle: Obstacle, colour: tuple[float, ...] | None = None) -> int:
    """Add an obstacle to a world, and return Bullet's number of it.

    Args:
        bullet: The world.
        obstacle: The obstacle; a mesh has been tried (see ``require_meshes``).
        colour: Red, green, blue and opacity, from 0 to 1. None: it is not visible.
    """
    kind, seen, felt = _shapes(bullet, obstacle)
    turn = (0.0, 0.0, math.sin(obstacle.yaw / 2), math.cos(obstacle.yaw / 2))
    visual = -1
    if colour is not None:
        visual = bullet.createVisualShape(kind, rgbaColor=colour, specularColor=(0, 0, 0), **seen)
    return int(
        bullet.createMultiBody(
            mass_of(obstacle),
            bullet.createCollisionShape(kind, **felt),
            visual,
            obstacle.position,
            baseOrientation=turn,
        )
    )


def mass_of(obstacle: Obstacle) -> float:
    """Return the mass of an obstacle that stands loose, [kg]; 0 for one that does not move."""
    return (obstacle.mass or 0.0) if isinstance(obstacle, CylinderObstacle) else 0.0


def _shapes(bullet: World, obstacle: Obstacle) -> tuple[int, dict[str, Any], dict[str, Any]]:
    """Return Bullet's kind of shape, and the measures of the visible and of the tangible one."""
    if isinstance(obstacle, BoxObstacle):
        half = {"halfExtents": [0.5 * edge for edge in obstacle.size]}
        return bullet.GEOM_BOX, half, half
    if isinstance(obstacle, CylinderObstacle):
        radius, height = obstacle.radius, obstacle.height
        return (
            bullet.GEOM_CYLINDER,
            {"radius": radius, "length": height},
            {"radius": radius, "height": height},
        )
    mesh = {"fileName": str(_found(obstacle.file)), "meshScale": [obstacle.scale] * 3}
    return bullet.GEOM_MESH, mesh, {**mesh, "flags": bullet.GEOM_FORCE_CONCAVE_TRIMESH}


def require_meshes(obstacles: tuple[Obstacle, ...]) -> None:
    """Load the meshes of obstacles in another process, which a damaged one may crash.

    Raises:
        InputDataError: A mesh is missing or damaged, or Bullet does not read it.
    """
    for obstacle in obstacles:
        if not isinstance(obstacle, BoxObstacle | CylinderObstacle):
            path = _found(obstacle.file)
            _try(path, path.stat().st_mtime_ns)


def _found(name: str) -> Path:
    try:
        return find_mesh(name, Path.cwd())
    except InputDataError as refusal:
        raise InputDataError(f"obstacles: refers to {refusal}.", hint=refusal.hint) from None


@lru_cache(maxsize=64)  # every episode of a batch asks for the same meshes
def _try(path: Path, _: int) -> None:
    try:
        with Child(LIMITS) as child:
            child.call(probe.mesh, str(path))
    except (InputDataError, TimeoutError, ChildDiedError, MemoryError, ValueError) as error:
        raise InputDataError(
            printable(f"obstacles: {path} cannot be loaded by PyBullet."),
            hint="Check the mesh, or write it anew.",
        ) from error
