"""A combined skill: several skills of which one alone acts at any time (Section 3.2)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray, Frozen, IntArray, frozen_array, require_positive, require_simplex
from skillctl.errors import InvalidModelError, UsageError
from skillctl.model.composite import Switched, require_parts
from skillctl.model.gated import StackedDensities
from skillctl.model.gates import combine_gate
from skillctl.model.mixture import GaussianMixture, softmax
from skillctl.model.skill import ActingSkill, Kind


@dataclass(frozen=True, eq=False, slots=True)
class CombinedSkill(Frozen, Switched):
    """Several skills of which one alone acts at any time (Section 3.2).

    Part i = argmax_j (log βⱼ + log rⱼ(ξ)) acts, each rⱼ of the state as part j charts it. ``latched``: chosen
    at the start, kept until the state jumps by more than ``disturbance_distance`` from where the last command
    should have led (the ``Controller`` owns that memory). ``instantaneous``: chosen anew at every instant.

    Attributes:
        parts: Learned or merged skills of one space; attractors may differ (multi-stable) or agree (aligned).
        part_priors: βᵢ > 0, summing to one. Shape (number of parts,).
        gate: One of ``model.gates.COMBINE_GATES``.
        disturbance_distance: In the unit of the space.
        speed: α > 0, a factor on all velocities.
        regions: rᵢ, one mixture a part (``compose.regions``); empty: the position densities of the parts.
    """

    kind: ClassVar[Kind] = "combined"
    parameters: ClassVar[Mapping[str, float]] = MappingProxyType({})

    parts: tuple[ActingSkill, ...]
    part_priors: FloatArray
    gate: str = "latched"
    disturbance_distance: float = 0.02
    speed: float = 1.0
    regions: tuple[GaussianMixture, ...] = ()
    _densities: StackedDensities = field(init=False, repr=False)
    _one_chart: bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        require_parts(self.parts, self.speed)
        priors = frozen_array("part_priors", self.part_priors, (len(self.parts),))
        require_simplex("part_priors", priors)
        object.__setattr__(self, "part_priors", priors)
        try:
            combine_gate(self.gate)
        except UsageError as error:
            raise InvalidModelError(str(error)) from error
        require_positive("disturbance_distance", self.disturbance_distance)
        if self.regions and [one.dimension for one in self.regions] != [self.dimension] * len(self.parts):
            raise InvalidModelError(f"regions: expected one a part, of {self.dimension} dimensions.")
        object.__setattr__(self, "_densities", StackedDensities(self.influences, priors))
        turns = self.part_attractors[:, self.space.positions :]
        object.__setattr__(self, "_one_chart", self.space.flat or bool((turns == turns[0]).all()))

    @property
    def shares(self) -> FloatArray:
        """The part priors."""
        return self.part_priors

    @property
    def acting_parts(self) -> tuple[ActingSkill, ...]:
        """The parts."""
        return self.parts

    @property
    def outer_speed(self) -> float:
        """The speed of the whole."""
        return self.speed

    @property
    def reselects(self) -> bool:
        """Whether the gate is instantaneous."""
        return combine_gate(self.gate).reselects

    @property
    def influences(self) -> tuple[GaussianMixture, ...]:
        """The mixture of each part whose value, times the prior, decides which one acts."""
        return self.regions or tuple(part.density for part in self.parts)

    @property
    def part_attractors(self) -> FloatArray:
        """The attractor of each part. Shape (number of parts, d)."""
        return np.stack([part.attractor for part in self.parts])

    @property
    def attractors(self) -> FloatArray:
        """The attractor of each part, or the one that all share. Shape (n, d)."""
        ends = self.part_attractors
        return ends[:1] if self.aligned else ends

    @property
    def aligned(self) -> bool:
        """Whether all parts share one attractor."""
        ends = self.part_attractors
        return bool((ends == ends[0]).all())

    def part_scores(self, positions: npt.ArrayLike) -> FloatArray:
        """Return log βᵢ + log rᵢ(ξ) for positions (n, d). Shape (n, parts); the largest part acts."""
        return self._scores(self.space.states(positions))

    def _scores(self, states: FloatArray) -> FloatArray:
        if self._one_chart:
            return self._densities.scores(self.parts[0].charted(states)).T
        logs = zip(self.parts, self.influences, np.log(self.part_priors), strict=True)
        return np.stack([log + one.log_density(part.charted(states)) for part, one, log in logs], axis=1)

    def part_at(self, states: npt.ArrayLike) -> IntArray:
        """Return the index of the part whose region each state (n, d) lies in. Shape (n,)."""
        return np.asarray(np.argmax(self.part_scores(states), axis=1), dtype=np.int64)

    def part_weights_at(self, states: FloatArray) -> FloatArray:
        """Return βᵢ rᵢ / Σⱼ βⱼ rⱼ at states (n, d): the largest part acts alone. Shape (n, parts)."""
        return softmax(self.part_scores(states).T).T

    def carried(self, target: FloatArray, goal: FloatArray) -> CombinedSkill:
        """Return the same motions, moved as a target is to a goal: attractors and regions together."""
        offset = self.space.anchor(goal) - self.space.anchor(target)
        return replace(
            self,
            parts=tuple(part.carried(target, goal) for part in self.parts),
            regions=tuple(region.translated(offset) for region in self.regions),
        )

    def selected(self, state: FloatArray) -> int:
        """Return the index of the part whose region one state (d,) lies in."""
        if self._one_chart:
            return int(self._densities.shares(self.parts[0].charted(state)).argmax())
        return int(self._scores(state[None])[0].argmax())
