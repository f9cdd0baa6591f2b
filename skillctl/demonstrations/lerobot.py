"""LeRobot datasets of versions 2 and 3: folders of Parquet files, described by ``meta/info.json``."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.demonstrations.features import Choice, Features, choose, numbered, offered, points
from skillctl.demonstrations.files import File
from skillctl.demonstrations.recording import Recording, listed
from skillctl.errors import InputDataError, printable
from skillctl.opening import open_regular

KIND = "LeRobot dataset"
INFO = "meta/info.json"
VERSIONS = ("v2.", "v3.")
MAX_INFO = 2**24  # bytes of meta/info.json
WIDEST = 64  # numbers of a robot state
STATE = "observation.state"
COUNTERS = ("timestamp", "frame_index", "episode_index", "index", "task_index")


def recognises(file: File) -> bool:
    """Return whether the content is one of the files of a dataset; its folder is recognised by ``INFO``."""
    return file.content.startswith(b"PAR1") or b'"codebase_version"' in file.content[:1000]


def read(file: File) -> list[Recording]:
    """Return the episodes of a dataset.

    Without ``file.columns``, the point x, y, z among the observations is read, if there is one; if there is
    none, the joints in ``observation.state``, in radians unless the user says degrees. Times are those of the
    frames.

    Raises:
        InputDataError: The dataset is damaged or of another version, a file of it is missing, or it is not
            certain which numbers are the position.

    References:
        Cadene et al. 2024, LeRobot, versions 2.1 and 3.0 of its dataset format.
    """
    path = file.path
    if not path.is_dir():
        raise InputDataError(
            f"{path}: one file of a LeRobot dataset.",
            hint=f"Name the folder of the dataset, which holds {INFO}.",
        )
    found = file.opened(overview, KIND)
    features: Features = {name: tuple(labels) for name, labels in found["features"].items()}
    choice = _choice(features, file)
    named = all(features[key] != numbered(key, len(features[key])) for key, _ in choice.places)
    episodes = file.opened(stacks, KIND, keys=choice.keys)
    several = f"{path}: its episodes show {found['tasks']} tasks; --demos chooses those of one."
    recordings = []
    for episode, stack in episodes.items():
        position, orientation = choice.split(stack[:, 1:], features)
        recordings.append(
            Recording(
                path,
                position,
                times=stack[:, 0],
                names=choice.names,
                part=f"episode {episode}",
                unused=() if file.columns is not None else choice.left,
                orientation=orientation,
                notes=(*choice.notes, several) if found["tasks"] > 1 else choice.notes,
                unit="m" if choice.point or not named else "rad",
                taken=choice.taken,
            )
        )
    return recordings


def _choice(features: Features, file: File) -> Choice:
    """Return the numbers that are the position."""
    if file.columns is not None:
        return choose(list(file.columns), features, file, what="feature")
    observed = {name: labels for name, labels in features.items() if name.startswith("observation")}
    holding = [name for name, labels in observed.items() if points(labels)]
    if len(holding) == 1 and len(points(observed[holding[0]])) == 1:
        return choose(holding, observed, file, what="feature")
    named = STATE in observed and observed[STATE] != numbered(STATE, len(observed[STATE]))
    if not holding and named:
        return choose([STATE], observed, file, what="feature")
    there = observed or features
    numbers = [f"{name} ({listed(labels)})" for name, labels in there.items()]
    offer = offered(there) or f"Choose with --columns, as in --columns '{STATE}_[0-2]'."
    raise InputDataError(
        f"{file.path}: it is not certain which numbers are the position.",
        hint=f"{offer} They are: {', '.join(numbers) or 'none'}.",
    )


# ----------------------------------------------------------------------------------------- in the child


def overview(path: str) -> dict[str, Any]:
    """Return the features of a dataset that are rows of numbers, and the number of its tasks."""
    info = _info(path)
    features = {}
    for name, feature in info["features"].items():
        shape, kind = feature.get("shape"), str(feature.get("dtype"))
        rows = kind.startswith(("float", "int")) and isinstance(shape, list) and len(shape) == 1
        if rows and 0 < shape[0] <= WIDEST and name not in COUNTERS:
            features[name] = _labels(name, feature.get("names"), int(shape[0]))
    tasks = info.get("total_tasks", 1)
    return {"features": features, "tasks": tasks if isinstance(tasks, int) else 1}


def stacks(path: str, keys: list[str]) -> dict[str, FloatArray]:
    """Return the frames of each episode: its times (T,) [s] and features side by side, (T, 1 + d)."""
    from pyarrow import parquet

    info = _info(path)
    episodes: dict[int, FloatArray] = {}
    for place in dict.fromkeys(_places(path, info)):
        if not (Path(path) / place).is_file():
            raise InputDataError(
                f"{printable(place)}: this file of the dataset is missing.", hint="Fetch it whole."
            )
        columns = ["episode_index", "timestamp", *keys]
        table = parquet.ParquetFile(Path(path) / place).read(columns, use_threads=False)
        rows = np.hstack([_matrix(table.column(name), len(table)) for name in columns])
        for frames in np.split(rows, np.flatnonzero(np.diff(rows[:, 0])) + 1):
            before = episodes.get(number := int(frames[0, 0]))
            episodes[number] = frames[:, 1:] if before is None else np.vstack([before, frames[:, 1:]])
    return {str(episode): episodes[episode] for episode in sorted(episodes)}


def _info(path: str) -> dict[str, Any]:
    """Return what the dataset says of itself."""
    with open_regular(Path(path) / INFO) as file:
        content = file.read(MAX_INFO + 1)
    if len(content) > MAX_INFO:
        raise InputDataError(f"{INFO} is larger than {MAX_INFO / 2**20:.0f} MiB.")
    info: dict[str, Any] = json.loads(content)
    version = str(info.get("codebase_version"))
    if not version.startswith(VERSIONS):
        raise InputDataError(
            f"a LeRobot dataset of version {printable(version)[:20]}; versions 2 and 3 are read.",
            hint="Convert it with LeRobot's script for the next version.",
        )
    return info


def _labels(feature: str, names: Any, width: int) -> list[str]:
    """Return the names of a feature's numbers; the dataset gives a list, lists by a kind, or none."""
    if isinstance(names, dict):
        names = [name for each in names.values() for name in (each if isinstance(each, list) else [])]
    if not isinstance(names, list) or len(names) != width or not all(isinstance(name, str) for name in names):
        return list(numbered(feature, width))
    often = Counter(names)
    return [name if often[name] == 1 else f"{name}_{index}" for index, name in enumerate(names)]


def _places(path: str, info: dict[str, Any]) -> Iterator[str]:
    """Yield the file of each episode, relative to the dataset, as its template says."""
    total = int(info["total_episodes"])
    if info["codebase_version"].startswith("v2."):
        size = int(info["chunks_size"])
        for episode in range(total):
            yield _place(info, episode_chunk=episode // size, episode_index=episode, total_episodes=total)
        return
    from pyarrow import parquet

    for file in sorted((Path(path) / "meta" / "episodes").glob("*/*.parquet")):
        columns = ["data/chunk_index", "data/file_index"]
        table = parquet.ParquetFile(file).read(columns, use_threads=False)
        for chunk, index in zip(*(table.column(name).to_pylist() for name in columns), strict=True):
            yield _place(info, chunk_index=int(chunk), file_index=int(index))


def _place(info: dict[str, Any], **indices: int) -> str:
    place: str = info["data_path"].format(**indices)
    parts = PurePosixPath(place).parts
    if ".." in parts or PurePosixPath(place).is_absolute():
        raise InputDataError(f"{printable(place)[:80]}: leads out of the dataset.", hint=f"Correct {INFO}.")
    return place


def _matrix(column: Any, rows: int) -> FloatArray:
    """Return a column of numbers, or of lists of numbers that are equally long, as a matrix."""
    values = column.combine_chunks()
    while hasattr(values, "flatten") and "list" in str(values.type):
        values = values.flatten()
    array = np.asarray(values.to_numpy(zero_copy_only=False), dtype=np.float64)
    if not rows or array.size % rows:
        raise ValueError("frames of different lengths")
    return array.reshape(rows, -1)
