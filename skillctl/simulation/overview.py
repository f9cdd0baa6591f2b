"""All episodes of a batch in one picture: where the cups stood, where the hand went, and what came of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from skillctl.errors import GoalNotReachedError
from skillctl.simulation.batch import Row, Trace
from skillctl.simulation.bullet import silenced
from skillctl.simulation.camera import Camera
from skillctl.simulation.frame import SHARPNESS, TARGET, composed, near, view_direction
from skillctl.simulation.overlay import SUPERSAMPLING, Colour, Overlay
from skillctl.simulation.picture import GUTTER, HEADER, INK, PAPER, draw_header, encode_png
from skillctl.simulation.stage import Stage

SIZE = (1200, 900)
SCENE_DIRECTION = (-0.85, -1.00, 1.45)  # from higher up than one episode: many cups
SUCCESS, FAILURE = (24, 92, 180), (206, 44, 32)
PARTS: tuple[Colour, ...] = (
    (0, 114, 178),
    (213, 94, 0),
    (0, 145, 105),
    (190, 80, 150),
    (146, 104, 0),
    (60, 60, 140),
)  # told apart by people with any colour vision
PALENESS = 0.6  # of the cups: lines of the same colour can be seen before them
LEGEND = 40

ColourBy: TypeAlias = Literal["outcome", "part"]


def encode_overview(
    rows: Sequence[Row],
    *,
    title: str,
    verdict: str,
    colour_by: ColourBy = "outcome",
    parts: Sequence[str] = (),
) -> bytes:
    """Return all episodes in one picture, as a PNG file; equal batches give equal bytes.

    The arm stands where the first episode begins. Each line is the way of a hand up to its cup or target,
    with a dot at its start; a cross ends the way of an episode that failed.

    Args:
        rows: The episodes; those that could not begin are counted, but not seen.
        title: For the header.
        verdict: For the header, too.
        colour_by: ``outcome``: success blue, failure red; ``part``: by the part of a combined skill.
        parts: Names of the parts.

    Raises:
        GoalNotReachedError: No episode could begin.
    """
    shown = [(row, row.trace) for row in rows if row.trace is not None]
    if not shown:
        raise GoalNotReachedError("there is nothing to show: no episode could begin.")
    picture = _world(shown, colour_by)
    sheet = Image.new("RGB", (SIZE[0] + 2 * GUTTER, HEADER + SIZE[1] + LEGEND), PAPER)
    sheet.paste(picture, (GUTTER, HEADER))
    draw_header(sheet, title, verdict, success=True)
    _draw_legend(sheet, _legend(rows, colour_by, parts))
    return encode_png(sheet)


def _world(shown: Sequence[tuple[Row, Trace]], colour_by: ColourBy) -> Image.Image:
    scene, first = shown[0][0].scenario.scene, shown[0][1]
    with silenced(1), Stage(first.arm, first.base_yaw, scene) as stage:
        stage.pose(first.joints, first.fingers)
        for row, trace in shown:
            if row.scenario.cup is not None:
                red, green, blue = 1 - PALENESS * (1 - np.array(_colour(row, trace, colour_by)) / 255)
                stage.place(stage.add_cup(row.scenario.cup, (red, green, blue, 1.0)), trace.cup)
        motion = np.vstack([np.vstack([trace.path, trace.target]) for _, trace in shown])
        points = np.vstack([motion, near(stage.corners, motion), stage.arm_extent()])
        towards = view_direction(first.plane, first.base_yaw) if scene is None else np.array(SCENE_DIRECTION)
        camera = Camera(points, towards, *(round(SHARPNESS * length) for length in SIZE))
        view = stage.seen_by(camera)
        overlay = Overlay(camera, view, SIZE)
        for row, trace in shown:
            overlay.line(trace.path, _colour(row, trace, colour_by), width=2.2)
        for row, trace in shown:
            overlay.disc(trace.path[0], _colour(row, trace, colour_by), radius=3.0)
            if scene is None:
                overlay.ring(trace.target, TARGET, radius=7.0)
            if not row.success:
                overlay.cross(trace.path[-1], FAILURE, radius=5.0)
        return composed(view, stage.floor, overlay, SIZE)


def _colour(row: Row, trace: Trace, colour_by: ColourBy) -> Colour:
    if colour_by == "part":
        return PARTS[trace.part % len(PARTS)]
    return SUCCESS if row.success else FAILURE


def _legend(rows: Sequence[Row], colour_by: ColourBy, parts: Sequence[str]) -> list[tuple[Colour, str]]:
    successes = sum(row.success for row in rows)
    failed = [(FAILURE, f"failed: {len(rows) - successes}")] if successes < len(rows) else []
    if colour_by == "outcome":
        return [(SUCCESS, f"succeeded: {successes}"), *failed]
    acted = [row.trace.part for row in rows if row.trace is not None]
    names = {part: parts[part] if part < len(parts) else f"part {part + 1}" for part in sorted(set(acted))}
    return [
        *((PARTS[part % len(PARTS)], f"{name}: {acted.count(part)}") for part, name in names.items()),
        *failed,
    ]


def _draw_legend(sheet: Image.Image, entries: Sequence[tuple[Colour, str]]) -> None:
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(16)
    x, middle = GUTTER + 12, sheet.height - LEGEND // 2
    large = Image.new("L", (12 * SUPERSAMPLING, 12 * SUPERSAMPLING))
    ImageDraw.Draw(large).ellipse((0, 0, large.width - 1, large.height - 1), fill=255)
    dot = large.reduce(SUPERSAMPLING)
    for colour, text in entries:
        sheet.paste(colour, (x - 6, middle - 6), dot)
        draw.text((x + 14, middle), text, font=font, fill=INK, anchor="lm")
        x += 14 + round(draw.textlength(text, font=font)) + 36
