"""Lines and marks at points in space, drawn over a rendered picture: solid if visible, else faint."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeAlias

import numpy as np
from PIL import Image, ImageDraw

from skillctl.arrays import FloatArray
from skillctl.rotations import turned
from skillctl.simulation.camera import Camera, View
from skillctl.simulation.episode import spread_out

Colour: TypeAlias = tuple[int, int, int]

SEEN, FAINT = 255, 80  # opacity in front of and behind surfaces
WHITE: Colour = (255, 255, 255)
AXES: tuple[Colour, ...] = ((205, 45, 45), (40, 140, 60), (45, 85, 205))  # x, y and z of a hand
SUPERSAMPLING = 4  # the layer is drawn this much larger than shown, for smooth edges
LINE_SPACING = 2.0  # pixels between the points that a line is drawn through
SKY_TOP, SKY_LOW = (214, 224, 236), (247, 249, 251)
HAZE = (2.2, 4.0)  # [m] from the camera to the floor, which fades into the sky between these distances


def under_sky(view: View, floor: int) -> View:
    """Return a view whose floor, the body of this number, fades into a sky."""
    fraction = np.linspace(0.0, 1.0, len(view.colours))[:, None]
    sky = ((1 - fraction) * SKY_TOP + fraction * SKY_LOW)[:, None, :]
    haze = np.clip((view.depths - HAZE[0]) / (HAZE[1] - HAZE[0]), 0.0, 1.0)
    haze *= view.surface == floor
    haze[view.surface < 0] = 1.0
    blended = (1 - haze[:, :, None]) * view.colours + haze[:, :, None] * sky
    return replace(view, colours=np.rint(blended).astype(np.uint8))


class Canvas:
    """A view with a transparent layer over it.

    Widths and radii are in pixels of the finished picture.
    """

    def __init__(
        self, view: View, camera: Camera, size: tuple[int, int], sampling: int = SUPERSAMPLING
    ) -> None:
        """Args: view; its camera; size of the finished picture; how much larger the layer is."""
        self._view, self._camera, self._size, self._sampling = view, camera, size, sampling
        self._layer = Image.new("RGBA", (sampling * size[0], sampling * size[1]), (0, 0, 0, 0))
        self._draw = ImageDraw.Draw(self._layer)

    def image(self) -> Image.Image:
        """Return the picture; the layer lies above all."""
        scene = Image.fromarray(self._view.colours)
        if scene.size != self._size:
            scene = scene.resize(self._size, Image.Resampling.LANCZOS)
        drawn = self._layer.reduce(self._sampling)
        scene.paste(drawn, mask=drawn)
        return scene

    def line(self, points: FloatArray, colour: Colour, width: float) -> None:
        """Draw a line through points (n, 3)."""
        points = self._thinned(points, LINE_SPACING)
        pixels, hidden = self._pixels(points), self._camera.hidden(points, self._view)
        changes = np.flatnonzero(np.diff(hidden)) + 1
        for run in np.split(np.arange(len(points)), changes):
            stretch = pixels[run[0] : run[-1] + 2]  # up to where the next run begins
            self._draw.line(
                [tuple(pixel) for pixel in stretch.tolist()],
                fill=(*colour, FAINT if hidden[run[0]] else SEEN),
                width=round(self._sampling * width),
                joint="curve",
            )
        if not hidden[0]:
            self._disc(pixels[0], 0.5 * width, (*colour, SEEN))  # a round beginning

    def axes(self, point: FloatArray, turn: FloatArray, size: float, width: float) -> None:
        """Draw the axes of a hand at a point (3,), turned by q_xyzw (4,), ``size`` [m] long."""
        ends = point + size * turned(np.eye(3), turn)
        for end, colour in zip(ends, AXES, strict=True):
            self.line(np.stack([point, end]), colour, width)

    def dots(self, points: FloatArray, colour: Colour, radius: float, spacing: float) -> None:
        """Draw a dotted line along points (n, 3)."""
        points = self._thinned(points, spacing)
        hidden = self._camera.hidden(points, self._view)
        for pixel, behind in zip(self._pixels(points), hidden, strict=True):
            self._disc(pixel, radius, (*colour, FAINT if behind else SEEN))

    def disc(self, point: FloatArray, colour: Colour, radius: float) -> None:
        """Draw a disc with a white rim at a point (3,)."""
        opacity = FAINT if self._camera.hidden(point[None], self._view)[0] else SEEN
        self._disc(self._pixels(point[None])[0], radius + 1.0, (*WHITE, opacity))
        self._disc(self._pixels(point[None])[0], radius, (*colour, opacity))

    def ring(self, point: FloatArray, colour: Colour, radius: float) -> None:
        """Draw a ring around a point (3,); it is never faint, so that it is found easily."""
        x, y = self._pixels(point[None])[0].tolist()
        for tint, size, width in ((WHITE, radius + 1.2, 4.4), (colour, radius, 2.0)):
            r = self._sampling * size
            self._draw.ellipse(
                (x - r, y - r, x + r, y + r), outline=tint, width=round(self._sampling * width)
            )

    def cross(self, point: FloatArray, colour: Colour, radius: float) -> None:
        """Draw a diagonal cross at a point (3,); never faint."""
        x, y = self._pixels(point[None])[0].tolist()
        r = self._sampling * radius
        for tint, width in ((WHITE, 5.0), (colour, 2.4)):
            for slope in (-1, 1):
                ends = (x - r, y - slope * r, x + r, y + slope * r)
                self._draw.line(ends, fill=tint, width=round(self._sampling * width))

    def _pixels(self, points: FloatArray) -> FloatArray:
        return self._camera.project(points)[0] * self._layer.size

    def _thinned(self, points: FloatArray, spacing: float) -> FloatArray:
        """Return the points (n, 3) at about equal distances in the picture, first and last included."""
        return np.asarray(points[spread_out(self._pixels(points) / self._sampling, spacing)])

    def _disc(self, pixel: FloatArray, radius: float, fill: tuple[int, int, int, int]) -> None:
        x, y = pixel.tolist()
        r = self._sampling * radius
        self._draw.ellipse((x - r, y - r, x + r, y + r), fill=fill)
