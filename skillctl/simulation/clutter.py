"""Bottles beside a cup, drawn by a seed: the last straight way to the cup is free, other ways are not."""

from __future__ import annotations

import math

import numpy as np

from skillctl.errors import UsageError
from skillctl.simulation.scenario import Cup, CylinderObstacle, Obstacle, Shelf, Table
from skillctl.simulation.scene import board_height

RADII, HEIGHTS = (0.025, 0.04), (0.16, 0.24)  # [m]; under the upper board of a shelf there are 0.26 m
MASS = 0.5  # [kg]
FREE = (
    0.13  # [m] to either side of the straight way along x to the cup: a hand 0.2 m wide, turned by up to 17°
)
ASIDE = (0.0, 0.08)  # [m] beyond what is free
ALONG = (-0.10, 0.03)  # [m] from the cup, along x: beside its last 10 cm
TRIES = 10_000


def bottles(
    count: int, cup: Cup, scene: Shelf | Table, generator: np.random.Generator
) -> tuple[Obstacle, ...]:
    """Return upright bottles on the cup's board, on either side of the straight way along x to the cup.

    All of a bottle is drawn uniformly, and drawn again until it stands on the board and overlaps no other.

    Raises:
        UsageError: There is no room for so many.
    """
    (front, back), half = scene.x_range, 0.5 * scene.width
    height_of_board = board_height(scene, cup.board)
    standing: list[CylinderObstacle] = []
    for _ in range(TRIES):
        side = math.copysign(1.0, generator.random() - 0.5)
        radius, height, aside, along = (generator.uniform(*ends) for ends in (RADII, HEIGHTS, ASIDE, ALONG))
        x, y = cup.place[0] + along, cup.place[1] + side * (FREE + aside + radius)
        fits = front + radius <= x <= back - radius and abs(y) <= half - radius
        if not fits or any(_overlap(x, y, radius, other) for other in standing):
            continue
        place = (x, y, height_of_board + 0.5 * height)
        name = f"bottle {len(standing) + 1}"
        standing.append(CylinderObstacle(name=name, position=place, radius=radius, height=height, mass=MASS))
        if len(standing) == count:
            return tuple(standing)
    raise UsageError(
        f"bottles: there is no room for {count} beside the cup.", hint="Take fewer, or a wider board."
    )


def _overlap(x: float, y: float, radius: float, other: CylinderObstacle) -> bool:
    return math.dist((x, y), other.position[:2]) < radius + other.radius
