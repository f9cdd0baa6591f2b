"""The search for one Lyapunov matrix P for many components; merging skills with different P needs it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from skillctl.arrays import FloatArray, frozen_array, require_spd
from skillctl.compose.barrier import minimise_largest_eigenvalue
from skillctl.errors import InvalidModelError, UsageError
from skillctl.model.lyapunov import QuadraticForm
from skillctl.model.skill import AnySkill, Skill
from skillctl.model.space import Space

ROUNDS = 3  # each search starts in the coordinates that the one before found


def with_lyapunov(skill: AnySkill, lyapunov: FloatArray) -> AnySkill:
    """Return the same motion with another Lyapunov matrix P (d, d) in every leaf.

    The velocity field does not change. Whether P proves it, ``skillctl.stability`` decides.

    Raises:
        UsageError: P of another dimension.
        InvalidModelError: P not symmetric positive definite.
    """
    if np.shape(lyapunov) != (skill.dimension, skill.dimension):
        raise UsageError(
            f"lyapunov: expected {skill.dimension} x {skill.dimension} numbers, got {np.shape(lyapunov)}."
        )
    return skill.with_leaves(lambda leaf: replace(leaf, lyapunov=lyapunov))


def common_lyapunov(
    system_matrices: FloatArray, *, known: Sequence[FloatArray] = (), period: float = 0.0
) -> FloatArray | None:
    """Return a P ≻ 0 with P Aₖ + Aₖᵀ P ≺ 0 for all k, near the one of fastest decay, or None.

    Maximises t over P with −(P Aₖ + Aₖᵀ P) ≽ t I and tr P = d, time scaled by the typical spectral radius,
    in coordinates in which the best P known so far is the identity. Therefore the result does not depend, up
    to rounding, on the units of time and of each axis. With a period Δt, Δt Aₖᵀ P Aₖ is added to
    P Aₖ + Aₖᵀ P, so that steps of that length contract, too; the problem stays linear in P. It is convex:
    None means that the bound of the barrier method excludes every P whose margin is larger than rounding
    errors. A P that is returned contracts in floating point; ``skillctl.stability`` proves it.

    Args:
        system_matrices: Aₖ, shape (K, d, d), [1/s].
        known: Candidates to start from, such as the P of each part. Shape (d, d) each.
        period: Δt ≥ 0, [s].

    Returns:
        P with trace d, shape (d, d), or None.

    References:
        S. Boyd et al., Linear Matrix Inequalities in System and Control Theory (1994), section 5.1; the
        scaling and the period are ours.
    """
    matrices = frozen_array("system_matrices", system_matrices, (None, None, None))
    eigenvalues = np.linalg.eigvals(matrices)
    if eigenvalues.real.max() >= 0:
        return None  # a component that is not stable alone has no P at all
    speed = float(np.median(np.abs(eigenvalues).max(axis=1)))
    scaled, step = matrices / speed, period * speed
    best = _best_start(scaled, known, step)
    for _ in range(ROUNDS):
        factor = np.linalg.cholesky(best).T  # best = factorᵀ factor
        inverse = np.linalg.inv(factor)
        found = minimise_largest_eigenvalue(np.asarray(factor @ scaled @ inverse), step)
        if found is None:
            break
        best = max(best, _normalised(factor.T @ found @ factor), key=lambda p: _slowest(p, scaled, step))
    return best if _slowest(best, scaled, step) > 0 else None


def common_lyapunov_of(parts: Sequence[Skill], *, period: float = 0.0) -> FloatArray | None:
    """Return the P that all parts share already, else one found for all their components, or None.

    Parts in different coordinates have none.

    Args:
        parts: In one state space.
        period: Δt at which a P that has to be found shall prove steps, too, [s].
    """
    leaves = [leaf for part in parts for leaf in part.leaves]
    first = leaves[0]
    if any(leaf.coordinates != first.coordinates for leaf in leaves):
        return None
    if all(leaf.form == first.form for leaf in leaves):
        return first.lyapunov
    acting = [(skill.outer_speed, part) for skill in parts for part in skill.acting_parts]
    matrices = np.concatenate([speed * part.component_matrices for speed, part in acting])
    return _by_blocks(first.space, matrices, [leaf.lyapunov for leaf in leaves], period)


def _by_blocks(
    space: Space, matrices: FloatArray, known: Sequence[FloatArray] = (), period: float = 0.0
) -> FloatArray | None:
    """Return ``common_lyapunov``; of poses that of the position, with the identity for the orientation."""
    if len(space.blocks) == 1:
        return common_lyapunov(matrices, known=known, period=period)
    c = space.positions
    orientation = np.eye(space.dimension - c)
    if _slowest(orientation, matrices[:, c:, c:], period) <= 0:
        return None
    position = common_lyapunov(matrices[:, :c, :c], known=[p[:c, :c] for p in known], period=period)
    if position is None:
        return None
    nothing = np.zeros((c, len(orientation)))
    return np.block([[position, nothing], [nothing.T, orientation]])


def conflicting_parts(parts: Sequence[Skill]) -> tuple[int, ...]:
    """Return the indices of one part, else a pair, else all parts that have no common P; empty if none.

    P in different coordinates have nothing in common: that of other parts is not looked for.
    """
    indices = range(len(parts))
    if len({leaf.coordinates for part in parts for leaf in part.leaves}) > 1:
        return tuple(indices)
    for size in (1, 2, len(parts)):
        for group in combinations(indices, size):
            matrices = np.concatenate([leaf.system_matrices for i in group for leaf in parts[i].leaves])
            if _by_blocks(parts[0].space, matrices) is None:
                return group
    return ()


def _best_start(matrices: FloatArray, known: Sequence[FloatArray], period: float) -> FloatArray:
    """Return the candidate under which the slowest component decays fastest.

    Candidates are the known P, their mean, and the mean of every component's own solution.
    """
    for p in known:
        require_spd("known", p)
    own = [_normalised(_lyapunov_solution(matrix)) for matrix in matrices]
    given = [_normalised(p) for p in known]
    means = [np.mean(group, axis=0) for group in (own, given) if group]
    return max([*given, *means], key=lambda p: _slowest(p, matrices, period))


def _lyapunov_solution(matrix: FloatArray) -> FloatArray:
    """Return P with P A + Aᵀ P = −I for a Hurwitz A (d, d)."""
    d = len(matrix)
    identity = np.eye(d)
    # vec(P A + Aᵀ P) = (Aᵀ ⊗ I + I ⊗ Aᵀ) vec P, row by row or column by column alike
    solution = np.linalg.solve(
        np.kron(matrix.T, identity) + np.kron(identity, matrix.T), -identity.ravel()
    ).reshape(d, d)
    return np.asarray(0.5 * (solution + solution.T))


def _normalised(p: FloatArray) -> FloatArray:
    """Return P, symmetric to the last bit, with trace d."""
    return np.asarray(0.5 * (p + p.T) * (len(p) / np.trace(p)))


def _slowest(p: FloatArray, matrices: FloatArray, period: float) -> float:
    """Return the smallest decay rate that steps of the period leave, −inf if P is not positive definite."""
    try:
        return float(QuadraticForm(p).rates(matrices, period).min())
    except (InvalidModelError, np.linalg.LinAlgError):
        return -np.inf
