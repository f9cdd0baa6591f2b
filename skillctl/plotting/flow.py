"""The velocity field in the plane: streamlines, of few paths for a small file."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.path import Path

from skillctl.arrays import FloatArray
from skillctl.model.skill import Skill
from skillctl.plotting.portrait import Portrait
from skillctl.plotting.style import FLOW

GRID = 90  # points a side at which the field is evaluated
FASTEST = 0.95  # quantile of the speeds on the grid at which a streamline is widest
DENSITY, DENSITY_OF_SMALL = 1.15, 0.7  # of the streamlines, in Matplotlib's measure
SMALL = 3.0  # [inch], width of axes that have room for fewer
WIDTHS = (0.3, 0.5, 0.8, 1.15, 1.6)  # from the slowest fifth of the speeds to the fastest [points]


def grid(low: FloatArray, high: FloatArray, points: int = GRID) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the coordinates of a grid over a plane box: x (n,), y (n,), and all pairs (n², 2), x fastest."""
    x = np.linspace(low[0], high[0], points)
    y = np.linspace(low[1], high[1], points)
    return x, y, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def drawn_grid(portrait: Portrait, points: int = GRID) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return ``grid`` over the box of a 2-D skill, x and y in the unit in which it is drawn."""
    x, y, places = grid(portrait.low, portrait.high, points)
    return portrait.scale.factor * x, portrait.scale.factor * y, places


def widest_speed(portrait: Portrait) -> float:
    """Return the speed of the widest streamlines, in the unit of the space per second."""
    *_, places = drawn_grid(portrait)
    speeds = np.linalg.norm(_velocities(portrait.skill, places), axis=1)
    return float(np.quantile(speeds, FASTEST)) or 1.0


def draw_flow(axes: Axes, portrait: Portrait) -> None:
    """Draw streamlines, the wider the faster.

    The field of a combined skill at a place is that of the part that a start there selects.
    """
    x, y, places = drawn_grid(portrait)
    velocities = _velocities(portrait.skill, places)
    shares = np.minimum(np.linalg.norm(velocities, axis=1) / widest_speed(portrait), 1.0)
    u, v = portrait.coordinates(velocities, (0, 1)).reshape(2, len(y), len(x))
    stream = axes.streamplot(
        x,
        y,
        u,
        v,
        linewidth=shares.reshape(len(y), len(x)),
        color=FLOW,
        density=DENSITY if _width(axes) > SMALL else DENSITY_OF_SMALL,
        arrowsize=0.7,
        arrowstyle="-|>",
        zorder=1.0,
    )
    _bundle(axes, stream.lines)


def _width(axes: Axes) -> float:
    """Return the width of axes, [inch], before the layout of the figure is made."""
    return float(axes.bbox.width / axes.figure.dpi)


def _velocities(skill: Skill, places: FloatArray) -> FloatArray:
    with np.errstate(over="ignore", invalid="ignore"):
        return np.nan_to_num(skill.velocity(places), posinf=0.0, neginf=0.0)


def _bundle(axes: Axes, lines: LineCollection) -> None:
    """Replace thousands of short segments by one path per width: a tenth of the bytes in a vector file."""
    segments = np.asarray(lines.get_segments(), dtype=np.float64)  # (n, 2, 2)
    shares = np.asarray(lines.get_linewidth(), dtype=np.float64)
    lines.remove()
    if not len(segments):
        return
    levels = np.minimum((shares * len(WIDTHS)).astype(np.int64), len(WIDTHS) - 1)
    for level, width in enumerate(WIDTHS):
        chosen = segments[levels == level]
        if len(chosen):
            path = _joined(chosen)
            axes.add_collection(
                PathCollection([path], facecolors="none", edgecolors=FLOW, linewidths=width, zorder=1.0)
            )


def _joined(segments: FloatArray) -> Path:
    """Return one path of segments (n, 2, 2), joined where one begins at the end of the one before."""
    begins = np.ones(len(segments), dtype=np.bool_)
    begins[1:] = (segments[1:, 0] != segments[:-1, 1]).any(axis=1)
    vertices, codes = [], []
    for begin, (first, second) in zip(begins, segments, strict=True):
        if begin:
            vertices.append(first)
            codes.append(Path.MOVETO)
        vertices.append(second)
        codes.append(Path.LINETO)
    return Path(np.asarray(vertices), codes)
