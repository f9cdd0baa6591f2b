"""One arm in a Bullet world of its own, and the interface through which an episode moves it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from tempfile import NamedTemporaryFile
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple, TypeAlias, TypeVar

import numpy as np

from skillctl.arrays import BoolArray, FloatArray
from skillctl.simulation.arms import ArmModel
from skillctl.simulation.bullet import World

if TYPE_CHECKING:
    from skillctl.simulation.ik import Kinematics

CONTROL_PERIOD = 1 / 240  # [s], also Bullet's step
LIMIT_MARGIN = 0.005  # [rad], between commands and limits: more than the lag of the motors
STOP_MARGIN = 1e-6  # [rad]: keeps a stopped joint within its limit in spite of rounding
FINGER_FORCE = 20.0  # [N]
COMMANDED_SHARE = 0.95  # of the largest joint velocity, because motors and torques overshoot a little

Shapes: TypeAlias = Literal["all", "collision", "none"]
Body = TypeVar("Body", bound="ArmBody")
Quaternion: TypeAlias = tuple[float, float, float, float]  # q_xyzw


@contextmanager
def described(text: str) -> Iterator[str]:
    """Yield the name of a file with this text, which Bullet can read within the block."""
    with NamedTemporaryFile("w", suffix=".urdf", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        yield file.name


class ArmBody:
    """One arm, fixed at the origin of a Bullet world of its own.

    As a context manager it closes the world at the end.

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
            base_yaw: Turn of the base about the vertical, [rad].
            shapes: Shapes of the arm that are loaded: ``all``, ``collision`` (from which Bullet computes the
                inertias of a built-in arm; an arm by path has those of its file), or ``none``, which loads
                thirty times as fast and is enough for kinematics.
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
        placed = {"baseOrientation": turn, "useFixedBase": True}
        if model.text:
            own = bullet.URDF_USE_INERTIA_FROM_FILE
            with described(model.text) as file:
                self.body = int(bullet.loadURDF(file, flags=flags[shapes] | own, **placed))
        else:
            self.body = int(bullet.loadURDF(str(model.path), flags=flags[shapes], **placed))
        bullet.setGravity(0.0, 0.0, -9.81)
        self.indices = list(model.indices)
        for joint, place in model.fingers:
            bullet.resetJointState(self.body, joint, place)
        inertial = bullet.getLinkState(self.body, model.tip)[2:4]
        self._tip = bullet.invertTransform(*inertial)[0]  # Bullet measures from the link's centre of mass

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

    def carrying(self, joints: FloatArray) -> FloatArray:
        """Return the torques (n,) [Nm] that carry the arm at rest at joints (n,) [rad]."""
        places = np.zeros(len(self.model.columns) + len(self.model.fingers))
        places[self.model.columns] = joints
        rest = [0.0] * len(places)
        torques = self.bullet.calculateInverseDynamics(self.body, places.tolist(), rest, rest)
        return np.array(torques)[self.model.columns]

    def jacobian(self, places: FloatArray) -> FloatArray:
        """Return the hand's Jacobian (6, n), for the places of all movable joints, fingers included."""
        rest = [0.0] * len(places)
        linear, angular = self.bullet.calculateJacobian(
            self.body, self.model.tip, self._tip, places.tolist(), rest, rest
        )
        return np.array(linear + angular)[:, self.model.columns]

    def manipulability(self, joints: FloatArray) -> float:
        """Return the product of the singular values of the hand's Jacobian J at joints (n,) [rad].

        It is Yoshikawa's √det(J Jᵀ) for six joints or more, and zero where the hand cannot move in some
        direction. Metres and radians meet in it, so it compares postures of one arm, not arms.
        """
        places = np.zeros(len(self.model.columns) + len(self.model.fingers))
        places[self.model.columns] = joints
        return float(np.linalg.svd(self.jacobian(places), compute_uv=False).prod())

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
    """Measurements of an arm: hand position (3,) [m]; joints [rad], velocities [rad/s], torques [Nm]."""

    hand: FloatArray
    joints: FloatArray
    velocities: FloatArray
    torques: FloatArray


class Tracking(NamedTuple):
    """How well the arm can follow the commands.

    Attributes:
        reference: Where the hand should be now, a place (see ``Kinematics``).
        residual: Error of inverse kinematics at the last step, [m].
        refusals: Number of steps in a row, up to the last, without a solution.
        at_limit: Joint, from 0, that was at its limit at the last of these; None if none was.
    """

    reference: FloatArray
    residual: float = 0.0
    refusals: int = 0
    at_limit: int | None = None


class LiveArm(ABC):
    """An arm under gravity, within the limits of the real one, commanded once a period.

    Bullet has no velocity limit for a joint, and a hard push carries a joint past its position limit. So
    after each step a joint that is too fast gets its largest velocity, and a joint beyond its limit is
    stopped there, as the drives and the stops of a real arm do.

    Attributes:
        period: Time between two commands, which is one step of Bullet, [s].
        kinematics: Of a twin of the arm.
        state: Measured after the last period.
        orientation: Orientation of the hand then, q_xyzw in the world.
        load: Weight of what the hand is known to carry, [N]; position motors hold it anyway.
    """

    period: ClassVar[float]

    def __init__(self, body: ArmBody, joints: FloatArray, kinematics: Kinematics) -> None:
        """Args: body, which nothing else moves; joints at the start, (n,), [rad], at rest; kinematics."""
        self.body, self.kinematics = body, kinematics
        self.orientation: Quaternion = (0.0, 0.0, 0.0, 1.0)
        self.load = 0.0
        self._lowest = np.array(body.model.lower) + STOP_MARGIN
        self._highest = np.array(body.model.upper) - STOP_MARGIN
        self._fastest = np.array(body.model.max_velocity)
        bullet = body.bullet
        bullet.setTimeStep(self.period)
        bullet.setPhysicsEngineParameter(deterministicOverlappingPairs=1)
        for joint, place in body.model.fingers:
            bullet.setJointMotorControl2(
                body.body, joint, bullet.POSITION_CONTROL, targetPosition=place, force=FINGER_FORCE
            )
        self.place(joints)

    @property
    def place_now(self) -> FloatArray:
        """Where the skill takes the arm to be: the place of its hand (see ``Kinematics``)."""
        return self.kinematics.place(self.state.hand, self.orientation)

    @property
    @abstractmethod
    def tracking(self) -> Tracking:
        """How well the arm follows."""

    @abstractmethod
    def drive(self, velocity: FloatArray, push: FloatArray | None = None) -> float:
        """Let one period pass, in which the hand should move with a velocity.

        Args:
            velocity: Velocity asked of the hand, shape (3,), [m/s]; of a taught hand the twist, shape (6,).
            push: Force on the hand during the period, shape (3,), [N].

        Returns:
            The share of the velocity that the joints' limits allowed.
        """

    def place(self, joints: FloatArray) -> None:
        """Put the joints at these angles (n,) [rad], at rest; no time passes."""
        self.body.pose(joints)
        self.state = self._measured()

    def _step(self, push: FloatArray | None, torques: FloatArray | None = None) -> None:
        """Let one period pass; ``torques`` (n,) [Nm] are those applied, if Bullet's motors are off."""
        body, bullet = self.body, self.body.bullet
        if push is not None:  # which Bullet clears after each step
            place = self.state.hand.tolist()
            bullet.applyExternalForce(body.body, body.model.tip, push.tolist(), place, bullet.WORLD_FRAME)
        bullet.stepSimulation()
        self.state = state = self._measured(torques)
        beyond = (state.joints < self._lowest) | (state.joints > self._highest)
        stopped = beyond | (np.abs(state.velocities) > self._fastest)
        if stopped.any():
            self._stop(beyond, stopped)
            self.state = self._measured(state.torques)

    def _measured(self, torques: FloatArray | None = None) -> ArmState:
        joints = self.body.bullet.getJointStates(self.body.body, self.body.indices)
        angles, velocities, _, measured = zip(*joints, strict=True)
        hand, self.orientation = self.body.hand()
        felt = np.array(measured) if torques is None else torques
        return ArmState(hand, np.array(angles), np.array(velocities), felt)

    def _stop(self, beyond: BoolArray, stopped: BoolArray) -> None:
        """Put joints ``beyond`` their limit (n,) back to it, and hold all that are ``stopped`` (n,)."""
        joints = np.clip(self.state.joints, self._lowest, self._highest)
        velocities = np.clip(self.state.velocities, -self._fastest, self._fastest)
        velocities[beyond] = 0.0
        for i in np.flatnonzero(stopped).tolist():
            self.body.bullet.resetJointState(self.body.body, self.body.indices[i], joints[i], velocities[i])
