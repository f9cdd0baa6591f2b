"""Files to read: written by other people's tools where there are any."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from skillctl.arrays import FloatArray
from skillctl.demonstrations import ReadResult, read_demonstrations


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
def save_mat(tmp_path: Path) -> Callable[..., Path]:
    """Write a MATLAB 5 file, by SciPy."""
    from scipy.io import savemat

    def save(variables: dict[str, object], compressed: bool = False) -> Path:
        savemat(tmp_path / "reach.mat", variables, do_compression=compressed)
        return tmp_path / "reach.mat"

    return save


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
