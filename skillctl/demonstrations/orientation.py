"""Orientations as files write them: what their numbers mean, their checks, and rotation vectors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skillctl import rotations
from skillctl.arrays import FloatArray, IntArray
from skillctl.demonstrations.recording import Orientation, Recording
from skillctl.errors import InputDataError
from skillctl.model.space import AXIS_NAMES

ROUNDED = 0.01  # quaternions and matrices written with two decimals are off by less; more is said,
DISTORTED = 0.05  # and so much is refused
TURN = 6.6  # [rad]; angles of a hand are smaller than a turn, unless they are degrees
HALF_TURN = np.pi  # [rad]; a skill reaches its end from orientations less far from it
STILL = np.deg2rad(1.0)  # [rad]; recorders shake by less
LENGTHS = (0.05, 0.5)  # [m/rad]; RoboTasks, where hands turn by 70 to 90°, have 0.36 and 0.42
LEAVE = "Correct it, leave this demonstration out, or learn positions only with --position-only."  # hint
HOMOGENEOUS = 16  # numbers of a 4 × 4 matrix

Conversion = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class Convention:
    """What the numbers of an orientation mean.

    Attributes:
        name: As in ``--orientation``.
        words: For messages.
        width: How many there are.
        quaternions: Makes quaternions x, y, z, w (T, 4) of them; of quaternions as long as they are.
        angles: Returns those of the numbers that are angles, [rad].
    """

    name: str
    words: str
    width: int
    quaternions: Conversion
    angles: Conversion = lambda numbers: numbers[:, :0]


def of_angles(angles: FloatArray) -> FloatArray:
    """Return the quaternions of roll, pitch and yaw (T, 3) [rad]: turns about the fixed x, then y, then z."""
    about_x, about_y, about_z = (rotations.quaternions(angles[:, [i]] * np.eye(3)[i]) for i in range(3))
    return rotations.product(about_z, rotations.product(about_y, about_x))


def of_matrices(rows: FloatArray) -> FloatArray:
    """Return the quaternions of the rotations that are nearest to matrices (T, 9), row by row.

    References:
        Bar-Itzhack 2000, "New method for extracting the quaternion from a rotation matrix", version 3.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rows.reshape(-1, 3, 3).transpose(1, 2, 0)
    form = np.array(
        [
            [xx - yy - zz, xy + yx, xz + zx, zy - yz],
            [xy + yx, yy - xx - zz, yz + zy, xz - zx],
            [xz + zx, yz + zy, zz - xx - yy, yx - xy],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    return np.asarray(np.linalg.eigh(form.transpose(2, 0, 1))[1][..., -1])


def _lengths(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(vectors, axis=1, keepdims=True))


def _in_degrees(name: str, words: str, quaternions: Conversion) -> Convention:
    return Convention(f"{name}-deg", words, 3, lambda numbers: quaternions(np.deg2rad(numbers)))


_RPY = "turns about the fixed axes x, y and z, in this order, in"
_ROTVEC = "a rotation vector (axis times angle) in"
CONVENTIONS = {
    each.name: each
    for each in (
        Convention("xyzw", "a quaternion x, y, z, w", 4, lambda numbers: numbers),
        Convention("wxyz", "a quaternion w, x, y, z", 4, lambda numbers: numbers[:, [1, 2, 3, 0]]),
        Convention("rotvec", f"{_ROTVEC} radians", 3, rotations.quaternions, _lengths),
        _in_degrees("rotvec", f"{_ROTVEC} degrees", rotations.quaternions),
        Convention("rpy", f"{_RPY} radians", 3, of_angles, np.abs),
        _in_degrees("rpy", f"{_RPY} degrees", of_angles),
        Convention("matrix", "a rotation matrix, row by row", 9, of_matrices),
    )
}


def split_off(recording: Recording, convention: str) -> Recording:
    """Return a recording whose columns behind the first three are an orientation; or a 4 × 4 matrix is both.

    Raises:
        InputDataError: There are more columns, or fewer.
    """
    values, width = recording.positions, CONVENTIONS[convention].width
    if convention == "matrix" and values.shape[1] == HOMOGENEOUS:
        values = _position_and_matrix(values)
    if values.shape[1] != len(AXIS_NAMES) + width:
        raise InputDataError(
            f"{recording.label}: {values.shape[1]} columns, where a position and an orientation {convention} "
            f"are {len(AXIS_NAMES) + width}.",
            hint="Say what the numbers of the orientation are with --orientation, or leave it out.",
        )
    behind = Orientation(values[:, len(AXIS_NAMES) :], convention)
    velocities = None if recording.velocities is None else recording.velocities[:, : len(AXIS_NAMES)]
    return replace(
        recording, positions=values[:, : len(AXIS_NAMES)], velocities=velocities, orientation=behind
    )


def _position_and_matrix(values: FloatArray) -> FloatArray:
    """Return x, y, z and nine numbers of matrices (T, 16), which stand row by row or column by column."""
    square = values.reshape(-1, 4, 4)
    by_column = (square[:, :3, 3] == 0).all() and (square[:, 3, 3] == 1).all()
    square = square.transpose(0, 2, 1) if by_column else square
    return np.hstack([square[:, :3, 3], square[:, :3, :3].reshape(-1, 9)])


# ------------------------------------------------------------------------------------------------- checks


def quaternions_of(recording: Recording, samples: IntArray) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the orientation at samples as unit quaternions x, y, z, w without changes of sign, and notes.

    Raises:
        InputDataError: One is no orientation: not finite, zero, not of length one, not orthonormal, or in
            degrees. The message gives file and place.
    """
    given = recording.orientation
    assert given is not None
    convention, numbers = CONVENTIONS[given.convention], given.numbers[samples]

    def refuse(where: Any, words: str, hint: str = LEAVE) -> None:
        if where.any():
            place = recording.where(int(samples[np.argmax(where)]))
            raise InputDataError(f"{recording.label}, {place}: {words}", hint=hint)

    refuse(~np.isfinite(numbers).all(axis=1), "its orientation is not finite.")
    refuse(
        (convention.angles(numbers) > TURN).any(axis=1),
        f"its orientation has angles up to {np.max(convention.angles(numbers), initial=0):.4g}; are they "
        "degrees?",
        f"If so, say --orientation {convention.name}-deg, or write the unit in the header, as in roll_deg.",
    )
    quaternions = convention.quaternions(numbers)
    off = np.abs(np.linalg.norm(quaternions, axis=1) - 1)
    what = "quaternions are not of length one"
    if convention.name == "matrix":
        square = numbers.reshape(-1, 3, 3)
        off = np.abs(square @ square.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        what = "rotation matrices are not orthonormal"
        mirrored = (off <= DISTORTED) & (np.linalg.det(square) < 0)
        refuse(mirrored, "its rotation matrix is left-handed, it mirrors (its determinant is -1).")
    zero = (numbers == 0).all(axis=1) & (off > DISTORTED)
    refuse(zero, "its orientation is all zeros, which is none; was it not measured?")
    refuse(off > DISTORTED, f"{what}, by {np.max(off):.0%}; are these columns the orientation?")
    worst = float(np.max(off))
    notes = (f"{recording.label}: {what}, by {worst:.1%}; they are corrected.",) if worst > ROUNDED else ()
    return _one_sign(quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)), notes


def _one_sign(quaternions: FloatArray) -> FloatArray:
    """Return quaternions (T, 4) of the same rotations without changes of sign: q and −q are one rotation."""
    opposite = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0
    signs = np.where(np.append(0, np.cumsum(opposite)) % 2, -1.0, 1.0)
    return signs[:, None] * quaternions


def require_half_turn(quaternions: FloatArray, label: str, where: Callable[[int], str]) -> None:
    """Raise InputDataError unless a motion stays less than half a turn from its last orientation.

    Turns add up: a hand that winds once around is not where it was.

    Args:
        quaternions: Of a recording, (T, 4).
        label: Of it.
        where: Names a sample of it.
    """
    to_end = rotations.vectors(rotations.product(rotations.inverse(quaternions[-1]), quaternions))
    angles = np.linalg.norm(rotations.continuous(to_end[::-1])[::-1], axis=1)
    farthest = int(np.argmax(angles))
    if angles[farthest] >= HALF_TURN:
        raise InputDataError(
            f"{label}: at {where(farthest)} its orientation is {np.rad2deg(angles[farthest]):.0f}° from its "
            "end; a skill turns by less than 180°.",
            hint="Record it with less turning, leave it out, or learn positions only with --position-only.",
        )


# ------------------------------------------------------------------------------------- of demonstrations


def vectors_to_end(quaternions: FloatArray) -> FloatArray:
    """Return continuous rotation vectors (T, 3) of a motion; the last one is at most π long."""
    return rotations.continuous(rotations.vectors(quaternions[::-1]))[::-1]


def characteristic_length(motions: Sequence[FloatArray]) -> float:
    """Return how many metres of motions weigh as much as a radian of them, [m/rad].

    It is the ratio of the root mean squares of the distances from the end, over all samples of motions of
    poses (T, 6), each motion counting alike; within LENGTHS. Where a hand hardly turns, a degree of its
    shaking would otherwise weigh as much as centimetres of its way.
    """
    moved = turned = 0.0
    for states in motions:
        moved += float(np.mean(np.sum((states[:, :3] - states[-1, :3]) ** 2, axis=1)))
        turned += float(np.mean(rotations.angles(states[:, 3:], states[-1, 3:]) ** 2))
    ratio = np.sqrt(moved / turned) if turned > 0 else np.inf
    return float(np.clip(ratio, *LENGTHS))


def is_still(quaternions: Sequence[FloatArray]) -> bool:
    """Return whether the hand keeps its orientation in all recordings."""
    return all(float(np.min(np.abs(each @ each[-1]))) > np.cos(STILL / 2) for each in quaternions)


def is_unmeasured(recordings: Sequence[Recording]) -> bool:
    """Return whether all orientations are exactly none: programs write this that do not know them."""
    given = [recording.orientation for recording in recordings if recording.orientation is not None]
    return all(
        np.isfinite(each.numbers).all()
        and (np.abs(CONVENTIONS[each.convention].quaternions(each.numbers)) == [0, 0, 0, 1]).all()
        for each in given
    )
