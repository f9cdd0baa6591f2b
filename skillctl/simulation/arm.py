"""The arms: what a data sheet says about each, and one body in a Bullet world of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Literal, TypeAlias

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.simulation.bullet import load_bullet

CONTROL_PERIOD = 1 / 240  # [s], also Bullet's step
POSITION_GAIN, VELOCITY_GAIN = 0.1, 1.0  # of Bullet's position motors; 0.03 to 0.6 track alike
LIMIT_MARGIN = 0.005  # [rad]: commands keep clear of the limits by more than the motors' lag
STOP_MARGIN = 1e-6  # [rad]: a stopped joint is within its limit, whatever is rounded
FINGER_FORCE = 20.0  # [N]

Shapes: TypeAlias = Literal["all", "collision", "none"]


@dataclass(frozen=True, eq=False, slots=True)
class ArmModel:
    """A data sheet. All arrays have one entry per arm joint; fingers are not arm joints.

    A sliding joint counts in [m], [m/s] and [N] where a turning one counts in [rad], [rad/s] and [Nm].

    Attributes:
        name: As on the command line.
        urdf: File of the ``pybullet_data`` package, or an absolute path.
        indices: Bullet's numbers of the arm's joints, from the base to the hand.
        tip: Link whose frame is "the hand": its z axis is the approach direction.
        lower, upper: Joint limits of the real arm, [rad] (the URDF's are wider).
        max_velocity, max_torque: Of the real arm, [rad/s] and [Nm].
        home: Ready posture for a hand pitched down by zero; the pitch is subtracted at ``pitch_joint``.
        pitch_joint: Joint that pitches the hand in the ready posture, with its sign; None if that is unknown.
        finger_axis: Sign of the hand's y axis against the horizontal in the natural branch (see ``ik``).
        fingers: Finger joints and how far they are held open, [m].
        reach_centre: Middle of the comfortable workspace in front of the arm, [m].
        yaw_share: How far the hand turns towards the azimuth of its place: 0 straight ahead, 1 radially.
        held: Joints that neither carry the hand nor are fingers of a known gripper, and where they are held.
    """

    name: str
    urdf: str
    indices: tuple[int, ...]
    tip: int
    lower: FloatArray
    upper: FloatArray
    max_velocity: FloatArray
    max_torque: FloatArray
    home: FloatArray
    pitch_joint: tuple[int, float] | None
    finger_axis: int
    fingers: tuple[tuple[int, float], ...]
    reach_centre: tuple[float, float, float]
    yaw_share: float
    held: tuple[tuple[int, float], ...] = ()

    @property
    def n_joints(self) -> int:
        """Number of arm joints."""
        return len(self.home)

    @property
    def path(self) -> Path:
        """Where the URDF file lies."""
        import pybullet_data

        return Path(pybullet_data.getDataPath()) / self.urdf

    @property
    def others(self) -> tuple[tuple[int, float], ...]:
        """All joints that are not the arm's, and where they are held."""
        return self.fingers + self.held

    @property
    def columns(self) -> list[int]:
        """Places of the arm's joints among all movable joints, the order in which Bullet lists those."""
        movable = sorted([*self.indices, *(joint for joint, _ in self.others)])
        return [movable.index(joint) for joint in self.indices]

    def home_joints(self, pitch: float) -> FloatArray:
        """Return the ready posture whose hand is pitched ``pitch`` [rad] below the horizontal."""
        joints = self.home.copy()
        if self.pitch_joint is not None:
            joint, sign = self.pitch_joint
            joints[joint] += sign * pitch
        return joints


PANDA = ArmModel(
    name="panda",
    urdf="franka_panda/panda.urdf",
    indices=tuple(range(7)),
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
    yaw_share=0.5,  # at a shelf: with 0 the elbow, with 1 the forearm comes near the boards or a wall
)
# The model in pybullet_data has the link lengths of the LBR iiwa 14 R820 (0.36, 0.42, 0.40 m).
IIWA = ArmModel(
    name="iiwa",
    urdf="kuka_iiwa/model.urdf",
    indices=tuple(range(7)),
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
    yaw_share=0.5,
)
XARM6 = ArmModel(
    name="xarm6",
    urdf="xarm/xarm6_robot.urdf",
    indices=tuple(range(1, 7)),
    tip=6,
    lower=np.radians([-360.0, -118.0, -225.0, -360.0, -97.0, -360.0]),
    upper=np.radians([360.0, 120.0, 11.0, 360.0, 180.0, 360.0]),
    max_velocity=np.radians([180.0] * 6),
    max_torque=np.array([50.0, 50.0, 32.0, 32.0, 32.0, 20.0]),
    home=np.array([0.0, -0.35, -1.05, 0.0, 1.4 - math.pi / 2, 0.0]),
    pitch_joint=(4, 1.0),
    finger_axis=-1,
    fingers=(),
    reach_centre=(0.45, 0.0, 0.45),
    yaw_share=1.0,  # with six joints anything less turns the wrist through its singularity
)
ARMS = {arm.name: arm for arm in (PANDA, IIWA, XARM6)}


class ArmBody:
    """One arm, fixed at the world's origin, alone in a Bullet world of its own.

    Usable as a context manager; the world ends with it.
    """

    def __init__(
        self, model: ArmModel, base_yaw: float, *, shapes: Shapes = "all", gui: bool = False
    ) -> None:
        """Make the world.

        Args:
            model: The arm.
            base_yaw: How far the base is turned about the vertical, [rad].
            shapes: What of the arm can be seen and touched: ``all``, ``collision`` (Bullet computes inertias
                from these), or ``none``, which loads thirty times as fast and is enough for kinematics.
            gui: Show the world in a window (see ``gui``).
        """
        self.model = model
        self.bullet = bullet = load_bullet()
        self.client = bullet.connect(bullet.GUI if gui else bullet.DIRECT)
        flags = {
            "all": bullet.URDF_ENABLE_CACHED_GRAPHICS_SHAPES,
            "collision": bullet.URDF_IGNORE_VISUAL_SHAPES,
            "none": bullet.URDF_IGNORE_VISUAL_SHAPES | bullet.URDF_IGNORE_COLLISION_SHAPES,
        }
        self.body = bullet.loadURDF(
            str(model.path),
            baseOrientation=(0.0, 0.0, math.sin(base_yaw / 2), math.cos(base_yaw / 2)),
            useFixedBase=True,
            flags=flags[shapes],
            physicsClientId=self.client,
        )
        self._indices = list(model.indices)
        for joint, place in model.others:
            bullet.resetJointState(self.body, joint, place, physicsClientId=self.client)

    def __enter__(self) -> ArmBody:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.bullet.disconnect(self.client)

    def pose(self, joints: FloatArray) -> None:
        """Put the arm's joints (n,) at these angles [rad], at rest."""
        self.bullet.resetJointStatesMultiDof(
            self.body, self._indices, [[angle] for angle in joints.tolist()], physicsClientId=self.client
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


class LiveArm:
    """An arm under gravity, in time, within the limits of the real one. What drives it is its subclasses'.

    Bullet knows nothing of a joint's velocity limit and lets a hard push carry it past a position limit. So
    after each step a joint that is too fast is held to its largest velocity, and one beyond its limit stands
    at it: what the drives and the stops of a real arm do, whatever their strength.

    Attributes:
        period: Time that one step takes, [s].
        push: Force at the hand, [N] in the world, shape (3,), in every step until it is set to None.
        orientation: The hand's, q_xyzw in the world.
    """

    def __init__(self, body: ArmBody, joints: FloatArray, period: float) -> None:
        """Args: body, moved by nobody else; joints: where it starts, at rest, (n,), [rad]; period, [s]."""
        self.body = body
        self.period = period
        self.push: FloatArray | None = None
        self.orientation = (0.0, 0.0, 0.0, 1.0)
        self._indices = list(body.model.indices)
        self._lowest, self._highest = body.model.lower + STOP_MARGIN, body.model.upper - STOP_MARGIN
        bullet, client = body.bullet, body.client
        bullet.setGravity(0.0, 0.0, -9.81, physicsClientId=client)
        bullet.setTimeStep(period, physicsClientId=client)
        bullet.setPhysicsEngineParameter(deterministicOverlappingPairs=1, physicsClientId=client)
        body.pose(joints)
        for joint, place in body.model.others:
            bullet.setJointMotorControl2(
                body.body,
                joint,
                bullet.POSITION_CONTROL,
                targetPosition=place,
                force=FINGER_FORCE,
                physicsClientId=client,
            )
        self._state = self._measured()

    def state(self) -> ArmState:
        """Return the measured state."""
        return self._state

    def place(self, joints: FloatArray) -> None:
        """Put the joints at these angles (n,) [rad] at once, at rest; no time passes."""
        self.body.pose(joints)
        self._state = self._measured()

    def step(self, torques: FloatArray | None = None) -> None:
        """Let one period pass; ``torques`` (n,) [Nm] drive the joints, if Bullet's motors do not."""
        body = self.body
        if self.push is not None:  # Bullet forgets a force after each step
            body.bullet.applyExternalForce(
                body.body,
                body.model.tip,
                self.push.tolist(),
                self._state.hand.tolist(),
                body.bullet.WORLD_FRAME,
                physicsClientId=body.client,
            )
        body.bullet.stepSimulation(physicsClientId=body.client)
        self._state = self._measured(torques)
        if self._stopped():
            self._state = self._measured(self._state.torques)

    def _measured(self, torques: FloatArray | None = None) -> ArmState:
        body = self.body
        joints = body.bullet.getJointStates(body.body, self._indices, physicsClientId=body.client)
        angles, velocities, _, measured = zip(*joints, strict=True)
        hand, self.orientation = body.hand()
        return ArmState(
            hand,
            np.array(angles),
            np.array(velocities),
            np.array(measured) if torques is None else torques,
        )

    def _stopped(self) -> bool:
        """Put joints that have passed a limit back to it; whether there were any."""
        state, model = self._state, self.body.model
        beyond = (state.joints < self._lowest) | (state.joints > self._highest)
        too_fast = np.abs(state.velocities) > model.max_velocity
        stopped = beyond | too_fast
        if not stopped.any():
            return False
        joints = np.clip(state.joints, self._lowest, self._highest)
        velocities = np.clip(state.velocities, -model.max_velocity, model.max_velocity)
        velocities[beyond] = 0.0
        for i in np.flatnonzero(stopped).tolist():
            self.body.bullet.resetJointState(
                self.body.body, self._indices[i], joints[i], velocities[i], physicsClientId=self.body.client
            )
        return True


class DrivenArm(LiveArm):
    """An arm with position motors; torques never exceed the real arm's.

    A position motor is a velocity constraint: a push of 40 to 60 N moves nothing at all, and one that is too
    strong for a joint's torque carries the arm away. Only ``TorqueArm`` yields in proportion.
    """

    def __init__(self, body: ArmBody, joints: FloatArray) -> None:
        """Args: body, moved by nobody else; joints: where it starts, at rest. Shape (n,), [rad]."""
        super().__init__(body, joints, CONTROL_PERIOD)
        n = body.model.n_joints
        self._forces = body.model.max_torque.tolist()
        self._gains = {"positionGains": [POSITION_GAIN] * n, "velocityGains": [VELOCITY_GAIN] * n}

    def drive(self, joints: FloatArray, goal: FloatArray) -> None:
        """Move from ``joints`` (n,), where the motors should be by now, to ``goal`` (n,) in one period.

        A position motor adds its correction to the velocity it is told. Corrected towards the goal it
        would run ahead by one period; corrected towards where it should be now, it arrives in time.
        """
        body = self.body
        body.bullet.setJointMotorControlArray(
            body.body,
            self._indices,
            body.bullet.POSITION_CONTROL,
            targetPositions=joints.tolist(),
            targetVelocities=((goal - joints) / CONTROL_PERIOD).tolist(),
            forces=self._forces,
            physicsClientId=body.client,
            **self._gains,
        )
        self.step()
