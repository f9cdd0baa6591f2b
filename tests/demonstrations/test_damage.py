"""Damaged files: always an answer in words, never a crash, whatever the damage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from skillctl.demonstrations import read_demonstrations
from skillctl.errors import InputDataError

COPIES = 300


@pytest.fixture(params=["csv", "npz", "mat", "mat-compressed", "lasa"])
def intact(request, save_npz, save_mat, cell, curve, lasa) -> bytes:
    if request.param == "csv":
        rows = (f"{i},{x!r},{y!r}" for i, (x, y) in enumerate(curve().tolist()))
        return "\n".join(["t,x,y", *rows]).encode()
    if request.param == "npz":
        return save_npz(positions=curve(), times=np.arange(20.0)).read_bytes()
    if request.param == "lasa":
        return lasa("Angle").read_bytes()
    data = cell(*(np.vstack([curve(seed=i).T] * 2) for i in range(3)))
    return save_mat({"data": data, "dt": 0.1}, compressed=request.param == "mat-compressed").read_bytes()


def answer(path: Path) -> InputDataError | None:
    """Read a file; return how it was refused, or None if what was read is sound."""
    try:
        result = read_demonstrations([path], dt=0.1)
    except InputDataError as refusal:
        return refusal
    assert all(np.isfinite(d.velocities).all() for d in result.demonstrations)
    return None


def test_a_damaged_file_is_read_or_refused_in_words(intact: bytes, write) -> None:
    random = np.random.default_rng(0)
    refusals = []
    for _ in range(COPIES):
        damaged = bytearray(intact)
        for _ in range(random.integers(1, 9)):
            # Half of the damage goes where sizes and kinds stand.
            end = len(damaged) if random.random() < 0.5 else min(len(damaged), 400)
            damaged[random.integers(end)] = random.integers(256)
        refusals.append(answer(write(bytes(damaged), "damaged")))
    messages = [str(refusal) for refusal in refusals if refusal]
    assert len(messages) > COPIES / 10
    assert all("damaged" in message and message.isprintable() for message in messages)


def test_a_file_cut_off_anywhere_is_read_or_refused_in_words(intact: bytes, write) -> None:
    lengths = np.linspace(1, len(intact) - 1, 100).astype(int)
    refusals = [answer(write(intact[:length], "cut")) for length in lengths]
    assert sum(refusal is not None for refusal in refusals) > 0
