"""Files to read: written by other people's tools where there are any."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from skillctl.arrays import FloatArray
from skillctl.demonstrations.files import LIMITS, NO_PLUGINS
from skillctl.demonstrations.reader import ReadResult, read_demonstrations
from skillctl.workers.child import Child


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Write text or bytes to a file of the given name."""

    def write(content: str | bytes, name: str = "reach.csv") -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


@pytest.fixture
def read_text(write: Callable[..., Path]) -> Callable[..., ReadResult]:
    """Read a table given as text."""
    return lambda text, **options: read_demonstrations([write(text)], **options)


@pytest.fixture
def save_npz(tmp_path: Path) -> Callable[..., Path]:
    def save(**arrays: object) -> Path:
        np.savez(tmp_path / "reach.npz", **arrays)
        return tmp_path / "reach.npz"

    return save


@pytest.fixture
def save_npy(tmp_path: Path) -> Callable[[FloatArray], Path]:
    def save(array: FloatArray) -> Path:
        np.save(tmp_path / "reach.npy", array)
        return tmp_path / "reach.npy"

    return save


@pytest.fixture
def save_mat(tmp_path: Path) -> Callable[..., Path]:
    """Write a MATLAB 5 file, by SciPy."""
    from scipy.io import savemat

    def save(variables: dict[str, object], compressed: bool = False) -> Path:
        savemat(tmp_path / "reach.mat", variables, do_compression=compressed)
        return tmp_path / "reach.mat"

    return save


@pytest.fixture(scope="module")
def child() -> Iterator[Child]:
    """A process that parses; one for many tests, because starting it takes longer than they do.

    It may take long on a busy machine.
    """
    with Child(replace(LIMITS, seconds=60.0), NO_PLUGINS) as child:
        yield child


@pytest.fixture
def cell() -> Callable[..., object]:
    """Make a cell array, one row."""

    def cell(*items: object) -> object:
        array = np.empty((1, len(items)), dtype=object)
        for index, item in enumerate(items):
            array[0, index] = item
        return array

    return cell


@pytest.fixture
def curve() -> Callable[..., FloatArray]:
    """Return a smooth motion, (samples, dimension), with a velocity that never vanishes."""

    def curve(samples: int = 20, dimension: int = 2, seed: int = 0) -> FloatArray:
        t = np.linspace(0, 1, samples)[:, None]
        a, b, c = np.random.default_rng(seed).uniform(0.1, 0.5, size=(3, dimension))
        return a + b * t + c * t**2

    return curve


@pytest.fixture
def save_robomimic(tmp_path: Path) -> Callable[..., Path]:
    """Write a dataset laid out as robomimic's are: of low-dimensional observations, with a filter key."""
    import h5py

    def save(
        motions: Sequence[FloatArray],
        *,
        env_args: object = {"env_name": "Lift", "type": 1, "env_kwargs": {"control_freq": 20}},
        edit: Callable[[h5py.File], None] = lambda file: None,
        **observations: Callable[[FloatArray], FloatArray],
    ) -> Path:
        with h5py.File(tmp_path / "low_dim.hdf5", "w") as file:
            data = file.create_group("data")
            data.attrs["total"] = sum(map(len, motions))
            data.attrs["env_args"] = env_args if isinstance(env_args, str) else json.dumps(env_args)
            for index, motion in enumerate(motions):
                demonstration = data.create_group(f"demo_{index}")
                demonstration.attrs["num_samples"] = len(motion)
                demonstration.attrs["model_file"] = "<mujoco/>" * 100
                for name, width in {"actions": 7, "states": 32}.items():
                    demonstration[name] = np.zeros((len(motion), width))
                demonstration["rewards"] = np.zeros(len(motion))
                demonstration["dones"] = np.zeros(len(motion), dtype=int)
                for group in ("obs", "next_obs"):
                    obs = demonstration.create_group(group)
                    obs["robot0_eef_pos"] = motion if group == "obs" else np.roll(motion, -1, axis=0)
                    obs["robot0_eef_quat"] = np.tile([0.0, 0, 0, 1], (len(motion), 1))
                    obs.create_dataset(
                        "agentview_image", data=np.zeros((len(motion), 8, 8, 3), "u1"), compression="gzip"
                    )
                    for name, made_of in observations.items():
                        obs.pop(name, None)
                        obs[name] = made_of(motion)
            file["mask/train"] = np.array([b"demo_0"])
            edit(file)
        return tmp_path / "low_dim.hdf5"

    return save
