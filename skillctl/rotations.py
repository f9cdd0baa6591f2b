"""Rotations, as rotation vectors (axis times angle, [rad]) and as unit quaternions (x, y, z, w).

A rotation R takes coordinates of a turned frame to those of the frame it is given in; ``product(a, b)`` turns
by b first. Vectors have shape (..., 3) and quaternions (..., 4), and all functions broadcast.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from skillctl.arrays import FloatArray

Vector: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]

SMALL = 1e-4  # of an angle: below it the first terms of a series are exact to float64
UPRIGHT = 1e-7  # [rad] from a pitch of 90°: nearer to it, roll and yaw would be mostly rounding


def quaternions(rotations: FloatArray) -> FloatArray:
    """Return the unit quaternions of rotation vectors of any length."""
    half = 0.5 * np.linalg.norm(rotations, axis=-1, keepdims=True)
    return np.concatenate([0.5 * np.sinc(half / np.pi) * rotations, np.cos(half)], axis=-1)


def vectors(given: FloatArray) -> FloatArray:
    """Return the rotation vectors, at most π long, of quaternions of any positive length and either sign."""
    real = given[..., 3:]
    imaginary = np.where(real < 0, -1.0, 1.0) * given[..., :3]
    sine = np.linalg.norm(imaginary, axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, np.abs(real))
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = np.where(sine > 0, angle / sine, 2.0)
    return np.asarray(scale * imaginary)


def inverse(given: FloatArray) -> FloatArray:
    """Return the inverses of unit quaternions."""
    return np.asarray(given * np.array([-1.0, -1.0, -1.0, 1.0]))


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the quaternions of the rotations by b, then by a."""
    va, wa, vb, wb = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    imaginary = wa * vb + wb * va + np.cross(va, vb)
    return np.concatenate([imaginary, wa * wb - np.sum(va * vb, axis=-1, keepdims=True)], axis=-1)


def turned(points: FloatArray, by: FloatArray) -> FloatArray:
    """Return points (..., 3) turned by unit quaternions."""
    axis, real = by[..., :3], by[..., 3:]
    across = 2 * np.cross(axis, points)
    return np.asarray(points + real * across + np.cross(axis, across))


def matrices(rotations: FloatArray) -> FloatArray:
    """Return the rotation matrices (..., 3, 3) of rotation vectors."""
    columns = turned(np.eye(3), quaternions(rotations)[..., None, :])
    return np.asarray(columns.swapaxes(-1, -2))


def roll_pitch_yaw(rotations: FloatArray) -> FloatArray:
    """Return the angles (..., 3) about the fixed axes x, then y, then z of rotation vectors, [rad].

    With a pitch of 90° or −90° only the sum or difference of roll and yaw counts: then yaw is zero.
    """
    m = matrices(rotations)
    level = np.hypot(m[..., 0, 0], m[..., 1, 0])
    upright = level < UPRIGHT
    roll = np.arctan2(
        np.where(upright, -m[..., 1, 2], m[..., 2, 1]), np.where(upright, m[..., 1, 1], m[..., 2, 2])
    )
    yaw = np.where(upright, 0.0, np.arctan2(m[..., 1, 0], m[..., 0, 0]))
    return np.stack([roll, np.arctan2(-m[..., 2, 0], level), yaw], axis=-1)


def angles(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the angles [rad] between rotations, given as rotation vectors. Shape (...)."""
    apart = product(inverse(quaternions(b)), quaternions(a))
    return np.asarray(2 * np.arctan2(np.linalg.norm(apart[..., :3], axis=-1), np.abs(apart[..., 3])))


def continuous(rotations: FloatArray) -> FloatArray:
    """Return a sequence of rotation vectors (T, 3) of the same rotations without jumps by full turns.

    Their lengths may exceed π. A rotation by an angle θ about an axis is one by θ − 2π, and by θ + 2π, too.
    """
    length = np.linalg.norm(rotations, axis=1)
    axes = np.divide(rotations, length[:, None], out=np.zeros_like(rotations), where=length[:, None] > 0)
    flips = np.sum(axes[1:] * axes[:-1], axis=1) < 0  # the axis turns round, and the angle changes its sign
    signs = np.where(np.append(0, np.cumsum(flips)) % 2, -1.0, 1.0)
    angles = signs * length
    turns = np.round((np.unwrap(angles) - angles) / (2 * np.pi))
    return np.asarray(rotations + (2 * np.pi * turns * signs)[:, None] * axes)


def mean(rotations: FloatArray, weights: FloatArray | None = None) -> FloatArray:
    """Return the rotation vector (3,) of the mean of rotations (n, 3).

    The mean is the unit quaternion q that maximises Σ wᵢ (q·qᵢ)², which knows no signs.

    Args:
        rotations: Rotation vectors; they lie within 90° of each other, or there may be no one mean.
        weights: wᵢ > 0, shape (n,); equal by default.
    """
    q = quaternions(rotations)
    share = np.full(len(q), 1.0) if weights is None else weights
    _, directions = np.linalg.eigh((q * share[:, None]).T @ q)
    return vectors(directions[:, -1])


# --- One rotation, for control loops: Python's floats are several times as fast as small arrays. ----------


def product_of(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the quaternion of the rotations by b, then by a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + bw * ax + ay * bz - az * by,
        aw * by + bw * ay + az * bx - ax * bz,
        aw * bz + bw * az + ax * by - ay * bx,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def quaternion_of(x: float, y: float, z: float) -> Quaternion:
    """Return the unit quaternion of one rotation vector."""
    half = 0.5 * math.sqrt(x * x + y * y + z * z)
    scale = 0.5 * (math.sin(half) / half if half > SMALL else 1.0 - half * half / 6)
    return scale * x, scale * y, scale * z, math.cos(half)


def vector_of(x: float, y: float, z: float, w: float) -> Vector:
    """Return the rotation vector, at most π long, of one quaternion."""
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 if sine == 0 else 2 * math.atan2(sine, abs(w)) / sine
    scale = -scale if w < 0 else scale
    return scale * x, scale * y, scale * z


def cross_of(a: Vector, b: Vector) -> Vector:
    """Return a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def turned_of(point: Vector, by: Quaternion) -> Vector:
    """Return one point, turned by a unit quaternion."""
    axis, real = by[:3], 2 * by[3]
    across = cross_of(axis, point)
    further = cross_of(axis, across)
    return (
        point[0] + real * across[0] + 2 * further[0],
        point[1] + real * across[1] + 2 * further[1],
        point[2] + real * across[2] + 2 * further[2],
    )
