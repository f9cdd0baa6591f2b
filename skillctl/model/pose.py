"""The space of poses: where a hand is, and how it is turned."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt

from skillctl import rotations
from skillctl.arrays import LARGEST, FloatArray, require_positive
from skillctl.errors import StateError
from skillctl.model.space import AXIS_NAMES, Place, Space, numbers

POSE_NAMES = (*AXIS_NAMES, "rx", "ry", "rz")
MEDIAN_STEPS, SAME = 20, 1e-6  # of the median of orientations; [rad], angles count as no less
SEAM = 0.2  # [rad] past half a turn from the target up to which a controller keeps the side it was on


@dataclass(frozen=True, slots=True)
class Pose(Space):
    """R³ × SO(3): where a hand is, and how it is turned. See ``Space`` for the attributes.

    A state is (x, y, z, rx, ry, rz): the position [m], and the rotation vector [rad] of the rotation R that
    takes coordinates of the hand to those of the frame. A velocity is a twist in that frame: (v [m/s],
    ω [rad/s]). With ℓ = ``length``, offsets from a target (p*, R*) are (p − p*, ℓ log(R*ᵀR)), in metres: six
    numbers that a mixture can move, since both blocks contract by themselves.

    Attributes:
        length: ℓ > 0, [m/rad]: how far apart in metres counts as far as one radian.
    """

    names: tuple[str, ...] = POSE_NAMES
    unit: Literal["m"] = "m"
    frame: str = "base"
    length: float = 1.0
    kind: Literal["pose"] = "pose"
    flat: ClassVar[bool] = False

    def __post_init__(self) -> None:
        require_positive("length", self.length)
        if len(self.names) != len(POSE_NAMES):
            raise StateError(f"names: a pose has {len(POSE_NAMES)} coordinates, got {len(self.names)}.")

    @property
    def blocks(self) -> tuple[int, ...]:
        """Position and orientation."""
        return (3, 3)

    @property
    def positions(self) -> int:
        """Three."""
        return 3

    @property
    def units(self) -> tuple[str, ...]:
        """Metres, and radians of the rotation vector."""
        return ("m", "m", "m", "rad", "rad", "rad")

    @property
    def sizes(self) -> tuple[int, ...]:
        """Position, with a rotation vector, or with a quaternion."""
        return (3, 6, 7)

    def difference(self, to: FloatArray, start: FloatArray) -> FloatArray:
        """Return (p_to − p_start, log(R_to R_startᵀ)), a twist times a duration. Shape (..., 6)."""
        turn = rotations.product(
            rotations.quaternions(to[..., 3:]), rotations.inverse(rotations.quaternions(start[..., 3:]))
        )
        return np.concatenate([to[..., :3] - start[..., :3], rotations.vectors(turn)], axis=-1)

    def displace(self, states: FloatArray, differences: FloatArray) -> FloatArray:
        """Return (p + Δp, exp(Δr) R). Shape (..., 6)."""
        turned = rotations.product(
            rotations.quaternions(differences[..., 3:]), rotations.quaternions(states[..., 3:])
        )
        moved = states[..., :3] + differences[..., :3]
        return np.concatenate([moved, rotations.vectors(turned)], axis=-1)

    def anchor(self, target: FloatArray) -> FloatArray:
        """Return (p*, 0, 0, 0)."""
        return np.array([*target[:3].tolist(), 0.0, 0.0, 0.0])

    def offsets(self, states: FloatArray, target: FloatArray) -> FloatArray:
        """Return (p − p*, ℓ log(R*ᵀR)). Shape (..., 6)."""
        turn = rotations.product(
            rotations.inverse(rotations.quaternions(target[..., 3:])), rotations.quaternions(states[..., 3:])
        )
        moved = states[..., :3] - target[..., :3]
        return np.concatenate([moved, self.length * rotations.vectors(turn)], axis=-1)

    def placed(self, offsets: FloatArray, target: FloatArray) -> FloatArray:
        """Return (p* + x, R* exp(r / ℓ)) at offsets (x, r). Shape (..., 6)."""
        turned = rotations.product(
            rotations.quaternions(target[..., 3:]), rotations.quaternions(offsets[..., 3:] / self.length)
        )
        moved = target[..., :3] + offsets[..., :3]
        return np.concatenate([moved, rotations.vectors(turned)], axis=-1)

    def carried(
        self, states: FloatArray, target: FloatArray, goal: FloatArray, *, turn: bool = False
    ) -> FloatArray:
        """Return states (..., 6) moved with a target (6,) to a goal (6,); see ``Space``."""
        moved = Space.carried(self, states, target, goal)
        if turn:
            base = rotations.product(
                rotations.quaternions(goal[3:]), rotations.inverse(rotations.quaternions(target[3:]))
            )
            moved[..., :3] = goal[:3] + rotations.turned(moved[..., :3] - goal[:3], base)
        return moved

    def mean(self, states: FloatArray, weights: FloatArray | None = None) -> FloatArray:
        """Return the mean of positions and that of orientations (6,) of poses (n, 6)."""
        positions = Space.mean(self, states[:, :3], weights)
        return np.concatenate([positions, rotations.mean(states[:, 3:], weights)])

    def middle(self, states: FloatArray) -> FloatArray:
        """Return the median of positions and that of orientations (6,): the sum of angles to it is least."""
        turn = rotations.mean(states[:, 3:])
        for _ in range(MEDIAN_STEPS):  # each of weight one over its angle, as Weiszfeld's method has it
            turn = rotations.mean(states[:, 3:], 1 / np.maximum(rotations.angles(states[:, 3:], turn), SAME))
        return np.concatenate([np.median(states[:, :3], axis=0), turn])

    def tangent(self, states: FloatArray, target: FloatArray) -> tuple[FloatArray, Place]:
        """Return offsets (n, 6), and what leads their velocities to twists (n, 6): ω = R* J(r/ℓ) ṙ / ℓ.

        J(r) = I + (1 − cos θ)/θ² [r]× + (θ − sin θ)/θ³ [r]×² with θ = ‖r‖ is the left Jacobian of exp.
        """
        offsets = self.offsets(states, target)
        r = offsets[:, 3:] / self.length
        angle = np.linalg.norm(r, axis=1)[:, None]
        # Both factors in terms of sinc, which is exact at zero: 1 − cos θ = 2 sin²(θ/2).
        first = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
        with np.errstate(invalid="ignore", divide="ignore"):
            second = np.where(angle > rotations.SMALL, (angle - np.sin(angle)) / angle**3, 1 / 6)
        base = rotations.quaternions(target[3:])

        def place(velocities: FloatArray) -> FloatArray:
            rate = velocities[:, 3:] / self.length
            across = np.cross(r, rate)
            turning = rate + first * across + second * np.cross(r, across)
            return np.concatenate([velocities[:, :3], rotations.turned(turning, base)], axis=1)

        return offsets, place

    def speeds(self, velocity: FloatArray) -> tuple[float, float]:
        """Return ‖v‖ [m/s] and ‖ω‖ [rad/s] of one twist (6,)."""
        vx, vy, vz, wx, wy, wz = velocity.tolist()
        return math.hypot(vx, vy, vz), math.hypot(wx, wy, wz)

    def distance(self, to: FloatArray, start: FloatArray) -> FloatArray:
        """Return √(‖Δp‖² + ℓ²θ²), [m]. Shape (...)."""
        moved, turned = self.apart(to, start)
        return np.asarray(np.hypot(moved, self.length * turned))

    def apart(self, to: FloatArray, start: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how far apart poses (..., 6) are: [m], and [rad]."""
        moved = np.linalg.norm(to[..., :3] - start[..., :3], axis=-1)
        return np.asarray(moved), rotations.angles(to[..., 3:], start[..., 3:])

    def magnitudes(self, velocities: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ‖v‖ [m/s] and ‖ω‖ [rad/s] of twists (..., 6)."""
        moving, turning = (np.linalg.norm(v, axis=-1) for v in (velocities[..., :3], velocities[..., 3:]))
        return np.asarray(moving), np.asarray(turning)

    def turns(self, states: FloatArray) -> FloatArray:
        """Return the rotation vectors (..., 3) of poses (..., 6)."""
        return states[..., 3:]

    def given(self, state: FloatArray) -> tuple[float, ...]:
        """Return one pose (6,) as (x, y, z, qx, qy, qz, qw)."""
        x, y, z, *turn = state.tolist()
        return (x, y, z, *rotations.quaternion_of(*turn))

    def rates(self, times: FloatArray, states: FloatArray) -> FloatArray:
        """Return the twists (T, 6) of a motion (T, 6): over both neighbours, at the ends over one."""
        index = np.arange(len(states))
        before, after = np.maximum(index - 1, 0), np.minimum(index + 1, len(states) - 1)
        return self.difference(states[after], states[before]) / (times[after] - times[before])[:, None]

    def continued(self, states: FloatArray) -> FloatArray:
        """Return a motion (T, 6) whose rotation vectors do not jump; they may be longer than π."""
        return np.concatenate([states[:, :3], rotations.continuous(states[:, 3:])], axis=1)

    def measured(self, state: npt.ArrayLike) -> FloatArray:
        """Return one measured pose (6,), given as such or as (x, y, z, qx, qy, qz, qw); see ``Space``.

        Raises:
            StateError: Neither, or not finite, or a quaternion of no length.
        """
        x = numbers(state)
        if x.shape != (7,):
            return Space.measured(self, x)
        values = x.tolist()
        if not all(abs(value) <= LARGEST for value in values) or not any(values[3:]):
            raise StateError(
                f"state: must be finite, with a quaternion that is not zero, got {values}.",
                hint="Check the measurement before it is passed on.",
            )
        return np.array([*values[:3], *rotations.vector_of(*values[3:])])

    # --- One state, for control loops: Python's floats are several times as fast as small arrays. ---------

    def offset_at(self, state: FloatArray, target: FloatArray, near: FloatArray | None = None) -> FloatArray:
        """Return the offset of one pose (6,).

        Args:
            state: The pose.
            target: The target.
            near: An earlier offset. Half a turn away from the target there are two offsets for about the same
                pose; the one on the side of the earlier offset is taken up to ``SEAM`` past half a turn.
        """
        x, y, z, *r = state.tolist()
        px, py, pz, *base = target.tolist()
        inverse = rotations.quaternion_of(-base[0], -base[1], -base[2])
        turn = rotations.vector_of(*rotations.product_of(inverse, rotations.quaternion_of(*r)))
        if near is not None:
            angle = math.hypot(*turn)
            along = turn[0] * near[3] + turn[1] * near[4] + turn[2] * near[5]
            if angle > math.pi - SEAM and along < 0:
                back = 1 - 2 * math.pi / angle
                turn = turn[0] * back, turn[1] * back, turn[2] * back
        ell = self.length
        return np.array([x - px, y - py, z - pz, ell * turn[0], ell * turn[1], ell * turn[2]])

    def difference_at(self, to: FloatArray, start: FloatArray) -> FloatArray:
        """Return as ``difference`` for two poses (6,)."""
        x, y, z, *r = to.tolist()
        px, py, pz, *base = start.tolist()
        inverse = rotations.quaternion_of(-base[0], -base[1], -base[2])
        turn = rotations.vector_of(*rotations.product_of(rotations.quaternion_of(*r), inverse))
        return np.array([x - px, y - py, z - pz, *turn])

    def displace_at(self, state: FloatArray, difference: FloatArray) -> FloatArray:
        """Return as ``displace`` for one pose (6,)."""
        x, y, z, *r = state.tolist()
        dx, dy, dz, *by = difference.tolist()
        turned = rotations.product_of(rotations.quaternion_of(*by), rotations.quaternion_of(*r))
        return np.array([x + dx, y + dy, z + dz, *rotations.vector_of(*turned)])

    def distance_at(self, to: FloatArray, start: FloatArray) -> float:
        """Return √(‖Δp‖² + ℓ²θ²) of two poses (6,), [m]."""
        moved, turned = self.speeds(self.difference_at(to, start))
        return math.hypot(moved, self.length * turned)

    def placed_at(self, offset: FloatArray, target: FloatArray) -> FloatArray:
        """Return the pose (6,) at one offset (6,)."""
        x, y, z, *scaled = offset.tolist()
        r = scaled[0] / self.length, scaled[1] / self.length, scaled[2] / self.length
        px, py, pz, *base = target.tolist()
        turned = rotations.product_of(rotations.quaternion_of(*base), rotations.quaternion_of(*r))
        return np.array([px + x, py + y, pz + z, *rotations.vector_of(*turned)])

    def tangent_at(self, state: FloatArray, target: FloatArray) -> tuple[FloatArray, Place]:
        """Return as ``tangent`` for one pose (6,)."""
        offset = self.offset_at(state, target)
        ell = self.length
        r = tuple(part / ell for part in offset.tolist()[3:])
        angle = math.hypot(*r)
        first = 0.5 * (math.sin(0.5 * angle) / (0.5 * angle)) ** 2 if angle > rotations.SMALL else 0.5
        second = (angle - math.sin(angle)) / angle**3 if angle > rotations.SMALL else 1 / 6
        base = rotations.quaternion_of(*target.tolist()[3:])

        def place(velocity: FloatArray) -> FloatArray:
            vx, vy, vz, *scaled = velocity.tolist()
            rate = scaled[0] / ell, scaled[1] / ell, scaled[2] / ell
            across = rotations.cross_of(r, rate)
            further = rotations.cross_of(r, across)
            turning = tuple(a + first * b + second * c for a, b, c in zip(rate, across, further, strict=True))
            return np.array([vx, vy, vz, *rotations.turned_of(turning, base)])

        return offset, place
