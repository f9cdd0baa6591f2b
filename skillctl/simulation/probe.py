"""What is in a URDF file: read in a process of its own, which a damaged file or mesh may take down.

Run as a program with the file and the module search path as its arguments; prints one JSON document. It
imports nothing of skillctl: it starts fast, and what it may break is its own.
"""

from __future__ import annotations

import json
import math
import os
import re
import sys
import xml.etree.ElementTree as Xml
from typing import Any

MEMORY_LIMIT = 4 * 2**30  # [bytes]: a mesh that needs more is not a robot's
STEPS = 24  # of physics: enough for masses that make no sense to show
BOUNDED = ("revolute", "prismatic")
JOINT_TYPES = (*BOUNDED, "continuous", "fixed")
FIXED = 4  # Bullet's number of this type


def main() -> None:
    """Describe the file that the command line names."""
    path, *sys.path[:] = sys.argv[1:]
    answer = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # Bullet talks on standard output
    _limit_memory()
    answer.write(json.dumps(describe(path)))
    answer.close()


def describe(path: str) -> dict[str, Any]:
    """Return ``refused`` with a reason, or ``joints`` and ``missing``: see ``urdf``."""
    try:
        root = Xml.parse(path).getroot()
    except Xml.ParseError as error:
        return {"refused": f"is no XML ({error})"}
    if root.tag != "robot":
        return {"refused": f"holds <{root.tag}>, not the <robot> of a URDF file"}
    if any("xacro" in element.tag for element in root.iter()):
        return {"refused": "is a xacro template, which has to be expanded first"}
    for joint in root.findall("joint"):
        name, kind, limit = joint.get("name"), joint.get("type"), joint.find("limit")
        if kind not in JOINT_TYPES:
            return {"refused": f"has a joint {name} of the type {kind}, which no motor drives"}
        bounded = limit is not None and limit.get("lower") is not None and limit.get("upper") is not None
        if kind in BOUNDED and not bounded:
            return {"refused": f"gives joint {name} no lower and upper limit"}
    return _loaded(path, {joint.get("name") for joint in root.iterfind("joint[@type='continuous']")})


def _loaded(path: str, continuous: set[str | None]) -> dict[str, Any]:
    import pybullet as bullet

    client = bullet.connect(bullet.DIRECT)
    try:
        body = bullet.loadURDF(path, useFixedBase=True, physicsClientId=client)
    except bullet.error:
        return {"refused": "cannot be loaded by PyBullet"}
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
        return {"refused": "has masses or inertias with which it cannot move"}
    return {"joints": [_joint(info, continuous) for info in infos]}


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


def complaint(chatter: str) -> str:
    """Return the file that Bullet says it cannot find, or nothing."""
    found = re.search(r"cannot find '([^']*)'|cannot extract mesh from '([^']*)'", chatter)
    return "" if found is None else found[1] or found[2]


def _limit_memory() -> None:
    try:
        import resource
    except ImportError:  # not on Windows
        return
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT, MEMORY_LIMIT))


if __name__ == "__main__":
    main()
