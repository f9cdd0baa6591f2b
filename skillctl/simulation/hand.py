"""Which joints of a robot are its arm, and which of its links is the hand, as a person would choose them."""

from __future__ import annotations

import re
from collections.abc import Container, Iterator

from skillctl.simulation.robot_file import Joint, Robot

FEWEST_JOINTS = 3  # to move a hand in three dimensions
JAW = re.compile(r"grip|jaw|finger|claw|thumb|knuckle|pincer|clamp", re.IGNORECASE)
JAW_LINK = re.compile(r"jaw|finger|claw|thumb|knuckle|pincer", re.IGNORECASE)
STILL = re.compile(r"fixed|static|base|palm", re.IGNORECASE)  # the jaw that the hand carries
WRIST = re.compile(r"wrist|elbow|shoulder|roll|pitch|yaw|rotat", re.IGNORECASE)
JAW_STROKE = 0.1  # [m]: a sliding joint at the end of five others that moves less is a finger
ARM_BEFORE_FINGER = 5
HANDS = [  # names of the hand's frame, the best first; of several with equal names the outermost is taken
    re.compile(pattern, re.IGNORECASE)
    for pattern in (
        r"tcp|tool_?cent|tool_?0",
        r"grasp|grip(per)?_?(frame|tip|center|centre|point)|pinch",
        r"end_?eff|(^|_)eef?(_|$)|tool",
        r"flange",
        r"(hand|palm|gripper)(_link|_frame)?$",
        r"hand|palm|gripper",
    )
]
BESIDE = HANDS[:3]  # a frame of these names beside a last moving link shows that this link is a jaw
NO_HAND = re.compile(
    r"camera|(^|_)cam(_|$)|sensor|optical|depth|colou?r|rgb|infra|imu|laser|lidar|light|(^|_)led|screen|display"
    r"|cuff|button|finger|motor|marker|(^|_)ft(_|$)|force|inertia|mount|cover|cable|contact",
    re.IGNORECASE,
)


def arm_ends(robot: Robot, places: Container[str], link: str | None = None) -> list[str]:
    """Return the last link that the arm moves; several, if the robot has arms of equal length.

    The arm is the longest chain of joints. It ends where a robot of at least three joints branches into short
    chains, which are fingers, and before the jaw of a gripper.

    Args:
        robot: The robot.
        places: Names of the joints that are held.
        link: From where on the arm is sought, by default the base.
    """
    end = robot.base if link is None else link
    while True:
        count = len(free_joints(robot, end, places))
        branches = [(_depth(robot, joint, places), joint) for joint in _next(robot, end, places)]
        longest = max((depth for depth, _ in branches), default=0)
        if not longest or (len(branches) > 1 and count >= FEWEST_JOINTS and longest <= count):
            return [_before_jaw(robot, end, places)]
        arms = [joint.child for depth, joint in branches if depth == longest]
        if len(arms) > 1:
            return [last for arm in arms for last in arm_ends(robot, places, arm)]
        end = arms[0]


def free_joints(robot: Robot, link: str, places: Container[str]) -> list[Joint]:
    """Return the joints between the base and a link that are not held, in this order."""
    return [joint for joint in robot.chain(link) if joint.moves and joint.name not in places]


def hand_frame(robot: Robot, end: str, places: Container[str]) -> str:
    """Return the frame fixed to the arm's last link that is its hand.

    That is the one with the best name; or else the last one before several are side by side, or a sensor.
    """
    frames = [end, *_fixed_to(robot, end, places)]
    for pattern in HANDS:
        named = [frame for frame in frames if pattern.search(frame) and not NO_HAND.search(frame)]
        if named:
            return named[0 if pattern is HANDS[-1] else -1]  # a gripper's other parts bear its name, too
    link = end
    while len(below := robot.below(link)) == 1 and below[0].child in frames:
        if NO_HAND.search(below[0].child):
            break
        link = below[0].child
    return link


def _next(robot: Robot, link: str, places: Container[str]) -> Iterator[Joint]:
    """Yield the first free joints on all ways out from a link. A mimicking joint moves, but is not free."""
    for joint in robot.below(link):
        if joint.moves and joint.name not in places and joint.mimic is None:
            yield joint
        else:
            yield from _next(robot, joint.child, places)


def _depth(robot: Robot, joint: Joint, places: Container[str]) -> int:
    """Return the number of free joints on the longest way out, from this one on."""
    return 1 + max((_depth(robot, after, places) for after in _next(robot, joint.child, places)), default=0)


def _before_jaw(robot: Robot, end: str, places: Container[str]) -> str:
    """Return the link before the jaws of a gripper, if the arm seems to end in some."""
    while joints := [joint for joint in free_joints(robot, end, places) if joint.mimic is None]:
        if len(joints) <= FEWEST_JOINTS or not _is_jaw(robot, joints[-1], len(joints) - 1, places):
            break
        end = joints[-1].parent
    return end


def _is_jaw(robot: Robot, joint: Joint, before: int, places: Container[str]) -> bool:
    if WRIST.search(joint.name):
        return False
    followed = any(
        other.mimic is not None and other.mimic.joint == joint.name and joint not in robot.chain(other.child)
        for other in robot.joints.values()
    )
    beside = any(_is_hand(frame) for frame in _fixed_to(robot, joint.parent, places))
    carried = any(_is_hand(frame) for frame in (joint.child, *_fixed_to(robot, joint.child, places)))
    slides = (
        before >= ARM_BEFORE_FINGER and joint.kind == "prismatic" and joint.upper - joint.lower <= JAW_STROKE
    )
    return bool(_named_jaw(joint) or slides or ((followed or beside) and not carried))


def _named_jaw(joint: Joint) -> bool:
    if WRIST.search(joint.name):
        return False
    named = JAW.search(joint.name) or (JAW_LINK.search(joint.child) and not STILL.search(joint.child))
    return named is not None


def _is_hand(frame: str) -> bool:
    return not NO_HAND.search(frame) and any(pattern.search(frame) for pattern in BESIDE)


def _fixed_to(robot: Robot, link: str, places: Container[str]) -> list[str]:
    """Return the links that cannot move against a link, from it outwards, but for jaws that are held."""
    found = []
    for joint in robot.below(link):
        if not joint.moves or (joint.name in places and not _named_jaw(joint)):
            found += [joint.child, *_fixed_to(robot, joint.child, places)]
    return found
