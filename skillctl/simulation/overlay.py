"""Lines and marks over a rendered picture, where their points in space are: solid if seen, else faint."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from PIL import Image, ImageDraw

from skillctl.arrays import FloatArray
from skillctl.simulation.camera import Camera, View

Colour: TypeAlias = tuple[int, int, int]

SEEN, FAINT = 255, 80  # opacity in front of and behind surfaces
WHITE: Colour = (255, 255, 255)
SUPERSAMPLING = 4  # drawn this much larger than it is shown: smooth edges
LINE_SPACING = 2.0  # pixels between the points that a line is drawn through


class Overlay:
    """A transparent layer over one view. Widths and radii are in pixels of the finished picture."""

    def __init__(self, camera: Camera, view: View, size: tuple[int, int]) -> None:
        """Args: camera and the view it rendered; size of the finished picture."""
        self._camera, self._view = camera, view
        self._layer = Image.new("RGBA", (SUPERSAMPLING * size[0], SUPERSAMPLING * size[1]), (0, 0, 0, 0))
        self._draw = ImageDraw.Draw(self._layer)

    def image(self) -> Image.Image:
        """Return the layer at its finished size."""
        return self._layer.reduce(SUPERSAMPLING)

    def line(self, points: FloatArray, colour: Colour, width: float) -> None:
        """Draw a line through points (n, 3)."""
        points = self._thinned(points, LINE_SPACING)
        pixels, hidden = self._pixels(points), self._camera.hidden(points, self._view)
        changes = np.flatnonzero(np.diff(hidden)) + 1
        for run in np.split(np.arange(len(points)), changes):
            opacity = FAINT if hidden[run[0]] else SEEN
            stretch = pixels[run[0] : run[-1] + 2]  # up to where the next run begins
            self._draw.line(
                [tuple(pixel) for pixel in stretch.tolist()],
                fill=(*colour, opacity),
                width=round(SUPERSAMPLING * width),
                joint="curve",
            )
        if not hidden[0]:
            self._disc(pixels[0], 0.5 * width, (*colour, SEEN))  # a round beginning

    def dots(self, points: FloatArray, colour: Colour, radius: float, spacing: float) -> None:
        """Draw a dotted line along points (n, 3)."""
        points = self._thinned(points, spacing)
        hidden = self._camera.hidden(points, self._view)
        for pixel, behind in zip(self._pixels(points), hidden, strict=True):
            self._disc(pixel, radius, (*colour, FAINT if behind else SEEN))

    def disc(self, point: FloatArray, colour: Colour, radius: float) -> None:
        """Draw a disc with a white rim at a point (3,)."""
        opacity = self._opacity(point)
        self._disc(self._pixels(point[None])[0], radius + 1.0, (*WHITE, opacity))
        self._disc(self._pixels(point[None])[0], radius, (*colour, opacity))

    def ring(self, point: FloatArray, colour: Colour, radius: float) -> None:
        """Draw a ring around a point (3,); never faint, so that it is found at a glance."""
        x, y = self._pixels(point[None])[0].tolist()
        for tint, size, width in ((WHITE, radius + 1.2, 4.4), (colour, radius, 2.0)):
            r = SUPERSAMPLING * size
            self._draw.ellipse((x - r, y - r, x + r, y + r), outline=tint, width=round(SUPERSAMPLING * width))

    def cross(self, point: FloatArray, colour: Colour, radius: float) -> None:
        """Draw a diagonal cross at a point (3,); never faint."""
        x, y = self._pixels(point[None])[0].tolist()
        r = SUPERSAMPLING * radius
        for tint, width in ((WHITE, 5.0), (colour, 2.4)):
            for slope in (-1, 1):
                ends = (x - r, y - slope * r, x + r, y + slope * r)
                self._draw.line(ends, fill=tint, width=round(SUPERSAMPLING * width))

    def _pixels(self, points: FloatArray) -> FloatArray:
        return self._camera.project(points)[0] * self._layer.size

    def _opacity(self, point: FloatArray) -> int:
        return FAINT if self._camera.hidden(point[None], self._view)[0] else SEEN

    def _thinned(self, points: FloatArray, spacing: float) -> FloatArray:
        """Return the points (n, 3) at about equal distances in the picture, first and last included."""
        steps = np.linalg.norm(np.diff(self._pixels(points), axis=0), axis=1) / SUPERSAMPLING
        way = np.concatenate([[0.0], np.cumsum(steps)])
        wanted = np.searchsorted(way, np.arange(0.0, way[-1], spacing))
        return np.asarray(points[np.unique([0, *wanted.tolist(), len(points) - 1])])

    def _disc(self, pixel: FloatArray, radius: float, fill: tuple[int, int, int, int]) -> None:
        x, y = pixel.tolist()
        r = SUPERSAMPLING * radius
        self._draw.ellipse((x - r, y - r, x + r, y + r), fill=fill)
