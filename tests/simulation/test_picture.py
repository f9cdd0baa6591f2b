from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from PIL import Image

from skillctl.model.seds import SedsSkill
from skillctl.simulation.arm import ArmBody
from skillctl.simulation.arms import ARMS
from skillctl.simulation.camera import Camera
from skillctl.simulation.episode import Episode
from skillctl.simulation.picture import TARGET, TILE, TRAIL, encode_picture
from skillctl.simulation.recording import encode_log
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import Scenario

MakeLinear = Callable[..., SedsSkill]
OPTIONS = Scenario(start=(0.42, -0.20, 0.45))

# Another process: its own hash seed, and another episode before the one that counts.
ELSEWHERE = """
import pickle, sys
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.picture import encode_picture
from skillctl.simulation.recording import encode_log
skill, options = pickle.load(sys.stdin.buffer)
simulate(skill, Scenario(arm="iiwa", max_duration=0.5))
episode = simulate(skill, options)
pickle.dump((encode_log(episode), encode_picture(episode, title="reach")), sys.stdout.buffer)
"""


@pytest.fixture(scope="module")
def episode(reach: SedsSkill) -> Episode:
    return simulate(reach, OPTIONS)


@pytest.fixture(scope="module")
def sheet(episode: Episode) -> bytes:
    return encode_picture(episode, title="reach")


def tiles(sheet: bytes) -> list[np.ndarray]:
    """Cut the sheet where the layout says; the first row of tiles begins after the header."""
    pixels = np.asarray(Image.open(io.BytesIO(sheet)).convert("RGB"), dtype=int)
    height, width = pixels.shape[:2]
    columns, rows = 3, 2
    gutter = (width - columns * TILE[0]) // (columns + 1)
    top = height - rows * (TILE[1] + gutter)
    return [
        pixels[
            top + row * (TILE[1] + gutter) : top + row * (TILE[1] + gutter) + TILE[1],
            gutter + column * (TILE[0] + gutter) : (column + 1) * (TILE[0] + gutter),
        ]
        for row in range(rows)
        for column in range(columns)
    ]


def count(tile: np.ndarray, colour: tuple[int, int, int]) -> int:
    return int((np.abs(tile - colour).max(axis=2) < 40).sum())


def test_the_sheet_is_a_png_of_six_tiles(sheet: bytes) -> None:
    with Image.open(io.BytesIO(sheet)) as image:
        image.verify()
        assert (image.format, image.size) == ("PNG", (1472, 868))


def test_the_trail_grows_and_the_target_is_in_every_tile(sheet: bytes) -> None:
    drawn = tiles(sheet)
    trail = [count(tile, TRAIL) for tile in drawn]
    assert trail[0] > 20  # the hand's disc
    assert trail[-1] > trail[0] + 200
    assert all(count(tile, TARGET) > 50 for tile in drawn)


def test_two_processes_give_the_same_bytes(episode: Episode, sheet: bytes, reach: SedsSkill) -> None:
    import pickle

    done = subprocess.run(
        [sys.executable, "-c", ELSEWHERE],
        input=pickle.dumps((reach, OPTIONS)),
        capture_output=True,
        check=True,
    )
    log, picture = pickle.loads(done.stdout)
    assert log == encode_log(episode)
    assert picture == sheet


def test_an_episode_that_went_nowhere_has_a_picture(linear: MakeLinear) -> None:
    skill = linear((0.5, 0.0, 0.5))
    episode = simulate(skill, Scenario(start=(0.5, 0.0, 0.5), settle_time=0.01, max_duration=0.004))
    with Image.open(io.BytesIO(encode_picture(episode))) as image:
        assert image.size == (1472, 868)


@pytest.fixture(scope="module")
def ball() -> np.ndarray:
    return np.array([0.45, -0.35, 0.30])


def test_the_camera_knows_where_points_are_in_its_picture(ball: np.ndarray) -> None:
    """A rendered ball is the witness: Bullet draws it, the camera's own formula has to find it."""
    with ArmBody(ARMS["iiwa"], 0.0) as body:
        bullet = body.bullet
        shape = bullet.createVisualShape(bullet.GEOM_SPHERE, radius=0.03)
        number = bullet.createMultiBody(0, -1, shape, ball.tolist())
        camera = Camera(np.vstack([body.links(), ball]), np.array([0.7, -1.2, 0.5]), 480, 400)
        view = camera.render(body)
    rows, columns = np.nonzero(view.surface == number)
    (place,), (depth,) = camera.project(ball[None])
    # Pixel centres lie half a pixel in; a ball's outline is off its centre by less than one more.
    assert place * (480, 400) == pytest.approx([columns.mean() + 0.5, rows.mean() + 0.5], abs=1.0)
    # The ball's nearest point is a radius in front of its centre; the depth buffer has single precision.
    assert view.depths[rows, columns].min() == pytest.approx(depth - 0.03, abs=2e-3)


def test_what_is_framed_fills_the_picture_up_to_its_margin() -> None:
    """No nearer camera in that direction sees all: two opposite margins are touched, none is passed."""
    points = np.random.default_rng(1).uniform((-2, -0.3, -0.1), (1, 0.5, 0.2), (50, 3))
    places, depths = Camera(points, np.array([1.0, 0.5, 0.4]), 480, 400).project(points)
    low, high = (2 * places - 1).min(axis=0), (2 * places - 1).max(axis=0)
    touched = np.argmax(high - low)
    # Some ten roundings of numbers up to the distance, a few metres, over a width of about one.
    assert (low[touched], high[touched]) == pytest.approx((-0.94, 0.94), abs=1e-13)
    assert (np.abs([low, high]) < 0.94 + 1e-13).all()
    assert (depths > 0).all()


def test_points_behind_a_surface_are_hidden(ball: np.ndarray) -> None:
    with ArmBody(ARMS["iiwa"], 0.0) as body:
        bullet = body.bullet
        shape = bullet.createVisualShape(bullet.GEOM_SPHERE, radius=0.05)
        bullet.createMultiBody(0, -1, shape, ball.tolist())
        camera = Camera(np.vstack([body.links(), ball]), np.array([0.7, -1.2, 0.5]), 480, 400)
        view = camera.render(body)
    sight = (camera.eye - ball) / np.linalg.norm(camera.eye - ball)
    in_front, inside, behind = ball + 0.2 * sight, ball, ball - 0.2 * sight
    assert camera.hidden(np.stack([in_front, inside, behind]), view).tolist() == [False, True, True]
