"""The contact sheet: six moments of an episode, with plan, trail and target drawn into the scene."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from skillctl.simulation.bullet import silenced
from skillctl.simulation.episode import PHASES, Episode
from skillctl.simulation.frame import Scenery

COLUMNS, ROWS = 3, 2
TILE = (480, 400)
GUTTER, HEADER = 8, 52
INK, PAPER, FAILURE = (38, 44, 54), (255, 255, 255), (190, 40, 30)


def encode_picture(episode: Episode, *, title: str = "") -> bytes:
    """Return the contact sheet of an episode as a PNG file; equal episodes give equal bytes.

    Solid line: where the hand was; dots: the ideal rollout; ring: the target. What lies behind a surface
    is faint. Frames are equal parts of the way apart, not of the time.
    """
    width = COLUMNS * TILE[0] + (COLUMNS + 1) * GUTTER
    height = HEADER + ROWS * (TILE[1] + GUTTER)
    sheet = Image.new("RGB", (width, height), PAPER)
    draw_header(sheet, title or f"{episode.arm.name} arm", verdict(episode), success=episode.success)
    moments = _moments(episode)
    with silenced(1), Scenery(episode, moments, TILE) as scenery:
        for place, moment in enumerate(moments):
            row, column = divmod(place, COLUMNS)
            corner = (GUTTER + column * (TILE[0] + GUTTER), HEADER + row * (TILE[1] + GUTTER))
            tile = scenery.picture(moment)
            draw_caption(tile, caption(episode, moment))
            sheet.paste(tile, corner)
    return encode_png(sheet)


def encode_png(image: Image.Image) -> bytes:
    """Return an image as a PNG file."""
    file = io.BytesIO()
    image.save(file, format="PNG", optimize=True)
    return file.getvalue()


def _moments(episode: Episode) -> list[int]:
    """Return the rows to show: at equal parts of the way, as the end of a motion is slow."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(episode.series.hand, axis=0), axis=1))])
    count = COLUMNS * ROWS
    inner = np.searchsorted(way, way[-1] * np.arange(1, count - 1) / (count - 1))
    return [0, *inner.tolist(), len(way) - 1]


def caption(episode: Episode, row: int) -> str:
    """Return what is said about one moment."""
    series = episode.series
    time = f"{series.times[row]:.2f} s"
    phase = PHASES[series.phases[row]]
    if phase != "approach":
        return f"{time}   {phase}"
    return f"{time}   {_length(float(np.linalg.norm(series.hand[row] - series.targets[row])))} to target"


def draw_caption(tile: Image.Image, text: str) -> None:
    """Write a caption into the lower left corner."""
    font = ImageFont.load_default(16)
    place = (12, tile.height - 30)
    ImageDraw.Draw(tile).text(place, text, font=font, fill=INK, stroke_width=2, stroke_fill=PAPER)


def draw_header(sheet: Image.Image, name: str, words: str, *, success: bool) -> None:
    """Write a name on the left and a verdict on the right into the free top of a sheet."""
    draw, middle = ImageDraw.Draw(sheet), HEADER // 2
    colour = INK if success else FAILURE
    draw.text((GUTTER + 4, middle), name, font=ImageFont.load_default(22), fill=INK, anchor="lm")
    right = sheet.width - GUTTER - 4
    draw.text((right, middle), words, font=ImageFont.load_default(18), fill=colour, anchor="rm")


def verdict(episode: Episode) -> str:
    """Return in a few words how an episode ended."""
    metrics = episode.metrics
    missed = _length(metrics.final_error)
    match episode.outcome:
        case "reached":
            return f"target reached after {metrics.time_to_target:.1f} s, {missed} off"
        case "grasped":
            return f"grasped, lifted and held: {metrics.simulated_time:.1f} s"
        case "timeout":
            return f"target not reached in {metrics.simulated_time:.1f} s, {missed} off"
    return f"{episode.outcome}: {episode.detail}"


def _length(metres: float) -> str:
    return f"{1e3 * metres:.1f} mm" if metres < 0.01 else f"{1e3 * metres:.0f} mm"
