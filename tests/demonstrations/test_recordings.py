"""What real recordings hold: spikes, rests, jitter, many demonstrations, many points."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from skillctl.arrays import FloatArray
from skillctl.demonstrations.reader import ReadResult, read_demonstrations


def as_table(times: FloatArray, positions: FloatArray) -> str:
    rows = np.column_stack([times, positions]).tolist()
    names = ["t", *"xyz"[: positions.shape[1]]]
    return "\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows)])


@pytest.fixture
def read_motion(read_text) -> Callable[[FloatArray], ReadResult]:
    """Read positions sampled 100 times a second."""
    return lambda positions: read_text(as_table(np.arange(len(positions)) / 100, positions))


def reach(samples: int = 200) -> FloatArray:
    """A reach in the plane, with steps of 3 to 10 mm."""
    s = np.linspace(0, 1, samples)[:, None]
    return np.hstack([s**3 * (10 - 15 * s + 6 * s**2), 0.2 * np.sin(np.pi * s)])


def spikes(result: ReadResult) -> list[str]:
    return [fault.sentence for fault in result.faults if fault.kind == "dropouts"]


# ------------------------------------------------------------------------------------- spikes


@pytest.mark.parametrize("width", [1, 5, 20])
@pytest.mark.parametrize("at", [1, 20, 100, 160])
def test_a_jump_aside_and_back_is_named_by_line_and_taken_out(read_motion, at: int, width: int) -> None:
    clean = reach() + 0.1  # a sample at the origin beside a spike would be lost, too
    positions = clean.copy()
    positions[at : at + width] += [0.3, 0.4]
    result = read_motion(positions)
    (sentence,) = spikes(result)
    (length,) = re.findall(r"jumps? aside, up to ([\d.]+) m off the motion", sentence)
    chord = clean[at + width] - clean[at - 1]
    assert abs(float(length) - 0.5) <= np.linalg.norm(chord) + 0.0005  # a motion may bend while it is lost
    last = f" to line {at + width + 1}" if width > 1 else ""  # the header is line 1, sample 0 line 2
    assert f"at line {at + 2}{last}, left out" in sentence
    kept = np.delete(clean, slice(at, at + width), axis=0)
    assert (result.demonstrations.demonstrations[0].positions == kept).all()


def test_spikes_are_counted_and_the_farthest_is_named(read_motion) -> None:
    positions = reach()
    positions[[30, 32, 60]] = 0.0, -0.5  # lost samples at one place, as cameras give them
    positions[120] += [0, 0.9]
    (sentence,) = spikes(read_motion(positions))
    assert sentence.startswith(
        "reach.csv: 4 samples jump aside, up to 0.9 m off the motion at line 122, left out"
    )


def test_lines_are_counted_over_rows_that_were_dropped(read_text) -> None:
    positions = reach()
    positions[50] += 1.0
    lines = as_table(np.arange(200) / 100, positions).splitlines()
    lines.insert(11, lines[10])
    (sentence,) = spikes(read_text("\n".join(lines)))
    assert "at line 53, left out" in sentence


def test_no_motion_of_a_hand_is_a_spike(read_motion) -> None:
    rest = np.zeros((300, 2))
    random = np.random.default_rng(0)
    there = reach()
    away = np.array([0.5, 0]) + there
    for motion in (
        there,
        np.vstack([rest, there, rest + there[-1]]),
        np.vstack([there, away]),  # a jump that is not taken back: tracking that was lost
        np.vstack([there, there[::-1], there]),
        np.vstack([np.repeat(there[:1], 900, axis=0), there, there[-2::-1]]),  # turns back on the spot
        there + random.normal(0, 1e-3, there.shape),
        np.vstack([rest, there]) + random.normal(0, 1e-5, (500, 2)),
        np.round(there, 2),
    ):
        assert spikes(read_motion(motion)) == []


@pytest.mark.parametrize(("steps", "reported"), [(9, False), (12, True)])
def test_a_spike_is_ten_times_longer_than_the_median_step(read_motion, steps: float, reported: bool) -> None:
    positions = np.linspace(0, 1, 101)[:, None] * [1.0, 0.0]
    positions[50, 1] = steps * 0.01  # aside from a line of steps of 0.01
    assert bool(spikes(read_motion(positions))) == reported


def test_a_motion_too_small_for_numbers_has_no_spikes(read_motion) -> None:
    positions = np.zeros((5, 1))
    positions[2] = 5e-324
    assert spikes(read_motion(positions)) == []


def test_a_spike_is_measured_in_the_skills_unit(read_text) -> None:
    positions = 1000 * reach()
    positions[50] += [300, 400]
    table = as_table(np.arange(200) / 100, positions)
    (sentence,) = spikes(read_text(table, units="mm", scale=2.0))
    assert "up to 1 m off the motion" in sentence


# ------------------------------------------------------------------------------------- rests and jitter


def test_rests_are_kept_and_are_no_repeated_rows(read_motion) -> None:
    rested = np.vstack([np.zeros((100, 2)), reach(), np.ones((100, 2)) * reach()[-1]])
    result = read_motion(rested)
    assert len(result.demonstrations.demonstrations[0].times) == 400
    assert result.notes == ()


def test_a_jittery_clock_is_reported_and_its_stamps_are_kept(read_text) -> None:
    times = np.cumsum(np.random.default_rng(0).uniform(0.001, 0.019, 200))
    result = read_text(as_table(times, reach()))
    assert (result.demonstrations.demonstrations[0].times == times - times[0]).all()
    assert any("uneven time steps" in note for note in result.notes)


def test_motions_of_all_lengths_make_one_set(write) -> None:
    paths = [write(as_table(np.arange(n) / n, reach(n)), f"{n}.csv") for n in (2, 3, 50, 5000)]
    assert [len(d.times) for d in read_demonstrations(paths).demonstrations] == [2, 3, 50, 5000]


@pytest.mark.parametrize("dimension", [1, 6, 7])
def test_lines_and_joint_spaces_are_read(read_text, dimension: int) -> None:
    names = [f"q{i + 1}" for i in range(dimension)]
    rows = [",".join(map(str, [i / 10, *(i * i + np.arange(dimension))])) for i in range(5)]
    result = read_text("\n".join([",".join(["t", *names]), *rows]), units="rad")
    assert result.demonstrations.space.names == tuple(names)
    assert not any("taken as metres" in note for note in result.notes)


# ------------------------------------------------------------------------------------- many


def test_a_hundred_demonstrations_are_read_from_files_or_from_one(write, save_robomimic) -> None:
    motions = [np.array([i / 1000, 0]) + reach() for i in range(100)]
    tables = [as_table(np.arange(200) / 20, motion) for motion in motions]
    files = [write(table, f"{i}.csv") for i, table in enumerate(tables)]
    rows = [f"{i},{row}" for i, table in enumerate(tables) for row in table.splitlines()[1:]]
    together = write("\n".join(["demo,t,x,y", *rows]), "all.csv")
    for paths in (files, [together]):
        demonstrations = read_demonstrations(paths).demonstrations
        assert len(demonstrations) == 100
        for demonstration, motion in zip(demonstrations, motions, strict=True):
            assert (demonstration.positions == motion).all()
    spatial = [np.hstack([motion, motion[:, :1]]) for motion in motions]
    demonstrations = read_demonstrations([save_robomimic(spatial)]).demonstrations
    assert all((d.positions == x).all() for d, x in zip(demonstrations, spatial, strict=True))


def test_memory_grows_with_the_file_and_no_faster(tmp_path: Path) -> None:
    """The peak of a process that reads n points, against one that reads 4 n."""
    if sys.platform != "linux":
        pytest.skip("elsewhere the peak has another unit")
    code = (
        "import resource, sys, skillctl.demonstrations.reader as d; d.read_demonstrations(sys.argv[1:])\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)"
    )
    peaks, sizes = [], []
    for points in (50_000, 200_000):
        path = tmp_path / f"{points}.csv"
        np.savetxt(
            path, np.column_stack([np.arange(points) / 100, reach(points)]), "%.6f", ",", header="t,x,y"
        )
        run = subprocess.run([sys.executable, "-c", code, path], capture_output=True, check=True)
        peaks.append(int(run.stdout))
        sizes.append(path.stat().st_size)
    # A point is 29 bytes of text and 8 numbers (line, time, position and velocity, twice while converted);
    # the limit is twice that.
    assert peaks[1] - peaks[0] < 2 * (sizes[1] - sizes[0] + 2 * 8 * 6 * 150_000)
