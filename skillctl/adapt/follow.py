"""Weights of a merger fitted to whole demonstrated motions, not to their velocities alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from skillctl.adapt.options import FitLevel
from skillctl.adapt.weights import WeightedMerger
from skillctl.arrays import FloatArray, IntArray
from skillctl.geometry import path_length, resample_by_arc_length
from skillctl.learning.options import LearnOptions
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.merged import MergedSkill
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import ActingSkill, AnyActing
from skillctl.model.stepper import moved

PERIOD = LearnOptions().period  # [s] of a controller; the result keeps it if its parts do
RATE_SHARE = 0.2  # least decay rate of the result, as a share of the slowest part's at the fitted speed
FACTORS = (0.02, 5.0)  # least and greatest of a component, as far as rate and period allow
WEIGHTS = (0.02, 50.0)  # least and greatest factor of a part
LEAST = 0.3  # least start weight of a part, as a share of equal weights: no factor changes a weight of zero
DROPPED = 0.02  # a part with less than this share is left out
PULL = 0.02  # an error of this share of the paths' lengths costs as much as factors e times too large
POINTS = 40  # compared per path
STEPS = 200  # at most, per demonstration duration
DURATIONS = 2  # a motion is followed for this many durations of the longest demonstration
SAFE = 0.999  # of the longest contracting step, because of rounding
ARRIVED = 0.01  # share of the path within which a motion counts as arrived; the rest is taken as straight
EVALUATIONS = 20
NUDGE = 1e-4  # of a logarithm, for finite differences


def follow(
    parts: Sequence[ActingSkill], demonstrations: DemonstrationSet, weights: FloatArray, *, level: FitLevel
) -> WeightedMerger:
    """Return the superposition of the parts whose motions come nearest to demonstrations of a new task.

    Starting at ``weights``, a local search minimises the mean squared distance between the demonstrated paths
    and those of the merger from the same starts, point by point in shares of the arc length, plus
    (``PULL`` log factor)². Paths do not depend on the speed, which is chosen last, to fit the velocities.

    Component k of a part then moves with c Aₖ, h̃ = c hₖ. Factors are bounded so that a P that proves the
    parts proves the result for controllers of ``PERIOD`` (or of the parts' own period where that is shorter)
    and a rate of at least ``RATE_SHARE`` times the slowest part's, at the fitted speed.

    Args:
        parts: Two or more SEDS or merged skills with one attractor and one Lyapunov matrix.
        demonstrations: Of the new task; each counts relative to its own end.
        weights: Start of the search, one per part, zero or more, not all zero.
        level: One factor per part, or one per component.

    Returns:
        The merger, and its weights up to a common factor (with one factor per component: the shares).

    References:
        Section 3.1 of the paper, h̃ᵏ = αᵏ hᵏ; fitting motions instead of velocities is ours.
    """
    from scipy.optimize import Bounds, least_squares  # late, as in ``weights``

    mixture = _Mixture.of(tuple(parts), weights, level)
    neutral = np.ones(len(mixture.owners))
    speed = mixture.speed(neutral, demonstrations)
    paths = _Paths.of(demonstrations, parts[0].attractor)
    step = mixture.step(speed, paths.longest)
    strength = PULL / np.sqrt(len(neutral))

    def misses_of(logs: FloatArray) -> FloatArray:
        return paths.misses(mixture, speed * mixture.levelled(np.exp(logs)), step)

    def residuals(logs: FloatArray) -> FloatArray:
        return np.append(misses_of(logs[None])[0], strength * logs)

    def slopes(logs: FloatArray) -> FloatArray:
        misses = misses_of(np.vstack([logs, logs + NUDGE * np.eye(len(logs))]))
        return np.vstack([(misses[1:] - misses[0]).T / NUDGE, strength * np.eye(len(logs))])

    found = least_squares(
        residuals,
        np.zeros(len(neutral)),
        slopes,
        bounds=Bounds(*map(np.log, mixture.bounds(speed * step))),
        max_nfev=EVALUATIONS,
        ftol=1e-4,
    )
    factors = np.exp(found.x)
    return mixture.merged(factors, mixture.speed(factors, demonstrations))


@dataclass(frozen=True, eq=False, slots=True)
class _Mixture:
    """A superposition whose velocity is linear in m factors: one per part, or one per component.

    Attributes:
        parts: SEDS or merged skills with one attractor and one P.
        shares: Influence of each part, summing to one.
        level: Whether a factor belongs to a part or to a component.
        owners: Part of each factor. Shape (m,).
        rates, periods: Slowest decay [1/s] and shortest contracting step [s] of what each moves. Shape (m,).
    """

    parts: tuple[ActingSkill, ...]
    shares: FloatArray
    level: FitLevel
    owners: IntArray
    rates: FloatArray
    periods: FloatArray

    @classmethod
    def of(cls, parts: tuple[ActingSkill, ...], weights: FloatArray, level: FitLevel) -> _Mixture:
        shares = np.maximum(weights / weights.sum(), LEAST / len(parts))
        rates = [part.form.rates(part.component_matrices) for part in parts]
        periods = [part.form.periods(part.component_matrices) for part in parts]
        if level == "part":
            rates, periods = (
                [own.min(keepdims=True) for own in rates],
                [own.min(keepdims=True) for own in periods],
            )
        owners = np.repeat(np.arange(len(parts)), [len(own) for own in rates])
        return cls(
            parts, shares / shares.sum(), level, owners, np.concatenate(rates), np.concatenate(periods)
        )

    @property
    def period(self) -> float:
        """The longest controller period at which the result must contract, [s]."""
        return min(PERIOD, float(self.periods.min()))

    def fields(self, positions: FloatArray) -> FloatArray:
        """Return what each factor multiplies, at positions (n, d). Shape (n, m, d)."""
        if self.level == "part":
            fields = np.stack([part.velocity(positions) for part in self.parts], axis=1)
        else:
            fields = np.concatenate([part.component_velocities(positions) for part in self.parts], axis=1)
        return np.asarray(self.shares[self.owners, None] * fields)

    def speed(self, factors: FloatArray, demonstrations: DemonstrationSet) -> float:
        """Return the speed that fits demonstrated velocities, as far as the controller period allows."""
        along, own = 0.0, 0.0
        for motion in demonstrations:
            x = motion.positions - motion.positions[-1] + self.parts[0].attractor
            velocities = np.einsum("m,nmd->nd", factors, self.fields(x))
            along += float(np.mean(velocities * motion.velocities))
            own += float(np.mean(velocities * velocities))
        own_speeds = np.full(len(factors), self.shares @ factors) if self.level == "part" else factors
        fastest = SAFE * float((self.periods / own_speeds).min()) / self.period
        return min(along / own, fastest) if along > 0 else min(1.0, fastest)

    def step(self, speed: float, longest: float) -> float:
        """Return a period at which motions with a speed contract, and take no more steps than needed, [s]."""
        return min(max(self.period, longest / STEPS), SAFE * float(self.periods.min()) / speed)

    def levelled(self, factors: FloatArray) -> FloatArray:
        """Return factors (b, m), those of parts scaled so that their weighted sum is one."""
        return factors / (factors @ self.shares)[:, None] if self.level == "part" else factors

    def bounds(self, advance: float) -> tuple[FloatArray, FloatArray]:
        """Return the smallest and the largest factors, (m,) each, with one in between.

        Args:
            advance: Period times speed with which steps shall contract, [s].
        """
        if self.level == "part":
            return np.full(len(self.owners), WEIGHTS[0]), np.full(len(self.owners), WEIGHTS[1])
        low = np.maximum(FACTORS[0], RATE_SHARE * self.rates.min() / self.rates)
        high = np.minimum(FACTORS[1], self.periods / advance)
        return low, np.maximum(high, 1.0 + NUDGE)

    def merged(self, factors: FloatArray, speed: float) -> WeightedMerger:
        """Return the superposition with these factors, without parts of next to no influence."""
        if self.level == "component":
            splits = [factors[self.owners == i] for i in range(len(self.parts))]
            scaled = [scaled_components(*pair) for pair in zip(self.parts, splits, strict=True)]
            return WeightedMerger(MergedSkill(tuple(scaled), self.shares, speed=speed), self.shares)
        weights = self.shares * factors
        weights[weights < DROPPED * weights.sum()] = 0
        used = np.flatnonzero(weights)
        chosen = tuple(self.parts[i] for i in used)
        skill = MergedSkill(
            chosen, weights[used] / weights[used].sum(), speed=speed * float(weights[used].sum())
        )
        return WeightedMerger(skill, weights)


@dataclass(frozen=True, eq=False, slots=True)
class _Paths:
    """The demonstrated paths.

    Attributes:
        goal: Where all end, (d,).
        curves: Points evenly spaced along each path. Shape (s, POINTS, d).
        lengths: Of the paths. Shape (s,).
        longest: Duration of the slowest demonstration, [s].
    """

    goal: FloatArray
    curves: FloatArray
    lengths: FloatArray
    longest: float

    @classmethod
    def of(cls, demonstrations: DemonstrationSet, goal: FloatArray) -> _Paths:
        paths = [m.positions - m.positions[-1] + goal for m in demonstrations]
        curves = np.stack([resample_by_arc_length(path, POINTS) for path in paths])
        return cls(goal, curves, path_length(curves), max(m.duration for m in demonstrations))

    def misses(self, mixture: _Mixture, factors: FloatArray, step: float) -> FloatArray:
        """Return the errors of motions with factors (b, m), in shares of the paths' lengths. Shape (b, …)."""
        starts = np.tile(self.curves[:, 0], (len(factors), 1))
        moved = self._moved(mixture, starts, np.repeat(factors, len(self.curves), axis=0), step)
        curves = np.stack([resample_by_arc_length(path, POINTS) for path in moved])
        misses = curves.reshape(len(factors), *self.curves.shape) - self.curves
        misses /= self.lengths[:, None, None] * np.sqrt(len(self.curves) * POINTS)
        return misses.reshape(len(factors), -1)

    def _moved(self, mixture: _Mixture, starts: FloatArray, factors: FloatArray, step: float) -> FloatArray:
        """Return motions from starts (n, d) to the goal, each with its own factors (n, m): (n, T, d)."""
        near = ARRIVED * np.tile(self.lengths, len(starts) // len(self.lengths))
        x, path = starts, [starts]
        for _ in range(round(DURATIONS * self.longest / step)):
            velocities = np.einsum("nm,nmd->nd", factors, mixture.fields(x))
            x = moved(mixture.parts[0].space, x, velocities, step)
            path.append(x)
            if (np.linalg.norm(x - self.goal, axis=1) < near).all():
                break
        path.append(np.broadcast_to(self.goal, x.shape))
        return np.stack(path, axis=1)


def scaled_components(part: AnyActing, factors: FloatArray) -> AnyActing:
    """Return the part with its components' velocities multiplied by positive factors (K,): h̃ᵏ = αᵏ hᵏ."""
    splits = iter(np.split(factors, np.cumsum([leaf.n_components for leaf in part.leaves])[:-1]))

    def scaled(leaf: SedsSkill) -> SedsSkill:
        own = next(splits)[:, None, None]
        matrices, residuals = leaf.system_matrices * own, leaf.residual_covariances * own**2
        return replace(leaf, system_matrices=matrices, residual_covariances=residuals)

    return part.with_leaves(scaled)
