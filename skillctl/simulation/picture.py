"""The contact sheet: six moments of an episode, with plan, trail and target drawn into the scene."""

from __future__ import annotations

import io
import math

import numpy as np
from PIL import Image, ImageDraw, ImageFilter, ImageFont

from skillctl.arrays import BoolArray, FloatArray
from skillctl.simulation.arm import ArmBody
from skillctl.simulation.bullet import silenced
from skillctl.simulation.camera import Camera, View
from skillctl.simulation.episode import Episode
from skillctl.simulation.overlay import Overlay
from skillctl.simulation.scenario import Plane

COLUMNS, ROWS = 3, 2
TILE = (480, 400)
GUTTER, HEADER = 8, 52
RENDERED = (720, 600)  # rendered larger than shown: smoother edges

# From the motion to the camera, for a base that faces +x. Planes are seen unmirrored.
DIRECTIONS: dict[Plane | None, tuple[float, float, float]] = {
    None: (0.75, -1.2, 0.55),
    "xy": (0.25, -1.1, 0.95),
    "xz": (0.15, -1.4, 0.35),
    "yz": (1.4, -0.45, 0.40),
}
ARM_RADIUS = 0.07  # [m]: links are this thick around their frames, for framing

SKY_TOP, SKY_LOW = (214, 224, 236), (247, 249, 251)
FLOOR_SIZE, FLOOR_COLOUR = 4.0, (0.90, 0.91, 0.93, 1.0)
HAZE = (2.2, 4.0)  # [m] from the camera: the floor fades into the sky between these distances
SHADOW_BLUR = 5
INK, PAPER = (38, 44, 54), (255, 255, 255)
TRAIL, PLAN, TARGET = (196, 16, 104), (84, 96, 112), (0, 122, 80)  # seen against white, blue and orange arms
FAILURE = (190, 40, 30)


def encode_picture(episode: Episode, *, title: str = "") -> bytes:
    """Return the contact sheet of an episode as a PNG file; equal episodes give equal bytes.

    Solid line: where the hand was; dots: the ideal rollout; ring: the target. What lies behind a surface
    is faint. Frames are equal parts of the way apart, not of the time.
    """
    width = COLUMNS * TILE[0] + (COLUMNS + 1) * GUTTER
    height = HEADER + ROWS * (TILE[1] + GUTTER)
    sheet = Image.new("RGB", (width, height), PAPER)
    _draw_header(ImageDraw.Draw(sheet), episode, title, width)
    with silenced(1), ArmBody(episode.arm, episode.base_yaw) as body:
        _add_floor(body)
        moments = _moments(episode)
        camera = _camera(episode, body, moments)
        for place, moment in enumerate(moments):
            row, column = divmod(place, COLUMNS)
            corner = (GUTTER + column * (TILE[0] + GUTTER), HEADER + row * (TILE[1] + GUTTER))
            sheet.paste(_tile(episode, body, camera, moment), corner)
    file = io.BytesIO()
    sheet.save(file, format="PNG", optimize=True)
    return file.getvalue()


def _moments(episode: Episode) -> list[int]:
    """Return the rows to show: at equal parts of the way, as the end of a motion is slow."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(episode.series.hand, axis=0), axis=1))])
    count = COLUMNS * ROWS
    inner = np.searchsorted(way, way[-1] * np.arange(1, count - 1) / (count - 1))
    return [0, *inner.tolist(), len(way) - 1]


def _add_floor(body: ArmBody) -> None:
    bullet = body.bullet
    slab = bullet.createVisualShape(
        bullet.GEOM_BOX,
        halfExtents=(FLOOR_SIZE, FLOOR_SIZE, 0.01),
        rgbaColor=FLOOR_COLOUR,
        physicsClientId=body.client,
    )
    bullet.createMultiBody(0, -1, slab, (0.0, 0.0, -0.01), physicsClientId=body.client)


def _camera(episode: Episode, body: ArmBody, moments: list[int]) -> Camera:
    points = [episode.series.hand, episode.plan.positions, episode.target[None]]
    for moment in moments:
        body.pose(episode.series.joints[moment])
        links = np.vstack([body.links(), np.zeros(3)])
        points += [links - ARM_RADIUS, links + ARM_RADIUS]
    x, y, z = DIRECTIONS[episode.placement.plane]
    cosine, sine = math.cos(episode.base_yaw), math.sin(episode.base_yaw)
    towards = np.array([cosine * x - sine * y, sine * x + cosine * y, z])
    return Camera(np.vstack(points), towards, *RENDERED)


def _tile(episode: Episode, body: ArmBody, camera: Camera, moment: int) -> Image.Image:
    body.pose(episode.series.joints[moment])
    view = camera.render(body)
    overlay = Overlay(camera, view, TILE)
    overlay.dots(episode.plan.positions, PLAN, radius=0.9, spacing=7.0)
    overlay.line(episode.series.hand[: moment + 1], TRAIL, width=3.0)
    overlay.ring(episode.target, TARGET, radius=9.0)
    overlay.disc(episode.series.hand[moment], TRAIL, radius=4.0)
    scene = _scene(view).resize(TILE, Image.Resampling.LANCZOS).convert("RGBA")
    tile = Image.alpha_composite(scene, overlay.image()).convert("RGB")
    distance = float(np.linalg.norm(episode.series.hand[moment] - episode.target))
    caption = f"{episode.series.times[moment]:.2f} s   {_length(distance)} to target"
    _draw_caption(ImageDraw.Draw(tile), caption)
    return tile


def _scene(view: View) -> Image.Image:
    """Return the rendered picture with soft shadows on the floor, which fades into the sky."""
    colours = view.colours.astype(np.float64)
    floor = view.surface == 1
    blurred = _blurred_within(colours[:, :, 1], floor)
    tint = np.array(FLOOR_COLOUR[:3]) / FLOOR_COLOUR[1]
    colours[floor] = np.minimum(blurred[floor, None] * tint, 255.0)
    fraction = np.linspace(0.0, 1.0, len(colours))[:, None]
    sky = ((1 - fraction) * SKY_TOP + fraction * SKY_LOW)[:, None, :]
    haze = np.clip((view.depths - HAZE[0]) / (HAZE[1] - HAZE[0]), 0.0, 1.0) * floor
    haze[view.surface < 0] = 1.0
    blended = (1 - haze[:, :, None]) * colours + haze[:, :, None] * sky
    return Image.fromarray(np.rint(blended).astype(np.uint8))


def _blurred_within(channel: FloatArray, mask: BoolArray) -> FloatArray:
    """Return a channel blurred among the pixels of the mask only: nothing bleeds in from outside."""
    shown, weight = (
        np.asarray(Image.fromarray(values.astype(np.uint8)).filter(ImageFilter.GaussianBlur(SHADOW_BLUR)))
        for values in (channel * mask, 255.0 * mask)
    )
    return np.asarray(255.0 * shown / np.maximum(weight, 1.0))


def _draw_caption(draw: ImageDraw.ImageDraw, text: str) -> None:
    font = ImageFont.load_default(16)
    draw.text((12, TILE[1] - 30), text, font=font, fill=INK, stroke_width=2, stroke_fill=PAPER)


def _draw_header(draw: ImageDraw.ImageDraw, episode: Episode, title: str, width: int) -> None:
    metrics = episode.metrics
    missed = _length(metrics.final_error)
    verdict = {
        "reached": f"target reached after {metrics.time_to_target:.1f} s, {missed} off",
        "timeout": f"target not reached in {metrics.simulated_time:.1f} s, {missed} off",
        "unreachable": f"out of the arm's reach after {metrics.simulated_time:.1f} s",
        "diverged": f"diverged after {metrics.simulated_time:.1f} s",
    }.get(episode.outcome, episode.detail or episode.outcome)
    colour = INK if episode.success else FAILURE
    left, right, middle = GUTTER + 4, width - GUTTER - 4, HEADER // 2
    name = title or f"{episode.arm.name} arm"
    draw.text((left, middle), name, font=ImageFont.load_default(22), fill=INK, anchor="lm")
    draw.text((right, middle), verdict, font=ImageFont.load_default(18), fill=colour, anchor="rm")


def _length(metres: float) -> str:
    return f"{1e3 * metres:.1f} mm" if metres < 0.01 else f"{1e3 * metres:.0f} mm"
