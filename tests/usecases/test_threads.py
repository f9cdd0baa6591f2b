"""Several threads that learn, merge and combine at once write the bytes that each would write alone."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest

from skillctl.compose.options import CombineOptions
from skillctl.learning.options import LearnOptions
from skillctl.store.registry import Registry
from skillctl.usecases.combine import combine
from skillctl.usecases.learn import learn
from skillctl.usecases.merge import merge


@pytest.fixture
def work(curve_files: list[Path], hook_files: list[Path], tmp_path: Path) -> list[Callable[[Path], object]]:
    """Functions that each write a skill to a file: learned in several ways, merged, combined."""
    fast = LearnOptions(preset="fast", n_components=3)
    parts = [tmp_path / "curve.h5", tmp_path / "hook.h5"]
    for part, files in zip(parts, (curve_files, hook_files), strict=True):
        learn(files, output=part, options=fast)
    sheared = LearnOptions(preset="fast", n_components=2, coordinates="shears")
    return [
        lambda output: learn(curve_files, output=output, options=fast),
        lambda output: learn(hook_files, output=output, options=sheared),
        lambda output: learn(hook_files[:2], output=output, options=fast),
        lambda output: merge(parts, output=output),
        lambda output: combine(parts, output=output, options=CombineOptions(align=True)),
    ]


def test_threads_that_work_at_once_write_the_same_bytes_as_alone(work, tmp_path: Path) -> None:
    alone = []
    for number, make in enumerate(work):
        make(tmp_path / f"alone-{number}.h5")
        alone.append((tmp_path / f"alone-{number}.h5").read_bytes())
    together = Barrier(2 * len(work))

    def write(number: int) -> bytes:
        together.wait(timeout=60)
        output = tmp_path / f"together-{number}.h5"
        work[number % len(work)](output)
        return output.read_bytes()

    with ThreadPoolExecutor(2 * len(work)) as pool:
        assert list(pool.map(write, range(2 * len(work)))) == alone * 2


def test_threads_that_publish_at_once_get_versions_of_their_own(
    curve_files: list[Path], tmp_path: Path
) -> None:
    options = LearnOptions(preset="fast", n_components=2)

    def publish(number: int) -> str:
        report = learn(curve_files, name="reach", store=tmp_path, options=options, note=f"{number}")
        return str(report.written.skill)

    with ThreadPoolExecutor(4) as pool:
        published = sorted(pool.map(publish, range(4)))
    assert published == [f"reach@{version}" for version in Registry(tmp_path).versions("reach")]
    assert len(published) == 4
