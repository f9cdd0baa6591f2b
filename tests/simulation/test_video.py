from __future__ import annotations

import io
import sys
from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from PIL import Image, ImageSequence

from skillctl.errors import NotFoundError, UsageError
from skillctl.model.seds import SedsSkill
from skillctl.simulation.bullet import silenced
from skillctl.simulation.episode import Episode
from skillctl.simulation.picture import TARGET, TRAIL, Scenery
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.video import LAST_FRAME, RATE, SIZE, Set, encode_video, film_format

MakeLinear = Callable[..., SedsSkill]


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
    assert sum(durations) / 1000 - LAST_FRAME == pytest.approx(episode.series.times[-1], abs=1 / float(RATE))


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
        assert film.streams.video[0].average_rate == RATE
    rate = float(RATE)
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
    assert "pip install av" in refusal.value.hint


def test_under_torque_control_a_film_lasts_as_long_as_the_motion(linear: MakeLinear) -> None:
    # The time series has a row each 5 ms then, not each 1/240 s.
    motion = simulate(
        linear((0.5, 0.0, 0.5)), Scenario(start=(0.45, 0, 0.5), control="torque", max_duration=0.5)
    )
    with Image.open(io.BytesIO(encode_video(motion, "gif"))) as film:
        shown = sum(frame.info["duration"] for frame in ImageSequence.Iterator(film)) / 1000
    assert shown - LAST_FRAME == pytest.approx(motion.series.times[-1], abs=1 / float(RATE))


@pytest.mark.parametrize("row", [0, -1])
def test_the_layers_of_a_film_show_what_one_picture_shows(linear: MakeLinear, row: int) -> None:
    scenario = Scenario(scene={"kind": "shelf"}, target="cup", start=(0.4, 0.0, 0.6), max_duration=1.5)
    motion = simulate(linear((0.5, 0.0, 0.5)), scenario)
    moment = range(len(motion.series.times))[row]
    with (
        silenced(1),
        Scenery(motion, [moment], SIZE, 1.0) as whole,
        Set(motion, [moment], SIZE, 1.0) as layered,
    ):
        whole.picture(moment)
        layered.picture(moment)
        wanted, found = whole.camera.plain(whole), layered.view
        assert len(np.unique(wanted.surface)) > 4  # arm, cup, floor, boards
        assert (found.surface == wanted.surface).mean() > 0.999  # but for ties where things touch
        assert found.depths == pytest.approx(wanted.depths, abs=0.02)
