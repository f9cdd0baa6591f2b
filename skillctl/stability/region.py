"""A radius around an attractor within which one part of a combined skill provably acts alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.exact import Dyadic, is_positive_definite, leading_minors
from skillctl.model.mixture import GaussianMixture
from skillctl.model.skill import Skill
from skillctl.stability.blocks import whole_of
from skillctl.stability.sublevels import TRIES, Sublevels, sublevels_of

# Exact numbers go through log, exp and sqrt, each good to a few units in the last place (2^-52); this share
# of the largest term is a million times that.
GUARD = 2.0**-32
BISECTIONS = 30  # a relative accuracy of 1e-9 of the radius


def certified_radius(skill: Skill, index: int) -> float | None:
    """Return a radius around part ``index``'s attractor from within which every motion ends there.

    On the ball ‖ξ − ξ*‖_P ≤ ρ each Gaussian's Mahalanobis distance lies within √m ± ρ √s, where √m is
    its distance at ξ* and s = λ_max(Σ⁻¹, P). That bounds βᵢ rᵢ from below and every other βⱼ rⱼ from
    above. Where the first is larger, part i alone acts; it shrinks the P-norm, so the motion stays in the
    ball and converges. In coordinates other than plain ones the ball is Euclidean, and the motion stays in
    a {√V ≤ σ} inside it. Valid only for a part that is itself proved. What it does not show: that motions
    from farther away end elsewhere.

    Returns:
        The radius of the largest Euclidean ball inside the largest such ball, in the unit of the space; None
        if the part does not provably act at its own attractor, or for poses: each part has its own chart.

    References:
        Theory page, verification; the bounds are ours.
    """
    if not skill.space.flat:
        return None
    part = skill.acting_parts[index]
    bent = bool(part.coordinates.links)
    norm = np.eye(skill.dimension) if bent else part.lyapunov
    try:
        bounds = [
            DensityBounds.of(influence, prior, part.attractor, norm)
            for influence, prior in zip(skill.influences, skill.shares.tolist(), strict=True)
        ]
    except (ArithmeticError, np.linalg.LinAlgError):  # a covariance singular, or numbers beyond float64
        return None
    own = bounds.pop(index)

    def acts_alone(rho: float) -> bool:
        lowest = own.lowest(rho)
        return all(lowest > rival.highest(rho) for rival in bounds)

    if not acts_alone(0.0):
        return None
    rho = _largest(acts_alone, start=1 / float(own.slopes.max()))
    return (
        _within(sublevels_of(whole_of(part)), part.attractor, rho) if bent else _euclidean(rho, part.lyapunov)
    )


def _within(sublevels: Sublevels, attractor: FloatArray, radius: float) -> float | None:
    """Return R with {‖ξ − ξ*‖ ≤ R} in a {√V ≤ σ} in {‖ξ − ξ*‖ ≤ radius}; None if none was found."""
    sigma = sublevels.radius(radius)
    if sigma is None:
        return None
    for _ in range(TRIES):
        level = sublevels.level(attractor - radius, attractor + radius)
        if level <= sigma**2 * (1 - GUARD):
            return radius * (1 - GUARD)
        radius *= 0.95 * max(sigma / math.sqrt(level), 0.1)
    return None


def selectable_parts(skill: Skill, low: FloatArray, high: FloatArray) -> tuple[int, ...]:
    """Return the indices of the parts that may be selected somewhere in the box between two corners (d,).

    All others provably are not: on the ball around the box their largest βᵢ rᵢ is below another's smallest.
    A box of positions of poses holds every orientation, so that any part may be.
    """
    everyone = tuple(range(len(skill.acting_parts)))
    if len(everyone) == 1 or not skill.space.flat:
        return everyone
    centre, radius = 0.5 * (low + high), 0.5 * (1 + GUARD) * float(np.linalg.norm(high - low))
    try:
        bounds = [
            DensityBounds.of(influence, prior, centre, np.eye(len(low)))
            for influence, prior in zip(skill.influences, skill.shares.tolist(), strict=True)
        ]
    except (ArithmeticError, np.linalg.LinAlgError):  # a covariance singular, or numbers beyond float64
        return everyone
    least = max(each.lowest(radius) for each in bounds)
    return tuple(index for index in everyone if not bounds[index].highest(radius) < least)


@dataclass(frozen=True, eq=False, slots=True)
class DensityBounds:
    """Bounds of log β r(ξ) on balls ‖ξ − ξ*‖_P ≤ ρ, from three numbers per Gaussian.

    Attributes:
        peaks: log β πₖ − ½ log det 2πΣₖ.
        distances: Mahalanobis distance of ξ* from μₖ.
        slopes: √s with s P ≻ Σₖ⁻¹.
    """

    peaks: FloatArray
    distances: FloatArray
    slopes: FloatArray

    @classmethod
    def of(
        cls, density: GaussianMixture, prior: float, centre: FloatArray, lyapunov: FloatArray
    ) -> DensityBounds:
        """Return the bounds of log β r around ``centre`` (d,), for balls of P (d, d); β is ``prior``."""
        rows = [
            (*_determinant_and_distance(mean, covariance, centre), _slope(covariance, lyapunov))
            for mean, covariance in zip(density.means, density.covariances, strict=True)
        ]
        log_determinants, distances, slopes = np.array(rows).T
        offset = math.log(prior) - 0.5 * density.dimension * math.log(2 * math.pi)
        return cls(np.log(density.priors) - 0.5 * log_determinants + offset, distances, slopes)

    def lowest(self, rho: float) -> float:
        """Return a value that log β r nowhere falls below on the ball of radius ρ."""
        value, guard = self._log_sum(self.distances + rho * self.slopes)
        return value - guard

    def highest(self, rho: float) -> float:
        """Return a value that log β r nowhere exceeds on the ball of radius ρ."""
        value, guard = self._log_sum(np.maximum(self.distances - rho * self.slopes, 0.0))
        return value + guard

    def _log_sum(self, distances: FloatArray) -> tuple[float, float]:
        """Return log Σ exp(peak − ½ distance²), and a bound on what rounding changed."""
        terms = self.peaks - 0.5 * distances**2
        top = float(terms.max())
        guard = GUARD * (1 + float(np.abs(self.peaks).max()) + float((distances**2).max()))
        return top + math.log(float(np.exp(terms - top).sum())), guard


def _determinant_and_distance(
    mean: FloatArray, covariance: FloatArray, centre: FloatArray
) -> tuple[float, float]:
    """Return log det Σ and √m, m = aᵀ Σ⁻¹ a for a = μ − ξ*, computed as rational numbers.

    m = −det [Σ a; aᵀ 0] / det Σ. Raises ArithmeticError where Σ is not exactly positive definite.
    """
    d = mean.size
    offset, sigma = Dyadic.of(mean) + -Dyadic.of(centre), Dyadic.of(covariance)
    if not is_positive_definite(sigma):
        raise ArithmeticError("covariance: not exactly positive definite.")
    common = max(offset.denominator, sigma.denominator)
    bordered = np.zeros((d + 1, d + 1), dtype=object)
    bordered[:d, :d] = sigma.integers * (common // sigma.denominator)
    bordered[:d, d] = bordered[d, :d] = offset.integers * (common // offset.denominator)
    *_, determinant, border = leading_minors(bordered)
    return math.log(determinant) - d * math.log(common), math.sqrt(-border / (determinant * common))


def _slope(covariance: FloatArray, lyapunov: FloatArray) -> float:
    """Return √s, s near the smallest with s P ≻ Σ⁻¹; decided exactly as s Σ P Σ − Σ ≻ 0.

    Raises ArithmeticError where it is beyond float64.
    """
    with np.errstate(all="ignore"):
        whitener = np.linalg.inv(np.linalg.cholesky(lyapunov))
        s = float(np.linalg.eigvalsh(whitener @ np.linalg.inv(covariance) @ whitener.T)[-1])
    if not math.isfinite(s):
        raise ArithmeticError("covariance: its inverse is beyond float64.")
    sigma = Dyadic.of(covariance)
    product = sigma @ Dyadic.of(lyapunov) @ sigma
    growth = 2.0**-40
    while not is_positive_definite(product * Dyadic.of(s) + -sigma):
        s = s * (1 + growth) if s > 0 else 1.0
        growth *= 2
    return math.sqrt(s) * (1 + GUARD)


def _largest(holds: Callable[[float], bool], start: float) -> float:
    """Return nearly the largest argument that passes a test which holds at 0 and fails from some point on."""
    low, high = 0.0, start
    while holds(high):
        low, high = high, 2 * high
    while low == 0.0:
        middle = 0.5 * high
        low, high = (middle, high) if holds(middle) else (0.0, middle)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def _euclidean(rho: float, lyapunov: FloatArray) -> float:
    """Return R with {‖e‖ ≤ R} inside {‖e‖_P ≤ ρ}; decided exactly as ρ² I − R² P ≻ 0."""
    radius = rho / math.sqrt(float(np.linalg.eigvalsh(lyapunov)[-1]))
    p, identity = Dyadic.of(lyapunov), Dyadic.of(np.eye(len(lyapunov)))
    rho_squared = Dyadic.of(rho) * Dyadic.of(rho)
    shrink = 2.0**-40
    while True:
        radius *= 1 - shrink
        squared = Dyadic.of(radius) * Dyadic.of(radius)
        if is_positive_definite(identity * rho_squared + -(p * squared)):
            return radius
        shrink = min(2 * shrink, 0.5)
