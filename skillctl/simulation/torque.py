"""A compliant arm: its joint torques make the hand a damper around the skill's velocity."""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.simulation.arm import COMMANDED_SHARE, ArmBody, LiveArm, Tracking
from skillctl.simulation.ik import Kinematics

TORQUE_PERIOD = 1e-3  # [s], of the fastest real arm controllers
DAMPING = 80.0  # [N s/m], of the hand against the velocity that the skill asks for
ROTATION_STIFFNESS, ROTATION_DAMPING = 60.0, 6.0  # [Nm/rad], [Nm s/rad]
POSTURE_STIFFNESS, POSTURE_DAMPING = 5.0, 2.0  # [Nm/rad], [Nm s/rad], where it does not move the hand
FOLLOWING_STIFFNESS, FOLLOWING_DAMPING = 20.0, 4.0  # the same of a posture that follows
FOLLOWED = 4  # periods between two postures that follow: about 1/240 s, as of stiff arms
# Of J Jᵀ, tuned by hand: below it J is damped, so that a stretched arm gets finite velocities and its posture
# pulls it back. With a third of it, an xArm6 that 80 N have folded over stays so; with three times as much,
# the posture moves a resting hand by some millimetres.
SINGULARITY = 3e-4


class TorqueArm(LiveArm):
    r"""An arm whose hand yields in proportion to a push, and then goes on with the skill's velocity.

        τ = Jᵀ [D (f − v); K e − D_r ω] + N [K_p (q₀ − q) − D_p q̇] + c(q, q̇)

    f is the velocity asked for, v and ω are the hand's, e is the rotation to the orientation wanted where the
    hand is (of a taught hand, D_r ω_f with the turning asked for takes the place of K e).
    N = 1 − Jᵀ (J Jᵀ)⁻¹ J, q₀ is the ready posture, c are gravity and Coriolis torques; each
    torque is cut to its limit. v, ω, q and q̇ are those at the *end* of the period, predicted with the arm's
    mass matrix: with those at its beginning, a wrist as light as an xArm's becomes unstable.

    After a push the hand does not return to its earlier path: it follows the skill's path from where it is.
    There is no integral term either, so a load that the arm is not told of (``load``) shifts the place where
    the hand comes to rest.

    Attributes:
        posture_follows: Whether q₀ is the posture that a stiff arm would have where the hand is, instead.

    References:
        Kronander and Billard, Passive interaction control with dynamical systems, IEEE Robotics and
        Automation Letters 1(1), 2016, for D (f − v), here with equal damping in all directions. The implicit
        step is ours.
    """

    period = TORQUE_PERIOD
    posture_follows: bool

    def __init__(self, body: ArmBody, joints: FloatArray, kinematics: Kinematics) -> None:
        """Args: body, which nothing else moves; joints at the start, (n,), [rad]; kinematics of a twin."""
        super().__init__(body, joints, kinematics)
        bullet, model = body.bullet, body.model
        self._posture = kinematics.home
        self.posture_follows, self._steps, self._stiff = False, 0, joints
        self._rows = 3 if kinematics.hand == "free" else 6
        self._damping = np.array([DAMPING] * 3 + [ROTATION_DAMPING] * 3)[: self._rows]
        turns = 0.0 if kinematics.hand == "taught" else ROTATION_STIFFNESS
        self._stiffness = np.array([0.0] * 3 + [turns] * 3)[: self._rows]
        self._columns = model.columns
        places = dict([*zip(model.indices, joints.tolist(), strict=True), *model.fingers])
        self._places = np.array([places[joint] for joint in sorted(places)])  # of all movable joints
        self._zeros = [0.0] * len(places)
        self._limits = np.array(model.max_torque)
        for joint in model.indices:
            # Real arms compensate the friction of their joints; Bullet's is explicit and shakes light joints.
            bullet.changeDynamics(body.body, joint, jointDamping=0.0)
        bullet.setJointMotorControlArray(  # by default a motor brakes its joint
            body.body, body.indices, bullet.VELOCITY_CONTROL, forces=[0.0] * model.n_joints
        )

    @property
    def tracking(self) -> Tracking:
        """The reference is the hand itself, as there is none under torque control."""
        return Tracking(self.place_now)

    def drive(self, velocity: FloatArray, push: FloatArray | None = None) -> float:
        """Let one period pass: see ``LiveArm``."""
        state = self.state
        held, slowed = POSTURE_STIFFNESS, POSTURE_DAMPING
        if self.posture_follows:
            held, slowed = FOLLOWING_STIFFNESS, FOLLOWING_DAMPING
            self._follow()
        self._places[self._columns] = state.joints
        jacobian = self.body.jacobian(self._places)[: self._rows]
        asked = np.zeros(self._rows)
        asked[: len(velocity)] = velocity
        square = jacobian @ jacobian.T
        regular = square @ square + SINGULARITY**2 * np.eye(self._rows)
        inverse = np.linalg.solve(regular, square @ jacobian).T  # of J, damped where it is nearly singular
        fastest = float((np.abs(inverse @ asked) / self._fastest).max())
        share = min(1.0, COMMANDED_SHARE / fastest) if fastest > 0 else 1.0
        wrench = self._damping * share * asked
        if self._stiffness.any():
            wrench[3:] = ROTATION_STIFFNESS * self._turn_wanted()
        free = np.eye(len(inverse)) - inverse @ jacobian
        spring = jacobian.T @ wrench + free @ (held * (self._posture - state.joints))
        stiffness = (jacobian.T * self._stiffness) @ jacobian + held * free
        damping = (jacobian.T * self._damping) @ jacobian + slowed * free
        carrying = self.load * jacobian[2]  # as gravity, not a part of what is predicted
        self._apply(self._implicit(spring, stiffness, damping) + carrying, push)
        return share

    def _follow(self) -> None:
        """Take as posture the joints that a stiff arm would have here, every few periods."""
        if self._steps % FOLLOWED == 0:
            self._stiff = self._posture = self.kinematics.follow(self.place_now, self._stiff).joints
        self._steps += 1

    def _implicit(self, spring: FloatArray, stiffness: FloatArray, damping: FloatArray) -> FloatArray:
        """Return the torques (n,) of springs and dampers as they will be at the end of the period.

        M (q̇₁ − q̇) / Δt = s − (Δt K + C) q̇₁ is solved for q̇₁; the torques are its right side.
        """
        body, period, velocities = self.body, self.period, self.state.velocities
        every = np.array(body.bullet.calculateMassMatrix(body.body, self._places.tolist()))
        masses = every[np.ix_(self._columns, self._columns)]
        resistance = damping + period * stiffness
        ahead = np.linalg.solve(masses + period * resistance, masses @ velocities + period * spring)
        return np.asarray(spring - resistance @ ahead)

    def _apply(self, torques: FloatArray, push: FloatArray | None) -> None:
        """Apply torques (n,) in addition to those that carry the arm, within the limits, for one period."""
        body, bullet = self.body.body, self.body.bullet
        velocities = np.zeros(len(self._places))
        velocities[self._columns] = self.state.velocities
        own = bullet.calculateInverseDynamics(body, self._places.tolist(), velocities.tolist(), self._zeros)
        limited = np.clip(torques + np.array(own)[self._columns], -self._limits, self._limits)
        bullet.setJointMotorControlArray(
            body, self.body.indices, bullet.TORQUE_CONTROL, forces=limited.tolist()
        )
        self._step(push, limited)

    def _turn_wanted(self) -> FloatArray:
        """Return the rotation to the orientation wanted here: its axis (3,) times 2 sin ½θ."""
        wanted = self.kinematics.orientation(self.state.hand)
        *axis, cosine = self.body.bullet.getDifferenceQuaternion(self.orientation, wanted)
        return np.array(axis) * (2.0 if cosine >= 0 else -2.0)
