"""A robot as a URDF file describes it: links, joints, and the joints that follow others."""

from __future__ import annotations

import math
import xml.etree.ElementTree as Xml
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from skillctl.errors import InputDataError, UsageError, did_you_mean, printable
from skillctl.opening import open_regular

BOUNDED = ("revolute", "prismatic")
JOINT_TYPES = (*BOUNDED, "continuous", "fixed")
FOREIGN = {
    "sdf": "an SDF file",
    "mujoco": "a MuJoCo model",
    "launch": "a launch file",
    "COLLADA": "a COLLADA file",
}
CHECK = "Check the file and the meshes it names."
MAX_BYTES = 16 * 2**20  # of the file itself; meshes are files of their own


@dataclass(frozen=True, slots=True)
class Mimic:
    """q = multiplier · q of another joint + offset, which a mechanism enforces."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint as the file describes it.

    Units are [rad], [rad/s], [Nm], or [m], [m/s], [N] of a sliding joint. A limit that is not given is NaN;
    those of a continuous joint are infinite, whatever its ``<limit>`` says.
    """

    name: str
    kind: str
    parent: str
    child: str
    lower: float
    upper: float
    velocity: float
    effort: float
    mimic: Mimic | None

    @property
    def moves(self) -> bool:
        """Whether it is not fixed."""
        return self.kind != "fixed"

    @property
    def unit(self) -> str:
        """Unit of its position."""
        return "m" if self.kind == "prismatic" else "rad"

    def clipped(self, place: float) -> float:
        """Return the place within its limits that is nearest to this one."""
        return min(max(place, self.lower), self.upper) if self.lower <= self.upper else place


class Robot:
    """The links and joints of a URDF file, which form a tree.

    Attributes:
        path: The file.
        root: Its XML.
        joints: By name, in the file's order.
        base: The link that hangs on no joint.
    """

    def __init__(self, path: Path, root: Xml.Element) -> None:
        """Read the joints, and check that they join all links to one tree."""
        self.path, self.root = path, root
        self.joints: dict[str, Joint] = {}
        self.above: dict[str, Joint] = {}  # by child link
        for element in root.findall("joint"):
            joint = self._joint(element)
            if joint.name in self.joints or joint.child in self.above:
                twice = joint.name if joint.name in self.joints else joint.child
                raise self.refused(f"has two joints for {twice}")
            self.joints[joint.name] = self.above[joint.child] = joint
        links = [str(link.get("name")) for link in root.findall("link")]
        for joint in self.joints.values():
            for link in (joint.parent, joint.child):
                if link not in links:
                    raise self.refused(f"has a joint {joint.name} at a link {link} that does not exist")
        bases = [link for link in links if link not in self.above]
        if len(bases) != 1:
            raise self.refused(f"has {len(bases)} base links ({', '.join(bases)}) instead of one")
        self.base = bases[0]
        self.links = [self.base, *(joint.child for joint in self._descend(self.base))]
        if len(self.links) < len(links):
            raise self.refused("has joints that form a loop")

    def refused(self, reason: str, hint: str = CHECK) -> InputDataError:
        """Return an error about the file; ``reason`` continues "this URDF file"."""
        return InputDataError(printable(f"{self.path}: this URDF file {reason}."), hint=hint)

    @cached_property
    def _below(self) -> dict[str, list[Joint]]:
        below: dict[str, list[Joint]] = {}
        for joint in self.joints.values():
            below.setdefault(joint.parent, []).append(joint)
        return below

    def below(self, link: str) -> list[Joint]:
        """Return the joints that hang on a link."""
        return self._below.get(link, [])

    def _descend(self, link: str) -> Iterator[Joint]:
        waiting = [link]
        while waiting:
            for joint in self.below(waiting.pop()):
                yield joint
                waiting.append(joint.child)

    def chain(self, link: str) -> list[Joint]:
        """Return all joints between the base and a link, in this order."""
        chain = []
        while link != self.base:
            chain.append(self.above[link])
            link = self.above[link].parent
        return chain[::-1]

    def places(self, held: Mapping[str, float]) -> dict[str, float]:
        """Return where joints stay that are held, and with them those that mimic one of these.

        Raises:
            UsageError: There is no such joint, or it cannot be held there.
        """
        for name, place in held.items():
            self._require_holdable(name, place)
        places = dict(held)
        for joint in self.joints.values():
            factor, offset, passed = 1.0, 0.0, [joint.name]
            while (mimic := self.joints[passed[-1]].mimic) is not None and mimic.joint in self.joints:
                if mimic.joint in passed:
                    raise self.refused(f"has a joint {mimic.joint} that mimics itself")
                factor, offset = factor * mimic.multiplier, factor * mimic.offset + offset
                passed.append(mimic.joint)
            if len(passed) > 1 and passed[-1] in held:
                places[joint.name] = factor * held[passed[-1]] + offset
        return places

    def _require_holdable(self, name: str, place: float) -> None:
        joint = self.joints.get(name)
        if joint is None or not joint.moves:
            moving = [each.name for each in self.joints.values() if each.moves]
            raise UsageError(
                f"hold: {self.path} has no moving joint {name!r}.",
                hint=did_you_mean(name, moving) or f"Its moving joints are {', '.join(moving)}.",
            )
        if joint.mimic is not None:
            raise UsageError(f"hold: joint {name} mimics {joint.mimic.joint}.", hint="Hold that one.")
        if joint.clipped(place) != place:
            raise UsageError(
                f"hold: joint {name} can be between {joint.lower:g} and {joint.upper:g}, not {place:g}."
            )

    def _joint(self, element: Xml.Element) -> Joint:
        name, kind = str(element.get("name")), str(element.get("type"))
        if kind not in JOINT_TYPES:
            raise self.refused(f"has a joint {name} of the type {kind}, which no motor drives")
        ends = [element.find("parent"), element.find("child")]
        parent, child = (str(end.get("link")) if end is not None else "" for end in ends)
        limit, mimic = element.find("limit"), element.find("mimic")
        lower, upper = _number(limit, "lower"), _number(limit, "upper")
        if kind == "continuous":
            lower, upper = -math.inf, math.inf
        elif kind == "fixed":
            lower = upper = 0.0
        return Joint(
            name=name,
            kind=kind,
            parent=parent,
            child=child,
            lower=lower,
            upper=upper,
            velocity=_number(limit, "velocity"),
            effort=_number(limit, "effort"),
            mimic=None
            if mimic is None
            else Mimic(
                str(mimic.get("joint")), _number(mimic, "multiplier", 1.0), _number(mimic, "offset", 0.0)
            ),
        )


def read_robot(path: Path) -> Robot:
    """Return the robot in a URDF file.

    Raises:
        InputDataError: It is no URDF file, or describes no tree of links.
    """
    try:
        with open_regular(path) as file:
            content = file.read(MAX_BYTES + 1)
        if len(content) > MAX_BYTES:
            raise Xml.ParseError(f"it is larger than {MAX_BYTES / 2**20:.0f} MiB")
        if b"<!ENTITY" in content:  # no robot needs them, and they can take all memory
            raise Xml.ParseError("it defines entities")
        root = Xml.fromstring(content)
    except (Xml.ParseError, ValueError, LookupError) as error:  # the last two: encodings that do not exist
        raise InputDataError(printable(f"{path}: this URDF file is no XML ({error})."), hint=CHECK) from error
    xacro = any("xacro" in element.tag for element in root.iter()) or path.suffix == ".xacro"
    if xacro and root.tag == "robot":
        plain = path.with_suffix("") if path.suffix == ".xacro" else path.with_name(f"plain_{path.name}")
        raise InputDataError(
            printable(f"{path}: this file is a xacro template, which has to be expanded first."),
            hint=f"Expand it, with ROS: xacro {path} > {plain if plain.suffix else f'{plain}.urdf'}",
        )
    if root.tag != "robot":
        what = "".join(f", {words}," for tag, words in FOREIGN.items() if tag == root.tag.rpartition("}")[2])
        raise InputDataError(
            printable(f"{path}: this file holds <{root.tag}>{what or ','} not the <robot> of a URDF file."),
            hint="Convert it to URDF; most robots are published as such, too.",
        )
    return Robot(path, root)


def _number(element: Xml.Element | None, name: str, default: float = math.nan) -> float:
    text = None if element is None else element.get(name)
    if text is None:
        return default
    try:
        return float(text)
    except ValueError:
        return math.nan
