"""The figure of a task: starts, bodies, what is to be passed, and motions coloured by their margin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon, Rectangle

from skillctl.arrays import FloatArray
from skillctl.plotting import style

WIDTH = 9.5  # inches
SIDES = {2: ((0, 1),), 3: ((0, 1), (0, 2))}  # of space: from above, from the side
BODY, KEPT, PASSED = "#777777", "#009E73", "#8E4B7B"
MARGINS = LinearSegmentedColormap.from_list("margins", [style.DEMONSTRATION, "#E8C77D", style.MOTION])
MARGIN = 0.08  # of the extent, free around everything


@dataclass(frozen=True, eq=False)
class TaskPicture:
    """What is drawn of a task, in the plane or in space.

    Attributes:
        title: Above it.
        names: Of the two or three coordinates.
        unit: Of all of them.
        low, high: Corners of the start box.
        target, tolerance: Where motions end, and within which distance.
        bodies: Name of each, and points (n, k) of which it is the convex hull.
        passed: Points to be passed, and within which distance.
        kept: Corners of boxes to stay in.
        motions: Shape (n, T, k).
        margins: Worst margin of each motion in the scale of its clause: from −1 to 1. Shape (n,).
    """

    title: str
    names: Sequence[str]
    unit: str
    low: FloatArray
    high: FloatArray
    target: FloatArray
    tolerance: float
    bodies: Sequence[tuple[str, FloatArray]]
    passed: Sequence[tuple[FloatArray, float]]
    kept: Sequence[tuple[FloatArray, FloatArray]]
    motions: FloatArray
    margins: FloatArray


def draw_task(picture: TaskPicture) -> Figure:
    """Return the figure: one panel in the plane, in space one from above and one from the side."""
    sides = SIDES[picture.motions.shape[-1]]
    every = [picture.motions.reshape(-1, len(picture.names)), *(points for _, points in picture.bodies)]
    points = np.concatenate([*every, picture.low[None], picture.high[None], picture.target[None]])
    low, high = points.min(axis=0), points.max(axis=0)
    free = MARGIN * float((high - low).max())
    with style.drawing():
        figure = Figure((WIDTH if len(sides) > 1 else 6.5, 5.2), layout="constrained")
        panels = list(figure.subplots(1, len(sides), squeeze=False).flat)
        for axes, (i, j) in zip(panels, sides, strict=True):
            _draw_side(axes, picture, (i, j))
            axes.set(
                xlabel=f"{picture.names[i]} [{picture.unit}]", ylabel=f"{picture.names[j]} [{picture.unit}]"
            )
            axes.set_aspect("equal")
            axes.set_xlim(low[i] - free, high[i] + free)
            axes.set_ylim(low[j] - free, high[j] + free)
        style.tidy(panels)
        colours = ScalarMappable(Normalize(-1, 1), MARGINS)
        bar = figure.colorbar(colours, ax=panels, shrink=0.7)
        bar.set_label("worst margin, 1: ample, below 0: a clause fails")
        figure.suptitle(style.named(picture.title, 90))
        style.legend(figure, _handles(picture), 6)
    return figure


def _draw_side(axes: Axes, picture: TaskPicture, pair: tuple[int, int]) -> None:
    """Draw everything, seen in two coordinates."""
    chosen = list(pair)
    for _, points in picture.bodies:
        axes.add_patch(
            Polygon(_hull(points[:, chosen]), fc=style.to_tint(BODY, 0.3), ec=BODY, lw=0.8, zorder=1.5)
        )
    for low, high in picture.kept:
        corner, size = low[chosen], (high - low)[chosen]
        axes.add_patch(
            Rectangle(tuple(corner), *size, fill=False, ec=KEPT, lw=1.1, ls=(0, (5, 2)), zorder=1.2)
        )
    for point, within in picture.passed:
        circle = Circle(
            tuple(point[chosen]), within, fc=style.to_tint(PASSED, 0.12), ec=PASSED, lw=0.9, zorder=2
        )
        axes.add_patch(circle)
    corner, size = picture.low[chosen], (picture.high - picture.low)[chosen]
    axes.add_patch(Rectangle(tuple(corner), *size, fill=False, ec=style.INK, lw=0.9, ls=":", zorder=3))
    for index in np.argsort(-picture.margins, kind="stable"):  # the worst on top
        colour = MARGINS(0.5 * (1 + float(picture.margins[index])))
        path = picture.motions[index][:, chosen]
        axes.plot(*path.T, color=colour, lw=0.9, zorder=4)
        axes.plot(*path[0], **{**style.STARTED, "ms": 2.2, "mew": 0.5})
    axes.add_patch(
        Circle(tuple(picture.target[chosen]), picture.tolerance, fill=False, ec=style.INK, zorder=6)
    )
    axes.plot(*picture.target[chosen], **style.GOAL)


def _handles(picture: TaskPicture) -> dict[str, Line2D | Patch]:
    """Return the legend's samples of what there is."""
    handles: dict[str, Line2D | Patch] = {
        "start box": Patch(fill=False, ec=style.INK, ls=":"),
        "start": Line2D([], [], **style.STARTED),
        "target": Line2D([], [], **style.GOAL),
    }
    if picture.bodies:
        handles["keep-out"] = Patch(fc=style.to_tint(BODY, 0.3), ec=BODY)
    if picture.passed:
        handles["via"] = Patch(fc=style.to_tint(PASSED, 0.12), ec=PASSED)
    if picture.kept:
        handles["stay-in"] = Patch(fill=False, ec=KEPT, ls="--")
    return handles


def _hull(points: FloatArray) -> FloatArray:
    """Return the corners of the convex hull of points (n, 2), in order."""
    from scipy.spatial import ConvexHull  # late: nothing else here needs SciPy

    return np.asarray(points[ConvexHull(points).vertices])
