"""The skill tree: a SEDS skill, several merged into one, several combined region by region."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray, IntArray, frozen_array, require_simplex, require_spd
from skillctl.errors import InvalidModelError, UsageError
from skillctl.model.demonstration import StateSpace
from skillctl.model.gated import GatedField
from skillctl.model.mixture import BLOCK, GaussianMixture, softmax

MergeGate: TypeAlias = Literal["superposition", "density", "experts"]
CombineGate: TypeAlias = Literal["latched", "instantaneous"]
MERGE_GATES: tuple[MergeGate, ...] = ("superposition", "density", "experts")
COMBINE_GATES: tuple[CombineGate, ...] = ("latched", "instantaneous")


@dataclass(frozen=True, eq=False, slots=True)
class SedsSkill:
    r"""A stable dynamical system learned from demonstrations: ξ̇ = α Σₖ hₖ(ξ) Aₖ (ξ − ξ*).

    hₖ(ξ) = πₖ N(ξ; μₖ, Σₖ) / Σⱼ πⱼ N(ξ; μⱼ, Σⱼ). The class holds whatever matrices it is given;
    whether they are stable is decided by ``skillctl.stability``, never assumed here.

    Attributes:
        priors, means, covariances: πₖ (K,), μₖ (K, d), Σₖ (K, d, d) of the gates hₖ.
        system_matrices: Aₖ, shape (K, d, d), [1/s].
        residual_covariances: Cₖ of the velocity around Aₖ(ξ − ξ*), shape (K, d, d).
        attractor: ξ*, shape (d,).
        lyapunov: P ≻ 0 of V = (ξ − ξ*)ᵀ P (ξ − ξ*), shape (d, d).
        density: Position density p(ξ) of the demonstrations: where the skill knows what it is doing.
        space: Names, unit and frame of the state.
        speed: α > 0, a factor on all velocities.

    References:
        Eq. 3–5 of the paper; Aₖ is stored rather than derived from a joint covariance, so that what is
        proved is what is executed (ours).
    """

    priors: FloatArray
    means: FloatArray
    covariances: FloatArray
    system_matrices: FloatArray
    residual_covariances: FloatArray
    attractor: FloatArray
    lyapunov: FloatArray
    density: GaussianMixture
    space: StateSpace
    speed: float = 1.0
    _field: GatedField = field(init=False, repr=False)

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
        require_spd("lyapunov", self.lyapunov)
        _require_speed(self.speed, self.system_matrices)
        if self.density.dimension != d or self.space.dimension != d:
            raise InvalidModelError(f"density and space: must have the {d} dimensions of the means.")
        gates = GaussianMixture(self.priors, self.means, self.covariances)  # checks priors and covariances
        coefficients, peak = gates.coefficients(self.attractor), float(gates.log_peaks.max())
        with np.errstate(over="ignore", invalid="ignore"):
            known = self.density.log_density(self.attractor[None])
        if not np.isfinite(known).all():
            raise InvalidModelError("density: too large or too small to compute with.")
        compiled = GatedField(coefficients, peak, self.component_matrices, self.attractor)
        object.__setattr__(self, "_field", compiled)

    @property
    def dimension(self) -> int:
        """Number of coordinates of a state, d."""
        return int(self.means.shape[1])

    @property
    def n_components(self) -> int:
        """Number of components, K."""
        return int(self.means.shape[0])

    @property
    def component_matrices(self) -> FloatArray:
        """The matrices that act: α Aₖ, shape (K, d, d), [1/s]."""
        return self.speed * self.system_matrices

    @property
    def leaves(self) -> tuple[SedsSkill, ...]:
        """The SEDS skills this one is made of: itself."""
        return (self,)

    def responsibilities(self, positions: FloatArray) -> FloatArray:
        """Return hₖ(ξ) for positions (n, d). Shape (n, K); rows sum to one at any distance."""
        return self._field.gates(np.asarray(positions, dtype=np.float64))

    def velocity(self, positions: npt.ArrayLike) -> FloatArray:
        """Return ξ̇ = f(ξ) for one state (d,) or many (n, d), in the same shape, per second."""
        x = np.asarray(positions, dtype=np.float64)
        return self._field.velocity(x) if x.ndim == 1 else self._field.velocities(x)

    def translated(self, offset: FloatArray) -> SedsSkill:
        """Return the same motion, moved by ``offset`` (d,): attractor and all means move together."""
        return replace(
            self,
            means=self.means + offset,
            attractor=self.attractor + offset,
            density=self.density.translated(offset),
        )


class _Tree:
    """What all skills made of parts have in common."""

    __slots__ = ()
    parts: tuple[SedsSkill | MergedSkill, ...]

    @property
    def dimension(self) -> int:
        """Number of coordinates of a state, d."""
        return self.parts[0].dimension

    @property
    def n_components(self) -> int:
        """Number of components of all parts together."""
        return sum(part.n_components for part in self.parts)

    @property
    def space(self) -> StateSpace:
        """Names, unit and frame of the state."""
        return self.parts[0].space

    @property
    def leaves(self) -> tuple[SedsSkill, ...]:
        """The SEDS skills this one is made of, from left to right."""
        return tuple(leaf for part in self.parts for leaf in part.leaves)


@dataclass(frozen=True, eq=False, slots=True)
class MergedSkill(_Tree):
    """Several skills acting together on one attractor, with one common Lyapunov matrix.

    ξ̇ = α Σᵢ Σₖ h̃ₖⁱ(ξ) Aₖⁱ (ξ − ξ*), where h̃ ≥ 0 sums to one over all components:

    - ``superposition``: h̃ = αᵢ hₖⁱ (Eq. 7 and 8);
    - ``density``: h̃ = αᵢ pᵢ / Σⱼ αⱼ pⱼ · hₖⁱ (Eq. 8 read as densities);
    - ``experts``: h̃ = αᵢ (hₖⁱ)^γ / Σⱼ Σₗ αⱼ (hₗʲ)^γ (Eq. 9), γ = sharpness ≥ 1.

    Attributes:
        parts: SEDS or merged skills with equal attractor, Lyapunov matrix and space.
        part_weights: αᵢ > 0, summing to one. Shape (number of parts,).
        gate, sharpness: See above; sharpness matters to ``experts`` alone.
        speed: α > 0, a factor on all velocities.
    """

    parts: tuple[SedsSkill | MergedSkill, ...]
    part_weights: FloatArray
    gate: MergeGate = "superposition"
    sharpness: float = 1.0
    speed: float = 1.0
    density: GaussianMixture = field(init=False, repr=False)
    _matrices: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        _require_parts(self.parts, (SedsSkill, MergedSkill))
        weights = frozen_array("part_weights", self.part_weights, (len(self.parts),))
        require_simplex("part_weights", weights)
        object.__setattr__(self, "part_weights", weights)
        if self.gate not in MERGE_GATES:
            raise InvalidModelError(f"gate: one of {', '.join(MERGE_GATES)}, not {self.gate!r}.")
        for part in self.parts:
            _require_speed(self.speed, part.component_matrices)
        if not (np.isfinite(self.sharpness) and self.sharpness >= 1):
            raise InvalidModelError("sharpness: must be at least 1.")
        first = self.parts[0]
        for part in self.parts[1:]:
            if (part.attractor != first.attractor).any() or (part.lyapunov != first.lyapunov).any():
                raise InvalidModelError("parts: must share one attractor and one Lyapunov matrix.")
        d = self.dimension
        object.__setattr__(self, "density", _joined_density(self.parts, weights))
        object.__setattr__(self, "_matrices", self.component_matrices.reshape(-1, d * d))

    @property
    def attractor(self) -> FloatArray:
        """ξ*, shape (d,)."""
        return self.parts[0].attractor

    @property
    def lyapunov(self) -> FloatArray:
        """The common P, shape (d, d)."""
        return self.parts[0].lyapunov

    @property
    def component_matrices(self) -> FloatArray:
        """The matrices that act, with every speed on the way multiplied in. Shape (K, d, d), [1/s]."""
        return self.speed * np.concatenate([part.component_matrices for part in self.parts])

    def responsibilities(self, positions: FloatArray) -> FloatArray:
        """Return h̃ for positions (n, d), parts side by side. Shape (n, K); rows sum to one."""
        x = np.asarray(positions, dtype=np.float64)
        within = [part.responsibilities(x) for part in self.parts]
        if self.gate == "experts":
            joined = np.hstack(within)
            # Relative to the largest, so that no sharpness makes all powers vanish.
            powers = (joined / joined.max(axis=1, keepdims=True)) ** self.sharpness
            powers *= np.repeat(self.part_weights, [part.n_components for part in self.parts])
            return np.asarray(powers / powers.sum(axis=1, keepdims=True))
        return np.hstack([g[:, None] * h for g, h in zip(self.part_gates(x).T, within, strict=True)])

    def part_gates(self, positions: FloatArray) -> FloatArray:
        """Return each part's share of the motion (its components' weights summed). Shape (n, parts)."""
        if self.gate == "superposition":
            return np.tile(self.part_weights, (len(positions), 1))
        if self.gate == "density":
            scores = np.stack([part.density.log_density(positions) for part in self.parts])
            return softmax(scores + np.log(self.part_weights)[:, None]).T
        starts = np.cumsum([0] + [part.n_components for part in self.parts[:-1]])
        return np.asarray(np.add.reduceat(self.responsibilities(positions), starts, axis=1))

    def velocity(self, positions: npt.ArrayLike) -> FloatArray:
        """Return ξ̇ = f(ξ) for one state (d,) or many (n, d), in the same shape, per second."""
        x = np.asarray(positions, dtype=np.float64)
        if x.ndim == 1:
            return np.asarray(self.velocity(x[None])[0])
        velocities = np.empty_like(x)
        for start in range(0, len(x), BLOCK):
            block = x[start : start + BLOCK]
            matrices = (self.responsibilities(block) @ self._matrices).reshape(-1, *[self.dimension] * 2)
            velocities[start : start + BLOCK] = np.einsum("nij,nj->ni", matrices, block - self.attractor)
        return velocities

    def translated(self, offset: FloatArray) -> MergedSkill:
        """Return the same motion, moved by ``offset`` (d,)."""
        return replace(self, parts=tuple(part.translated(offset) for part in self.parts))


@dataclass(frozen=True, eq=False, slots=True)
class CombinedSkill(_Tree):
    """Several skills of which one alone acts at any time (Section 3.2).

    Part i = argmax_j (log βⱼ + log pⱼ(ξ)) acts. ``latched``: chosen at the start, kept until the state
    jumps by more than ``disturbance_distance`` from where the last command should have led (the
    ``Controller`` owns that memory). ``instantaneous``: chosen anew at every instant.

    Attributes:
        parts: SEDS or merged skills of one space; attractors may differ (multi-stable) or agree (aligned).
        part_priors: βᵢ > 0, summing to one. Shape (number of parts,).
        gate: See above.
        disturbance_distance: In the unit of the space.
        speed: α > 0, a factor on all velocities.
    """

    parts: tuple[SedsSkill | MergedSkill, ...]
    part_priors: FloatArray
    gate: CombineGate = "latched"
    disturbance_distance: float = 0.02
    speed: float = 1.0

    def __post_init__(self) -> None:
        _require_parts(self.parts, (SedsSkill, MergedSkill))
        priors = frozen_array("part_priors", self.part_priors, (len(self.parts),))
        require_simplex("part_priors", priors)
        object.__setattr__(self, "part_priors", priors)
        if self.gate not in COMBINE_GATES:
            raise InvalidModelError(f"gate: one of {', '.join(COMBINE_GATES)}, not {self.gate!r}.")
        for part in self.parts:
            _require_speed(self.speed, part.component_matrices)
        _require_positive("disturbance_distance", self.disturbance_distance)

    @property
    def attractors(self) -> FloatArray:
        """The attractor of each part. Shape (number of parts, d)."""
        return np.stack([part.attractor for part in self.parts])

    @property
    def aligned(self) -> bool:
        """Whether all parts share one attractor."""
        return bool((self.attractors == self.attractors[0]).all())

    def part_scores(self, positions: FloatArray) -> FloatArray:
        """Return log βᵢ + log pᵢ(ξ) for positions (n, d). Shape (n, parts); the largest part acts."""
        scores = np.stack([part.density.log_density(positions) for part in self.parts], axis=1)
        return np.asarray(scores + np.log(self.part_priors))

    def part_at(self, positions: npt.ArrayLike) -> IntArray:
        """Return the index of the part whose region each position (n, d) lies in. Shape (n,)."""
        scores = self.part_scores(np.asarray(positions, dtype=np.float64))
        return np.asarray(np.argmax(scores, axis=1), dtype=np.int64)

    def velocity(self, positions: npt.ArrayLike, parts: IntArray | None = None) -> FloatArray:
        """Return ξ̇ for one state (d,) or many (n, d), per second.

        Args:
            positions: State or states.
            parts: Which part acts on each state, shape (n,). Default: the part of the state's region,
                which is what a latched skill does at a start, and an instantaneous one always.
        """
        x = np.asarray(positions, dtype=np.float64)
        if x.ndim == 1:
            return np.asarray(self.velocity(x[None], parts)[0])
        chosen = self.part_at(x) if parts is None else parts
        velocities = np.empty_like(x)
        for index in np.unique(chosen):
            mask = chosen == index
            velocities[mask] = self.speed * self.parts[index].velocity(x[mask])
        return velocities

    def translated(self, offset: FloatArray) -> CombinedSkill:
        """Return the same motion, moved by ``offset`` (d,): all attractors move together."""
        return replace(self, parts=tuple(part.translated(offset) for part in self.parts))


Skill: TypeAlias = SedsSkill | MergedSkill | CombinedSkill


def attractors_of(skill: Skill) -> FloatArray:
    """Return every state at which the skill can come to rest. Shape (n, d); one row unless multi-stable."""
    if isinstance(skill, CombinedSkill):
        return skill.attractors[:1] if skill.aligned else skill.attractors
    return skill.attractor[None]


def density_of(skill: Skill) -> GaussianMixture:
    """Return the position density of all that the skill was taught."""
    if isinstance(skill, CombinedSkill):
        return _joined_density(skill.parts, skill.part_priors)
    return skill.density


def retargeted(skill: Skill, target: npt.ArrayLike) -> Skill:
    """Return the same motion towards ``target`` (d,); all guarantees stay (theory: the motion is relative).

    Raises:
        UsageError: Wrong number of coordinates, not finite, or a skill with several attractors.
    """
    goal = np.asarray(target, dtype=np.float64)
    attractors = attractors_of(skill)
    if goal.shape != (skill.dimension,) or not np.isfinite(goal).all():
        raise UsageError(f"target: expected {skill.dimension} finite numbers, got {np.size(goal)}.")
    if len(attractors) > 1:
        raise UsageError(
            f"this skill has {len(attractors)} attractors; it cannot be moved to one target.",
            hint="Combine its parts with --align to give them one target.",
        )
    return _with_attractor(skill.translated(goal - attractors[0]), goal)


def _with_attractor(skill: Skill, attractor: FloatArray) -> Skill:
    """Set the attractor exactly: ξ* + (target − ξ*) may differ from the target in its last bit."""
    if isinstance(skill, SedsSkill):
        return replace(skill, attractor=attractor)
    parts = tuple(_with_attractor(part, attractor) for part in skill.parts)
    return replace(skill, parts=parts)  # type: ignore[arg-type]


def _joined_density(parts: tuple[SedsSkill | MergedSkill, ...], weights: FloatArray) -> GaussianMixture:
    priors = np.concatenate([w * part.density.priors for w, part in zip(weights, parts, strict=True)])
    return GaussianMixture(
        priors / priors.sum(),
        np.concatenate([part.density.means for part in parts]),
        np.concatenate([part.density.covariances for part in parts]),
    )


def _require_parts(parts: tuple[Skill, ...], kinds: tuple[type, ...]) -> None:
    if not parts:
        raise InvalidModelError("parts: at least one is needed.")
    for part in parts:
        if not isinstance(part, kinds):
            raise InvalidModelError("parts: a combined skill cannot be a part of another skill.")
        if part.space != parts[0].space:
            raise InvalidModelError(f"parts: state spaces differ ({part.space} and {parts[0].space}).")


def _require_speed(speed: float, matrices: FloatArray) -> None:
    _require_positive("speed", speed)
    with np.errstate(over="ignore"):
        if not np.isfinite(speed * matrices).all():
            raise InvalidModelError(f"speed: {speed!r} times the system matrices is beyond float64.")


def _require_positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise InvalidModelError(f"{name}: must be a positive number, got {value!r}.")
