"""The groups of a part's offsets that contract by themselves: all of them, or the two of a pose."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.exact import Dyadic, is_positive_definite
from skillctl.model.coordinates.chain import Chain, OnPosition
from skillctl.model.lyapunov import QuadraticForm
from skillctl.model.pose import Pose
from skillctl.model.skill import ActingSkill
from skillctl.stability.exact import largest_proved

NAMES = ("position", "orientation")


@dataclass(frozen=True, eq=False, slots=True)
class Block:
    """Some of the charted states of a part, and the V of them alone.

    Attributes:
        name: ``position`` or ``orientation``; empty if they are all there are.
        rows: Which of the coordinates they are.
        anchor: Where they are at the target, shape (b,).
        form: V of them.
        coordinates: c of them.
    """

    name: str
    rows: slice
    anchor: FloatArray
    form: QuadraticForm
    coordinates: Chain

    @property
    def lyapunov(self) -> FloatArray:
        """P of V, shape (b, b)."""
        return self.form.matrix

    def of(self, matrix: FloatArray) -> FloatArray:
        """Return what a matrix (..., d, d) does within the block. Shape (..., b, b)."""
        return np.ascontiguousarray(matrix[..., self.rows, self.rows])


def whole_of(part: ActingSkill) -> Block:
    """Return all coordinates of a part as one block."""
    return Block("", slice(0, part.dimension), part.anchor, part.form, part.coordinates)


def blocks_of(part: ActingSkill) -> tuple[Block, ...]:
    """Return the blocks of a part, from the first coordinate to the last."""
    sizes = part.space.blocks
    if len(sizes) == 1:
        return (whole_of(part),)
    bent = Chain(tuple(link.link for link in part.coordinates.links if isinstance(link, OnPosition)))
    edges = pairwise(np.cumsum([0, *sizes]).tolist())
    return tuple(
        Block(name, rows, part.anchor[rows], QuadraticForm(part.lyapunov[rows, rows]), coordinates)
        for name, rows, coordinates in zip(
            NAMES, (slice(*edge) for edge in edges), (bent, Chain()), strict=True
        )
    )


def coupling(part: ActingSkill) -> tuple[str, ...]:
    """Return why position and orientation do not contract by themselves, in sentences; empty if they do.

    Every comparison is of stored numbers, so that nothing is rounded. The angle to the target itself has to
    fall, not another norm of the rotation vector: then no motion comes half a turn away from its target.
    """
    if len(part.space.blocks) == 1:
        return ()
    _, turn = blocks_of(part)
    apart = np.arange(part.dimension) < turn.rows.start
    across = apart[:, None] != apart
    conditions = {
        f"leaf {number}, component {k + 1}: A couples position and orientation": (matrix[across] == 0).all()
        for number, leaf in enumerate(part.leaves, start=1)
        for k, matrix in enumerate(leaf.system_matrices)
    }
    conditions["P couples position and orientation"] = (part.lyapunov[across] == 0).all()
    multiple = turn.lyapunov[0, 0] * np.eye(len(turn.lyapunov))
    conditions["P of the orientation is no multiple of the identity"] = (turn.lyapunov == multiple).all()
    conditions["coordinates bend the orientation"] = all(
        isinstance(link, OnPosition) for link in part.coordinates.links
    )
    return tuple(f"{reason}." for reason, holds in conditions.items() if not holds)


def coupled_radius(part: ActingSkill) -> float | None:
    """Return R [m] such that motions of a coupled part that start within R never come half a turn away.

    That is ℓπ in the offsets that are charted, in which an angle counts ℓ metres a radian. {V ≤ c} ends
    before it if P (ℓπ)² − c diag(0, I) ≻ 0, and holds all within R if c I − R² P ≻ 0.

    Returns:
        None for bent coordinates, of which no such bound is known.

    References:
        Ours: c = (ℓπ)² / λ_max of the block of P⁻¹ that belongs to the orientation.
    """
    if part.coordinates.links or not isinstance(part.space, Pose):
        return None
    half_turn = math.nextafter(math.pi * part.space.length, 0.0)
    _, turn = blocks_of(part)
    lyapunov, identity = Dyadic.of(part.lyapunov), np.eye(part.dimension)
    turning = identity.copy()
    turning[: turn.rows.start] = 0.0
    scaled = lyapunov * (Dyadic.of(half_turn) * Dyadic.of(half_turn))
    inverse = np.asarray(np.linalg.inv(part.lyapunov), dtype=np.float64)
    level = largest_proved(
        half_turn**2 / float(np.linalg.eigvalsh(turn.of(inverse))[-1]),
        half_turn,
        lambda c: is_positive_definite(scaled + -(Dyadic.of(turning) * c)),
    )
    if level is None:
        return None
    whole = Dyadic.of(level * identity)
    return largest_proved(
        math.sqrt(level / float(np.linalg.eigvalsh(part.lyapunov)[-1])),
        half_turn,
        lambda radius: is_positive_definite(whole + -(lyapunov * (radius * radius))),
    )
