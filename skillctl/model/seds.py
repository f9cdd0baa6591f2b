"""A learned skill: one stable mixture of linear systems (SEDS)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray, Frozen, frozen_array, require_moderate, require_spd
from skillctl.errors import InvalidModelError
from skillctl.model.coordinates.chain import IDENTITY, Chain
from skillctl.model.gated import GatedField
from skillctl.model.lyapunov import QuadraticForm
from skillctl.model.mixture import GaussianMixture
from skillctl.model.skill import ActingSkill, Kind, require_speed
from skillctl.model.space import Space


@dataclass(frozen=True, eq=False, slots=True)
class SedsSkill(Frozen, ActingSkill):
    r"""A stable dynamical system learned from demonstrations: ξ̇ = α Σₖ hₖ(ξ) Aₖ (ξ − ξ*).

    hₖ(ξ) = πₖ N(ξ; μₖ, Σₖ) / Σⱼ πⱼ N(ξ; μⱼ, Σⱼ). In coordinates other than the identity all of this, but the
    position density, is said of y = a + c(x); the density is said of the charted state a + x. The class holds
    whatever matrices it is given; whether they are stable ``skillctl.stability`` decides; nothing assumes it.

    Attributes:
        priors, means, covariances: πₖ (K,), μₖ (K, d), Σₖ (K, d, d) of the gates hₖ.
        system_matrices: Aₖ, shape (K, d, d), [1/s].
        residual_covariances: Cₖ of the velocity around Aₖ(ξ − ξ*), shape (K, d, d).
        attractor: ξ*, shape (d,).
        lyapunov: P ≻ 0 of V = (ξ − ξ*)ᵀ P (ξ − ξ*), shape (d, d).
        density: Position density p(ξ) of the demonstrations: where the skill knows what it is doing.
        space: Names, unit and frame of the state.
        speed: α > 0, a factor on all velocities.
        coordinates: c, on offsets from the attractor.

    References:
        Eq. 3–5 of the paper; Aₖ is stored rather than derived from a joint covariance, so that what is
        proved is what is executed (ours).
    """

    kind: ClassVar[Kind] = "seds"
    parts: ClassVar[tuple[ActingSkill, ...]] = ()
    gate: ClassVar[str] = ""
    parameters: ClassVar[Mapping[str, float]] = MappingProxyType({})

    priors: FloatArray
    means: FloatArray
    covariances: FloatArray
    system_matrices: FloatArray
    residual_covariances: FloatArray
    attractor: FloatArray
    lyapunov: FloatArray
    density: GaussianMixture
    space: Space
    speed: float = 1.0
    coordinates: Chain = IDENTITY
    form: QuadraticForm = field(init=False, repr=False)
    gated: GatedField = field(init=False, repr=False)

    def __post_init__(self) -> None:
        k, d = frozen_array("means", self.means, (None, None)).shape
        shapes = {
            "priors": (k,),
            "means": (k, d),
            "covariances": (k, d, d),
            "system_matrices": (k, d, d),
            "residual_covariances": (k, d, d),
            "attractor": (d,),
            "lyapunov": (d, d),
        }
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), shape))
        require_spd("residual_covariances", self.residual_covariances)
        object.__setattr__(self, "form", QuadraticForm(self.lyapunov))
        require_moderate("system_matrices", self.system_matrices)
        require_speed(self.speed, self.system_matrices)
        if self.density.dimension != d or self.space.dimension != d:
            raise InvalidModelError(f"density and space: must have the {d} dimensions of the means.")
        gates = GaussianMixture(self.priors, self.means, self.covariances)  # checks priors and covariances
        coefficients, peak = gates.coefficients(self.anchor), float(gates.log_peaks.max())
        with np.errstate(over="ignore", invalid="ignore"):
            known = self.density.log_density(self.anchor[None])
        if not np.isfinite(known).all():
            raise InvalidModelError("density: too large or too small to compute with.")
        compiled = GatedField(coefficients, peak, self.component_matrices, self.anchor)
        object.__setattr__(self, "gated", compiled)

    @property
    def component_matrices(self) -> FloatArray:
        """The matrices that act: α Aₖ, shape (K, d, d), [1/s]."""
        return self.speed * self.system_matrices

    @property
    def leaves(self) -> tuple[SedsSkill, ...]:
        """The learned skills this one is made of: itself."""
        return (self,)

    @property
    def shares(self) -> FloatArray:
        """Of no parts."""
        return np.empty(0)

    def responsibilities(self, positions: npt.ArrayLike) -> FloatArray:
        """Return hₖ(ξ) for positions (n, d). Shape (n, K); rows sum to one at any distance."""
        return self.gated.gates(self.lifted(self.space.states(positions)))

    def mixed(self, h: FloatArray, charted: FloatArray) -> FloatArray:
        """Return h: a leaf's own weights."""
        return h

    def part_weights_at(self, states: FloatArray) -> FloatArray:
        """Return one for each state (n, d): a learned skill moves alone. Shape (n, 1)."""
        return np.ones((len(states), 1))

    def _moved_at(self, y: FloatArray, charted: FloatArray) -> FloatArray:
        return self.gated.velocity(y)

    def _moved(self, y: FloatArray, charted: FloatArray) -> FloatArray:
        return self.gated.velocities(y)

    def accelerated(self, factor: float) -> SedsSkill:
        """Return the same motion, faster by a positive factor."""
        return self if factor == 1 else replace(self, speed=self.speed * factor)

    def carried(self, target: FloatArray, goal: FloatArray) -> SedsSkill:
        """Return the same motion, moved as a target is to a goal: attractor and all means move together."""
        attractor = self.space.carried(self.attractor, target, goal)
        offset = self.space.anchor(goal) - self.space.anchor(target)
        return replace(
            self, means=self.means + offset, attractor=attractor, density=self.density.translated(offset)
        )

    def with_leaves(self, change: Callable[[SedsSkill], SedsSkill]) -> SedsSkill:
        """Return the changed leaf."""
        return change(self)
