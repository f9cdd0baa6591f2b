"""LeRobot datasets, written by pyarrow in the layouts of versions 2.1 and 3.0."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from scipy.spatial.transform import Rotation

from skillctl.arrays import FloatArray
from skillctl.demonstrations.reader import read_demonstrations
from skillctl.errors import InputDataError, NotFoundError

FPS = 30
COUNTERS = {
    "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    **{
        name: {"dtype": "int64", "shape": [1], "names": None}
        for name in ("frame_index", "episode_index", "index", "task_index")
    },
}
TEMPLATES = {
    "v2.1": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
    "v3.0": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
}
HAND = ["x", "y", "z", "roll", "pitch", "yaw", "gripper", "gripper"]
SO100 = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]


def states(motion: FloatArray, width: int) -> FloatArray:
    """Return states (T, width) that begin with a motion, (T, 3)."""
    return np.hstack([motion, np.tile(np.arange(3.0, width), (len(motion), 1))])


@pytest.fixture
def motions(curve) -> list[FloatArray]:
    return [curve(samples=10 + i, dimension=3, seed=i).astype(np.float32).astype(float) for i in range(5)]


@pytest.fixture
def save(tmp_path: Path, motions) -> Callable[..., Path]:
    """Write a dataset; ``features`` maps names to (names of numbers, what makes them of a motion)."""

    def save(version: str, *, info: dict[str, Any] | None = None, **features: Any) -> Path:
        root = tmp_path / f"dataset-{version}"
        described: dict[str, Any] = {
            "observation.images.top": {"dtype": "video", "shape": [48, 64, 3], "names": ["h", "w", "c"]}
        }
        tables = []
        start = 0
        for episode, motion in enumerate(motions):
            count = len(motion)
            columns: dict[str, Any] = {}
            for key, (names, made) in features.items():
                values, name = made(motion), key.replace("__", ".")
                described[name] = {"dtype": "float32", "shape": [values.shape[1]], "names": names}
                flat = pa.array(values.ravel(), pa.float32())
                columns[name] = (
                    pa.FixedSizeListArray.from_arrays(flat, values.shape[1])
                    if version == "v2.1"
                    else pa.array(values.tolist(), pa.list_(pa.float32()))
                )
            columns["timestamp"] = pa.array(np.arange(count, dtype=np.float32) / np.float32(FPS))
            columns["frame_index"] = pa.array(range(count))
            columns["episode_index"] = pa.array([episode] * count)
            columns["index"] = pa.array(range(start, start + count))
            columns["task_index"] = pa.array([0] * count)
            tables.append(pa.table(columns))
            start += count
        described |= COUNTERS
        document = {
            "codebase_version": version, "robot_type": "so100", "total_episodes": len(motions),
            "total_frames": start, "total_tasks": 1, "chunks_size": 2, "fps": FPS,
            "data_path": TEMPLATES[version], "features": described, **(info or {}),
        }  # fmt: skip
        (root / "meta").mkdir(parents=True)
        (root / "meta/info.json").write_text(json.dumps(document, indent=4))
        files: dict[str, list[Any]] = {}
        for episode, table in enumerate(tables):  # two episodes a chunk, or three a file
            names = {"episode_chunk": episode // 2, "episode_index": episode, "chunk_index": 0}
            files.setdefault(TEMPLATES[version].format(**names, file_index=episode // 3), []).append(table)
        for name, parts in files.items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            parquet.write_table(pa.concat_tables(parts), root / name)
        if version == "v3.0":
            (root / "meta/episodes/chunk-000").mkdir(parents=True)
            episodes = {
                "episode_index": list(range(len(motions))),
                "length": list(map(len, motions)),
                "data/chunk_index": [0] * len(motions),
                "data/file_index": [episode // 3 for episode in range(len(motions))],
                "stats/observation.state/mean": [[0.0]] * len(motions),
            }
            parquet.write_table(pa.table(episodes), root / "meta/episodes/chunk-000/file-000.parquet")
        return root

    return save


HAND_STATE = {"observation__state": ({"motors": HAND}, lambda motion: states(motion, 8))}
JOINT_STATE = {"observation__state": (SO100, lambda motion: states(64 * motion, 6))}
ACTION = {"action": (HAND, lambda motion: states(motion + 1, 8))}


@pytest.mark.parametrize("version", TEMPLATES)
def test_the_hand_is_read_of_every_episode(save, motions, version: str) -> None:
    result = read_demonstrations([save(version, **HAND_STATE, **ACTION)], position_only=True)
    assert len(result.demonstrations) == len(motions)
    for index, (demonstration, motion) in enumerate(zip(result.demonstrations, motions, strict=True)):
        assert (demonstration.positions == motion).all()
        assert demonstration.source == f"dataset-{version}, episode {index}"
        # Stamps are recorded in single precision.
        expected = np.arange(len(motion)) / FPS
        assert np.abs(demonstration.times - expected).max() <= np.finfo(np.float32).eps * expected.max()
    space = result.demonstrations.space
    assert (space.names, space.unit) == (("x", "y", "z"), "m")
    assert result.notes[0] == (
        "the position is x, y, z; left aside: roll, pitch, yaw, gripper_6, gripper_7; "
        "use --columns to choose others."
    )
    assert result.sources[0].importer == "lerobot"


def test_the_orientation_of_the_hand_is_read_from_its_own_state(save, motions) -> None:
    result = read_demonstrations([save("v2.1", **HAND_STATE, **ACTION)])
    assert result.notes[0].startswith("the orientation is roll, pitch, yaw: turns about")
    assert "left aside: gripper_6, gripper_7; " in result.notes[1]
    turn = Rotation.from_euler("xyz", [3, 4, 5])  # small letters: about fixed axes
    for demonstration, motion in zip(result.demonstrations, motions, strict=True):
        assert (demonstration.positions[:, :3] == motion).all()
        turned = Rotation.from_rotvec(np.array(demonstration.positions[:, 3:]))
        assert (turn.inv() * turned).magnitude().max() < 1e-14  # [rad], of float64


@pytest.mark.parametrize("version", TEMPLATES)
def test_joints_leave_the_gripper_aside(save, motions, version: str) -> None:
    path = save(version, **JOINT_STATE)
    with pytest.raises(InputDataError, match="are they degrees") as error:
        read_demonstrations([path])
    assert "--units deg" in error.value.hint
    result = read_demonstrations([path], units="deg")
    assert result.demonstrations.space.names == tuple(SO100[:5])
    assert result.demonstrations.space.unit == "rad"
    degrees = np.degrees(result.demonstrations.demonstrations[1].positions)
    expected = states(64 * motions[1], 6)[:, :5]
    assert np.abs(degrees - expected).max() <= 4 * np.finfo(float).eps * expected.max()
    assert "left aside: gripper;" in result.notes[0]


def test_numbers_and_features_are_chosen_by_name(save, motions) -> None:
    path = save("v3.0", **HAND_STATE, **ACTION)
    chosen = read_demonstrations([path], columns=["action/y", "action/x"]).demonstrations
    moved = (motions[0] + 1).astype(np.float32)
    assert (chosen.demonstrations[0].positions == moved[:, [1, 0]]).all()
    assert chosen.space.names == ("y", "x")
    whole = read_demonstrations([path], columns=["action"]).demonstrations
    assert (whole.demonstrations[0].positions[:, :3] == moved).all()


@pytest.mark.parametrize(
    "features",
    [
        {"observation__state": (None, lambda motion: states(motion, 8))},
        {
            "observation__left": (["ee.x", "ee.y", "ee.z"], lambda motion: motion),
            "observation__right": (["ee.x", "ee.y", "ee.z"], lambda motion: motion),
        },
        ACTION,
    ],
    ids=["no-names", "two-hands", "no-observation"],
)
def test_what_is_not_certain_is_asked_for(save, features) -> None:
    with pytest.raises(InputDataError, match="not certain which numbers are the position") as error:
        read_demonstrations([save("v2.1", **features)])
    name = next(iter(features)).replace("__", ".")
    assert f"Choose with --columns, as in --columns {name}" in error.value.hint.replace("'", "")
    assert f"They are: {name} (" in error.value.hint


def test_several_tasks_are_no_secret(save) -> None:
    result = read_demonstrations([save("v2.1", info={"total_tasks": 3}, **HAND_STATE)], demos=[0, 1])
    assert any("its episodes show 3 tasks" in note for note in result.notes)


def test_the_digest_covers_the_files_that_are_read_and_no_others(save) -> None:
    path = save("v3.0", **HAND_STATE)
    (before,) = read_demonstrations([path]).sources
    (path / "videos").mkdir()
    (path / "videos/film.mp4").write_bytes(b"film")
    assert read_demonstrations([path]).sources[0].sha256 == before.sha256
    data = path / "data/chunk-000/file-001.parquet"
    parquet.write_table(parquet.read_table(data), data, compression="gzip")
    assert read_demonstrations([path]).sources[0].sha256 != before.sha256


# ------------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize("name", ["meta/info.json", "data/chunk-000/file-000.parquet"])
def test_one_file_of_a_dataset_leads_to_its_folder(save, name: str) -> None:
    with pytest.raises(InputDataError, match="one file of a LeRobot dataset") as error:
        read_demonstrations([save("v3.0", **HAND_STATE) / name])
    assert "Name the folder" in error.value.hint


@pytest.mark.parametrize("version", TEMPLATES)
def test_a_missing_file_is_named(save, version: str) -> None:
    path = save(version, **HAND_STATE)
    (path / TEMPLATES[version].format(episode_chunk=1, episode_index=2, chunk_index=0, file_index=1)).unlink()
    with pytest.raises(InputDataError, match=r"parquet: this file of the dataset is missing"):
        read_demonstrations([path])


@pytest.mark.parametrize(
    ("info", "words"),
    [
        ({"codebase_version": "v1.6"}, "version v1.6; versions 2 and 3 are read"),
        ({"data_path": "../{episode_index}.parquet"}, "leads out of the dataset"),
        ({"data_path": "/etc/passwd"}, "leads out of the dataset"),
        ({"data_path": "{episode_index:>99999999999d}"}, "(takes more than|not an intact LeRobot dataset)"),
        ({"data_path": "{nothing}"}, "not an intact LeRobot dataset"),
        ({"total_episodes": "many"}, "not an intact LeRobot dataset"),
        ({"features": []}, "not an intact LeRobot dataset"),
    ],
)
def test_what_info_may_not_say_is_refused(save, info, words: str) -> None:
    with pytest.raises(InputDataError, match=words) as error:
        read_demonstrations([save("v2.1", info=info, **HAND_STATE)])
    assert str(error.value).isprintable()


def test_damaged_files_are_refused_in_words(save, tmp_path) -> None:
    intact = save("v3.0", **HAND_STATE)
    for name, content in {
        "meta/info.json": b"{",
        "data/chunk-000/file-000.parquet": b"PAR1" + bytes(100) + b"PAR1",
        "meta/episodes/chunk-000/file-000.parquet": b"no Parquet",
    }.items():
        path = shutil.copytree(intact, tmp_path / "damaged", dirs_exist_ok=True)
        (path / name).write_bytes(content)
        with pytest.raises(InputDataError, match="not an intact LeRobot dataset"):
            read_demonstrations([path])


def test_without_its_reader_a_dataset_says_what_to_install(save, monkeypatch) -> None:
    monkeypatch.setattr("skillctl.demonstrations.formats.find_spec", lambda name: None)
    with pytest.raises(NotFoundError, match="pyarrow is not installed") as error:
        read_demonstrations([save("v3.0", **HAND_STATE)])
    assert error.value.hint == "pip install pyarrow"


def test_other_folders_are_refused_as_before(tmp_path) -> None:
    with pytest.raises(InputDataError, match="is a folder, not a file"):
        read_demonstrations([tmp_path])
