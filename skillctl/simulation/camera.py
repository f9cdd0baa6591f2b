"""A camera that frames given points, and projects points into its picture."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from PIL import Image, ImageFilter

from skillctl.arrays import BoolArray, FloatArray, IntArray
from skillctl.simulation.arm import ArmBody

FIELD_OF_VIEW = math.radians(36.0)  # vertical
NEAR, FAR = 0.1, 12.0  # [m]
MARGIN = 0.94  # share of the picture that the framed points may use
LIGHT = np.array([-0.75, 1.1, 1.0])  # from the scene, as right, up and towards the viewer
LIGHT_DISTANCE = 10.0  # with Bullet's default, which is near, everything shades itself
SHADOW_BLUR = 4  # pixels
BURIED = 0.012  # [m]: a point farther behind a surface is hidden; a nearer one is on it


@dataclass(frozen=True, eq=False, slots=True)
class View:
    """One rendered picture.

    Attributes:
        colours: Shape (height, width, 3), 0 to 255.
        depths: Distance of each pixel's surface along the viewing direction, shape (height, width), [m].
        surface: Bullet's number of the body each pixel shows, −1 for none. Shape (height, width).
    """

    colours: np.ndarray[Any, np.dtype[np.uint8]]
    depths: FloatArray
    surface: IntArray

    def through(self, body: int, behind: View, opacity: float) -> View:
        """Return the picture with a body translucent; ``behind`` is the same one without it.

        Args:
            body: Bullet's number of it.
            behind: What lies behind it.
            opacity: Of the body, from 0 to 1.
        """
        share = opacity * (self.surface == body)[:, :, None]
        colours = share * self.colours + (1 - share) * behind.colours
        return replace(behind, colours=np.rint(colours).astype(np.uint8))


class Camera:
    """A camera with a fixed direction, as near as it can be with all given points in the picture."""

    def __init__(self, points: FloatArray, towards: FloatArray, width: int, height: int) -> None:
        """Args: points (n, 3) to frame; direction (3,) from them to the camera; size of the picture."""
        self.width, self.height = width, height
        back = towards / np.linalg.norm(towards)
        right = np.cross((0.0, 0.0, 1.0), back)
        right /= np.linalg.norm(right)
        self._axes = np.stack([right, np.cross(back, right), back])  # rows: right, up, towards the viewer
        self._tangents = math.tan(FIELD_OF_VIEW / 2) * np.array([width / height, 1.0])
        # A point (x, y, z) is inside a picture around (u, v) from the distance w if |x − u| and |y − v| are
        # at most tangent · (w − z). The least w for which all points are follows for x and y separately.
        viewed = points @ self._axes.T
        sideways, depths = viewed[:, :2] / (MARGIN * self._tangents), viewed[:, 2:]
        ahead, behind = (depths + sideways).max(axis=0), (depths - sideways).max(axis=0)
        middle = 0.5 * (ahead - behind) * MARGIN * self._tangents
        distance = 0.5 * float((ahead + behind).max())
        self.eye = np.array([*middle, distance]) @ self._axes

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the places (n, 2) of points (n, 3) in the picture, and their depths (n,), [m].

        A place goes from 0 to 1 from left to right, and from top to bottom.
        """
        viewed = (points - self.eye) @ self._axes.T
        depths = -viewed[:, 2]
        plane = viewed[:, :2] / (depths[:, None] * self._tangents)  # −1 … 1
        return 0.5 * (1 + plane * (1, -1)), depths

    def hidden(self, points: FloatArray, view: View) -> BoolArray:
        """Return which points (n, 3) lie behind a surface of the picture. Shape (n,)."""
        places, depths = self.project(points)
        columns = np.clip((self.width * places[:, 0]).astype(int), 0, self.width - 1)
        rows = np.clip((self.height * places[:, 1]).astype(int), 0, self.height - 1)
        return np.asarray(depths > view.depths[rows, columns] + BURIED)

    def render(self, body: ArmBody) -> View:
        """Return the picture of everything in the body's world, with soft shadows.

        Bullet's shadows have jagged edges. The share of light that a shadow leaves a pixel does not depend
        on the colour there, so these shares are blurred, for each body by itself.
        """
        lit, shaded = self.plain(body), self.plain(body, shadow=True)
        share = shaded.colours.sum(axis=2) / np.maximum(lit.colours.sum(axis=2), 1.0)
        softened = blurred_within(np.minimum(share, 1.0), lit.surface)
        return replace(lit, colours=np.rint(lit.colours * softened[:, :, None]).astype(np.uint8))

    def plain(self, body: ArmBody, *, shadow: bool = False) -> View:
        """Return the picture as Bullet draws it, without shadows or with hard ones."""
        bullet = body.bullet
        aspect = self.width / self.height
        _, _, colours, buffer, bodies = bullet.getCameraImage(
            self.width,
            self.height,
            bullet.computeViewMatrix(self.eye.tolist(), (self.eye - self._axes[2]).tolist(), (0.0, 0.0, 1.0)),
            bullet.computeProjectionMatrixFOV(math.degrees(FIELD_OF_VIEW), aspect, NEAR, FAR),
            shadow=int(shadow),
            lightDirection=(LIGHT @ self._axes).tolist(),
            lightDistance=LIGHT_DISTANCE,
            lightAmbientCoeff=0.62,
            lightDiffuseCoeff=0.45,
            lightSpecularCoeff=0.03,
            renderer=bullet.ER_TINY_RENDERER,
        )
        shape = (self.height, self.width)
        pixels = np.reshape(np.asarray(colours, dtype=np.uint8), (*shape, 4))[:, :, :3]
        buffered = np.reshape(np.asarray(buffer, dtype=np.float64), shape)
        depths = FAR * NEAR / (FAR - (FAR - NEAR) * buffered)
        return View(pixels, depths, np.reshape(np.asarray(bodies, dtype=np.int64), shape))


def in_front(near: View, far: View) -> View:
    """Return a picture in which what ``near`` shows hides what is behind it in ``far``."""
    found = View(far.colours.copy(), far.depths.copy(), far.surface.copy())
    hiding = (near.surface >= 0) & (near.depths < far.depths)
    for name in ("colours", "depths", "surface"):
        getattr(found, name)[hiding] = getattr(near, name)[hiding]
    return found


def blurred_within(shares: FloatArray, areas: IntArray) -> FloatArray:
    """Return shares (h, w) from 0 to 1, blurred among the pixels of equal ``areas`` (h, w) only."""
    blurred = shares.copy()
    for area in np.unique(areas):
        rows, columns = np.nonzero(areas == area)
        window = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        inside = areas[window] == area
        blur, weight = (
            np.asarray(Image.fromarray(layer.astype(np.uint8)).filter(ImageFilter.GaussianBlur(SHADOW_BLUR)))
            for layer in (np.rint(255 * shares[window] * inside), 255 * inside)
        )
        blurred[window][inside] = blur[inside] / np.maximum(weight[inside], 1.0)
    return blurred
