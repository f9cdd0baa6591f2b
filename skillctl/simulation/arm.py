"""One arm in a Bullet world of its own, and the one interface through which an episode moves it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple, TypeAlias, TypeVar

import numpy as np

from skillctl.arrays import BoolArray, FloatArray
from skillctl.simulation.arms import ArmModel
from skillctl.simulation.bullet import World

CONTROL_PERIOD = 1 / 240  # [s], also Bullet's step
LIMIT_MARGIN = 0.005  # [rad]: commands keep clear of the limits by more than the motors' lag
STOP_MARGIN = 1e-6  # [rad]: a stopped joint is within its limit, whatever is rounded
FINGER_FORCE = 20.0  # [N]
COMMANDED_SHARE = 0.95  # of the real arm's joint velocity: motors and torques overshoot a little

Shapes: TypeAlias = Literal["all", "collision", "none"]
Body = TypeVar("Body", bound="ArmBody")
Quaternion: TypeAlias = tuple[float, float, float, float]  # q_xyzw


class ArmBody:
    """One arm, fixed at the world's origin, alone in a Bullet world of its own.

    Usable as a context manager; the world ends with it.

    Attributes:
        bullet: The world.
        body: Bullet's number of the arm.
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
        self.bullet = bullet = World(gui=gui)
        flags = {
            "all": bullet.URDF_ENABLE_CACHED_GRAPHICS_SHAPES,
            "collision": bullet.URDF_IGNORE_VISUAL_SHAPES,
            "none": bullet.URDF_IGNORE_VISUAL_SHAPES | bullet.URDF_IGNORE_COLLISION_SHAPES,
        }
        turn = (0.0, 0.0, math.sin(base_yaw / 2), math.cos(base_yaw / 2))
        self.body: int = bullet.loadURDF(
            str(model.path), baseOrientation=turn, useFixedBase=True, flags=flags[shapes]
        )
        self.indices = list(model.indices)
        for joint, place in model.others:
            bullet.resetJointState(self.body, joint, place)

    def __enter__(self: Body) -> Body:
        return self

    def __exit__(self, *_: object) -> None:
        self.bullet.disconnect()

    def pose(self, joints: FloatArray) -> None:
        """Put the arm's joints (n,) at these angles [rad], at rest."""
        self.bullet.resetJointStatesMultiDof(self.body, self.indices, [[angle] for angle in joints.tolist()])

    def hand(self) -> tuple[FloatArray, Quaternion]:
        """Return the hand's position (3,) [m] and orientation q_xyzw, both in the world."""
        state = self.bullet.getLinkState(self.body, self.model.tip, computeForwardKinematics=1)
        return np.array(state[4]), state[5]

    def link_names(self) -> list[str]:
        """Return the names of all links but the base, in Bullet's order."""
        count = self.bullet.getNumJoints(self.body)
        return [self.bullet.getJointInfo(self.body, joint)[12].decode() for joint in range(count)]

    def links(self) -> FloatArray:
        """Return the positions of all link frames, shape (m, 3), [m]."""
        count = self.bullet.getNumJoints(self.body)
        states = self.bullet.getLinkStates(self.body, list(range(count)), computeForwardKinematics=1)
        return np.array([state[4] for state in states])


@dataclass(frozen=True, eq=False, slots=True)
class ArmState:
    """What the arm's sensors say: hand position (3,) [m]; joints [rad], velocities [rad/s], torques [Nm]."""

    hand: FloatArray
    joints: FloatArray
    velocities: FloatArray
    torques: FloatArray


class Tracking(NamedTuple):
    """How well the arm can do what it was told.

    Attributes:
        reference: Where the hand should be by now, shape (3,), [m].
        residual: How far inverse kinematics missed the reference at the last step, [m].
        refusals: Steps in a row, up to the last, for which there were no joints.
        at_limit: Joint, from 0, that was at its limit when that last happened; None if none was.
    """

    reference: FloatArray
    residual: float = 0.0
    refusals: int = 0
    at_limit: int | None = None


class LiveArm(ABC):
    """An arm under gravity, in time, within the limits of the real one, told once a period how to move.

    Bullet knows nothing of a joint's velocity limit and lets a hard push carry it past a position limit. So
    after each step a joint that is too fast is held to its largest velocity, and one beyond its limit stands
    at it: what the drives and the stops of a real arm do, whatever their strength.

    Attributes:
        period: Time between two commands, which is one step of Bullet, [s].
        orientation: The hand's, q_xyzw in the world.
    """

    period: ClassVar[float]

    def __init__(self, body: ArmBody, joints: FloatArray) -> None:
        """Args: body, moved by nobody else; joints: where it starts, at rest, (n,), [rad]."""
        self.body = body
        self.orientation: Quaternion = (0.0, 0.0, 0.0, 1.0)
        self._lowest = np.array(body.model.lower) + STOP_MARGIN
        self._highest = np.array(body.model.upper) - STOP_MARGIN
        self._fastest = np.array(body.model.max_velocity)
        bullet = body.bullet
        bullet.setGravity(0.0, 0.0, -9.81)
        bullet.setTimeStep(self.period)
        bullet.setPhysicsEngineParameter(deterministicOverlappingPairs=1)
        for joint, place in body.model.others:
            bullet.setJointMotorControl2(
                body.body, joint, bullet.POSITION_CONTROL, targetPosition=place, force=FINGER_FORCE
            )
        self.place(joints)

    @property
    @abstractmethod
    def tracking(self) -> Tracking:
        """How well the arm follows."""

    @abstractmethod
    def drive(self, velocity: FloatArray, push: FloatArray | None = None) -> float:
        """Let one period pass, in which the hand shall move with ``velocity`` (3,) [m/s].

        Args:
            velocity: Of the hand.
            push: Force on the hand all through the period, shape (3,), [N].

        Returns:
            The share of the velocity that the joints' limits allowed.
        """

    def state(self) -> ArmState:
        """Return the measured state."""
        return self._state

    def place(self, joints: FloatArray) -> None:
        """Put the joints at these angles (n,) [rad] at once, at rest; no time passes."""
        self.body.pose(joints)
        self._state = self._measured()

    def _step(self, push: FloatArray | None, torques: FloatArray | None = None) -> None:
        """Let one period pass; ``torques`` (n,) [Nm] drive the joints, if Bullet's motors do not."""
        body, bullet = self.body, self.body.bullet
        if push is not None:  # Bullet forgets a force after each step
            place = self._state.hand.tolist()
            bullet.applyExternalForce(body.body, body.model.tip, push.tolist(), place, bullet.WORLD_FRAME)
        bullet.stepSimulation()
        self._state = state = self._measured(torques)
        beyond = (state.joints < self._lowest) | (state.joints > self._highest)
        stopped = beyond | (np.abs(state.velocities) > self._fastest)
        if stopped.any():
            self._stop(beyond, stopped)
            self._state = self._measured(state.torques)

    def _measured(self, torques: FloatArray | None = None) -> ArmState:
        joints = self.body.bullet.getJointStates(self.body.body, self.body.indices)
        angles, velocities, _, measured = zip(*joints, strict=True)
        hand, self.orientation = self.body.hand()
        felt = np.array(measured) if torques is None else torques
        return ArmState(hand, np.array(angles), np.array(velocities), felt)

    def _stop(self, beyond: BoolArray, stopped: BoolArray) -> None:
        """Put joints ``beyond`` their limit (n,) back to it, and hold all that are ``stopped`` (n,)."""
        joints = np.clip(self._state.joints, self._lowest, self._highest)
        velocities = np.clip(self._state.velocities, -self._fastest, self._fastest)
        velocities[beyond] = 0.0
        for i in np.flatnonzero(stopped).tolist():
            self.body.bullet.resetJointState(self.body.body, self.body.indices[i], joints[i], velocities[i])
