"""The figure of a fit: paths and speeds of every demonstration against the skill's motion from its start."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from skillctl.arrays import FloatArray
from skillctl.model.demonstration import Demonstration
from skillctl.plotting import style
from skillctl.plotting.panels import columns_of, latest_of, traced
from skillctl.plotting.portrait import Motion, Portrait, box_around
from skillctl.plotting.skill import WIDTH

Apart: TypeAlias = "tuple[float | None, float | None]"  # a distance, and an angle [rad]

UNKNOWN: Apart = (None, None)
MOST_PROFILES = 12  # panels of speed; paths are drawn of all
ACROSS = 4
HEADROOM = 2.5  # of the fastest demonstration; a faster motion is cut off and its peak given as a number


def draw_fit(
    portrait: Portrait,
    errors: Sequence[Apart],
    left_out: Sequence[Motion] = (),
    moved: Sequence[Apart] = (),
) -> Figure:
    """Return the figure of a fit.

    Args:
        portrait: The learned skill, with at least one demonstration.
        errors: Mean DTW distance to each of its demonstrations, in the unit of the space, and angle, [rad];
            None if unknown.
        left_out: For each demonstration, the motion from its start of a skill that was learned without it;
            empty if there are none.
        moved: How far each demonstration was moved and turned to end at the target, likewise; empty if
            unknown.
    """
    profiled = portrait.demonstrations[:MOST_PROFILES]
    rows = math.ceil(len(profiled) / ACROSS)
    portrait = _boxed(portrait, left_out)
    draws = columns_of(portrait, paths=True)
    tall = _height_of_paths(portrait, len(draws))
    with style.drawing():
        figure = Figure((WIDTH, tall + 1.45 * rows + 1.0), layout="constrained")
        upper, lower = figure.subfigures(2, 1, squeeze=False, height_ratios=(tall, 1.45 * rows + 0.3)).flat
        across = _across(len(draws))
        paths = upper.subplots(math.ceil(len(draws) / across), across, squeeze=False)
        for panel, (axes, draw) in enumerate(zip(style.first(paths, len(draws)), draws, strict=True)):
            draw(axes, portrait)
            _draw_left_out(axes, portrait, left_out, panel)
            if across == 2:
                axes.locator_params(axis="x", nbins=6)
        fastest = max(float(_speeds(d, portrait).max()) for d in portrait.demonstrations)
        top = HEADROOM * portrait.scale.factor * fastest
        profiles = lower.subplots(rows, ACROSS, squeeze=False, sharex=True, sharey=True)
        profiles = style.first(profiles, len(profiled))
        for index, (axes, demonstration) in enumerate(zip(profiles, profiled, strict=True)):
            held = left_out[index] if left_out else None
            _draw_profile(axes, demonstration, portrait.motions[index], held, portrait, top)
            error = _error(errors[index], moved[index] if moved else UNKNOWN, portrait)
            axes.set_title(f"{style.named(demonstration.source, 28)}\n{error}", fontsize=7.5)
        _label_outer(profiles, portrait, top)
        count = len(portrait.demonstrations)
        some = f", speeds of the first {len(profiled)} of {count}" if count > len(profiled) else ""
        figure.suptitle(f"{style.named(portrait.name)}: demonstrations and motions from their starts{some}")
        held_out = ["learned without that demonstration"] if left_out else []
        ends = ["start", "attractor"] if portrait.dimension in (2, 3) else []
        ends += style.AXES if portrait.turns else []
        style.legend(figure, style.entries("demonstration", "motion of the skill", *held_out, *ends))
    return figure


def _error(distance: Apart, moved: Apart, portrait: Portrait) -> str:
    dtw = f"DTW {_said(distance, portrait)}"
    between = ",\n" if portrait.turns else ", "  # there is no room for four numbers in a line
    return f"{dtw}{between}moved {_said(moved, portrait)}" if any(moved) else dtw


def _said(apart: Apart, portrait: Portrait) -> str:
    unit = portrait.skill.space.unit
    value, turned = apart
    text = "–" if value is None else f"{1e3 * value:.2f} mm" if unit == "m" else f"{value:.3g} {unit}"
    return text if turned is None else f"{text}, {math.degrees(turned):.2f}°"


def _boxed(portrait: Portrait, left_out: Sequence[Motion]) -> Portrait:
    """Return the portrait with a box around all that the figure shows."""
    points = [portrait.goals, *(d.positions for d in portrait.demonstrations)]
    points += [motion.positions for motion in (*portrait.motions, *left_out)]
    low, high = box_around(np.vstack(points)[:, : portrait.dimension])
    return portrait.within(low, high)


def _across(panels: int) -> int:
    """Return how many panels of paths stand in a row: three, but four make two rows."""
    return 2 if panels == 4 else min(panels, 3)


def _height_of_paths(portrait: Portrait, panels: int) -> float:
    """Return the height of the panels of paths, [inch]."""
    span = portrait.high - portrait.low
    if panels == 1 and len(span) == 2:
        return min(0.62 * WIDTH * float(span[1] / span[0]), 5.0) + 0.5
    return (2.7 if len(span) == 3 else 1.9) * math.ceil(panels / _across(panels))


def _draw_left_out(axes: Axes, portrait: Portrait, left_out: Sequence[Motion], panel: int) -> None:
    for each in left_out:
        axes.plot(*traced(portrait, each, panel), **style.HELD)


def _draw_profile(
    axes: Axes,
    demonstration: Demonstration,
    motion: Motion,
    held: Motion | None,
    portrait: Portrait,
    top: float,
) -> None:
    """Draw speeds over time; the skill has no clock, so only shape and size are to be compared."""
    speeds, scale = _speeds(demonstration, portrait), portrait.scale
    times = demonstration.times[: len(speeds)] - demonstration.times[0]
    axes.plot(times, scale.factor * speeds, **style.DEMONSTRATED)
    drawn = [(motion, style.MOVED)] if held is None else [(motion, style.MOVED), (held, style.HELD)]
    for row, (each, line) in enumerate(drawn):
        axes.plot(each.times, scale.factor * each.speeds, **line)
        peak = scale.factor * float(each.speeds.max())
        if peak > top:
            words = f"peak {style.two_digits(peak)} {scale.unit}/s"
            place = (0.98, 0.97 - 0.15 * row)
            axes.annotate(words, place, xycoords="axes fraction", ha="right", va="top", fontsize=7,
                          color=line["color"])  # fmt: skip


def _speeds(demonstration: Demonstration, portrait: Portrait) -> FloatArray:
    """Return the speeds along a demonstration, per second; shape (T − 2,).

    Its last sample closes the gap that trimming left before the point of rest, which was not
    demonstrated: neither that sample nor the difference across it has a speed.
    """
    shown = demonstration.velocities[: max(len(demonstration.times) - 2, 1)]
    return portrait.skill.space.magnitudes(shown)[0]


def _label_outer(axes: Sequence[Axes], portrait: Portrait, top: float) -> None:
    for index, each in enumerate(axes):
        if index + ACROSS >= len(axes):
            each.set_xlabel("time [s]")
            each.tick_params(labelbottom=True)
        if index % ACROSS == 0:
            each.set_ylabel(f"speed [{portrait.scale.unit}/s]")
    style.tidy(axes)
    axes[0].set_xlim(0, latest_of(portrait))
    axes[0].set_ylim(0, min(top, axes[0].get_ylim()[1]))
