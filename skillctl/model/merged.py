"""A merged skill: several skills acting together on one attractor (Section 3.1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from types import MappingProxyType
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray, Frozen, IntArray, frozen_array, require_simplex
from skillctl.errors import InvalidModelError, UsageError
from skillctl.model.composite import Composite, require_parts
from skillctl.model.coordinates.chain import Chain
from skillctl.model.gated import StackedDensities, StackedGates
from skillctl.model.gates import Weighting, gate_parameters, merge_gate
from skillctl.model.lyapunov import QuadraticForm
from skillctl.model.mixture import BLOCK, GaussianMixture, joined, softmax
from skillctl.model.skill import ActingSkill, Kind


@dataclass(frozen=True, eq=False, slots=True)
class MergedSkill(Frozen, Composite, ActingSkill):
    """Several skills acting together on one attractor, with one common Lyapunov matrix.

    ξ̇ = α Σᵢ Σₖ h̃ₖⁱ(ξ) Aₖⁱ (ξ − ξ*), where h̃ ≥ 0 sums to one over all components:

    - ``superposition``: h̃ = αᵢ hₖⁱ (Eq. 7 and 8);
    - ``density``: h̃ = αᵢ pᵢ / Σⱼ αⱼ pⱼ · hₖⁱ (Eq. 8 read as densities);
    - ``experts``: h̃ = αᵢ (hₖⁱ)^γ / Σⱼ Σₗ αⱼ (hₗʲ)^γ (Eq. 9), γ = sharpness ≥ 1.

    Attributes:
        parts: Learned or merged skills with equal attractor, Lyapunov matrix, coordinates and space.
        part_weights: αᵢ > 0, summing to one. Shape (number of parts,).
        gate: One of ``model.gates.MERGE_GATES``.
        speed: α > 0, a factor on all velocities.
        parameters: Of the gate, by name; defaults where none is given.
    """

    kind: ClassVar[Kind] = "merged"

    parts: tuple[ActingSkill, ...]
    part_weights: FloatArray
    gate: str = "superposition"
    speed: float = 1.0
    parameters: Mapping[str, float] = field(default_factory=dict)
    density: GaussianMixture = field(init=False, repr=False)
    _gates: StackedGates = field(init=False, repr=False)
    _matrices: FloatArray = field(init=False, repr=False)
    _owners: IntArray = field(init=False, repr=False)
    _nested: bool = field(init=False, repr=False)
    _weigh: Weighting = field(init=False, repr=False)
    _densities: StackedDensities = field(init=False, repr=False)

    def __post_init__(self) -> None:
        require_parts(self.parts, self.speed)
        weights = frozen_array("part_weights", self.part_weights, (len(self.parts),))
        require_simplex("part_weights", weights)
        object.__setattr__(self, "part_weights", weights)
        try:
            gate = merge_gate(self.gate)
            parameters = gate_parameters(gate, self.parameters)
        except UsageError as error:
            raise InvalidModelError(str(error)) from error
        object.__setattr__(self, "parameters", MappingProxyType(parameters))
        object.__setattr__(self, "_weigh", gate.weigh)
        object.__setattr__(self, "_nested", any(part.parts for part in self.parts))
        first = self.parts[0]
        for part in self.parts[1:]:
            if (part.attractor != first.attractor).any() or part.form != first.form:
                raise InvalidModelError("parts: must share one attractor and one Lyapunov matrix.")
            if part.coordinates != first.coordinates:
                raise InvalidModelError("parts: must share their coordinates.")
        densities = [part.density for part in self.parts]
        object.__setattr__(self, "density", joined(densities, weights))
        object.__setattr__(self, "_gates", StackedGates([leaf.gated for leaf in self.leaves]))
        object.__setattr__(self, "_matrices", self.component_matrices.reshape(-1, self.dimension**2))
        counts = [part.n_components for part in self.parts]
        object.__setattr__(self, "_owners", np.repeat(np.arange(len(counts)), counts))
        object.__setattr__(self, "_densities", StackedDensities(densities, weights))

    @property
    def shares(self) -> FloatArray:
        """The part weights."""
        return self.part_weights

    @property
    def attractor(self) -> FloatArray:
        """ξ*, shape (d,)."""
        return self.parts[0].attractor

    @property
    def lyapunov(self) -> FloatArray:
        """The common P, shape (d, d)."""
        return self.parts[0].lyapunov

    @property
    def form(self) -> QuadraticForm:
        """The common V."""
        return self.parts[0].form

    @property
    def coordinates(self) -> Chain:
        """The common c."""
        return self.parts[0].coordinates

    @property
    def component_matrices(self) -> FloatArray:
        """The matrices that act, with every speed on the way multiplied in. Shape (K, d, d), [1/s]."""
        return self.speed * np.concatenate([part.component_matrices for part in self.parts])

    def responsibilities(self, positions: npt.ArrayLike) -> FloatArray:
        """Return h̃ for positions (n, d), parts side by side. Shape (n, K); rows sum to one."""
        states = self.space.states(positions)
        offsets = self.lifted(states).T - self._gates.logits.origin[:, None]
        return self.mixed(self._gates.many(offsets), self.charted(states))

    def mixed(self, h: FloatArray, charted: FloatArray) -> FloatArray:
        """Return h̃ of all components from their weights within their own leaf; see ``ActingSkill``."""
        if self._nested:  # merged skills among the parts mix their own first
            blocks = np.split(h, np.flatnonzero(np.diff(self._owners)) + 1, axis=-1)
            h = np.concatenate(
                [p.mixed(b, charted) for p, b in zip(self.parts, blocks, strict=True)], axis=-1
            )
        shares = partial(self._part_shares, charted)
        return self._weigh(h, self._owners, self.part_weights, shares, self.parameters)

    def _part_shares(self, charted: FloatArray) -> FloatArray:
        """Return αᵢ pᵢ / Σⱼ αⱼ pⱼ at one or many charted states (..., d). Shape (..., parts)."""
        densities = self._densities
        return densities.shares(charted) if charted.ndim == 1 else softmax(densities.scores(charted)).T

    def part_weights_at(self, states: FloatArray) -> FloatArray:
        """Return each part's share of the motion (its components' weights summed). Shape (n, parts)."""
        starts = np.searchsorted(self._owners, np.arange(len(self.parts)))
        return np.asarray(np.add.reduceat(self.responsibilities(states), starts, axis=1))

    def _moved_at(self, y: FloatArray, charted: FloatArray) -> FloatArray:
        offset = y - self._gates.logits.origin
        weights = self.mixed(self._gates.at(offset), charted)
        velocity: FloatArray = weights.dot(self._matrices).reshape(y.size, -1).dot(offset)
        return velocity

    def _moved(self, y: FloatArray, charted: FloatArray) -> FloatArray:
        velocities = np.empty_like(y)
        for start in range(0, len(y), BLOCK):
            offsets = y[start : start + BLOCK] - self._gates.logits.origin
            weights = self.mixed(self._gates.many(offsets.T), charted[start : start + BLOCK])
            matrices = (weights @ self._matrices).reshape(-1, *[self.dimension] * 2)
            velocities[start : start + BLOCK] = np.einsum("nij,nj->ni", matrices, offsets)
        return velocities

    def accelerated(self, factor: float) -> MergedSkill:
        """Return the same motion, faster by a positive factor."""
        return self if factor == 1 else replace(self, speed=self.speed * factor)
