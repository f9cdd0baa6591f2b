"""Many mergers of the same parts, followed at once: they differ in weights and factors, not in fields."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np

from skillctl.adapt.follow import scaled_components
from skillctl.arrays import FloatArray
from skillctl.model.gated import StackedGates
from skillctl.model.gates import gate_parameters, merge_gate
from skillctl.model.merged import MergedSkill
from skillctl.model.mixture import log_sum_exp, softmax
from skillctl.model.skill import ActingSkill

GRIDS = {2: 12, 3: 6, 4: 4, 5: 3}  # number of parts → into how many steps a weight is divided
CHECKED = 25  # steps between two looks at whether all have arrived


class Blend(NamedTuple):
    """One merger: weights of the parts (N,), summing to one, and a factor of each component (K,)."""

    weights: FloatArray
    factors: FloatArray


class Blends:
    """Parts with one attractor, one P and one chart, and what their mergers do.

    Every merger of them, with any weights, is proved by the proof of its parts.

    Attributes:
        parts: The parts.
        owners: Part of each component. Shape (K,).
        periods: Longest contracting step of each component under the common P, [s]. Shape (K,).
    """

    def __init__(self, parts: Sequence[ActingSkill]) -> None:
        first = parts[0]
        self.parts = tuple(parts)
        self._goal, self._anchor, self._coordinates = first.attractor, first.anchor, first.coordinates
        self._space = first.space
        self._gates = StackedGates([leaf.gated for part in parts for leaf in part.leaves])
        matrices = np.concatenate([part.component_matrices for part in parts])
        self._matrices = matrices.reshape(len(matrices), -1)
        self.owners = np.repeat(np.arange(len(parts)), [part.n_components for part in parts])
        self._starts = np.searchsorted(self.owners, np.arange(1, len(parts)))
        self._nested = any(part.parts for part in parts)
        self.periods = np.concatenate([part.form.periods(part.component_matrices) for part in parts])

    def plain(self, weights: FloatArray) -> Blend:
        """Return the merger with these weights (N,) and no factors."""
        return Blend(weights, np.ones(len(self.owners)))

    def period(self, blend: Blend) -> float:
        """Return the longest step at which a merger contracts, an estimate, [s]."""
        used = blend.weights[self.owners] > 0
        return float((self.periods[used] / blend.factors[used]).min())

    def skill(self, blend: Blend, gate: str, speed: float) -> MergedSkill:
        """Return a merger as a skill, without the parts of no weight."""
        used = np.flatnonzero(blend.weights)
        parts = [self.parts[i] for i in used]
        if (blend.factors != 1).any():
            parts = [scaled_components(self.parts[i], blend.factors[self.owners == i]) for i in used]
        weights = blend.weights[used] / blend.weights[used].sum()
        return MergedSkill(tuple(parts), weights, gate, speed)

    def follow(
        self, blends: Sequence[Blend], gate: str, starts: FloatArray, step: float, count: int, near: float
    ) -> FloatArray:
        """Return the motions of mergers from starts: y⁺ = y + Δt ẏ, as a controller of that period moves.

        Args:
            blends: C mergers.
            gate: Of all of them.
            starts: Shape (n, d).
            step: Δt, [s].
            count: Most steps; fewer if all have arrived.
            near: Distance to the target at which a motion has arrived, in the unit of the space.

        Returns:
            States, shape (C, n, T, d).
        """
        chosen = merge_gate(gate)
        parameters, n = gate_parameters(chosen, {}), len(starts)
        weights = np.repeat(np.stack([blend.weights for blend in blends]), n, axis=0)
        factors = np.repeat(np.stack([blend.factors for blend in blends]), n, axis=0)
        scaled = bool((factors != 1).any())
        offsets = self._space.offsets(np.tile(starts, (len(blends), 1)), self._goal)
        y = self._coordinates.forward(offsets)
        kept = [offsets]
        for number in range(count):
            charted = self._anchor + offsets
            h = self._own(self._gates.many(y.T), charted)
            shares = partial(self._shares, charted, weights)
            h = chosen.weigh(h, self.owners, weights, shares, parameters)
            if scaled:
                h = h * factors
            matrices = (h @ self._matrices).reshape(len(y), y.shape[1], -1)
            y = y + step * np.einsum("nij,nj->ni", matrices, y)
            offsets = self._coordinates.back(y)
            kept.append(offsets)
            if number % CHECKED == 0 and np.linalg.norm(offsets, axis=1).max() < near:
                break
        states = self._space.placed(np.stack(kept, axis=1), self._goal)
        return states.reshape(len(blends), n, len(kept), -1)

    def _own(self, h: FloatArray, charted: FloatArray) -> FloatArray:
        """Return the weights of components within their part: merged skills mix their own first."""
        if not self._nested:
            return h
        blocks = np.split(h, self._starts, axis=1)
        return np.concatenate([p.mixed(b, charted) for p, b in zip(self.parts, blocks, strict=True)], axis=1)

    def _shares(self, charted: FloatArray, weights: FloatArray) -> FloatArray:
        """Return αᵢ pᵢ / Σⱼ αⱼ pⱼ, with the weights of each state. Shape (n, N)."""
        logs = np.stack([log_sum_exp(part.density.log_joint(charted)) for part in self.parts])
        with np.errstate(divide="ignore"):  # no weight: never acts
            return softmax(logs + np.log(weights.T)).T


def weight_grid(count: int) -> list[FloatArray]:
    """Return weights of ``count`` parts on a grid over the simplex, without the corners; equal ones first."""
    steps = GRIDS.get(count, 2)
    found = [
        np.array(split) / steps
        for split in product(range(steps + 1), repeat=count)
        if sum(split) == steps and max(split) < steps
    ]
    return [np.full(count, 1 / count), *(w for w in found if np.ptp(w) > 0)]


def weight_neighbours(weights: FloatArray, moved: float) -> list[FloatArray]:
    """Return weights with a little moved from one part to another; two parts or more keep some."""
    found = []
    for giver, taker in product(range(len(weights)), repeat=2):
        if giver != taker and weights[giver] > 0:
            other = weights.copy()
            other[giver], other[taker] = max(weights[giver] - moved, 0.0), weights[taker]
            other[taker] += weights[giver] - other[giver]
            if np.count_nonzero(other) > 1:
                found.append(other / other.sum())
    return found
