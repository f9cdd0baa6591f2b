"""What more than one module of these tests needs."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def good(library: Path) -> bytes:
    """An artifact that `learn` wrote, for making bad ones of."""
    return (library / "curve" / "1.h5").read_bytes()
