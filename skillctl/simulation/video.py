"""A film of an episode in real time: GIF with Pillow, MP4 with PyAV."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from PIL import Image

from skillctl.arrays import FloatArray
from skillctl.errors import NotFoundError, UsageError
from skillctl.progress import Progress
from skillctl.simulation.arm import CONTROL_PERIOD
from skillctl.simulation.bullet import silenced
from skillctl.simulation.camera import in_front
from skillctl.simulation.canvas import Canvas, under_sky
from skillctl.simulation.episode import Episode
from skillctl.simulation.picture import Scenery

SIZE = (480, 416)  # multiples of 16: the blocks that video is coded in
SAMPLING = 2  # of lines
STILL = 0.5  # pixels: while nothing has moved farther, the last picture of the arm is shown again
KINDS = ("gif", "mp4")
RATE = Fraction(10)  # [1/s]; a GIF counts in hundredths of a second
LAST_FRAME = 1.5  # [s], how long the last frame is shown
FRAMING = 8  # moments for which the whole arm has to be in the picture
SWATCHES = 6  # frames that the colours of a GIF are chosen from
QUALITY = {"crf": "20", "preset": "medium"}


def film_format(name: str) -> str:
    """Return the format that a file's name asks for, ready to be written.

    Raises:
        UsageError: Neither ``.gif`` nor ``.mp4``.
        NotFoundError: MP4, and PyAV is not installed.
    """
    kind = name.rpartition(".")[2].lower()
    if kind not in KINDS:
        raise UsageError(f"{name}: a video is a .gif or an .mp4.", hint="For example: motion.gif.")
    if kind == "mp4":
        _load_av()
    return kind


def encode_video(episode: Episode, kind: str, *, progress: Progress | None = None) -> bytes:
    """Return a film of an episode, in real time. Equal episodes give equal GIFs; an MP4's bytes may differ.

    Args:
        episode: What to show.
        kind: ``gif`` or ``mp4``.
        progress: Called after every frame, with frames drawn and in all.

    Raises:
        NotFoundError: MP4, and PyAV is not installed.
    """
    count = len(episode.series.times)
    times = episode.series.times
    moments = np.arange(0.0, times[-1] + 1 / float(RATE), 1 / float(RATE))
    rows = np.minimum(np.searchsorted(times, moments - 0.5 * CONTROL_PERIOD), count - 1).tolist()
    framed = np.linspace(0, count - 1, FRAMING, dtype=int)
    with silenced(1), Set(episode, framed, SIZE, 1.0) as scenery:
        frames = []
        for row in rows:
            frames.append(scenery.picture(row))
            if progress is not None:
                progress("filming", len(frames), len(rows))
    return _gif(frames) if kind == "gif" else _mp4(frames)


class Set(Scenery):
    """The scenery of a film: all but arm and cup is drawn once, and these if they moved.

    So they throw no shadows. This saves nine tenths of the time. ``view`` is the last picture.
    """

    def __init__(
        self, episode: Episode, rows: Iterable[int], size: tuple[int, int], sharpness: float
    ) -> None:
        """See ``Scenery``."""
        super().__init__(episode, rows, size, sharpness)
        moving = [self.body, *([] if self._cup is None else [self._cup])]
        every = [self.bullet.getBodyUniqueId(i) for i in range(self.bullet.getNumBodies())]
        places = self._away(moving)
        self._behind = self.view = under_sky(self.camera.render(self), self.floor)
        for body, place in zip(moving, places, strict=True):
            self.bullet.resetBasePositionAndOrientation(body, *place)
        self._away([body for body in every if body not in moving])
        self._shown_at: FloatArray | None = None

    def _away(self, bodies: Sequence[int]) -> list[Any]:
        """Put bodies out of the picture, and return where they were."""
        places = [self.bullet.getBasePositionAndOrientation(body) for body in bodies]
        for body in bodies:
            self.bullet.resetBasePositionAndOrientation(body, (0.0, 0.0, -100.0), (0.0, 0.0, 0.0, 1.0))
        return places

    def picture(self, row: int) -> Image.Image:
        """Return one moment; see ``Scenery``."""
        self._show_row(row)
        cup = self._episode.series.cups[row, :3][None] if self._cup is not None else np.zeros((0, 3))
        places = self.camera.project(np.vstack([self.links(), cup]))[0] * self._size
        moved = np.inf if self._shown_at is None else float(np.abs(places - self._shown_at).max())
        if moved > STILL:
            self._shown_at = places
            self.view = in_front(self.camera.plain(self), self._behind)
        return self._drawn(Canvas(self.view, self.camera, self._size, SAMPLING), row)


def _gif(frames: Sequence[Image.Image]) -> bytes:
    """Return an endless GIF. All frames share their colours, or the background would flicker."""
    palette = _palette(frames)
    first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    durations = [round(1000 / RATE)] * len(others) + [round(1000 * LAST_FRAME)]
    file = io.BytesIO()
    first.save(file, format="GIF", save_all=True, append_images=others, duration=durations, loop=0)
    return file.getvalue()


def _palette(frames: Sequence[Image.Image]) -> Image.Image:
    """Return an image with 256 colours: half are the most common, half are spread over all in the frames.

    The common ones alone would leave no colour for a line, the others none for a soft shadow.
    """
    picks = np.linspace(0, len(frames) - 1, min(SWATCHES, len(frames)), dtype=int)
    swatch = Image.new("RGB", (SIZE[0], SIZE[1] * len(picks)))
    for place, pick in enumerate(picks):
        swatch.paste(frames[pick], (0, place * SIZE[1]))
    colours: list[int] = []
    for method in (Image.Quantize.MEDIANCUT, Image.Quantize.MAXCOVERAGE):
        half = swatch.quantize(128, method=method, dither=Image.Dither.NONE)
        colours += (half.getpalette() or [])[: 3 * 128]
    palette = Image.new("P", (1, 1))
    palette.putpalette(colours)
    return palette


def _mp4(frames: Sequence[Image.Image]) -> bytes:
    """Return H.264 in the pixel format that every player reads."""
    av = _load_av()
    file = io.BytesIO()
    with av.open(file, "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=RATE, options=QUALITY)
        (stream.width, stream.height), stream.pix_fmt = SIZE, "yuv420p"
        for image in [*frames, *[frames[-1]] * round(LAST_FRAME * RATE)]:
            container.mux(stream.encode(av.VideoFrame.from_image(image)))
        container.mux(stream.encode(None))
    return file.getvalue()


def _load_av() -> Any:
    try:
        import av
    except ImportError as error:
        raise NotFoundError(
            "PyAV is not installed; only .mp4 videos need it.",
            hint="Install it (pip install av), or write a .gif.",
        ) from error
    return av
