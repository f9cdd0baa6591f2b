"""What more than one module of these tests needs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    import numpy as np


@pytest.fixture(scope="session")
def good(library: Path) -> bytes:
    """An artifact that `learn` wrote, for making bad ones of."""
    return (library / "curve" / "1.h5").read_bytes()


@pytest.fixture(scope="session")
def save_with_matrix(library: Path) -> Callable[[str, int, np.ndarray, Path], Path]:
    """Return a function that saves a learned skill of the library with one of its matrices replaced."""
    from skillctl.model.seds import SedsSkill
    from skillctl.usecases.files import load, save

    def save_changed(name: str, component: int, matrix: np.ndarray, path: Path) -> Path:
        skill = load(library / name / "1.h5")
        assert isinstance(skill, SedsSkill)
        matrices = skill.system_matrices.copy()
        matrices[component] = matrix
        return save(replace(skill, system_matrices=matrices), path)

    return save_changed
