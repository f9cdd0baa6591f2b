"""A first load of a description, in a child process, which a damaged mesh may crash."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager

from skillctl.errors import InputDataError
from skillctl.simulation.bullet import load_bullet, silenced

STEPS = 24  # of physics: after these, impossible masses give values that are not finite
FIXED = 4  # Bullet's number of this type of joint


def robot(path: str) -> tuple[list[str], list[str]]:
    """Return the names of joints and links in Bullet's order, after some steps and a picture of the robot.

    Raises:
        InputDataError: The file cannot be simulated. The text continues a sentence that begins with "this
            URDF file".
    """
    bullet = load_bullet()
    client = bullet.connect(bullet.DIRECT)
    with _chatter() as chatter:
        try:
            body = bullet.loadURDF(
                path, useFixedBase=True, flags=bullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client
            )
        except bullet.error:
            body = None
    if missing := re.search(r"cannot (?:find|extract mesh from) '([^']*)'", chatter[0]):
        raise InputDataError(f"refers to {missing[1]!r}, which is damaged")
    if body is None:
        raise InputDataError("cannot be loaded by PyBullet")
    infos = [
        bullet.getJointInfo(body, joint, physicsClientId=client)
        for joint in range(bullet.getNumJoints(body, physicsClientId=client))
    ]
    bullet.setGravity(0, 0, -9.81, physicsClientId=client)
    for _ in range(STEPS):
        bullet.stepSimulation(physicsClientId=client)
    bullet.getCameraImage(16, 16, renderer=bullet.ER_TINY_RENDERER, physicsClientId=client)
    moving = [info[0] for info in infos if info[2] != FIXED]
    states = bullet.getJointStates(body, moving, physicsClientId=client) if moving else []
    if not all(math.isfinite(value) for state in states for value in state[:2]):
        raise InputDataError("has masses or inertias with which it cannot move")
    joints, links = ([info[place].decode(errors="replace") for info in infos] for place in (1, 12))
    return joints, links


def mesh(path: str) -> None:
    """Load a mesh to be seen and to be touched.

    Raises:
        InputDataError: PyBullet does not load it.
    """
    bullet = load_bullet()
    client = bullet.connect(bullet.DIRECT)
    with _chatter() as chatter:
        try:
            shapes = [
                make(bullet.GEOM_MESH, fileName=path, flags=flags, physicsClientId=client)
                for make, flags in (
                    (bullet.createCollisionShape, bullet.GEOM_FORCE_CONCAVE_TRIMESH),
                    (bullet.createVisualShape, 0),
                )
            ]
            bullet.createMultiBody(0, *shapes, physicsClientId=client)
            bullet.getCameraImage(16, 16, renderer=bullet.ER_TINY_RENDERER, physicsClientId=client)
        except bullet.error as error:
            raise InputDataError(str(error)) from error
    if min(shapes) < 0 or "cannot" in chatter[0]:
        raise InputDataError("cannot be loaded")


@contextmanager
def _chatter() -> Iterator[list[str]]:
    """Yield a list that holds, after the block, what C code has printed: at least the first 64 KiB."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)  # what does not fit into the pipe is lost, and writing never blocks
    printed: list[str] = []
    with silenced(1, writing), silenced(2, writing):
        yield printed
    os.close(writing)
    with os.fdopen(reading, errors="replace") as pipe:
        printed.append(pipe.read())
