"""The proof for one part: every component contracts under the part's Lyapunov matrix."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.exact import Dyadic, is_positive_definite
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import ActingSkill, Skill
from skillctl.stability.blocks import Block, blocks_of, coupling, whole_of
from skillctl.stability.exact import FLOAT64, decays, largest_proved, steps_contract
from skillctl.stability.report import BlockCertificate, ComponentCertificate, PartCertificate

MARGIN = 2.0**-40  # about 1e-12: far above float64 rounding of a velocity, far below any useful rate


def certify_part(number: int, part: ActingSkill, speed: float) -> PartCertificate:
    """Return what exact arithmetic proves of one part.

    With V = (ξ − ξ*)ᵀ P (ξ − ξ*), every convex combination of components that contract in the P-norm
    contracts in it, for any gates. The proof holds for the field as stored: speeds and matrices are
    multiplied as rational numbers, and weights sum to one.

    Args:
        number: Number of the part, counted from 1.
        part: A skill with one P and one attractor.
        speed: Factor of the combined skill around it, 1 without one.
    """
    whole, lyapunov = whole_of(part), Dyadic.of(part.lyapunov)
    acting = [
        (leaf_number, k + 1, Dyadic.of(matrix) * factor, Dyadic.of(MARGIN * np.abs(matrix).max()) * factor)
        for leaf_number, (leaf, factor) in enumerate(_leaves(part, Dyadic.of(speed)), start=1)
        for k, matrix in enumerate(leaf.system_matrices)
    ]
    matrices, floats = [matrix for _, _, matrix, _ in acting], speed * part.component_matrices
    rates, _ = _estimates(whole, floats)
    components = tuple(
        ComponentCertificate(leaf, k, decays(lyapunov, matrix, margin), float(r) if np.isfinite(r) else None)
        for (leaf, k, matrix, margin), r in zip(acting, rates, strict=True)
    )
    positive, coupled = is_positive_definite(lyapunov), coupling(part)
    blocks: tuple[BlockCertificate, ...] = ()
    if positive and all(component.proved for component in components):
        alone = (whole,) if coupled else blocks_of(part)
        blocks = tuple(BlockCertificate(block.name, *_figures(block, matrices, floats)) for block in alone)
    return PartCertificate(
        number,
        positive,
        components,
        least([block.rate for block in blocks]),
        least([block.period for block in blocks]),
        part.coordinates.check(),
        coupling=coupled,
        blocks=blocks if len(blocks) > 1 else (),
    )


def least(values: Sequence[float | None]) -> float | None:
    """Return the smallest of some proved numbers; None if one is not proved, or there is none."""
    known = [value for value in values if value is not None]
    return min(known) if known and len(known) == len(values) else None


def _figures(
    block: Block, matrices: Sequence[Dyadic], floats: FloatArray
) -> tuple[float | None, float | None]:
    """Return the proved rate and period of a block under all matrices (d, d)."""
    lyapunov, inner = Dyadic.of(block.lyapunov), [matrix.block(block.rows) for matrix in matrices]
    rates, periods = _estimates(block, floats)
    size = float(np.abs(block.of(floats)).max())
    rate = largest_proved(
        float(rates.min()), size, lambda r: all(decays(lyapunov, matrix, r) for matrix in inner)
    )
    period = largest_proved(
        float(periods.min()),
        1 / size if size > 0 else float(FLOAT64.max),
        lambda t: all(steps_contract(lyapunov, matrix, t) for matrix in inner),
    )
    return rate, period


def proved_rate(part: ActingSkill, speed: float, period: float, block: Block | None = None) -> float | None:
    """Return r such that every step Δt up to a period shrinks the P-distance by e^(−rΔt) or more, [1/s].

    Args:
        part: A skill with one P and one attractor.
        speed: Factor of the combined skill around it, 1 without one.
        period: [s].
        block: Whose P-distance; by default that of all coordinates.

    Returns:
        None if nothing is proved, as where the period is longer than the certified one.
    """
    block = block or whole_of(part)
    lyapunov, longest = Dyadic.of(block.lyapunov), Dyadic.of(period)
    matrices = [
        Dyadic.of(block.of(matrix)) * factor
        for leaf, factor in _leaves(part, Dyadic.of(speed))
        for matrix in leaf.system_matrices
    ]
    estimate = float(block.form.rates(block.of(speed * part.component_matrices), period).min())
    return largest_proved(
        estimate, 0.0, lambda rate: all(decays(lyapunov, matrix, rate, longest) for matrix in matrices)
    )


def _leaves(skill: Skill, speed: Dyadic) -> Iterator[tuple[SedsSkill, Dyadic]]:
    """Yield every leaf with the product of all speeds on the way to it."""
    speed = speed * Dyadic.of(skill.speed)
    if not skill.parts:
        yield from ((leaf, speed) for leaf in skill.leaves)
    for part in skill.parts:
        yield from _leaves(part, speed)


def _estimates(block: Block, matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return decay rates (K,) and periods (K,) of a block under matrices (K, d, d), in floating point."""
    inner = block.of(matrices)
    try:
        with np.errstate(all="ignore"):  # near the limits of float64 they may be infinite, or no numbers
            return block.form.rates(inner), block.form.periods(inner)
    except np.linalg.LinAlgError:  # P or a matrix is singular to working precision
        unknown = np.full(len(inner), np.nan)
        return unknown, unknown
