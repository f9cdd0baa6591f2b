"""Figures of certificates: where and how fast V shrinks, which is no proof, beside what is proved."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Circle

from skillctl.arrays import FloatArray
from skillctl.model.lyapunov import QuadraticForm
from skillctl.model.skill import Skill
from skillctl.plotting import style
from skillctl.plotting.flow import grid
from skillctl.plotting.panels import draw_regions, frame
from skillctl.plotting.portrait import Motion, Portrait, box_around, motions_from
from skillctl.plotting.skill import WIDTH

FINENESS = {2: 241, 3: 61}  # points a side of the grid of a map, odd: the middle is one
# Of the rates: readable with any colour vision; without the darkest fifth, for the sake of black lines.
COLOURS = ListedColormap(matplotlib.colormaps["cividis"](np.linspace(0.2, 1.0, 256)))
RATE = "decay rate −V̇ / 2V [1/s]"
BLOCKS = ("position: √V", "orientation: the angle from the target")
LARGEST_SHARE = 1e2  # of it; above it motions are lost
RANGE = 1e4  # from the largest decay rate shown in its own colour down to the smallest
SMALLEST_SHARE = 1e-4  # of the distance at the start; below it motions have arrived


@dataclass(frozen=True, eq=False)
class Bounds:
    """The parts of a certificate that a figure shows.

    Attributes:
        verdict: The verdict, in words, for the title.
        rates: Proved decay rates of motions from everywhere, [1/s], one for each block of the space: of all
            coordinates, or of position and orientation; None where there is none.
        radii: Distance from each part's attractor within which motions are proved to end there, or None.
        witness: Start (d,) of a motion that reaches no attractor, or None.
    """

    verdict: str
    rates: tuple[float | None, ...]
    radii: tuple[float | None, ...]
    witness: tuple[float, ...] | None


def decay(skill: Skill, positions: FloatArray) -> FloatArray:
    r"""Return −V̇ / (2 V) at positions (n, d), shape (n,), [1/s]: the rate at which √V shrinks there.

    V is that of the part that a start there selects. The rate is zero exactly
    where V̇ is, negative where V grows, and NaN at the attractor.
    """
    rates = np.empty(len(positions))
    acting = skill.part_at(positions)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for index, part in enumerate(skill.acting_parts):
            mask = acting == index
            rates[mask] = skill.outer_speed * part.decay(positions[mask])
    rates[~np.isfinite(rates)] = np.nan
    return rates


def draw_proofs(proofs: Sequence[tuple[Portrait, Bounds]]) -> Figure:
    """Return the figure of certificates, one row per skill.

    Each row has a map of the decay rate −V̇ / 2V in two dimensions, or its slices through the attractor in
    three, and in every dimension √V along motions, beside the proved rate. Of poses the slices have the
    orientation of the target, and √V of position and orientation, which is an angle, are apart.
    """
    heights = [_height(portrait) for portrait, _ in proofs]
    with style.drawing():
        figure = Figure((WIDTH + 1.6, sum(heights) + 0.7), layout="constrained")
        rows = figure.subfigures(len(proofs), 1, squeeze=False, height_ratios=heights).flat
        for row, (portrait, bounds) in zip(rows, proofs, strict=True):
            lost = _witness(portrait, bounds)
            if portrait.dimension == 2:
                map_axes, *courses = row.subplots(1, 2, width_ratios=(1.5, 1))
                _draw_map(map_axes, portrait, bounds, lost)
            elif portrait.dimension == 3:
                panels = list(row.subplot_mosaic("aabbcc;dddeee" if portrait.turns else "ab;cd").values())
                _draw_slices(panels[:3], portrait, bounds, lost)
                courses = panels[3:]
            else:
                courses = [row.subplots()]
            for block, axes in enumerate(courses):
                _draw_courses(axes, portrait, bounds, lost, block)
            row.suptitle(f"{style.named(portrait.name)}: {bounds.verdict}")
        style.legend(figure, _explained(proofs), columns=3)
    return figure


def _witness(portrait: Portrait, bounds: Bounds) -> Motion | None:
    """Return the motion that reaches no attractor, if one was found."""
    if bounds.witness is None:
        return None
    longest = max((motion.times[-1] for motion in portrait.motions), default=None)
    return motions_from(portrait.skill, np.array([bounds.witness]), longest)[0]


def _draw_map(axes: Axes, portrait: Portrait, bounds: Bounds, lost: Motion | None) -> None:
    """Draw the decay rate over the plane, its zero level, its lowest point, radii and witness."""
    if lost is not None:
        low, high = box_around(np.vstack([portrait.low, portrait.high, lost.positions[:1]]))
        portrait = portrait.within(low, high)
    x, y, places = grid(portrait.low, portrait.high, FINENESS[2])
    rates = decay(portrait.skill, places)
    image = _draw_rates(axes, rates.reshape(len(y), len(x)), portrait, (0, 1), _limits(rates))
    bar = axes.figure.colorbar(image, ax=axes, label=RATE, extend=_extend(rates), shrink=0.8)
    style.logarithmic(bar.ax.yaxis)
    draw_regions(axes, portrait, tint=0)
    _draw_marks(axes, portrait, bounds, lost, (0, 1))
    if np.isfinite(rates).any():
        lowest = int(np.nanargmin(rates))
        axes.plot(*portrait.coordinates(places[lowest], (0, 1)), **style.LOWEST)
        axes.set_title(f"lowest here: {rates[lowest]:.3g} 1/s")


def _draw_slices(axes: Sequence[Axes], portrait: Portrait, bounds: Bounds, lost: Motion | None) -> None:
    """Draw the decay rate in three planes through the first attractor, and the lowest rate in space."""
    scale, through = portrait.scale, portrait.goals[0]
    sides = [np.linspace(portrait.low[i], portrait.high[i], FINENESS[3]) for i in range(3)]
    space = np.tile(through, (FINENESS[3] ** 3, 1))
    space[:, :3] = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    rates = decay(portrait.skill, space)
    limits = _limits(rates)
    for each, pair in zip(axes, itertools.combinations(range(3), 2), strict=True):
        i, j = pair
        x, y, flat = grid(portrait.low[[i, j]], portrait.high[[i, j]], 2 * FINENESS[3] - 1)
        places = np.tile(through, (len(flat), 1))
        places[:, [i, j]] = flat
        plane = decay(portrait.skill, places).reshape(len(y), len(x))
        image = _draw_rates(each, plane, portrait, pair, limits)
        _draw_marks(each, portrait, bounds, lost, pair)
        (rest,) = {0, 1, 2} - {i, j}
        where = f"{scale.factor * through[rest]:.3g} {scale.unit}"
        each.set_title(f"{style.named(portrait.skill.space.names[rest])} = {where}")
        if np.isfinite(rates).any():
            lowest = int(np.nanargmin(rates))
            each.plot(*portrait.coordinates(space[lowest], pair), **style.LOWEST)
    where = "\nturned as the target, lowest in the box" if portrait.turns else "; lowest in the box"
    words = f"{RATE}{where}: {np.nanmin(rates):.3g}"
    bar = axes[0].figure.colorbar(
        image, ax=list(axes), label=words, extend=_extend(rates), location="left", shrink=0.7
    )
    style.logarithmic(bar.ax.yaxis)


def _extend(rates: FloatArray) -> str:
    """Return the end of the colour bar that gets an arrow: below, if some rate is not positive."""
    return "min" if np.nanmin(rates) <= 0 else "neither"


def _limits(rates: FloatArray) -> tuple[float, float]:
    """Return the smallest and largest rate with a colour of its own, [1/s]; both positive."""
    positive = rates[rates > 0]
    if not len(positive):
        return 1e-3, 1.0
    top = float(np.quantile(positive, 0.99))
    return max(float(positive.min()), top / RANGE), max(top, 1.001 * float(positive.min()))


def _draw_rates(
    axes: Axes,
    rates: FloatArray,
    portrait: Portrait,
    pair: tuple[int, int],
    limits: tuple[float, float],
) -> AxesImage:
    """Draw rates on a grid (y, x); those that are not positive have a colour of their own, and a border."""
    i, j = pair
    low, high = portrait.scale.factor * portrait.low, portrait.scale.factor * portrait.high
    colours = COLOURS.with_extremes(under=style.GROWING, bad="white")
    extent = (low[i], high[i], low[j], high[j])
    frame(axes, portrait, pair)
    image = axes.imshow(
        np.where(rates > 0, np.maximum(rates, limits[0]), np.where(np.isnan(rates), np.nan, 0.5 * limits[0])),
        extent=extent,
        origin="lower",
        cmap=colours,
        norm=LogNorm(*limits),
        interpolation="nearest",
        zorder=0.1,
    )
    if np.nanmin(rates) < 0 < np.nanmax(rates):
        axes.contour(np.nan_to_num(rates), levels=[0], extent=extent, colors=[style.INK], linewidths=1.0)
    return image


def _draw_marks(
    axes: Axes, portrait: Portrait, bounds: Bounds, lost: Motion | None, pair: tuple[int, int]
) -> None:
    """Draw demonstrations faintly, attractors, certified radii and the witness."""
    for motion in portrait.motions:
        axes.plot(*portrait.coordinates(motion.positions, pair), **style.FAINT)
    axes.plot(*portrait.coordinates(portrait.goals, pair), **style.GOAL)
    for part, radius in zip(portrait.skill.acting_parts, bounds.radii, strict=True):
        if radius is not None:
            x, y = portrait.coordinates(part.attractor, pair)
            size = portrait.scale.factor * radius
            look: style.Line = {"fc": "none", "ec": "white", "lw": 1.0, "path_effects": style.OUTLINED}
            axes.add_patch(Circle((x, y), size, zorder=6, **look))
    if lost is not None:
        axes.plot(*portrait.coordinates(lost.positions, pair), **style.LOST)
        start = portrait.coordinates(lost.positions[0], pair)
        axes.plot(*start, "o", mfc="white", mec=style.WITNESS, ms=5, zorder=8)


def _draw_courses(axes: Axes, portrait: Portrait, bounds: Bounds, lost: Motion | None, block: int) -> None:
    """Draw how √V of a block shrinks along motions, on a logarithmic scale.

    There the proved rate is a straight line.
    """
    latest = max(float(motion.times[-1]) for motion in portrait.motions)
    for motion in portrait.motions:
        _draw_shares(axes, portrait, motion, block, {**style.MOVED, "lw": 0.8, "zorder": 3.0})
    if lost is not None:
        _draw_shares(axes, portrait, lost, block, style.LOST)
        latest = max(latest, float(lost.times[-1]))
    rate = bounds.rates[block]
    if rate is not None:
        times = np.linspace(0, latest, 50)
        axes.plot(times, np.exp(-rate * times), **style.PROVED)
    axes.set(xlabel="time [s]", ylabel="√V, as a share of that at the start", yscale="log")
    if portrait.turns:
        axes.set_title(BLOCKS[block])
        axes.set_ylabel("share of that at the start")
    axes.set_xlim(0, latest)
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, SMALLEST_SHARE), min(max(high, 1.5), LARGEST_SHARE))
    style.logarithmic(axes.yaxis)
    axes.grid(True, color="#DDDDDD", lw=0.5)
    style.tidy([axes])


def _draw_shares(axes: Axes, portrait: Portrait, motion: Motion, block: int, line: style.Line) -> None:
    part = portrait.skill.acting_parts[motion.part]
    low, high = np.cumsum([0, *part.space.blocks])[block : block + 2]
    offsets = (part.lifted(motion.positions) - part.anchor)[:, low:high]
    shrinking = QuadraticForm(part.lyapunov[low:high, low:high]).distance(offsets)
    if shrinking[0] > 0:
        axes.plot(motion.times, np.maximum(shrinking / shrinking[0], 1e-12), **line)


def _height(portrait: Portrait) -> float:
    """Return the height of a skill's row, [inch]."""
    span = portrait.high - portrait.low
    if len(span) == 2:
        return min(max(4.4 * float(span[1] / span[0]), 2.6), 6.0) + 0.7
    return 6.4 if len(span) == 3 else 3.2


def _explained(proofs: Sequence[tuple[Portrait, Bounds]]) -> dict[str, Any]:
    """Return the entries of the legend, of only what these figures show."""
    wanted = ["motion of the skill"]
    if any(rate is not None for _, bounds in proofs for rate in bounds.rates):
        wanted.append("proved: no motion is slower")
    if any(bounds.witness is not None for _, bounds in proofs):
        wanted.append("witness: reaches no attractor")
    if any(portrait.dimension in (2, 3) for portrait, _ in proofs):
        wanted += ["attractor", "lowest decay rate"]
    if any(radius is not None for _, bounds in proofs for radius in bounds.radii):
        wanted.append("proved radius")
    return style.entries(*wanted)
