"""The arms: what a data sheet says about each, and one body in a Bullet world of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import TracebackType

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.simulation.bullet import load_bullet

CONTROL_PERIOD = 1 / 240  # [s], also Bullet's step
POSITION_GAIN, VELOCITY_GAIN = 0.1, 1.0  # of Bullet's position motors; 0.03 to 0.6 track alike
LIMIT_MARGIN = 0.005  # [rad]: commands keep clear of the limits by more than the motors' lag
FINGER_FORCE = 20.0  # [N]


@dataclass(frozen=True, eq=False, slots=True)
class ArmModel:
    """A data sheet. All arrays have one entry per arm joint; fingers are not arm joints.

    Attributes:
        name: As on the command line.
        urdf: File of the ``pybullet_data`` package.
        tip: Link whose frame is "the hand": its z axis is the approach direction.
        lower, upper: Joint limits of the real arm, [rad] (the URDF's are wider).
        max_velocity, max_torque: Of the real arm, [rad/s] and [Nm].
        home: Ready posture for a hand pitched down by zero; the pitch is subtracted at ``pitch_joint``.
        pitch_joint: Joint that pitches the hand in the ready posture, with its sign.
        finger_axis: Sign of the hand's y axis against the horizontal in the natural branch (see ``ik``).
        fingers: Finger joints and how far they are held open, [m].
        reach_centre: Middle of the comfortable workspace in front of the arm, [m].
    """

    name: str
    urdf: str
    tip: int
    lower: FloatArray
    upper: FloatArray
    max_velocity: FloatArray
    max_torque: FloatArray
    home: FloatArray
    pitch_joint: tuple[int, float]
    finger_axis: int
    fingers: tuple[tuple[int, float], ...]
    reach_centre: tuple[float, float, float]

    @property
    def n_joints(self) -> int:
        """Number of arm joints."""
        return len(self.home)

    def home_joints(self, pitch: float) -> FloatArray:
        """Return the ready posture whose hand is pitched ``pitch`` [rad] below the horizontal."""
        joint, sign = self.pitch_joint
        joints = self.home.copy()
        joints[joint] += sign * pitch
        return joints


PANDA = ArmModel(
    name="panda",
    urdf="franka_panda/panda.urdf",
    tip=11,
    lower=np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]),
    upper=np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]),
    max_velocity=np.array([2.175] * 4 + [2.61] * 3),
    max_torque=np.array([87.0] * 4 + [12.0] * 3),
    home=np.array([0.0, -0.785, 0.0, -2.356, 0.0, math.pi, 0.785]),
    pitch_joint=(5, -1.0),
    finger_axis=-1,
    fingers=((9, 0.04), (10, 0.04)),
    reach_centre=(0.50, 0.0, 0.60),
)
# The model in pybullet_data has the link lengths of the LBR iiwa 14 R820 (0.36, 0.42, 0.40 m).
IIWA = ArmModel(
    name="iiwa",
    urdf="kuka_iiwa/model.urdf",
    tip=6,
    lower=-np.radians([170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 175.0]),
    upper=np.radians([170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 175.0]),
    max_velocity=np.radians([85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0]),
    max_torque=np.array([320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0]),
    home=np.array([0.0, 0.2, 0.0, -2.0, 0.0, math.pi / 2 - 2.2, 0.0]),  # the wrist is bent: not singular
    pitch_joint=(5, 1.0),
    finger_axis=1,
    fingers=(),
    reach_centre=(0.60, 0.0, 0.60),
)
ARMS = {arm.name: arm for arm in (PANDA, IIWA)}


class ArmBody:
    """One arm, fixed at the world's origin, alone in a DIRECT-mode Bullet world.

    Usable as a context manager; the world ends with it.
    """

    def __init__(self, model: ArmModel, base_yaw: float) -> None:
        """Args: model; base_yaw: how far the base is turned about the vertical, [rad]."""
        self.model = model
        self.bullet = load_bullet()
        import pybullet_data

        self.client = self.bullet.connect(self.bullet.DIRECT)
        self.body = self.bullet.loadURDF(
            f"{pybullet_data.getDataPath()}/{model.urdf}",
            baseOrientation=(0.0, 0.0, math.sin(base_yaw / 2), math.cos(base_yaw / 2)),
            useFixedBase=True,
            flags=self.bullet.URDF_ENABLE_CACHED_GRAPHICS_SHAPES,
            physicsClientId=self.client,
        )
        for joint, opening in model.fingers:
            self.bullet.resetJointState(self.body, joint, opening, physicsClientId=self.client)

    def __enter__(self) -> ArmBody:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.bullet.disconnect(self.client)

    def pose(self, joints: FloatArray) -> None:
        """Put the arm's joints (n,) at these angles [rad], at rest."""
        self.bullet.resetJointStatesMultiDof(
            self.body,
            list(range(self.model.n_joints)),
            [[angle] for angle in joints.tolist()],
            physicsClientId=self.client,
        )

    def hand(self) -> tuple[FloatArray, tuple[float, float, float, float]]:
        """Return the hand's position (3,) [m] and orientation q_xyzw, both in the world."""
        state = self.bullet.getLinkState(
            self.body, self.model.tip, computeForwardKinematics=1, physicsClientId=self.client
        )
        return np.array(state[4]), state[5]

    def links(self) -> FloatArray:
        """Return the positions of all link frames, shape (m, 3), [m]."""
        count = self.bullet.getNumJoints(self.body, physicsClientId=self.client)
        states = self.bullet.getLinkStates(
            self.body, list(range(count)), computeForwardKinematics=1, physicsClientId=self.client
        )
        return np.array([state[4] for state in states])


@dataclass(frozen=True, eq=False, slots=True)
class ArmState:
    """What the arm's sensors say: hand position (3,) [m]; joints [rad], velocities [rad/s], torques [Nm]."""

    hand: FloatArray
    joints: FloatArray
    velocities: FloatArray
    torques: FloatArray


class DrivenArm:
    """An arm with position motors, gravity and time; torques never exceed the real arm's."""

    def __init__(self, body: ArmBody, joints: FloatArray) -> None:
        """Args: body, used by nobody else; joints: where it starts, at rest. Shape (n,), [rad]."""
        self._body = body
        self._indices = list(range(body.model.n_joints))
        bullet, client = body.bullet, body.client
        bullet.setGravity(0.0, 0.0, -9.81, physicsClientId=client)
        bullet.setTimeStep(CONTROL_PERIOD, physicsClientId=client)
        bullet.setPhysicsEngineParameter(deterministicOverlappingPairs=1, physicsClientId=client)
        body.pose(joints)
        for joint, opening in body.model.fingers:
            bullet.setJointMotorControl2(
                body.body,
                joint,
                bullet.POSITION_CONTROL,
                targetPosition=opening,
                force=FINGER_FORCE,
                physicsClientId=client,
            )

    def state(self) -> ArmState:
        """Return the measured state."""
        body = self._body
        joints = body.bullet.getJointStates(body.body, self._indices, physicsClientId=body.client)
        hand, _ = body.hand()
        return ArmState(hand, *(np.array([joint[field] for joint in joints]) for field in (0, 1, 3)))

    def drive(self, joints: FloatArray, goal: FloatArray) -> None:
        """Move from ``joints`` (n,), where the motors should be by now, to ``goal`` (n,) in one period.

        A position motor adds its correction to the velocity it is told. Corrected towards the goal it
        would run ahead by one period; corrected towards where it should be now, it arrives in time.
        """
        body = self._body
        n = len(self._indices)
        body.bullet.setJointMotorControlArray(
            body.body,
            self._indices,
            body.bullet.POSITION_CONTROL,
            targetPositions=joints.tolist(),
            targetVelocities=((goal - joints) / CONTROL_PERIOD).tolist(),
            forces=body.model.max_torque.tolist(),
            positionGains=[POSITION_GAIN] * n,
            velocityGains=[VELOCITY_GAIN] * n,
            physicsClientId=body.client,
        )
        body.bullet.stepSimulation(physicsClientId=body.client)
