"""The figure of a fit: paths and speeds of every demonstration against the skill's motion from its start."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from skillctl.arrays import FloatArray
from skillctl.model.demonstration import Demonstration
from skillctl.plotting import style
from skillctl.plotting.panels import VIEWS, columns_of, latest_of
from skillctl.plotting.portrait import Motion, Portrait, Scale, box_around
from skillctl.plotting.skill import WIDTH

MOST_PROFILES = 12  # panels of speed; paths are drawn of all
ACROSS = 4
HEADROOM = 2.5  # of the fastest demonstration; a faster motion is cut off and its peak given as a number


def draw_fit(
    portrait: Portrait,
    errors: Sequence[float | None],
    left_out: Sequence[Motion] = (),
    moved: Sequence[float | None] = (),
) -> Figure:
    """Return the figure of a fit.

    Args:
        portrait: The learned skill, with at least one demonstration.
        errors: Mean DTW distance to each of its demonstrations, in the unit of the space; None if unknown.
        left_out: For each demonstration, the motion from its start of a skill that was learned without it;
            empty if there are none.
        moved: How far each demonstration was moved to end at the target, in the unit of the space; empty if
            unknown.
    """
    profiled = portrait.demonstrations[:MOST_PROFILES]
    dimension = portrait.skill.dimension
    rows = math.ceil(len(profiled) / ACROSS)
    portrait = _boxed(portrait, left_out)
    draws = columns_of(portrait, paths=True)
    tall = _height_of_paths(portrait, len(draws))
    with style.drawing():
        figure = Figure((WIDTH, tall + 1.45 * rows + 1.0), layout="constrained")
        upper, lower = figure.subfigures(2, 1, squeeze=False, height_ratios=(tall, 1.45 * rows + 0.3)).flat
        paths = upper.subplots(math.ceil(len(draws) / 3), min(len(draws), 3), squeeze=False)
        for panel, (axes, draw) in enumerate(zip(style.first(paths, len(draws)), draws, strict=True)):
            draw(axes, portrait)
            _draw_left_out(axes, portrait, left_out, panel)
        top = HEADROOM * portrait.scale.factor * max(float(_speeds(d).max()) for d in portrait.demonstrations)
        profiles = lower.subplots(rows, ACROSS, squeeze=False, sharex=True, sharey=True)
        profiles = style.first(profiles, len(profiled))
        for index, (axes, demonstration) in enumerate(zip(profiles, profiled, strict=True)):
            held = left_out[index] if left_out else None
            _draw_profile(axes, demonstration, portrait.motions[index], held, portrait.scale, top)
            error = _error(errors[index], moved[index] if moved else None, portrait)
            axes.set_title(f"{style.named(demonstration.source, 28)}\n{error}", fontsize=7.5)
        _label_outer(profiles, portrait, top)
        count = len(portrait.demonstrations)
        some = f", speeds of the first {len(profiled)} of {count}" if count > len(profiled) else ""
        figure.suptitle(f"{style.named(portrait.name)}: demonstrations and motions from their starts{some}")
        held_out = ["learned without that demonstration"] if left_out else []
        ends = ["start", "attractor"] if dimension in (2, 3) else []
        style.legend(figure, style.entries("demonstration", "motion of the skill", *held_out, *ends))
    return figure


def _error(distance: float | None, moved: float | None, portrait: Portrait) -> str:
    unit = portrait.skill.space.unit
    dtw, aside = (
        "–" if value is None else f"{1e3 * value:.2f} mm" if unit == "m" else f"{value:.3g} {unit}"
        for value in (distance, moved)
    )
    return f"DTW {dtw}, moved {aside}" if moved else f"DTW {dtw}"


def _boxed(portrait: Portrait, left_out: Sequence[Motion]) -> Portrait:
    """Return the portrait with a box around all that the figure shows."""
    points = [portrait.goals, *(d.positions for d in portrait.demonstrations)]
    points += [motion.positions for motion in portrait.motions]
    points += [each.positions for each in left_out]
    low, high = box_around(np.vstack(points))
    return portrait.within(low, high)


def _height_of_paths(portrait: Portrait, panels: int) -> float:
    """Return the height of the panels of paths, [inch]."""
    span = portrait.high - portrait.low
    if panels == 1 and len(span) == 2:
        return min(0.62 * WIDTH * float(span[1] / span[0]), 5.0) + 0.5
    return 2.7 if len(span) == 3 else 1.9 * math.ceil(panels / 3)


def _draw_left_out(axes: Axes, portrait: Portrait, left_out: Sequence[Motion], panel: int) -> None:
    for each in left_out:
        if portrait.skill.dimension in (2, 3):
            axes.plot(*portrait.coordinates(each.positions, VIEWS[panel]), **style.HELD)
        else:
            axes.plot(each.times, *portrait.coordinates(each.positions, [panel]), **style.HELD)


def _draw_profile(
    axes: Axes, demonstration: Demonstration, motion: Motion, held: Motion | None, scale: Scale, top: float
) -> None:
    """Draw speeds over time; the skill has no clock, so only shape and size are to be compared."""
    speeds = _speeds(demonstration)
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


def _speeds(demonstration: Demonstration) -> FloatArray:
    """Return the speeds along a demonstration, per second; shape (T − 2,).

    Its last sample closes the gap that trimming left before the point of rest, which was not
    demonstrated: neither that sample nor the difference across it has a speed.
    """
    return np.asarray(
        np.linalg.norm(demonstration.velocities[: max(len(demonstration.times) - 2, 1)], axis=1)
    )


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
