"""Pictures of episodes: the contact sheet of one, and the overview of many."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Sequence
from typing import Literal, TypeAlias

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from skillctl.arrays import FloatArray
from skillctl.errors import GoalNotReachedError
from skillctl.geometry import arc_lengths, box
from skillctl.simulation.batch import Row, Trace
from skillctl.simulation.bullet import silenced
from skillctl.simulation.camera import Camera
from skillctl.simulation.canvas import SUPERSAMPLING, Canvas, Colour, under_sky
from skillctl.simulation.episode import PHASES, Episode, spread_out
from skillctl.simulation.options import Plane
from skillctl.simulation.stage import Stage

ColourBy: TypeAlias = Literal["outcome", "part"]

COLUMNS, ROWS = 3, 2  # of a contact sheet
TILE, OVERVIEW = (480, 400), (1200, 900)
GUTTER, HEADER, LEGEND = 8, 52, 40  # pixels
SHARPNESS = 1.5  # pictures are rendered this much larger than shown, for smooth edges
INK, PAPER = (38, 44, 54), (255, 255, 255)
TRAIL, PLAN, TARGET = (
    (196, 16, 104),
    (84, 96, 112),
    (0, 122, 80),
)  # unlike all arms
SUCCESS, FAILURE, REFUSAL = (24, 92, 180), (206, 44, 32), (190, 40, 30)
PARTS: tuple[Colour, ...] = (
    (0, 114, 178),
    (213, 94, 0),
    (0, 145, 105),
    (190, 80, 150),
    (146, 104, 0),
    (60, 60, 140),
)  # readers with any colour vision can distinguish these
PALENESS = 0.6  # of the cups in an overview, so that lines of the same colour stand out
AXES_SPACING, AXES_SIZE = 0.08, 0.035  # [m], of the hand's axes along a path
FEW = 10  # paths in an overview; of more, fewer axes are drawn on each
NEIGHBOURHOOD = 0.15  # [m]: the scene this far around the motions has to be in an overview

# Directions from the motion to the camera, for a base that faces +x; planes are not mirrored.
DIRECTIONS: dict[Plane | None, tuple[float, float, float]] = {
    None: (0.75, -1.2, 0.55),
    "xy": (0.25, -1.1, 0.95),
    "xz": (0.15, -1.4, 0.35),
    "yz": (1.4, -0.45, 0.40),
}
SCENE_DIRECTION = (-0.40, -1.3, 0.75)  # past the arm, onto the boards
ARM_OPACITY = 0.6  # in the overview, where it hides no motion
OVERVIEW_DIRECTION = (-0.85, -1.00, 1.45)  # from above, because there are many cups


def encode_picture(episode: Episode, *, title: str = "") -> bytes:
    """Return the contact sheet of an episode as a PNG file; equal episodes give equal bytes.

    The solid line is the path of the hand, the dots are the ideal rollout, the ring is the target. Parts
    behind a surface are faint. Frames are at equal parts of the path, not of the time. A hand that is turned
    by the skill has its axes along the path, and so has its target: x red, y green, z, the approach, blue.
    """
    size = COLUMNS * (TILE[0] + GUTTER) + GUTTER, HEADER + ROWS * (TILE[1] + GUTTER)
    sheet = Image.new("RGB", size, PAPER)
    colour = INK if episode.success else REFUSAL
    _draw_header(sheet, title or f"{episode.setup.arm.name} arm", _verdict(episode), colour)
    moments = _moments(episode)
    with silenced(1), Scenery(episode, moments, TILE) as scenery:
        for place, moment in enumerate(moments):
            row, column = divmod(place, COLUMNS)
            corner = (GUTTER + column * (TILE[0] + GUTTER), HEADER + row * (TILE[1] + GUTTER))
            sheet.paste(scenery.picture(moment), corner)
    return _png(sheet)


def encode_overview(
    rows: Sequence[Row],
    *,
    title: str,
    verdict: str,
    colour_by: ColourBy = "outcome",
    parts: Sequence[str] = (),
) -> bytes:
    """Return all episodes in one picture, as a PNG file; equal batches give equal bytes.

    The arm has its posture at the start of the first episode. Each line is the path of a hand to its cup or
    target, with a dot at its start, and a cross at its end if the episode failed. A hand that is turned by
    the skill has its axes along the path, as in ``encode_picture``.

    Args:
        rows: The episodes; those that could not begin are counted, but not drawn.
        title: Left text of the header.
        verdict: Right text of the header.
        colour_by: ``outcome``: success blue, failure red; ``part``: by the part of a combined skill.
        parts: Names of the parts.

    Raises:
        GoalNotReachedError: No episode could begin.
    """
    visible = [(row, row.trace) for row in rows if row.trace is not None]
    if not visible:
        raise GoalNotReachedError("there is nothing to draw: no episode could begin.")
    sheet = Image.new("RGB", (OVERVIEW[0] + 2 * GUTTER, HEADER + OVERVIEW[1] + LEGEND), PAPER)
    sheet.paste(_all_of(visible, colour_by), (GUTTER, HEADER))
    _draw_header(sheet, title, verdict, INK)
    _draw_legend(sheet, _legend(rows, colour_by, parts))
    return _png(sheet)


class Scenery(Stage):
    """The world of one episode, and a ``camera`` from which all of it can be seen."""

    def __init__(
        self, episode: Episode, rows: Iterable[int], size: tuple[int, int], sharpness: float = SHARPNESS
    ) -> None:
        """Make the world.

        Args:
            episode: The episode to show.
            rows: Rows of its series at which the whole arm has to be in the picture.
            size: Width and height of the pictures.
            sharpness: How much larger than that they are rendered.
        """
        scenario, setup, series = episode.scenario, episode.setup, episode.series
        super().__init__(setup.arm, setup.base_yaw, scenario)
        self._episode, self._size = episode, size
        self._cup = None if scenario.cup is None else self.add_cup(scenario.cup)
        extents = []
        for row in rows:
            self._show_row(row)
            extents.append(self.arm_extent())
        points = np.vstack([series.hand, setup.plan.path, series.targets, self.corners, *extents])
        towards = _direction(setup.placement.plane, setup.base_yaw)
        if scenario.scene is not None:
            towards = np.array(SCENE_DIRECTION)
        self.camera = Camera(points, towards, *(round(sharpness * length) for length in size))

    def picture(self, row: int) -> Image.Image:
        """Return one moment: the trail so far, the plan, the target at that time, and a caption."""
        self._show_row(row)
        return self._drawn(
            Canvas(under_sky(self.camera.render(self), self.floor), self.camera, self._size), row
        )

    def _drawn(self, canvas: Canvas, row: int) -> Image.Image:
        """Draw the motion of a moment over a picture of it."""
        episode, series = self._episode, self._episode.series
        canvas.dots(episode.setup.plan.path, PLAN, radius=0.9, spacing=7.0)
        canvas.line(series.hand[: row + 1], TRAIL, width=3.0)
        if episode.setup.turns:
            _draw_axes(canvas, series.hand[: row + 1], series.hand_turns, AXES_SPACING, width=2.0)
            canvas.axes(series.targets[row], series.target_turns[row], AXES_SIZE, width=2.0)
        canvas.ring(series.targets[row], TARGET, radius=9.0)
        canvas.disc(series.hand[row], TRAIL, radius=4.0)
        tile = canvas.image()
        place = (12, tile.height - 30)
        ImageDraw.Draw(tile).text(
            place, _caption(episode, row), font=_font(16), fill=INK, stroke_width=2, stroke_fill=PAPER
        )
        return tile

    def _show_row(self, row: int) -> None:
        series = self._episode.series
        self.show(series.joints[row], series.fingers[row])
        if self._cup is not None:
            self.put(self._cup, series.cups[row])


def _draw_axes(canvas: Canvas, path: FloatArray, turns: FloatArray, spacing: float, width: float) -> None:
    """Draw the axes of a hand along its path (k, 3), with its orientations q_xyzw (k or more, 4)."""
    for row in spread_out(path, spacing).tolist():
        canvas.axes(path[row], turns[row], AXES_SIZE, width)


def _moments(episode: Episode) -> list[int]:
    """Return the rows to show, at equal parts of the path, as the end of a motion is slow."""
    way = arc_lengths(episode.series.hand)
    count = COLUMNS * ROWS
    inner = np.searchsorted(way, way[-1] * np.arange(1, count - 1) / (count - 1))
    return [0, *inner.tolist(), len(way) - 1]


def _direction(plane: Plane | None, base_yaw: float) -> FloatArray:
    """Return the direction (3,) from a motion to a camera that sees it well, where there is no scene."""
    x, y, z = DIRECTIONS[plane]
    cosine, sine = math.cos(base_yaw), math.sin(base_yaw)
    return np.array([cosine * x - sine * y, sine * x + cosine * y, z])


def _caption(episode: Episode, row: int) -> str:
    """Return the caption of one moment."""
    series = episode.series
    time, phase = f"{series.times[row]:.2f} s", PHASES[series.phases[row]]
    if phase != "approach":
        return f"{time}   {phase}"
    return f"{time}   {_length(float(np.linalg.norm(series.hand[row] - series.targets[row])))} to target"


def _verdict(episode: Episode) -> str:
    """Return how an episode ended, in a few words."""
    metrics = episode.metrics
    error = metrics.final_error
    missed = _length(error) if episode.setup.unit == "m" else f"{math.degrees(error):.2f}°"
    if episode.setup.turns:
        missed += f" and {math.degrees(metrics.final_turn):.1f}°"
    match episode.outcome:
        case "reached":
            return f"target reached after {metrics.time_to_target:.1f} s, {missed} off"
        case "placed":
            return f"placed {_length(metrics.cup_off)} from its place: {metrics.simulated_time:.1f} s"
        case "grasped":
            return f"grasped, lifted and held: {metrics.simulated_time:.1f} s"
        case "timeout":
            return f"target not reached in {metrics.simulated_time:.1f} s, {missed} off"
    return f"{episode.outcome}: {episode.detail}"


def _length(metres: float) -> str:
    return f"{1e3 * metres:.1f} mm" if metres < 0.01 else f"{1e3 * metres:.0f} mm"


def _all_of(visible: Sequence[tuple[Row, Trace]], colour_by: ColourBy) -> Image.Image:
    """Return a picture of the world with all episodes in it."""
    scene, first = visible[0][0].scenario.scene, visible[0][1]
    with silenced(1), Stage(first.arm, first.base_yaw, visible[0][0].scenario) as stage:
        stage.show(first.joints, first.fingers)
        for row, trace in visible:
            if row.scenario.cup is not None:
                red, green, blue = 1 - PALENESS * (1 - np.array(_colour(row, trace, colour_by)) / 255)
                stage.put(stage.add_cup(row.scenario.cup, (red, green, blue, 1.0)), trace.cup)
        motion = np.vstack([np.vstack([trace.path, trace.target]) for _, trace in visible])
        low, high = box(motion)
        near = np.clip(stage.corners, low - NEIGHBOURHOOD, high + NEIGHBOURHOOD)
        points = np.vstack([motion, near, stage.arm_extent()])
        towards = _direction(first.plane, first.base_yaw) if scene is None else np.array(OVERVIEW_DIRECTION)
        camera = Camera(points, towards, *(round(SHARPNESS * length) for length in OVERVIEW))
        view = camera.render(stage)
        with stage.without_arm():
            view = view.through(stage.body, camera.render(stage), ARM_OPACITY)
        canvas = Canvas(under_sky(view, stage.floor), camera, OVERVIEW)
    for row, trace in visible:
        canvas.line(trace.path, _colour(row, trace, colour_by), width=2.2)
        if len(trace.turns):
            _draw_axes(
                canvas, trace.path, trace.turns, AXES_SPACING * max(1.0, len(visible) / FEW), width=1.2
            )
    for row, trace in visible:
        canvas.disc(trace.path[0], _colour(row, trace, colour_by), radius=3.0)
        if scene is None:
            canvas.ring(trace.target, TARGET, radius=7.0)
        if not row.success:
            canvas.cross(trace.path[-1], FAILURE, radius=5.0)
    return canvas.image()


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
    counted = [(PARTS[part % len(PARTS)], f"{name}: {acted.count(part)}") for part, name in names.items()]
    return [*counted, *failed]


def _draw_header(sheet: Image.Image, name: str, words: str, colour: Colour) -> None:
    """Write a name on the left and a verdict on the right into the free top of a sheet."""
    draw, middle, margin = ImageDraw.Draw(sheet), HEADER // 2, GUTTER + 4
    draw.text((margin, middle), name, font=_font(22), fill=INK, anchor="lm")
    draw.text((sheet.width - margin, middle), words, font=_font(18), fill=colour, anchor="rm")


def _draw_legend(sheet: Image.Image, entries: Sequence[tuple[Colour, str]]) -> None:
    """Write the meaning of the colours into the free bottom of a sheet."""
    draw, font = ImageDraw.Draw(sheet), _font(16)
    x, middle = GUTTER + 12, sheet.height - LEGEND // 2
    large = Image.new("L", (12 * SUPERSAMPLING, 12 * SUPERSAMPLING))
    ImageDraw.Draw(large).ellipse((0, 0, large.width - 1, large.height - 1), fill=255)
    dot = large.reduce(SUPERSAMPLING)
    for colour, text in entries:
        sheet.paste(colour, (x - 6, middle - 6), dot)
        draw.text((x + 14, middle), text, font=font, fill=INK, anchor="lm")
        x += 14 + round(draw.textlength(text, font=font)) + 36


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


def _png(image: Image.Image) -> bytes:
    file = io.BytesIO()
    image.save(file, format="PNG", optimize=True)
    return file.getvalue()
