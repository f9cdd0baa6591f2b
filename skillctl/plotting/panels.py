"""The panels of figures: a skill in its plane, from one side, or one coordinate over time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse

from skillctl.arrays import FloatArray
from skillctl.model.mixture import GaussianMixture
from skillctl.plotting import style
from skillctl.plotting.chain import draw_handovers, pieces
from skillctl.plotting.flow import draw_flow, drawn_grid
from skillctl.plotting.portrait import Motion, Portrait
from skillctl.rotations import matrices

DEVIATIONS = 2.0  # standard deviations an ellipse reaches
REGION_GRID = 220  # points a side; borders between regions are drawn as smooth as that
LEVELS = 6  # contours of V between the attractor and the farthest corner

VIEWS = ((0, 1), (0, 2), (1, 2))  # of space: from above, from the side, from the front
HANDS = 5  # places along a motion at which the axes of the hand are drawn
HAND = 0.05  # of the longest side of the box: the length of an axis of the hand

Draw = Callable[[Axes, Portrait], None]


def label(portrait: Portrait, axis: int) -> str:
    """Return the label of a coordinate, with its unit."""
    return f"{style.named(portrait.skill.space.names[axis])} [{portrait.scale.unit}]"


def draw_plane(axes: Axes, portrait: Portrait) -> None:
    """Draw a 2-D skill: regions, V, field, density, demonstrations, motions, attractors."""
    frame(axes, portrait, (0, 1))
    if not portrait.chained:  # each stage has a field of its own
        draw_regions(axes, portrait)
        draw_levels(axes, portrait)
        draw_flow(axes, portrait)
        draw_densities(axes, portrait, (0, 1))
    draw_handovers(axes, portrait, (0, 1))
    draw_paths(axes, portrait, (0, 1))


def side(i: int, j: int, *, density: bool = True) -> Draw:
    """Return the function that draws a skill seen so that i points right and j up."""

    def draw(axes: Axes, portrait: Portrait) -> None:
        frame(axes, portrait, (i, j))
        if density and not portrait.chained:
            draw_densities(axes, portrait, (i, j))
        draw_handovers(axes, portrait, (i, j))
        draw_paths(axes, portrait, (i, j))

    return draw


def course(i: int) -> Draw:
    """Return the function that draws coordinate i against time."""

    def draw(axes: Axes, portrait: Portrait) -> None:
        for demonstration in portrait.timed:
            times = demonstration.times - demonstration.times[0]
            axes.plot(times, *portrait.coordinates(demonstration.positions, [i]), **style.DEMONSTRATED)
        for motion in portrait.motions:
            for piece, look in pieces(portrait, motion):
                axes.plot(motion.times[piece], *portrait.coordinates(motion.positions[piece], [i]), **look)
        for goal in portrait.goals:
            axes.axhline(portrait.scale.factor * goal[i], color=style.INK, lw=0.7, ls=(0, (1, 2)), zorder=1)
        axes.set(xlabel="time [s]", ylabel=label(portrait, i))
        axes.set_xlim(0, latest_of(portrait))

    return draw


def draw_angles(axes: Axes, portrait: Portrait) -> None:
    """Draw against time how far a hand is turned from where it ends."""
    for demonstration in portrait.timed:
        states = demonstration.positions
        times = demonstration.times - demonstration.times[0]
        axes.plot(times, portrait.angles(states, states[-1]), **style.DEMONSTRATED)
    for motion in portrait.motions:
        times, angles = angle_course(portrait, motion)
        for piece, look in pieces(portrait, motion, apart=portrait.chained):
            axes.plot(times[piece], angles[piece], **look)
    axes.set(xlabel="time [s]", ylabel="angle from target [°]")
    axes.set_xlim(0, latest_of(portrait))
    axes.set_ylim(bottom=0)


def angle_course(portrait: Portrait, motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Return the times of a motion, and how far it is turned from the target of what acts, in degrees."""
    targets = np.stack([part.attractor for part in portrait.skill.acting_parts])[motion.acting]
    return motion.times, portrait.angles(motion.positions, targets)


def draw_line_field(axes: Axes, portrait: Portrait) -> None:
    """Draw a 1-D skill: its velocity over its coordinate, with that of the demonstrations."""
    x = np.linspace(portrait.low[0], portrait.high[0], 400)
    field = portrait.skill.velocity(x[:, None])[:, 0]
    for demonstration in portrait.demonstrations:
        phases = np.hstack([demonstration.positions, demonstration.velocities])
        axes.plot(*portrait.coordinates(phases, (0, 1)), **style.DEMONSTRATED)
    axes.plot(*portrait.coordinates(np.stack([x, field], axis=1), (0, 1)), **style.MOVED)
    axes.axhline(0, color=style.QUIET, lw=0.7, zorder=1)
    axes.plot(portrait.scale.factor * portrait.goals[:, 0], np.zeros(len(portrait.goals)), **style.GOAL)
    axes.set(xlabel=label(portrait, 0), ylabel=f"velocity [{portrait.scale.unit}/s]")


def columns_of(portrait: Portrait, *, paths: bool = False) -> tuple[Draw, ...]:
    """Return the panels that show a skill: one for a plane, three views of space, else coordinates.

    Those of a skill with orientation also have the angle from the target.

    Args:
        portrait: The skill.
        paths: Show only paths, neither field nor density.
    """
    if portrait.dimension == 2:
        return (side(0, 1, density=False) if paths else draw_plane,)
    if portrait.dimension == 3:
        views = tuple(side(i, j, density=not paths) for i, j in VIEWS)
        return (*views, draw_angles) if portrait.turns else views
    return tuple(course(i) for i in range(portrait.dimension))


def traced(portrait: Portrait, motion: Motion, panel: int) -> Sequence[FloatArray]:
    """Return the line that shows a motion in a panel of ``columns_of(…, paths=True)``: x and y."""
    if portrait.dimension not in (2, 3):
        return [motion.times, *portrait.coordinates(motion.positions, [panel])]
    if panel < len(VIEWS):
        return list(portrait.coordinates(motion.positions, VIEWS[panel]))
    return angle_course(portrait, motion)


def frame(axes: Axes, portrait: Portrait, pair: tuple[int, int]) -> None:
    """Set limits, labels and equal aspect for two coordinates."""
    i, j = pair
    low, high = portrait.scale.factor * portrait.low, portrait.scale.factor * portrait.high
    axes.set(xlabel=label(portrait, i), ylabel=label(portrait, j))
    axes.set_aspect("equal")
    axes.set_xlim(low[i], high[i])
    axes.set_ylim(low[j], high[j])


def draw_paths(axes: Axes, portrait: Portrait, picked: Sequence[int]) -> None:
    """Draw demonstrations, motions, starts and attractors in the coordinates picked: two, or three in 3-D."""

    def draw(positions: FloatArray, line: style.Line) -> None:
        axes.plot(*portrait.coordinates(positions, picked), **line)

    for demonstration in portrait.demonstrations:
        draw(demonstration.positions, style.DEMONSTRATED)
    for motion in portrait.motions:
        for piece, look in pieces(portrait, motion):
            draw(motion.positions[piece], look)
    if portrait.turns:
        draw_hands(axes, portrait, picked)
    for colour, starts in starts_of(portrait):
        draw(starts, {**style.STARTED, "mfc": colour})
    draw(portrait.goals, style.GOAL)


def draw_hands(axes: Axes, portrait: Portrait, picked: Sequence[int]) -> None:
    """Draw the three axes of the hand at a few places along each motion, in the coordinates picked."""
    states = np.vstack([_spread(motion.positions, portrait.dimension) for motion in portrait.motions])
    turns = portrait.skill.space.turns(states)
    assert turns is not None
    reach = HAND * float((portrait.high - portrait.low).max())
    places = states[:, : portrait.dimension]
    tips = places[:, None] + reach * matrices(turns).swapaxes(1, 2)  # (n, axis, 3)
    for axis, line in enumerate(style.AXES.values()):
        gaps = np.full_like(places, np.nan)
        ends = np.stack([places, tips[:, axis], gaps], axis=1).reshape(-1, portrait.dimension)
        axes.plot(*portrait.coordinates(ends, picked), **line)


def _spread(states: FloatArray, n: int) -> FloatArray:
    """Return a few states of a motion (T, d), evenly along the path of its first n coordinates."""
    way = np.cumsum(np.linalg.norm(np.diff(states[:, :n], axis=0, prepend=states[:1, :n]), axis=1))
    return np.asarray(states[np.searchsorted(way, np.linspace(0, way[-1], HANDS))])


def starts_of(portrait: Portrait) -> Iterator[tuple[str, FloatArray]]:
    """Yield starts (n, d) and their colour: of a combined skill, that of the part which they select."""
    skill, starts = portrait.skill, np.array([motion.positions[0] for motion in portrait.motions])
    if portrait.chained or not portrait.grouped:
        yield "white", starts
        return
    selected = skill.part_at(starts)
    for index in np.unique(selected).tolist():
        yield style.part_colour(index), starts[selected == index]


def draw_densities(axes: Axes, portrait: Portrait, pair: tuple[int, int]) -> None:
    """Draw the ellipses of the position densities, seen in two coordinates."""
    several, factor = len(portrait.skill.acting_parts) > 1, portrait.scale.factor
    for index, part in enumerate(portrait.skill.acting_parts):
        colour = style.part_colour(index) if several else style.DENSITY
        # Parts made from one skill have ellipses in common; dashes leave the one below in sight.
        dash = (0, (3, 3)) if index else "-"
        for centre, width, height, angle in ellipses(part.density, pair):
            axes.add_patch(
                Ellipse(
                    tuple((factor * centre).tolist()),
                    factor * width,
                    factor * height,
                    angle=angle,
                    facecolor=style.to_tint(colour, 0.08 if several else 0.13),
                    edgecolor=colour,
                    lw=1.1 if several else 0.8,
                    ls=dash,
                    zorder=2.0,
                )
            )


def ellipses(
    density: GaussianMixture, pair: tuple[int, int]
) -> Iterator[tuple[FloatArray, float, float, float]]:
    """Yield centre (2,), width, height and angle [degrees] of each component's ellipse in two coordinates.

    A Gaussian's marginal keeps the rows and columns of its coordinates; the ellipse reaches 2σ.
    """
    chosen = np.ix_(pair, pair)
    for mean, covariance in zip(density.means, density.covariances, strict=True):
        variances, directions = np.linalg.eigh(covariance[chosen])
        height, width = 2 * DEVIATIONS * np.sqrt(np.maximum(variances, 0.0))
        angle = float(np.degrees(np.arctan2(directions[1, 1], directions[0, 1])))
        yield mean[list(pair)], float(width), float(height), angle


def draw_regions(axes: Axes, portrait: Portrait, *, tint: float = 0.22) -> None:
    """Draw the borders between the regions of a combined 2-D skill, and tint those unless ``tint`` is 0."""
    for index, (x, y, lead) in enumerate(_leads(portrait)):
        if tint > 0:
            colour = style.to_tint(style.part_colour(index), tint)
            axes.contourf(x, y, lead, levels=[0, 1e6], colors=[colour], zorder=0.2)
        if lead.min() < 0 < lead.max():
            axes.contour(x, y, lead, levels=[0], colors=[style.INK], linewidths=0.6, zorder=1.5)


def _leads(portrait: Portrait) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Yield per part a grid and its lead over the other parts there; it acts where that is positive."""
    skill = portrait.skill
    if len(skill.acting_parts) == 1:
        return
    x, y, places = drawn_grid(portrait, REGION_GRID)
    with np.errstate(divide="ignore"):  # a weight may vanish
        scores = np.log(skill.part_weights_at(places))
    for index in range(len(skill.acting_parts)):
        others = np.delete(scores, index, axis=1)
        lead = np.clip(scores[:, index] - others.max(axis=1, initial=-np.inf), -1e3, 1e3)
        yield x, y, lead.reshape(len(y), len(x))


def draw_levels(axes: Axes, portrait: Portrait) -> None:
    """Draw levels of V at equal steps of distance, those of each part where it acts."""
    x, y, places = drawn_grid(portrait, REGION_GRID)
    acting, parts = portrait.skill.part_at(places), portrait.skill.acting_parts
    shared = all(part.form == parts[0].form for part in parts) and len(portrait.goals) == 1
    for index, part in enumerate(parts[: 1 if shared else None]):
        distances = part.v_distance(places)
        if not shared:
            distances[acting != index] = np.nan
        if np.isfinite(distances).any():
            levels = np.linspace(0, float(np.nanmax(distances)), LEVELS + 1)[1:-1]
            field = np.ma.masked_invalid(distances).reshape(len(y), len(x))
            look: style.Line = {"colors": [style.QUIET], "linewidths": 0.8, "linestyles": ":", "zorder": 1.2}
            axes.contour(x, y, field, levels=levels, **look)


def latest_of(portrait: Portrait) -> float:
    """Return the time up to which motions are worth showing, [s]: the end of a rollout is slow."""
    ends = [d.duration for d in portrait.timed]
    arrivals = [float(motion.times[-1]) for motion in portrait.motions]
    return min(2 * max(ends), max([*ends, *arrivals])) if ends else max(arrivals)
