"""A robot's description written anew, so that Bullet simulates what the file says.

Bullet reads some things otherwise: it enforces the limits of continuous joints, gives a link without an
inertial 1 kg and 1 kg m², sets an inertia that breaks the triangle inequality to zero, ignores mimic joints,
and finds packages only in the folders above. Here, all joints that the arm does not move are fixed.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as Xml
from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import InputDataError
from skillctl.simulation.meshes import find_mesh
from skillctl.simulation.robot_file import CHECK, Joint, Robot

KEPT = ("link", "joint", "material")
LIGHTEST = 0.01  # [kg], where a joint moves nothing that has a mass, with which Bullet could not compute
BALL_RADIUS = 0.02  # [m], whose inertia a moving link has that gives none
INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
ROUNDED = 1e-3  # by this share, an inertia may break the triangle inequality without a word
INSIDE = 1 - 1e-6  # of the inequality, so that Bullet's rounding does not break it


def for_bullet(
    robot: Robot, fixed: Mapping[str, float], packages: Sequence[Path] = ()
) -> tuple[str, list[str]]:
    """Return the description, and a note on each thing that could not be taken from the file.

    Args:
        robot: The robot.
        fixed: Joints that do not move, and their places; all others keep their kind.
        packages: Folders whose meshes may be read, too (see ``find_mesh``).

    Raises:
        InputDataError: A mesh is missing, may not be read, or is of a kind that Bullet does not read; or a
            mass is impossible.
    """
    root = Xml.Element("robot", {"name": robot.root.get("name", "robot")})
    root.extend(deepcopy(element) for element in robot.root if element.tag in KEPT)
    for material in [*root.iter("material")]:
        for texture in material.findall("texture"):  # which Bullet would look for in many places
            material.remove(texture)
    masses = {str(link.get("name")): _mass(robot, link) for link in root.iterfind("link")}
    notes: list[str] = []
    for link in root.iterfind("link"):
        name = str(link.get("name"))
        above = robot.above.get(name)
        moved = above is not None and above.moves and above.name not in fixed
        _write_inertial(link, masses[name], moved and not _carries(robot, name, masses), notes)
        for mesh in link.iter("mesh"):
            try:
                found = find_mesh(mesh.get("filename", ""), robot.path.resolve().parent, packages)
                mesh.set("filename", str(found))
            except InputDataError as refusal:
                raise robot.refused(f"refers to {refusal}", refusal.hint) from None
    for element in root.iterfind("joint"):
        joint = robot.joints[str(element.get("name"))]
        _write_joint(element, joint, fixed.get(joint.name, 0.0 if not joint.moves else None))
    return Xml.tostring(root, "unicode"), notes


def _mass(robot: Robot, link: Xml.Element) -> float:
    mass = link.find("inertial/mass")
    try:
        value = 0.0 if mass is None else float(mass.get("value", "0"))
    except ValueError:
        value = math.nan
    if not 0 <= value < math.inf:
        raise robot.refused(f"gives link {link.get('name')} an impossible mass", CHECK)
    return value


def _carries(robot: Robot, link: str, masses: Mapping[str, float]) -> bool:
    """Return whether a link, or what hangs on it, has a mass."""
    return masses[link] > 0 or any(_carries(robot, joint.child, masses) for joint in robot.below(link))


def _write_inertial(link: Xml.Element, mass: float, weightless: bool, notes: list[str]) -> None:
    """Give a link the inertial of the file: none for a frame, and a possible one for a mass."""
    name, inertial = link.get("name"), link.find("inertial")
    origin = link.find("inertial/origin")
    tensor = np.zeros((3, 3)) if inertial is None else _tensor(inertial.find("inertia"))
    if inertial is not None:
        link.remove(inertial)
    if weightless:
        notes.append(f"link {name} moves and has no mass; it is simulated with {1e3 * LIGHTEST:.0f} g.")
        mass = LIGHTEST
    if mass > 0:
        tensor, doubt = _possible(tensor, mass)
        if doubt and not weightless:
            notes.append(f"link {name} {doubt}.")
    else:
        tensor = np.zeros((3, 3))
    new = Xml.SubElement(link, "inertial")
    Xml.SubElement(new, "origin", {} if origin is None else origin.attrib)
    Xml.SubElement(new, "mass", {"value": repr(float(mass))})
    entries = tensor[np.triu_indices(3)].tolist()
    Xml.SubElement(new, "inertia", {key: repr(entry) for key, entry in zip(INERTIA, entries, strict=True)})


def _tensor(inertia: Xml.Element | None) -> FloatArray:
    """Return the inertia (3, 3), [kg m²]; zero without one."""
    try:
        entries = [0.0 if inertia is None else float(inertia.get(key, "0")) for key in INERTIA]
    except ValueError:
        entries = [math.nan] * len(INERTIA)
    upper = np.zeros((3, 3))
    upper[np.triu_indices(3)] = entries
    return np.asarray(upper + np.triu(upper, 1).T)


def _possible(tensor: FloatArray, mass: float) -> tuple[FloatArray, str]:
    """Return the inertia (3, 3), or a possible one for one that no body has, and what is wrong with it."""
    ball = 0.4 * mass * BALL_RADIUS**2 * np.eye(3)
    if not np.isfinite(tensor).all() or not tensor.any():
        return ball, f"gives no inertia; it counts as a ball of {1e3 * BALL_RADIUS:.0f} mm"
    moments, axes = np.linalg.eigh(tensor)
    if moments[0] <= 0:
        return ball, f"has an impossible inertia; it counts as a ball of {1e3 * BALL_RADIUS:.0f} mm"
    largest = moments[0] + moments[1]
    if moments[2] < INSIDE * largest:
        return tensor, ""
    doubt = moments[2] > (1 + ROUNDED) * largest
    moments[2] = INSIDE * largest
    words = "has an impossible inertia: a moment above the sum of the others, to which it is reduced"
    return np.asarray((axes * moments) @ axes.T), words if doubt else ""


def _write_joint(element: Xml.Element, joint: Joint, place: float | None) -> None:
    """Fix a joint at its place, or, if that is None, take the limits from one that has none."""
    axis = _vector(element.find("axis"), "xyz", (1.0, 0.0, 0.0))
    axis = axis / (np.linalg.norm(axis) or 1.0)
    if place is None:
        limit, written = element.find("limit"), element.find("axis")
        if joint.kind == "continuous" and limit is not None:
            for end in ("lower", "upper"):
                limit.attrib.pop(end, None)
        if written is not None:
            written.set("xyz", " ".join(map(repr, axis.tolist())))
        return
    origin = element.find("origin")
    position, turn = _vector(origin, "xyz"), _rotation(_vector(origin, "rpy"))
    if joint.kind == "prismatic":
        position = position + turn @ (place * axis)
    else:
        turn = turn @ _about(axis, place)
    for child in list(element):
        if child.tag not in ("parent", "child"):
            element.remove(child)
    element.set("type", "fixed")
    texts = (" ".join(map(repr, numbers)) for numbers in (position.tolist(), _angles(turn)))
    Xml.SubElement(element, "origin", dict(zip(("xyz", "rpy"), texts, strict=True)))


def _vector(
    element: Xml.Element | None, key: str, default: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> FloatArray:
    text = None if element is None else element.get(key)
    numbers = default if text is None else [float(number) for number in text.split()]
    return np.array(numbers if len(numbers) == 3 else default)


def _rotation(angles: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) of URDF's roll, pitch, yaw: about the fixed axes x, y, z."""
    roll, pitch, yaw = (_about(axis, angle) for axis, angle in zip(np.eye(3), angles.tolist(), strict=True))
    return np.asarray(yaw @ pitch @ roll)


def _about(axis: FloatArray, angle: float) -> FloatArray:
    """Return the rotation (3, 3) about an axis, after Rodrigues."""
    x, y, z = axis.tolist()
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross)


def _angles(turn: FloatArray) -> list[float]:
    """Return roll, pitch and yaw of a rotation; with the pitch at ± ½ π, the roll is taken to be 0."""
    pitch = math.atan2(-turn[2, 0], math.hypot(turn[0, 0], turn[1, 0]))
    if abs(abs(pitch) - math.pi / 2) < 1e-9:
        return [0.0, pitch, math.atan2(-turn[0, 1], turn[1, 1])]
    return [math.atan2(turn[2, 1], turn[2, 2]), pitch, math.atan2(turn[1, 0], turn[0, 0])]
