"""The contents of a figure: a skill, its demonstrations, motions from their starts, and a box around them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from skillctl.arrays import FloatArray, IntArray
from skillctl.geometry import box
from skillctl.model.chained import ChainedSkill
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.rollout import rollout
from skillctl.model.skill import Skill
from skillctl.model.space import Space

STEPS = 1000  # of a motion as long as the longest demonstration
PATIENCE = 10  # durations of the longest demonstration, after which a motion is cut off
MOST_STEPS = 20_000  # bounds the cost to a second or two
LOST = 1.5  # boxes from the middle; farther positions of a motion are outside the picture
MARGIN = 0.1  # of the box around everything, left free on each side
SLIMMEST = 0.55  # shortest side of the box, as a share of the longest
POINTS = 300  # drawn of one motion; more would not be visible
CENTIMETRES = 0.3  # smaller extents are given in millimetres


@dataclass(frozen=True, eq=False)
class Motion:
    """One motion of a skill.

    Attributes:
        times: Shape (T,), [s].
        positions: States, shape (T, d).
        acting: The part that acts, from 0. Shape (T,).
        speeds: By central differences, shape (T,), in the unit of the space per second.
    """

    times: FloatArray
    positions: FloatArray
    acting: IntArray
    speeds: FloatArray

    @property
    def part(self) -> int:
        """The part that acted at its end."""
        return int(self.acting[-1])


@dataclass(frozen=True, eq=False)
class Scale:
    """The unit in which a figure gives lengths, and how many of them are one unit of the space."""

    factor: float
    unit: str

    @classmethod
    def of(cls, space: Space, extent: float) -> Scale:
        """Return the scale for things of an extent in the unit of the space."""
        return cls(1e3, "mm") if space.unit == "m" and extent < CENTIMETRES else cls(1.0, space.unit)


@dataclass(frozen=True, eq=False)
class Portrait:
    """A skill as figures show it.

    Attributes:
        name: For its title.
        skill: The skill.
        demonstrations: The demonstrations that it carries.
        motions: One from the start of each; without demonstrations, one from each centre of its density. Of a
            chain those of its first stage.
        low, high: Corners of the box around their positions and the attractors', with a margin. Shape (n,),
            where n is the number of coordinates that are a position.
    """

    name: str
    skill: Skill
    demonstrations: tuple[Demonstration, ...]
    motions: tuple[Motion, ...]
    low: FloatArray
    high: FloatArray

    @property
    def goals(self) -> FloatArray:
        """Where motions end. Shape (n, d)."""
        return self.skill.attractors

    @property
    def chained(self) -> bool:
        """Whether the skill is a chain."""
        return self.skill.kind == "chain"

    @property
    def timed(self) -> tuple[Demonstration, ...]:
        """The demonstrations that begin when motions do: of a chain, whose stages begin later, none."""
        return () if self.chained else self.demonstrations

    @property
    def grouped(self) -> bool:
        """Whether colours tell which part, or which stage, acts."""
        return len(self.skill.acting_parts) > 1

    def group_of(self, part: int) -> int:
        """Return the number of the colour of a part that acts: of a chain, that of its stage."""
        return self.skill.stage_of(part) if self.chained else part

    @property
    def dimension(self) -> int:
        """How many coordinates of a state are a position; figures show the plane or the space of these."""
        return self.skill.space.positions

    @property
    def turns(self) -> bool:
        """Whether states have an orientation, too."""
        return self.skill.space.turns(self.goals) is not None

    @property
    def scale(self) -> Scale:
        """The unit in which its figures give lengths, which the size of its box decides."""
        return Scale.of(self.skill.space, float((self.high - self.low).max()))

    def coordinates(self, positions: FloatArray, picked: Sequence[int]) -> FloatArray:
        """Return the picked coordinates of positions or states in that unit. Shape (number picked, …)."""
        return np.asarray(self.scale.factor * positions[..., picked].T)

    def angles(self, states: FloatArray, target: FloatArray) -> FloatArray:
        """Return how far states (…, d) are turned from a target (d,), in degrees; zeros if nothing turns."""
        _, turned = self.skill.space.apart(states, target)
        return np.zeros(states.shape[:-1]) if turned is None else np.degrees(turned)

    def within(self, low: FloatArray, high: FloatArray) -> Portrait:
        """Return the same portrait with another box, given by its corners."""
        return replace(self, low=low, high=high)


def portrait_of(name: str, skill: Skill, taught: Sequence[DemonstrationSet | None]) -> Portrait:
    """Return the portrait of a skill and the demonstrations that its leaves carry."""
    demonstrations = tuple(_members(taught))
    density, n = skill.density, skill.space.positions
    first = skill.parts[0] if isinstance(skill, ChainedSkill) else skill
    shown = list(_members(taught[: len(first.leaves)]))
    if shown:
        starts = np.stack([d.positions[0] for d in shown])
    else:
        starts = np.vstack([part.uncharted(part.density.means) for part in first.acting_parts])
    longest = max((d.duration for d in demonstrations), default=None)
    motions = motions_from(skill, starts, longest)
    spread = 2 * np.sqrt(np.diagonal(density.covariances, axis1=1, axis2=2))
    around = [d.positions for d in demonstrations] or [density.means - spread, density.means + spread]
    ends = [part.attractor for part in skill.acting_parts]
    inner = np.vstack([*around, *ends])[:, :n]
    near = [_inside(motion.positions[:, :n], inner) for motion in motions]
    low, high = box_around(np.vstack([inner, *near]))
    return Portrait(name, skill, demonstrations, motions, low, high)


def _members(taught: Sequence[DemonstrationSet | None]) -> Iterator[Demonstration]:
    return (motion for members in taught if members is not None for motion in members)


def motions_from(skill: Skill, starts: FloatArray, longest: float | None = None) -> tuple[Motion, ...]:
    """Return the motions of a skill from starts (n, d), each until it arrives or leaves the picture.

    Args:
        skill: The skill.
        starts: Shape (n, d).
        longest: Duration of the longest demonstration, [s]; None: by the skill's own speed.
    """
    period = _period(skill) if longest is None else min(longest / STEPS, _period(skill))
    stages = len(skill.parts) if isinstance(skill, ChainedSkill) else 1
    duration = min(stages * PATIENCE * (longest or STEPS * period), MOST_STEPS * period)
    with np.errstate(over="ignore", invalid="ignore"):  # a skill without proof may leave all bounds
        result = rollout(skill, starts, duration=duration, period=period)
    motions = []
    for index in range(len(starts)):
        times, positions = result.trajectory(index)
        usable = np.isfinite(positions).all(axis=1)
        end = len(times) if usable.all() else int(np.argmin(usable))
        picked = np.unique(np.linspace(0, end - 1, POINTS).astype(np.int64))
        times, positions = times[picked], positions[picked]
        speeds = _speeds(skill, times, positions)
        motions.append(Motion(times, positions, result.acting[index, picked], speeds))
    return tuple(motions)


def _speeds(skill: Skill, times: FloatArray, positions: FloatArray) -> FloatArray:
    """Return the speeds (T,) of a motion; a motion that is nowhere else has none."""
    if len(times) < 2:
        return np.zeros(len(times))
    with np.errstate(over="ignore"):  # of a motion that leaves all bounds
        return skill.space.magnitudes(skill.space.rates(times, positions))[0]


def joint_box(portraits: Sequence[Portrait]) -> tuple[FloatArray, FloatArray]:
    """Return the corners of the box around several portraits."""
    lows, highs = [p.low for p in portraits], [p.high for p in portraits]
    return np.min(lows, axis=0), np.max(highs, axis=0)


def box_around(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the corners of a box around points (n, d), with a margin, no side much shorter than others."""
    low, high = box(points)
    longest = float((high - low).max()) or 1.0
    half = 0.5 * np.maximum(high - low, SLIMMEST * longest) + MARGIN * longest
    middle = 0.5 * (low + high)
    return middle - half, middle + half


def _inside(positions: FloatArray, inner: FloatArray) -> FloatArray:
    """Return the positions that are near enough to be in the picture."""
    low, high = box(inner)
    reach = LOST * max(float((high - low).max()), np.finfo(np.float64).tiny)
    near = (np.abs(positions - 0.5 * (low + high)) < reach).all(axis=1)
    return np.asarray(positions[near])


def _period(skill: Skill) -> float:
    """Return a period that resolves the fastest component, and at which the proved ones contract."""
    steps = []
    for part in skill.acting_parts:
        matrices = skill.outer_speed * part.component_matrices
        fastest = float(np.linalg.norm(matrices, 2, axis=(1, 2)).max())
        steps.append(0.25 / fastest if fastest > np.finfo(np.float64).tiny else 1.0)
        steps += [0.5 * step for step in part.form.periods(matrices).tolist() if step > 0]
    return min(steps)
