"""Figures of one skill, and of a skill beside those it was made from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from skillctl.arrays import FloatArray
from skillctl.plotting import style
from skillctl.plotting.chain import draw_speeds
from skillctl.plotting.flow import widest_speed
from skillctl.plotting.panels import (
    Draw,
    columns_of,
    course,
    draw_angles,
    draw_line_field,
    draw_paths,
    draw_plane,
    label,
)
from skillctl.plotting.portrait import Portrait, joint_box

WIDTH = 7.4  # [inch], of figures; a README shows them a little smaller
PANEL = 2.7  # [inch], width of one skill among several
COURSE = 1.6  # [inch], height of a course over time below views
TITLES = ("seen from above", "seen from the side", "seen from the front")
MOST_IN_A_ROW = 4


def draw_skill(portrait: Portrait, about: str) -> Figure:
    """Return the figure of one skill.

    Two dimensions: the plane. Three: orthogonal views and a perspective. One: velocity over position, and
    position over time. More: every coordinate over time. With an orientation also the axes of the hand, and
    its angle from the target over time. Of a chain also speeds over time.

    Args:
        portrait: The skill.
        about: The kind of skill, for the title.
    """
    with style.drawing():
        figure = {2: _plane, 3: _space}.get(portrait.dimension, _courses)(portrait)
        figure.suptitle(f"{style.named(portrait.name)}  ({about})")
        style.legend(figure, explained([portrait]))
    return figure


def draw_family(parents: Sequence[tuple[Portrait, str]], child: tuple[Portrait, str]) -> Figure:
    """Return the figure of a skill beside its parents, all on the same axes.

    Args:
        parents: The parents, each with its role, such as ``weight 0.5``.
        child: The child with its kind, such as ``merged``.
    """
    members = [*parents, child]
    low, high = joint_box([portrait for portrait, _ in members])
    boxed = [portrait.within(low, high) for portrait, _ in members]
    draws = columns_of(boxed[0])
    across = len(members) if len(draws) > 1 else min(len(members), MOST_IN_A_ROW)
    heights = _heights(high - low, len(draws), math.ceil(len(members) / across))
    with style.drawing():
        size = max(PANEL * across, 4.5), sum(heights) + 1.1
        figure = Figure(size, layout="compressed")
        grid = figure.subplots(len(heights), across, squeeze=False, height_ratios=heights)
        # A member with several panels has a column of the grid; members with one panel fill its rows.
        panels = np.array(style.first(grid.T if len(draws) > 1 else grid, len(members) * len(draws)))
        for column, portrait, (_, role) in zip(panels.reshape(len(members), -1), boxed, members, strict=True):
            for axes, draw in zip(column, draws, strict=True):
                draw(axes, portrait)
            column[0].set_title(f"{style.named(portrait.name, 26)}\n{role}")
        for axes in panels[-len(draws) :]:
            axes.spines[:].set(linewidth=1.6, edgecolor=style.INK)
        style.legend(figure, explained(boxed), columns=max(2, min(across, 4)))
    return figure


def _heights(span: FloatArray, panels: int, rows: int) -> list[float]:
    """Return the height of each row of panels, [inch], for the sides of the box (d,)."""
    labels = 0.5
    if len(span) == 1:
        return [0.7 * PANEL] * rows
    if panels == 1:
        return [PANEL * float(span[1] / span[0]) + labels] * rows
    if len(span) == 3:
        x, y, z = span.tolist()
        views = [PANEL * min(share, 1.2) + labels for share in (y / x, z / x, z / y)]
        return views + [0.7 * PANEL] * (panels - len(views))
    return [0.7 * PANEL] * panels


def explained(portraits: Sequence[Portrait]) -> dict[str, Any]:
    """Return the entries of the legend, of only what these portraits show."""
    dimension = portraits[0].dimension
    wanted = ["motion of the skill"]
    if any(portrait.demonstrations for portrait in portraits):
        wanted.insert(0, "demonstration")
    if dimension in (2, 3):
        wanted += ["start", "attractor"]
    if portraits[0].turns:
        wanted += style.AXES
    handles = style.entries(*wanted) | _fields([portrait for portrait in portraits if not portrait.chained])
    for portrait in portraits:
        if portrait.grouped:
            handles["motion of the skill"].set_color(style.INK)  # the colours tell the parts
            if len(portraits) == 1:
                handles.pop("position density, 2σ", None)
            handles |= _parts(portrait)
    return handles


def _fields(portraits: Sequence[Portrait]) -> dict[str, Any]:
    """Return the entries of what is drawn of skills with one field: density, and in the plane the field."""
    dimension = portraits[0].dimension if portraits else 0
    if dimension not in (2, 3):
        return {}
    handles = style.entries("position density, 2σ", *["level of V"][: dimension == 2])
    if dimension == 2:
        words = "the wider, the faster"
        if len(portraits) == 1:
            (only,) = portraits
            fastest = style.two_digits(only.scale.factor * widest_speed(only))
            words = f"widest: {fastest} {only.scale.unit}/s"
        handles[f"field; {words}"] = style.entries("field")["field"]
    return handles


def _parts(portrait: Portrait) -> dict[str, Any]:
    """Return the entries of the parts of a combined skill, or of the stages of a chain."""
    if portrait.chained:
        over = ["where a stage is over"][: portrait.dimension in (2, 3)]
        return style.entries(*over) | _patches("stage", len(portrait.skill.parts))
    chosen = "acts: part" if portrait.skill.reselects else "starts that select part"
    what = {2: chosen, 3: "density of part"}.get(portrait.dimension, "part")
    return _patches(what, len(portrait.skill.acting_parts))


def _patches(what: str, count: int) -> dict[str, Any]:
    colours = map(style.part_colour, range(count))
    return {
        f"{what} {number}": Patch(facecolor=style.to_tint(colour, 0.35), edgecolor=colour)
        for number, colour in enumerate(colours, start=1)
    }


def _plane(portrait: Portrait) -> Figure:
    span = portrait.high - portrait.low
    width = WIDTH - 0.8
    below = _below(portrait)
    tall = min(width * float(span[1] / span[0]), 8.0)
    figure = Figure((WIDTH, tall + COURSE * len(below) + 1.3), layout="constrained")
    panels = figure.subplots(1 + len(below), 1, squeeze=False, height_ratios=[tall, *[COURSE] * len(below)])
    for axes, draw in zip(panels.flat, (draw_plane, *below.values()), strict=True):
        draw(axes, portrait)
    return figure


def _below(portrait: Portrait) -> dict[str, Draw]:
    """Return what is drawn over time, below a plane or views of space, by its title."""
    angles: dict[str, Draw] = {"how far the hand is turned": draw_angles} if portrait.turns else {}
    return angles | ({"how fast it moves, stage by stage": draw_speeds} if portrait.chained else {})


def _space(portrait: Portrait) -> Figure:
    """Return views from above, the side and the front on one scale, edge to edge, and a perspective.

    A skill with orientation has its angle from the target below them, a chain its speeds.
    """
    x, y, z = (portrait.high - portrait.low).tolist()
    scene = WIDTH - 1.6
    tall = scene * (y + z) / (x + y)
    below = _below(portrait)
    figure = Figure((WIDTH, tall + COURSE * len(below) + 2.3), layout="constrained")
    heights = [tall * y / (y + z), tall * z / (y + z), *[COURSE] * len(below)]
    grid = figure.add_gridspec(len(heights), 2, width_ratios=(x, y), height_ratios=heights)
    places = (grid[0, 0], grid[1, 0], grid[1, 1], *(grid[row, :] for row in range(2, len(heights))))
    draws = dict(zip(TITLES, columns_of(portrait), strict=False)) | below
    for place, (title, draw) in zip(places, draws.items(), strict=True):
        axes = figure.add_subplot(place)
        draw(axes, portrait)
        if portrait.skill.space.unit == "m":  # joint angles have no above
            axes.set_title(title)
    _draw_perspective(figure.add_subplot(grid[0, 1], projection="3d"), portrait)
    return figure


def _draw_perspective(axes: Axes3D, portrait: Portrait) -> None:
    draw_paths(axes, portrait, (0, 1, 2))
    low, high = portrait.scale.factor * portrait.low, portrait.scale.factor * portrait.high
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(tuple((high - low).tolist()), zoom=0.95)
    axes.view_init(elev=22, azim=-60)
    axes.set_title("in perspective")
    for i, axis in enumerate((axes.xaxis, axes.yaxis, axes.zaxis)):
        axis.set_major_locator(MaxNLocator(3))
        axis.set_tick_params(labelsize=6.5, pad=-2)
        axis.set_label_text(label(portrait, i), fontsize=8)
        axis.labelpad = -6
        axis.pane.set_visible(False)
    # The label is at the upper end of the axis, because beside it it would leave the figure.
    axes.zaxis.set_label_text("")
    top = high[2] + 0.05 * (high[2] - low[2])
    axes.text(high[0], high[1], top, label(portrait, 2), fontsize=8, ha="right")


def _courses(portrait: Portrait) -> Figure:
    dimension = portrait.dimension
    first = [draw_line_field][: dimension == 1 and not portrait.chained]
    draws = [*first, *map(course, range(dimension)), *[draw_speeds][: portrait.chained]]
    rows = math.ceil(len(draws) / 2)
    figure = Figure((WIDTH, 1.9 * rows + 1.2), layout="constrained")
    axes = style.first(figure.subplots(rows, 2, squeeze=False), len(draws))
    for each, draw in zip(axes, draws, strict=True):
        draw(each, portrait)
    style.tidy(axes)
    return figure
