"""What figures show of a chain: motions in the colours of their stages, where one is over, and speeds."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from skillctl.arrays import FloatArray
from skillctl.model.chained import ChainedSkill
from skillctl.model.skill import ActingSkill
from skillctl.plotting import style
from skillctl.plotting.portrait import Motion, Portrait

CORNERS = 60  # of an outline
BAND = 0.18  # tint of the time of a stage


def pieces(portrait: Portrait, motion: Motion, *, apart: bool = False) -> Iterator[tuple[slice, style.Line]]:
    """Yield what to draw of a motion in one look: all of it, or what each part, or each stage, moves.

    Args:
        portrait: The skill.
        motion: One of its motions.
        apart: Leave gaps between the pieces, as of a value that jumps there.
    """
    groups = np.array([portrait.group_of(part) for part in motion.acting.tolist()])
    changes = np.flatnonzero(np.diff(groups)) + 1
    for first, end in zip([0, *changes], [*changes, len(groups)], strict=True):
        look = style.moved_by(int(groups[first])) if portrait.grouped else style.MOVED
        yield slice(first, end + (not apart)), look


def draw_handovers(axes: Axes, portrait: Portrait, pair: tuple[int, int]) -> None:
    """Draw where stages of a chain are over, {V ≤ level}, in two coordinates, and number their targets."""
    chain = portrait.skill
    if not isinstance(chain, ChainedSkill):
        return
    ends: dict[tuple[float, float], dict[int, None]] = {}  # stages by where they end
    for index, part in enumerate(chain.acting_parts):
        stage = chain.stage_of(index)
        x, y = portrait.coordinates(part.attractor, pair).tolist()
        ends.setdefault((x, y), {})[stage + 1] = None
        colour = style.part_colour(stage)
        border = portrait.coordinates(outline(part, float(chain.levels[stage]), pair), (0, 1)).T
        axes.add_patch(Polygon(border, fc=style.to_tint(colour, 0.35), ec=colour, lw=1.0, zorder=6.5))
    for place, numbers in ends.items():
        text = ", ".join(map(str, numbers))
        axes.annotate(text, place, (5, 4), textcoords="offset points", zorder=8, **style.NUMBERED)


def outline(part: ActingSkill, level: float, pair: tuple[int, int]) -> FloatArray:
    """Return the corners (n, 2) of the outline of {V ≤ level}, seen in two coordinates of the state.

    Of all y with V = c, √c P⁻¹u / √(uᵀP⁻¹u) lies farthest in the direction u. In learned coordinates of more
    than two dimensions that is the outline but for what these bend within so short a distance.
    """
    angles = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
    directions = np.zeros((CORNERS, part.dimension))
    directions[:, pair] = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    pulled = np.linalg.solve(part.lyapunov, directions.T).T
    border = np.sqrt(level / (directions * pulled).sum(axis=1))[:, None] * pulled
    return part.space.placed(part.coordinates.back(border), part.attractor)[:, pair]


def stage_begins(portrait: Portrait) -> FloatArray:
    """Return when each stage begins, the median over the motions that come so far, [s]. Shape (stages,)."""
    stages = range(len(portrait.skill.parts))
    begun = np.full((len(portrait.motions), len(stages)), np.nan)
    for row, motion in zip(begun, portrait.motions, strict=True):
        groups = np.array([portrait.group_of(part) for part in motion.acting.tolist()])
        for stage in stages:
            if (groups >= stage).any():
                row[stage] = motion.times[(groups >= stage).argmax()]
    known = np.isfinite(begun).any(axis=0)
    return np.asarray(np.nanmedian(begun[:, known], axis=0))


def draw_speeds(axes: Axes, portrait: Portrait) -> None:
    """Draw the speeds of motions of a chain over time, behind them when each stage acts, and its events."""
    chain, latest = portrait.skill, max(float(motion.times[-1]) for motion in portrait.motions)
    assert isinstance(chain, ChainedSkill)
    factor, begins = portrait.scale.factor, stage_begins(portrait)
    top = max(float(motion.speeds.max()) for motion in portrait.motions) * factor or 1.0
    for stage, (begin, end) in enumerate(zip(begins, [*begins[1:], latest], strict=True)):
        axes.axvspan(begin, end, color=style.to_tint(style.part_colour(stage), BAND), lw=0, zorder=0.5)
        axes.text(0.5 * (begin + end), 1.04 * top, str(stage + 1), **style.NUMBERED, ha="center", va="bottom")
        if events := ", ".join(chain.events[stage]):
            axes.text(end, 1.04 * top, f"{events} ", **style.NOTED, ha="right", va="top", rotation=90)
    for motion in portrait.motions:
        for piece, look in pieces(portrait, motion):
            axes.plot(motion.times[piece], factor * motion.speeds[piece], **look)
    axes.set(xlabel="time [s], without events", ylabel=f"speed [{portrait.scale.unit}/s]")
    axes.set_xlim(0, latest)
    axes.set_ylim(0, 1.2 * top)
