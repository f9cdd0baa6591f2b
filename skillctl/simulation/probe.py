"""The joints in a URDF file, read in a child process, which a damaged file or mesh may crash."""

from __future__ import annotations

import math
import os
import re
import xml.etree.ElementTree as Xml
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from skillctl.errors import InputDataError
from skillctl.simulation.bullet import load_bullet, silenced

STEPS = 24  # of physics: after these, impossible masses give values that are not finite
BOUNDED = ("revolute", "prismatic")
JOINT_TYPES = (*BOUNDED, "continuous", "fixed")
FIXED = 4  # Bullet's number of this type


def joints(path: str) -> list[dict[str, Any]]:
    """Return the joints that PyBullet finds in a URDF file, see ``_joint``.

    Raises:
        InputDataError: The file is not a URDF file, or cannot be simulated. The text continues a
            sentence that begins with "this URDF file".
    """
    try:
        root = Xml.parse(path).getroot()
    except Xml.ParseError as error:
        raise InputDataError(f"is no XML ({error})") from error
    if root.tag != "robot":
        raise InputDataError(f"holds <{root.tag}>, not the <robot> of a URDF file")
    if any("xacro" in element.tag for element in root.iter()):
        raise InputDataError("is a xacro template, which has to be expanded first")
    for joint in root.findall("joint"):
        name, kind, limit = joint.get("name"), joint.get("type"), joint.find("limit")
        if kind not in JOINT_TYPES:
            raise InputDataError(f"has a joint {name} of the type {kind}, which no motor drives")
        bounded = limit is not None and limit.get("lower") is not None and limit.get("upper") is not None
        if kind in BOUNDED and not bounded:
            raise InputDataError(f"gives joint {name} no lower and upper limit")
    return _loaded(path, {joint.get("name") for joint in root.iterfind("joint[@type='continuous']")})


def _loaded(path: str, continuous: set[str | None]) -> list[dict[str, Any]]:
    bullet = load_bullet()
    client = bullet.connect(bullet.DIRECT)
    with _chatter() as chatter:
        try:
            body = bullet.loadURDF(path, useFixedBase=True, physicsClientId=client)
        except bullet.error:
            body = None
    if missing := re.search(r"cannot (?:find|extract mesh from) '([^']*)'", chatter[0]):
        raise InputDataError(f"refers to {missing[1]!r}, which is missing or damaged")
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
    return [_joint(info, continuous) for info in infos]


def _joint(info: tuple[Any, ...], continuous: set[str | None]) -> dict[str, Any]:
    name = info[1].decode(errors="replace")
    return {
        "index": info[0],
        "name": name,
        "link": info[12].decode(errors="replace"),
        "parent": info[16],
        "moves": info[2] != FIXED,
        "continuous": name in continuous,
        "lower": info[8],
        "upper": info[9],
        "torque": info[10],
        "velocity": info[11],
    }


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
