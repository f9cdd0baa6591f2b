"""Example demonstrations: human-like reaches for a cup on a shelf, from a seeded generator.

Metres, base frame of the arm: x forwards, y to the left, z up. The shelf has a board at z = 0.42 and one at
0.70, both from x = 0.50 on. Every reach starts low in front of the shelf, moves sideways and upwards to the
place while still in front of the boards, and then straight in along x. How the hand moves sideways and how
it moves upwards do not depend on each other, so a reach to the top left has, relative to its target, the
sideways motion of one to the bottom left and the upward motion of one to the top centre.

If orientations are asked for, people turn the hand on the way, from straight ahead to the direction in which
the cup stands from the shoulder, which is the arm's base. They move straight in in that direction, too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.demonstrations.writing import DECIMALS
from skillctl.errors import UsageError
from skillctl.geometry import arc_lengths
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.pose import Pose
from skillctl.model.space import Euclidean
from skillctl.rotations import product, quaternions, vectors

SIDES = {"left": 0.28, "centre": 0.0, "right": -0.28}  # y of the cup [m]
HEIGHTS = {"bottom": 0.48, "top": 0.76}  # z of the cup's middle [m]
DEPTH = 0.63  # x of the cup [m]
PLACES = tuple(f"{height}-{side}" for height in HEIGHTS for side in SIDES)
TASKS = ("bottom-left", "bottom-right", "top-centre")  # of the examples; the other places are for tests
COUNT, SEED = 8, 0  # demonstrations per task, and their seed

Box: TypeAlias = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]  # of x, y and z [m]
STARTS: Box = ((0.385, 0.44), (-0.12, 0.12), (0.52, 0.58))  # as low as the example arm reaches, hand level
LOW_STARTS: Box = ((0.385, 0.44), (-0.12, 0.12), (0.10, 0.20))  # a hand resting on the table: all goes up
DURATION = (2.4, 3.8)  # [s]
RATE = 100  # samples per second
LARGEST_MANNER = 0.15  # [m]: as far as the straight entry is tested
PITCH = 0.25  # [rad]: how far the hand points down at the cup
LEVEL = np.array([1.0, 0.0, 1.0, 0.0]) / np.sqrt(2)  # q_xyzw of a hand that points to +x, fingers level
PATH_POINTS = 2001  # of the path before timing: chords of 0.3 mm, 1000 times shorter than its bends


def target_of(place: str) -> FloatArray:
    """Return the position of the cup at a place, such as ``top-centre``. Shape (3,), [m], base frame.

    Raises:
        UsageError: There is no such place.
    """
    if place not in PLACES:
        raise UsageError(f"place: {place!r} is none of {', '.join(PLACES)}.")
    height, side = place.split("-")
    return np.array([DEPTH, SIDES[side], HEIGHTS[height]])


def reaching_demonstrations(
    place: str,
    count: int = COUNT,
    seed: int = SEED,
    *,
    starts: Box = STARTS,
    variability: float = 1.0,
    manner: float = 0.0,
    turned: bool = False,
) -> DemonstrationSet:
    """Return ``count`` reaches to a place, each ending at the cup after at least 10 cm of straight motion.

    Path, start and duration vary smoothly from one reach to the next; the speed along each path follows
    the minimum-jerk law. Demonstration i depends on i and the arguments other than ``count`` alone. Positions
    are rounded to 10 µm, so that the numbers are the same on every platform and survive a table unchanged.

    Args:
        place: One of ``PLACES``, see ``target_of``.
        count: Number of demonstrations, at least 1.
        seed: Any integer from 0.
        starts: Box in which the reaches start, below and in front of the place.
        variability: How much the ways of reaching differ, from 0, alike except for start and duration, to 1.
        manner: How far the hand swings out on its way to either side, and is lifted on its way to the top,
            [m]; with 0 all places are reached in the same way.
        turned: Whether the demonstrations are poses of a hand that is turned towards the side.

    Raises:
        UsageError: There is no such place, or a number is outside its range.

    References:
        Minimum jerk: Flash & Hogan 1985, Eq. 3. The shapes of path and variability are ours.
    """
    target = target_of(place)
    if count < 1 or seed < 0:
        raise UsageError(f"count and seed: at least 1 and 0, got {count} and {seed}.")
    if not 0 <= variability <= 1:
        raise UsageError(f"variability: from 0 to 1, not {variability:g}.")
    if not 0 <= manner <= LARGEST_MANNER:
        raise UsageError(f"manner: from 0 to {LARGEST_MANNER:g}, not {manner:g}.")
    swing = _swing(place, manner)
    # Uniform doubles straight from the bits: distributions may change between NumPy versions, these do not.
    streams = [np.random.Generator(np.random.PCG64([seed, PLACES.index(place), i])) for i in range(count)]
    styles = [_Style.drawn(stream, starts, variability) for stream in streams]
    if turned:
        towards = float(np.arctan2(target[1], target[0]))
        manners = [_Turning.drawn(stream, variability) for stream in streams]
        pairs = zip(styles, manners, strict=True)
        motions = [_turned_reach(style, manner, target, swing, towards) for style, manner in pairs]
        space = Pose()
        return DemonstrationSet(
            tuple(
                Demonstration.from_positions(times, poses, f"{place} {index}", space)
                for index, (times, poses) in enumerate(motions, start=1)
            ),
            space,
        )
    reaches = (_reach(style, target, swing) for style in styles)
    demonstrations = (
        Demonstration.from_positions(times, positions, f"{place} {index}")
        for index, (times, positions) in enumerate(reaches, start=1)
    )
    return DemonstrationSet(tuple(demonstrations), Euclidean.cartesian(3))


@dataclass(frozen=True, eq=False, slots=True)
class _Style:
    """How one reach differs from the next.

    Attributes:
        start: Shape (3,), [m].
        duration: [s].
        entry: Share of the path parameter after which the hand begins to move in.
        lateral_end, vertical_end: Shares after which sideways and upward motion are done.
        sway: Detours on the way to the straight entry: a bow and an S per axis, shape (3, 2), [m].
    """

    start: FloatArray
    duration: float
    entry: float
    lateral_end: float
    vertical_end: float
    sway: FloatArray

    @classmethod
    def drawn(cls, stream: np.random.Generator, starts: Box = STARTS, variability: float = 1.0) -> _Style:
        def uniform(low: float, high: float) -> float:
            return low + (high - low) * stream.random()

        def varied(low: float, high: float) -> float:  # with variability 1 the same to the last bit
            return low + (high - low) * (0.5 + variability * (stream.random() - 0.5))

        return cls(
            start=np.array([uniform(low, high) for low, high in starts]),
            duration=round(RATE * uniform(*DURATION)) / RATE,
            entry=varied(0.18, 0.24),
            lateral_end=varied(0.57, 0.64),
            vertical_end=varied(0.48, 0.58),
            # People draw the hand back a little before they lift it past an edge.
            sway=np.array([[varied(low, low + 0.04), varied(-0.02, 0.02)] for low in (-0.03, -0.02, -0.01)]),
        )


@dataclass(frozen=True, eq=False, slots=True)
class _Turning:
    """How the turning of one hand differs from the next.

    Attributes:
        start: Yaw, pitch and roll before the reach, shape (3,), [rad].
        end: Share of the path after which the hand is turned; before it moves straight in.
    """

    start: FloatArray
    end: float

    @classmethod
    def drawn(cls, stream: np.random.Generator, variability: float) -> _Turning:
        spread = variability * (2 * stream.random(3) - 1) * [0.10, 0.05, 0.05]
        level = np.array([0.0, PITCH, 0.0])
        return cls(level + spread, 0.62 + 0.1 * variability * (2 * stream.random() - 1))

    def along(self, share: FloatArray, towards: float) -> FloatArray:
        """Return the rotation vectors (T, 3) of a hand on its way, at shares (T,) of the path.

        The hand's z axis is the direction of approach, and its y axis is that of the fingers.
        """
        end = np.array([towards, PITCH, 0.0])
        angles = self.start + _minimum_jerk(share / self.end)[:, None] * (end - self.start)
        yaw, pitch, roll = (
            quaternions(angle[:, None] * np.eye(3)[axis])
            for angle, axis in zip(angles.T, (2, 1, 2), strict=True)
        )
        return vectors(product(product(product(yaw, pitch), LEVEL), roll))


def _turned_reach(
    style: _Style, manner: _Turning, target: FloatArray, swing: FloatArray, towards: float
) -> tuple[FloatArray, FloatArray]:
    """Return times (T,) and poses (T, 6) of one reach that ends in a direction, an angle [rad] from ahead."""
    shear = np.eye(3)
    shear[1, 0] = np.tan(towards)  # ahead becomes towards the cup; forwards and upwards stay
    start, end = np.linalg.solve(shear, np.stack([style.start, target]).T).T
    times, positions = _reach(replace(style, start=start), end, swing)
    share = arc_lengths(positions)
    turns = manner.along(share / share[-1], towards)
    return times, np.concatenate([np.round(positions @ shear.T, DECIMALS), turns], axis=1)


def _swing(place: str, manner: float) -> FloatArray:
    """Return the bow that belongs to a place: outwards on its side, upwards to the top. Shape (3,), [m]."""
    height, side = place.split("-")
    return manner * np.array([0.0, np.sign(SIDES[side]), float(height == "top")])


def _reach(style: _Style, target: FloatArray, swing: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return times (T,) and positions (T, 3) of one reach, sampled at RATE and rounded."""
    path = _path(style, target, swing)
    arc = arc_lengths(path)
    samples = round(style.duration * RATE) + 1
    travelled = arc[-1] * _minimum_jerk(np.arange(samples) / (samples - 1))
    positions = np.stack([np.interp(travelled, arc, column) for column in path.T], axis=1)
    return np.round(np.arange(samples) / RATE, DECIMALS), np.round(positions, DECIMALS)


def _path(style: _Style, target: FloatArray, swing: FloatArray) -> FloatArray:
    """Return the path as a smooth curve, not yet timed. Shape (PATH_POINTS, 3)."""
    u = np.linspace(0.0, 1.0, PATH_POINTS)
    progress = np.stack(
        [
            _minimum_jerk((u - style.entry) / (1.0 - style.entry)),
            _minimum_jerk(u / style.lateral_end),
            _minimum_jerk(u / style.vertical_end),
        ],
        axis=1,
    )
    bow, bend = _detours(u / style.vertical_end)
    detour = bow[:, None] * (style.sway[:, 0] + swing) + bend[:, None] * style.sway[:, 1]
    return style.start + progress * (target - style.start) + detour


def _minimum_jerk(time: FloatArray) -> FloatArray:
    """Return 10 t³ − 15 t⁴ + 6 t⁵, constant at 0 before t = 0 and at 1 after t = 1."""
    t = np.clip(time, 0.0, 1.0)
    return t * t * t * (10.0 + t * (6.0 * t - 15.0))


def _detours(time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a bow and an S over 0 … 1, at most one high, smooth into the rest outside."""
    t = np.clip(time, 0.0, 1.0)
    hump = 4.0 * t * (1.0 - t)
    bow = hump * hump * hump
    return bow, 2.0 * bow * (2.0 * t - 1.0)
