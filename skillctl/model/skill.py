"""What every skill can do, whatever its kind; a skill is learned, merged, combined or a chain."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from skillctl.arrays import BoolArray, FloatArray, IntArray, require_moderate, require_positive
from skillctl.model.coordinates.chain import Chain
from skillctl.model.lyapunov import QuadraticForm
from skillctl.model.mixture import GaussianMixture
from skillctl.model.space import Space

if TYPE_CHECKING:
    from skillctl.model.seds import SedsSkill

Kind: TypeAlias = Literal["seds", "merged", "combined", "chain"]
AnySkill = TypeVar("AnySkill", bound="Skill")


class Skill(ABC):
    """A motion ξ̇ = f(ξ). Only reading, writing and messages ask for its kind.

    Attributes:
        kind: ``seds`` (learned), ``merged``, ``combined`` or ``chain``.
        space: What a state is.
        parts: The skills this one is made of; none of a learned one.
        shares: Weight or prior of each part, summing to one. Shape (number of parts,).
        gate: How the parts act together, or follow each other; empty for a learned skill.
        parameters: Of the gate, by name.
        speed: α > 0, a factor on all velocities.
        density: Position density of all that the skill was taught.
        influences: A mixture for each acting part: the one of the largest value, times its share, acts.
        acting_parts: The parts of which one acts at a time; the skill itself if it is learned or merged.
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
        def parts(self) -> tuple[Skill, ...]: ...  # noqa: D102
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

    def stage_of(self, part: int) -> int:
        """Return the stage of an acting part, both counted from 0: 0 but of a chain."""
        return 0

    def onward(self, states: FloatArray, parts: IntArray) -> IntArray:
        """Return which part acts next at states (n, d), where parts (n,) did: another in a chain only."""
        return parts

    def onward_at(self, state: FloatArray, part: int) -> int:
        """Return which part acts next at one state (d,), not checked: another in a chain only."""
        return part

    def arrived(self, states: FloatArray, parts: IntArray, distance: float) -> BoolArray:
        """Return whether states (n, d), at which parts (n,) act, are this near to an end. Shape (n,)."""
        nearest = self.space.distance(states[:, None], self.attractors).min(axis=1)
        return np.asarray(nearest < distance)

    @abstractmethod
    def part_weights_at(self, states: FloatArray) -> FloatArray:
        """Return each part's share of the motion, or of the regions, at states (n, d). Shape (n, parts)."""

    @abstractmethod
    def carried(self: AnySkill, target: FloatArray, goal: FloatArray) -> AnySkill:
        """Return the motions, moved as a target (d,) is to a goal (d,): attractors and means together."""

    def translated(self: AnySkill, offset: FloatArray) -> AnySkill:
        """Return the same motions, moved in position by an offset; orientations, if there are, stay."""
        still = np.zeros(self.dimension)
        return self.carried(still, np.concatenate([offset, still[len(offset) :]]))

    @abstractmethod
    def with_leaves(self: AnySkill, change: Callable[[SedsSkill], SedsSkill]) -> AnySkill:
        """Return the same tree with every leaf changed, from left to right."""


AnyActing = TypeVar("AnyActing", bound="ActingSkill")


class Ahead(NamedTuple):
    """Where a step leads: a state (d,), and its offset (d,) from the attractor."""

    state: FloatArray
    offset: FloatArray


class ActingSkill(Skill):
    """A skill with one attractor and one V: learned, or merged; what can be a part of a combined skill.

    It moves y = a + c(x) by a mixture of linear systems, ẏ = Σₖ h̃ₖ(y) Aₖ (y − a), where x is the offset of
    the state from the attractor and a the anchor. In R^d that is y = ξ* + c(ξ − ξ*).

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
    def mixed(self, h: FloatArray, charted: FloatArray) -> FloatArray:
        """Return h̃ of all components from their weights within their own leaf.

        Args:
            h: Leaves side by side, shape (..., K).
            charted: Where, shape (..., d): one or many. Position densities are densities of charted states.
        """

    @abstractmethod
    def _moved_at(self, y: FloatArray, charted: FloatArray) -> FloatArray:
        """Return ẏ for one y (d,), which is that of a charted state (d,)."""

    @abstractmethod
    def _moved(self, y: FloatArray, charted: FloatArray) -> FloatArray:
        """Return ẏ for many y (n, d), which are those of charted states (n, d)."""

    @property
    def anchor(self) -> FloatArray:
        """What is added to offsets from the attractor, so that they are charted states. Shape (d,)."""
        return self.space.anchor(self.attractor)

    @property
    def plain(self) -> bool:
        """Whether y is the state itself."""
        return self.space.flat and not self.coordinates.links

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
        if self.plain:
            return self._moved_at(state, state)
        offset, place = self.space.tangent_at(state, self.attractor)
        y, pull = self.coordinates.tangent_at(offset)
        return place(pull(self._moved_at(y + self.anchor, self._charted(state, offset))))

    def _velocities(self, states: FloatArray, parts: IntArray | None) -> FloatArray:
        if self.plain:
            return self._moved(states, states)
        offsets, place = self.space.tangent(states, self.attractor)
        y, pull = self.coordinates.tangent(offsets)
        return place(pull(self._moved(y + self.anchor, self._charted(states, offsets))))

    def charted(self, states: FloatArray) -> FloatArray:
        """Return the charted states (..., d) of states (..., d): what densities are said of."""
        return states if self.space.flat else self.anchor + self.space.offsets(states, self.attractor)

    def uncharted(self, charted: FloatArray) -> FloatArray:
        """Return the states (..., d) of charted states (..., d)."""
        return charted if self.space.flat else self.space.placed(charted - self.anchor, self.attractor)

    def _charted(self, states: FloatArray, offsets: FloatArray) -> FloatArray:
        return states if self.space.flat else self.anchor + offsets

    def lifted(self, states: FloatArray) -> FloatArray:
        """Return y for states (n, d). Shape (n, d)."""
        if self.plain:
            return states
        return self.coordinates.forward(self.space.offsets(states, self.attractor)) + self.anchor

    def component_velocities(self, states: FloatArray) -> FloatArray:
        """Return what each component adds to ξ̇ at states (n, d): h̃ₖ Aₖ, led back. Shape (n, K, d)."""
        offsets, place = self.space.tangent(states, self.attractor)
        y, pull = self.coordinates.tangent(offsets)
        shares = np.einsum("nk,kij,nj->kni", self.responsibilities(states), self.component_matrices, y)
        return np.stack([place(pull(each)) for each in shares], axis=1)

    def decay(self, states: FloatArray) -> FloatArray:
        """Return −V̇ / (2 V) at states (n, d), shape (n,), [1/s]: how fast √V shrinks there.

        Zero exactly where V̇ is, negative where V grows, and no number at the attractor.
        """
        y = self.lifted(states)
        pulled = (y - self.anchor) @ self.lyapunov
        along = (pulled * self._moved(y, self.charted(states))).sum(axis=1)
        return np.asarray(-along / (pulled * (y - self.anchor)).sum(axis=1))

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
        ahead = y + durations * self._moved(y, self.charted(states)) - self.anchor
        return self.space.placed(self.coordinates.back(ahead), self.attractor)

    def advanced_at(self, state: FloatArray, near: FloatArray | None = None) -> Callable[[float], Ahead]:
        """Return what leads one state (d,) ahead by a step of a given Δt [s], as ``advanced`` does.

        Args:
            state: ξ, shape (d,).
            near: Offset at which the last step ended, if its side is to be kept; see ``Space.offset_at``.
        """
        space, goal, coordinates, anchor = self.space, self.attractor, self.coordinates, self.anchor
        offset = space.offset_at(state, goal, near)
        y = coordinates.forward_at(offset)
        velocity = self._moved_at(y + anchor, self._charted(state, offset))

        def ahead(duration: float) -> Ahead:
            reached = coordinates.back_at(y + duration * velocity)
            return Ahead(space.placed_at(reached, goal), reached)

        return ahead

    def v_distance(self, states: FloatArray) -> FloatArray:
        """Return √V for states (n, d). Shape (n,)."""
        return self.form.distance(self.lifted(states) - self.anchor)

    def v_distance_at(self, state: FloatArray) -> float:
        """Return √V for one state (d,), not checked."""
        y = self.coordinates.forward_at(self.space.offset_at(state, self.attractor))
        return math.sqrt(y.dot(self.lyapunov.dot(y)))


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


def require_speed(speed: float, matrices: FloatArray) -> None:
    """Raise InvalidModelError unless a speed is positive, and it and what it moves are of moderate size."""
    require_positive("speed", speed)
    require_moderate("speed", np.array([speed]))
    require_moderate("speed times the system matrices", speed * matrices)
