"""What every skill can do, whatever its kind; a skill is learned, merged or combined."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Literal, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from skillctl.arrays import FloatArray, IntArray, require_positive
from skillctl.errors import InvalidModelError, UsageError
from skillctl.model.coordinates.chain import Chain
from skillctl.model.lyapunov import QuadraticForm
from skillctl.model.mixture import GaussianMixture
from skillctl.model.space import Space

if TYPE_CHECKING:
    from skillctl.model.seds import SedsSkill

Kind: TypeAlias = Literal["seds", "merged", "combined"]
AnySkill = TypeVar("AnySkill", bound="Skill")


class Skill(ABC):
    """A motion ξ̇ = f(ξ). Only reading, writing and messages ask for its kind.

    Attributes:
        kind: ``seds`` (learned), ``merged`` or ``combined``.
        space: What a state is.
        parts: The skills this one is made of; none of a learned one.
        shares: Weight or prior of each part, summing to one. Shape (number of parts,).
        gate: How the parts act together; empty for a learned skill.
        parameters: Of the gate, by name.
        speed: α > 0, a factor on all velocities.
        density: Position density of all that the skill was taught.
        influences: A mixture for each acting part: the one of the largest value, times its share, acts.
        acting_parts: The parts of which one acts at a time; the skill itself unless it is combined.
        outer_speed: Factor on the velocity of each acting part.
        reselects: Whether the acting part is chosen at every instant.
        disturbance_distance: A jump of the state by more than this selects the acting part again.
        attractors: Every state at which the skill can come to rest, shape (n, d); one unless multi-stable.
        leaves: The learned skills this one is made of, from left to right.
    """

    __slots__ = ()
    kind: ClassVar[Kind]

    if (
        TYPE_CHECKING
    ):  # fields of some kinds, and properties of others: dataclasses would take them for defaults

        @property
        def space(self) -> Space: ...  # noqa: D102
        @property
        def parts(self) -> tuple[ActingSkill, ...]: ...  # noqa: D102
        @property
        def shares(self) -> FloatArray: ...  # noqa: D102
        @property
        def gate(self) -> str: ...  # noqa: D102
        @property
        def parameters(self) -> Mapping[str, float]: ...  # noqa: D102
        @property
        def speed(self) -> float: ...  # noqa: D102
        @property
        def density(self) -> GaussianMixture: ...  # noqa: D102
        @property
        def influences(self) -> tuple[GaussianMixture, ...]: ...  # noqa: D102
        @property
        def acting_parts(self) -> tuple[ActingSkill, ...]: ...  # noqa: D102
        @property
        def outer_speed(self) -> float: ...  # noqa: D102
        @property
        def reselects(self) -> bool: ...  # noqa: D102
        @property
        def disturbance_distance(self) -> float: ...  # noqa: D102
        @property
        def attractors(self) -> FloatArray: ...  # noqa: D102
        @property
        def leaves(self) -> tuple[SedsSkill, ...]: ...  # noqa: D102

    @property
    def dimension(self) -> int:
        """Number of coordinates of a state, d."""
        return self.space.dimension

    @property
    def n_components(self) -> int:
        """Number of components of all leaves together."""
        return sum(len(leaf.priors) for leaf in self.leaves)

    def velocity(self, states: npt.ArrayLike, parts: IntArray | int | None = None) -> FloatArray:
        """Return ξ̇ = f(ξ) for one state (d,) or many (n, d), in the same shape, per second.

        Args:
            states: State or states.
            parts: Index of the acting part, one for all or one for each state. Default: the part of the
                state's region, as at the start of a latched skill, and always for an instantaneous one.

        Raises:
            StateError: Not numbers, or of another dimension.
        """
        x = self.space.states(states)
        if x.ndim == 2:
            return self._velocities(x, None if parts is None else np.broadcast_to(parts, len(x)))
        return self.velocity_at(x, None if parts is None else int(np.ravel(parts)[0]))

    @abstractmethod
    def velocity_at(self, state: FloatArray, part: int | None = None) -> FloatArray:
        """Return ξ̇ for one state (d,), which is not checked: what a control loop calls."""

    @abstractmethod
    def _velocities(self, states: FloatArray, parts: IntArray | None) -> FloatArray:
        """Return ξ̇ for many states (n, d)."""

    @abstractmethod
    def part_at(self, states: npt.ArrayLike) -> IntArray:
        """Return the index of the acting part whose region each state (n, d) lies in. Shape (n,)."""

    @abstractmethod
    def selected(self, state: FloatArray) -> int:
        """Return the index of the acting part whose region one state (d,), not checked, lies in."""

    @abstractmethod
    def part_weights_at(self, states: FloatArray) -> FloatArray:
        """Return each part's share of the motion, or of the regions, at states (n, d). Shape (n, parts)."""

    @abstractmethod
    def translated(self: AnySkill, offset: FloatArray) -> AnySkill:
        """Return the same motion, moved by ``offset`` (d,): attractors and means move together."""

    @abstractmethod
    def with_leaves(self: AnySkill, change: Callable[[SedsSkill], SedsSkill]) -> AnySkill:
        """Return the same tree with every leaf changed, from left to right."""


class Composite(Skill):
    """A skill made of parts: what it takes over from them."""

    __slots__ = ()

    @property
    def space(self) -> Space:
        """Names, unit and frame of the state."""
        return self.parts[0].space

    @property
    def leaves(self) -> tuple[SedsSkill, ...]:
        """The learned skills this one is made of, from left to right."""
        return tuple(leaf for part in self.parts for leaf in part.leaves)

    def translated(self: AnySkill, offset: FloatArray) -> AnySkill:
        """Return the same motion, moved by ``offset`` (d,): all attractors move together."""
        return replace(self, parts=tuple(part.translated(offset) for part in self.parts))  # type: ignore[type-var]

    def with_leaves(self: AnySkill, change: Callable[[SedsSkill], SedsSkill]) -> AnySkill:
        """Return the same tree of changed leaves."""
        return replace(self, parts=tuple(part.with_leaves(change) for part in self.parts))  # type: ignore[type-var]


AnyActing = TypeVar("AnyActing", bound="ActingSkill")


class ActingSkill(Skill):
    """A skill with one attractor and one V: learned, or merged; what can be a part of a combined skill.

    It moves y = ξ* + c(ξ − ξ*) by a mixture of linear systems, ẏ = Σₖ h̃ₖ(y) Aₖ (y − ξ*).

    Attributes:
        attractor: ξ*, shape (d,).
        lyapunov: P of V = (y − ξ*)ᵀ P (y − ξ*), shape (d, d).
        form: V itself.
        coordinates: c.
        component_matrices: The matrices that act, every speed multiplied in. Shape (K, d, d), [1/s].
    """

    __slots__ = ()

    if TYPE_CHECKING:

        @property
        def attractor(self) -> FloatArray: ...  # noqa: D102
        @property
        def lyapunov(self) -> FloatArray: ...  # noqa: D102
        @property
        def form(self) -> QuadraticForm: ...  # noqa: D102
        @property
        def coordinates(self) -> Chain: ...  # noqa: D102
        @property
        def component_matrices(self) -> FloatArray: ...  # noqa: D102

    @abstractmethod
    def responsibilities(self, positions: npt.ArrayLike) -> FloatArray:
        """Return h̃ for positions (n, d). Shape (n, K); rows sum to one at any distance."""

    @abstractmethod
    def mixed(self, h: FloatArray, states: FloatArray) -> FloatArray:
        """Return h̃ of all components from their weights within their own leaf.

        Args:
            h: Leaves side by side, shape (..., K).
            states: Where, shape (..., d): one or many. Position densities are densities of the state.
        """

    @abstractmethod
    def _moved_at(self, y: FloatArray, state: FloatArray) -> FloatArray:
        """Return ẏ for one y (d,), which is that of a state (d,)."""

    @abstractmethod
    def _moved(self, y: FloatArray, states: FloatArray) -> FloatArray:
        """Return ẏ for many y (n, d), which are those of states (n, d)."""

    @property
    def acting_parts(self) -> tuple[ActingSkill, ...]:
        """The skill itself: nothing else ever acts."""
        return (self,)

    @property
    def influences(self) -> tuple[GaussianMixture, ...]:
        """Its own position density: nothing else is to be chosen."""
        return (self.density,)

    @property
    def outer_speed(self) -> float:
        """One: the skill's own speed is in ``component_matrices``."""
        return 1.0

    @property
    def reselects(self) -> bool:
        """False: there is nothing to select."""
        return False

    @property
    def disturbance_distance(self) -> float:
        """Infinite: no jump changes what acts."""
        return float("inf")

    @property
    def attractors(self) -> FloatArray:
        """The one attractor. Shape (1, d)."""
        return self.attractor[None]

    def part_at(self, states: npt.ArrayLike) -> IntArray:
        """Return 0 for each state (n, d). Shape (n,)."""
        return np.zeros(len(self.space.states(states)), dtype=np.int64)

    def selected(self, state: FloatArray) -> int:
        """Return 0: there is no other part."""
        return 0

    def velocity_at(self, state: FloatArray, part: int | None = None) -> FloatArray:
        """Return ξ̇ for one state (d,), which is not checked."""
        if not self.coordinates.links:
            return self._moved_at(state, state)
        y, pull = self.coordinates.tangent_at(state - self.attractor)
        return pull(self._moved_at(y + self.attractor, state))

    def _velocities(self, states: FloatArray, parts: IntArray | None) -> FloatArray:
        if not self.coordinates.links:
            return self._moved(states, states)
        y, pull = self.coordinates.tangent(states - self.attractor)
        return pull(self._moved(y + self.attractor, states))

    def lifted(self, states: FloatArray) -> FloatArray:
        """Return y for states (n, d). Shape (n, d)."""
        if not self.coordinates.links:
            return states
        return self.coordinates.forward(states - self.attractor) + self.attractor

    def component_velocities(self, states: FloatArray) -> FloatArray:
        """Return what each component adds to ξ̇ at states (n, d): h̃ₖ Aₖ, led back. Shape (n, K, d)."""
        y, pull = self.coordinates.tangent(states - self.attractor)
        shares = np.einsum("nk,kij,nj->kni", self.responsibilities(states), self.component_matrices, y)
        return np.stack([pull(each) for each in shares], axis=1)

    def decay(self, states: FloatArray) -> FloatArray:
        """Return −V̇ / (2 V) at states (n, d), shape (n,), [1/s]: how fast √V shrinks there.

        Zero exactly where V̇ is, negative where V grows, and no number at the attractor.
        """
        y = self.lifted(states)
        pulled = (y - self.attractor) @ self.lyapunov
        along = (pulled * self._moved(y, states)).sum(axis=1)
        return np.asarray(-along / (pulled * (y - self.attractor)).sum(axis=1))

    @abstractmethod
    def accelerated(self: AnyActing, factor: float) -> AnyActing:
        """Return the same motion, faster by a positive factor."""

    def advanced(self, states: FloatArray, durations: FloatArray | float) -> FloatArray:
        """Return where states (n, d) are after one step y⁺ = y + Δt ẏ; V falls at every step that is proved.

        Args:
            states: ξ.
            durations: Δt of each step, a number or of shape (n, 1), [s].
        """
        y = self.lifted(states)
        ahead = y + durations * self._moved(y, states) - self.attractor
        return self.coordinates.back(ahead) + self.attractor

    def advanced_at(self, state: FloatArray) -> Callable[[float], FloatArray]:
        """Return what leads one state (d,) ahead by a step of a given Δt [s], as ``advanced`` does."""
        goal, coordinates = self.attractor, self.coordinates
        y = coordinates.forward_at(state - goal)
        velocity = self._moved_at(y + goal, state)
        return lambda duration: coordinates.back_at(y + duration * velocity) + goal

    def v_distance(self, states: FloatArray) -> FloatArray:
        """Return √V for states (n, d). Shape (n,)."""
        return self.form.distance(self.lifted(states) - self.attractor)


def contraction_period(skill: Skill) -> float:
    """Return the longest controller period at which every acting part still contracts, [s]: an estimate.

    Zero where some part does not contract at all. ``skillctl.stability`` proves what this estimates.
    """
    return min(
        float(part.form.periods(skill.outer_speed * part.component_matrices).min())
        for part in skill.acting_parts
    )


def extent(density: GaussianMixture) -> float:
    """Return the diagonal of the box two standard deviations around the data of a density, in its unit."""
    reach = 2 * np.sqrt(np.diagonal(density.covariances, axis1=1, axis2=2))
    low, high = (density.means - reach).min(axis=0), (density.means + reach).max(axis=0)
    return float(np.linalg.norm(high - low))


def retargeted(skill: AnySkill, target: npt.ArrayLike) -> AnySkill:
    """Return the same motion towards ``target`` (d,); all guarantees stay (theory: the motion is relative).

    Raises:
        UsageError: Wrong number of coordinates, not finite, or a skill with several attractors.
    """
    goal = np.asarray(target, dtype=np.float64)
    attractors = skill.attractors
    if goal.shape != (skill.dimension,) or not np.isfinite(goal).all():
        raise UsageError(f"target: expected {skill.dimension} finite numbers, got {np.size(goal)}.")
    if len(attractors) > 1:
        raise UsageError(
            f"this skill has {len(attractors)} attractors; it cannot be moved to one target.",
            hint="Combine its parts with --align to give them one target.",
        )
    # ξ* + (target − ξ*) may differ from the target in its last bit, so the attractor is set once more.
    return skill.translated(goal - attractors[0]).with_leaves(lambda leaf: replace(leaf, attractor=goal))


def require_parts(parts: tuple[ActingSkill, ...], speed: float) -> None:
    """Raise InvalidModelError unless there are parts, each with one attractor, all in one space."""
    if not parts:
        raise InvalidModelError("parts: at least one is needed.")
    for part in parts:
        if not isinstance(part, ActingSkill):
            raise InvalidModelError("parts: a combined skill cannot be a part of another skill.")
        if part.space != parts[0].space:
            raise InvalidModelError(f"parts: state spaces differ ({part.space} and {parts[0].space}).")
        require_speed(speed, part.component_matrices)


def require_speed(speed: float, matrices: FloatArray) -> None:
    """Raise InvalidModelError unless a speed is positive, and matrices times it are within float64."""
    require_positive("speed", speed)
    with np.errstate(over="ignore"):
        if not np.isfinite(speed * matrices).all():
            raise InvalidModelError(f"speed: {speed!r} times the system matrices is beyond float64.")
