"""One moment of an episode as a picture: the rendered world, its backdrop, and what is drawn over it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from types import TracebackType

import numpy as np
from PIL import Image

from skillctl.arrays import FloatArray
from skillctl.simulation.camera import Camera, View
from skillctl.simulation.episode import Episode
from skillctl.simulation.overlay import Overlay
from skillctl.simulation.scenario import Plane
from skillctl.simulation.stage import Stage

SHARPNESS = 1.5  # stills are rendered this much larger than shown: smoother edges

# From the motion to the camera, for a base that faces +x. Planes are seen unmirrored.
DIRECTIONS: dict[Plane | None, tuple[float, float, float]] = {
    None: (0.75, -1.2, 0.55),
    "xy": (0.25, -1.1, 0.95),
    "xz": (0.15, -1.4, 0.35),
    "yz": (1.4, -0.45, 0.40),
}
SCENE_DIRECTION = (-0.40, -1.3, 0.75)  # past the arm onto its boards
NEIGHBOURHOOD = 0.15  # [m] around the motion: so much of the scene has to be in the picture

SKY_TOP, SKY_LOW = (214, 224, 236), (247, 249, 251)
HAZE = (2.2, 4.0)  # [m] from the camera to the floor, which fades into the sky between these distances
TRAIL, PLAN, TARGET = (196, 16, 104), (84, 96, 112), (0, 122, 80)  # seen against white, blue and orange arms


class Scenery:
    """The world of one episode, and a camera from which all of it can be seen. A context manager."""

    def __init__(
        self, episode: Episode, rows: Iterable[int], size: tuple[int, int], sharpness: float = SHARPNESS
    ) -> None:
        """Make the world.

        Args:
            episode: What to show.
            rows: Of its series, for which the whole arm has to be in the picture.
            size: Width and height of the pictures.
            sharpness: How much larger than that they are rendered.
        """
        self._episode, self._size = episode, size
        self._stage = Stage(episode.arm, episode.base_yaw, episode.scenario.scene)
        cup = episode.scenario.cup
        self._cup = None if cup is None else self._stage.add_cup(cup)
        extents = []
        for row in rows:
            self._pose(row)
            extents.append(self._stage.arm_extent())
        series = episode.series
        points = np.vstack(
            [series.hand, episode.plan.positions, series.targets, self._stage.corners, *extents]
        )
        towards = view_direction(episode.placement.plane, episode.base_yaw)
        if episode.scenario.scene is not None:
            towards = np.array(SCENE_DIRECTION)
        self._camera = Camera(points, towards, *(round(sharpness * length) for length in size))

    def __enter__(self) -> Scenery:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stage.__exit__(kind, error, trace)

    def picture(self, row: int) -> Image.Image:
        """Return one moment: the trail so far, the plan, and the target as it was then."""
        self._pose(row)
        view = self._stage.seen_by(self._camera)
        episode, series = self._episode, self._episode.series
        overlay = Overlay(self._camera, view, self._size)
        overlay.dots(episode.plan.positions, PLAN, radius=0.9, spacing=7.0)
        overlay.line(series.hand[: row + 1], TRAIL, width=3.0)
        overlay.ring(series.targets[row], TARGET, radius=9.0)
        overlay.disc(series.hand[row], TRAIL, radius=4.0)
        return composed(view, self._stage.floor, overlay, self._size)

    def _pose(self, row: int) -> None:
        series = self._episode.series
        self._stage.pose(series.joints[row], series.fingers[row])
        if self._cup is not None:
            self._stage.place(self._cup, series.cups[row])


def view_direction(plane: Plane | None, base_yaw: float) -> FloatArray:
    """Return the direction (3,) from a motion to a camera that sees it well, where there is no scene."""
    x, y, z = DIRECTIONS[plane]
    cosine, sine = math.cos(base_yaw), math.sin(base_yaw)
    return np.array([cosine * x - sine * y, sine * x + cosine * y, z])


def near(corners: FloatArray, motion: FloatArray) -> FloatArray:
    """Return the corners (n, 3) of a scene, drawn in to the neighbourhood of a motion (m, 3)."""
    return np.clip(corners, motion.min(axis=0) - NEIGHBOURHOOD, motion.max(axis=0) + NEIGHBOURHOOD)


def composed(view: View, floor: int, overlay: Overlay, size: tuple[int, int]) -> Image.Image:
    """Return a view at its finished size: the floor fades into the sky, the overlay lies above all."""
    colours = view.colours.astype(np.float64)
    fraction = np.linspace(0.0, 1.0, len(colours))[:, None]
    sky = ((1 - fraction) * SKY_TOP + fraction * SKY_LOW)[:, None, :]
    haze = np.clip((view.depths - HAZE[0]) / (HAZE[1] - HAZE[0]), 0.0, 1.0) * (view.surface == floor)
    haze[view.surface < 0] = 1.0
    blended = (1 - haze[:, :, None]) * colours + haze[:, :, None] * sky
    scene = Image.fromarray(np.rint(blended).astype(np.uint8)).resize(size, Image.Resampling.LANCZOS)
    return Image.alpha_composite(scene.convert("RGBA"), overlay.image()).convert("RGB")
