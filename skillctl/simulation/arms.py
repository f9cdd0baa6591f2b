"""The arms, one data sheet each; a new arm needs no more than another record.

This module imports no NumPy, so that the command line can list the arms without it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

Angles = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ArmModel:
    """A data sheet. Every tuple of limits has one entry per arm joint; fingers are not arm joints.

    Units are those of a turning joint, [rad], [rad/s], [Nm]; a sliding one has [m], [m/s], [N] instead.

    Attributes:
        name: As on the command line.
        title: Maker and type.
        urdf: File of the ``pybullet_data`` package, or an absolute path.
        indices: Bullet's numbers of the arm's joints, from the base to the hand.
        tip: Link whose frame is the hand; its z axis is the approach direction.
        lower, upper: Joint limits of the real arm, [rad] (the URDF's are wider).
        max_velocity, max_torque: Limits of the real arm, [rad/s] and [Nm].
        home: Ready posture for a hand pitched down by zero; the pitch is subtracted at ``pitch_joint``.
        pitch_joint: Joint that pitches the hand in the ready posture, with its sign; None if that is unknown.
        finger_axis: Sign of the hand's y axis against the horizontal in the natural branch (see ``ik``).
        fingers: Finger joints and their open positions, [m].
        reach_centre: Middle of the comfortable workspace in front of the arm, [m].
        yaw_share: How far the hand turns towards the azimuth of its position: 0 ahead, 1 radially.
        tip_link: Name of that link.
        joints: Names of the arm's joints.
        text: Description for Bullet of an arm by file (see ``for_bullet``); empty for the others.
        held: Joints of an arm by file that are not the arm's, and where they are fixed.
        notes: What was not taken from the file, in sentences.
    """

    name: str
    title: str
    urdf: str
    indices: tuple[int, ...]
    tip: int
    lower: Angles
    upper: Angles
    max_velocity: Angles
    max_torque: Angles
    home: Angles
    pitch_joint: tuple[int, float] | None
    finger_axis: int
    fingers: tuple[tuple[int, float], ...]
    reach_centre: tuple[float, float, float]
    yaw_share: float
    tip_link: str
    joints: tuple[str, ...]
    text: str = ""
    held: tuple[tuple[str, float], ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def n_joints(self) -> int:
        """Number of arm joints."""
        return len(self.home)

    @property
    def path(self) -> Path:
        """Path of the URDF file."""
        import pybullet_data

        return Path(pybullet_data.getDataPath()) / self.urdf

    @property
    def columns(self) -> list[int]:
        """Indices of the arm's joints among all movable joints, in Bullet's order."""
        movable = sorted([*self.indices, *(joint for joint, _ in self.fingers)])
        return [movable.index(joint) for joint in self.indices]

    def home_joints(self, pitch: float) -> Angles:
        """Return the ready posture whose hand is pitched ``pitch`` [rad] below the horizontal."""
        joints = list(self.home)
        if self.pitch_joint is not None:
            joint, sign = self.pitch_joint
            joints[joint] += sign * pitch
        return tuple(joints)


def degrees(angles: Sequence[float]) -> Angles:
    """Return angles given in degrees in radians."""
    return tuple(map(math.radians, angles))


PANDA = ArmModel(
    name="panda",
    title="Franka Panda",
    urdf="franka_panda/panda.urdf",
    indices=tuple(range(7)),
    tip=11,
    lower=(-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
    upper=(2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
    max_velocity=(2.175,) * 4 + (2.61,) * 3,
    max_torque=(87.0,) * 4 + (12.0,) * 3,
    home=(0.0, -0.785, 0.0, -2.356, 0.0, math.pi, 0.785),
    pitch_joint=(5, -1.0),
    finger_axis=-1,
    fingers=((9, 0.04), (10, 0.04)),
    reach_centre=(0.50, 0.0, 0.60),
    tip_link="panda_grasptarget",
    joints=tuple(f"panda_joint{i}" for i in range(1, 8)),
    yaw_share=0.5,  # at a shelf, 0 brings the elbow near the boards or a wall, 1 the forearm
)
# The model in pybullet_data has the link lengths of the LBR iiwa 14 R820 (0.36, 0.42, 0.40 m).
IIWA = ArmModel(
    name="iiwa",
    title="KUKA LBR iiwa",
    urdf="kuka_iiwa/model.urdf",
    indices=tuple(range(7)),
    tip=6,
    lower=degrees((-170, -120, -170, -120, -170, -120, -175)),
    upper=degrees((170, 120, 170, 120, 170, 120, 175)),
    max_velocity=degrees((85, 85, 100, 75, 130, 135, 135)),
    max_torque=(320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0),
    home=(0.0, 0.2, 0.0, -2.0, 0.0, math.pi / 2 - 2.2, 0.0),  # the wrist is bent: not singular
    pitch_joint=(5, 1.0),
    finger_axis=1,
    fingers=(),
    reach_centre=(0.60, 0.0, 0.60),
    tip_link="lbr_iiwa_link_7",
    joints=tuple(f"lbr_iiwa_joint_{i}" for i in range(1, 8)),
    yaw_share=0.5,
)
XARM6 = ArmModel(
    name="xarm6",
    title="UFACTORY xArm6",
    urdf="xarm/xarm6_robot.urdf",
    indices=tuple(range(1, 7)),
    tip=6,
    lower=degrees((-360, -118, -225, -360, -97, -360)),
    upper=degrees((360, 120, 11, 360, 180, 360)),
    max_velocity=degrees((180,) * 6),
    max_torque=(50.0, 50.0, 32.0, 32.0, 32.0, 20.0),
    home=(0.0, -0.35, -1.05, 0.0, 1.4 - math.pi / 2, 0.0),
    pitch_joint=(4, 1.0),
    finger_axis=-1,
    fingers=(),
    reach_centre=(0.45, 0.0, 0.45),
    tip_link="link6",
    joints=tuple(f"joint{i}" for i in range(1, 7)),
    yaw_share=1.0,  # with six joints, less than 1 takes the wrist through its singularity
)
ARMS = {arm.name: arm for arm in (PANDA, IIWA, XARM6)}  # the first is the default
