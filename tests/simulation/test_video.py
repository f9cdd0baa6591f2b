from __future__ import annotations

import io
import sys

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from PIL import Image, ImageSequence

from skillctl.errors import NotFoundError, UsageError
from skillctl.model.seds import SedsSkill
from skillctl.simulation.episode import Episode
from skillctl.simulation.picture import TARGET, TRAIL
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.video import LAST_FRAME, RATES, SIZE, encode_video, film_format


@pytest.fixture(scope="module")
def episode(reach: SedsSkill) -> Episode:
    return simulate(reach, Scenario(start=(0.54, 0.10, 0.53), max_duration=0.3))


@pytest.fixture(scope="module")
def gif(episode: Episode) -> bytes:
    return encode_video(episode, "gif")


def test_a_gif_lasts_as_long_as_the_motion(episode: Episode, gif: bytes) -> None:
    with Image.open(io.BytesIO(gif)) as film:
        assert film.size == SIZE
        durations = [frame.info["duration"] for frame in ImageSequence.Iterator(film)]
    # Frames lie on a grid of 1/rate; equal neighbours may be one longer frame; the last one stands still.
    assert sum(durations) / 1000 - LAST_FRAME == pytest.approx(
        episode.series.times[-1], abs=1 / float(RATES["gif"])
    )


def test_a_gif_keeps_the_colours_of_what_is_drawn(gif: bytes) -> None:
    with Image.open(io.BytesIO(gif)) as film:
        film.seek(1)
        pixels = np.asarray(film.convert("RGB"), dtype=int)
    for colour in (TRAIL, TARGET):
        assert (np.abs(pixels - colour).max(axis=2) < 12).sum() > 10


def test_the_same_episode_gives_the_same_film(episode: Episode, gif: bytes) -> None:
    seen = []
    assert encode_video(episode, "gif", progress=lambda *report: seen.append(report)) == gif
    assert seen == [("filming", i + 1, len(seen)) for i in range(len(seen))]


def test_an_mp4_has_a_frame_for_each_moment(episode: Episode) -> None:
    av = pytest.importorskip("av", reason="PyAV is the optional extra 'video'")
    data = encode_video(episode, "mp4")
    with av.open(io.BytesIO(data)) as film:
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
        assert film.streams.video[0].average_rate == RATES["mp4"]
    rate = float(RATES["mp4"])
    assert len(frames) / rate - LAST_FRAME == pytest.approx(episode.series.times[-1], abs=2 / rate)
    assert frames[0].shape == (SIZE[1], SIZE[0], 3)


def test_a_video_is_a_gif_or_an_mp4() -> None:
    with pytest.raises(UsageError, match=r"motion\.avi: a video is a \.gif or an \.mp4"):
        film_format("motion.avi")
    assert film_format("motion.GIF") == "gif"


def test_without_pyav_it_is_said_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(NotFoundError, match=r"PyAV is not installed; only \.mp4") as refusal:
        film_format("motion.mp4")
    assert ".[video]" in refusal.value.hint
