"""Damaged files: always an answer in words, never a crash, whatever the damage."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from skillctl.demonstrations import checks, files, formats
from skillctl.errors import InputDataError
from skillctl.workers.child import Child

COPIES = 300
KINDS = ["csv", "tum", "npz", "robomimic", "mat", "mat-compressed", "lasa"]


@pytest.fixture(params=KINDS)
def intact(request, save_npz, save_mat, save_robomimic, cell, curve, lasa) -> bytes:
    if request.param == "csv":
        rows = (f"{i},{x!r},{y!r}" for i, (x, y) in enumerate(curve().tolist()))
        return "\n".join(["t,x,y", *rows]).encode()
    if request.param == "tum":
        rows = (f"{i} {x!r} {y!r} 0.5 0 0 0.6 0.8" for i, (x, y) in enumerate(curve().tolist()))
        return "\n".join(rows).encode()
    if request.param == "npz":
        return save_npz(positions=curve(), times=np.arange(20.0)).read_bytes()
    if request.param == "robomimic":
        return save_robomimic([curve(dimension=3, seed=i) for i in range(3)]).read_bytes()
    if request.param == "lasa":
        return lasa("Angle").read_bytes()
    data = cell(*(np.vstack([curve(seed=i).T] * 2) for i in range(3)))
    return save_mat({"data": data, "dt": 0.1}, compressed=request.param == "mat-compressed").read_bytes()


@pytest.fixture
def impatient() -> Iterator[Child]:
    """Some damage is without end: 0 or 1 of 300 copies."""
    with Child(replace(files.LIMITS, seconds=3.0), files.NO_PLUGINS) as child:
        yield child


@pytest.fixture
def answer(impatient: Child, tmp_path: Path, monkeypatch) -> Callable[[bytes], InputDataError | None]:
    """Read a file; return how it was refused, or None if what was read is sound."""
    monkeypatch.chdir(tmp_path)

    def answer(content: bytes) -> InputDataError | None:
        try:
            Path("damaged").write_bytes(content)
            file = files.File(Path("damaged"), content, None, impatient)
            recordings = formats.format_of(file).read(file)
            demonstrations = [checks.prepare(recording, dt=0.1, scale=1.0)[0] for recording in recordings]
        except InputDataError as refusal:
            return refusal
        assert all(np.isfinite(demonstration.velocities).all() for demonstration in demonstrations)
        return None

    return answer


def test_a_damaged_file_is_read_or_refused_in_words(intact: bytes, answer) -> None:
    random = np.random.default_rng(0)
    refusals = []
    for _ in range(COPIES):
        damaged = bytearray(intact)
        for _ in range(random.integers(1, 9)):
            # Half of the damage goes where sizes and kinds stand.
            end = len(damaged) if random.random() < 0.5 else min(len(damaged), 400)
            damaged[random.integers(end)] = random.integers(256)
        refusals.append(answer(bytes(damaged)))
    messages = [str(refusal) for refusal in refusals if refusal]
    assert len(messages) > COPIES / 10
    assert all(message.startswith("damaged") and message.isprintable() for message in messages)


def test_a_file_cut_off_anywhere_is_read_or_refused_in_words(intact: bytes, answer) -> None:
    lengths = np.linspace(1, len(intact) - 1, 100).astype(int)
    refusals = [answer(intact[:length]) for length in lengths]
    assert sum(refusal is not None for refusal in refusals) > 0
