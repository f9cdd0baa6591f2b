"""Faults are put into recordings that have none: each is found where it is, and what is left is right."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from skillctl.arrays import FloatArray
from skillctl.demonstrations.faults import Fault, require_accepted, told
from skillctl.demonstrations.options import Reading
from skillctl.demonstrations.reader import ReadResult, read_demonstrations
from skillctl.errors import InputDataError

SAMPLES, RATE = 200, 100.0
READ = Callable[..., ReadResult]


def eased(samples: int = SAMPLES) -> FloatArray:
    s = np.linspace(0, 1, samples)[:, None]
    return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))


def reach(start: Sequence[float] = (0.8, 0.1, 0.4), end: Sequence[float] = (0.3, 0.4, 0.2)) -> FloatArray:
    """A reach with a bend: its extent is about 0.7 m, its longest step 7 mm."""
    e = eased()
    return np.asarray(start) + (np.asarray(end) - start) * e + np.sin(np.pi * e) * [0.0, 0.0, 0.2]


def four() -> list[FloatArray]:
    return [reach(start=(0.8, 0.1 + i / 50, 0.4)) for i in range(4)]


@pytest.fixture
def read(tmp_path: Path) -> READ:
    """Write motions as tables, one a file, and read them; line k of a table is sample k − 2."""

    def read(*motions: FloatArray, times: FloatArray | None = None) -> ReadResult:
        paths = []
        for number, motion in enumerate(motions):
            stamps = np.arange(len(motion)) / RATE if times is None else times
            paths.append(tmp_path / f"{number}.csv")
            table = np.column_stack([stamps, motion])
            names = ",".join(["t", *"xyz"[: motion.shape[1]]])
            np.savetxt(paths[-1], table, "%.17g", ",", header=names, comments="")
        return read_demonstrations(paths)

    return read


def only(result: ReadResult) -> Fault:
    (fault,) = result.faults
    return fault


# ------------------------------------------------------------------------------------- dropouts


def zeros(clean: FloatArray, lost: slice) -> FloatArray:
    return np.zeros(3)


def held(clean: FloatArray, lost: slice) -> FloatArray:
    return clean[lost.start - 1]


def elsewhere(clean: FloatArray, lost: slice) -> FloatArray:
    return clean[lost] + [0.0, 0.5, 0.0]


def wild(clean: FloatArray, lost: slice) -> FloatArray:
    random = np.random.default_rng(lost.start)
    ways = random.normal(size=(lost.stop - lost.start, 3))
    return clean[lost] + ways / np.linalg.norm(ways, axis=1, keepdims=True)


@pytest.mark.parametrize(
    ("first", "count"), [(0, 1), (0, 20), (50, 1), (90, 5), (150, 20), (195, 5), (199, 1)]
)
@pytest.mark.parametrize("fault", [zeros, elsewhere, wild])
def test_lost_samples_are_left_out_wherever_they_are(read: READ, fault, first: int, count: int) -> None:
    if fault is not zeros and count == 20 and first == 0:
        pytest.skip("twenty moving samples at an end are a motion of their own")
    if fault is wild and count == 20:
        pytest.skip("noise of that length is refused, below")
    clean, lost = reach(), slice(first, first + count)
    recorded = clean.copy()
    recorded[lost] = fault(clean, lost)
    result = read(recorded)
    assert only(result).kind == "dropouts"
    assert not only(result).refused
    last = f" to line {first + count + 1}" if count > 1 and fault is not wild else ""
    assert f"at line {first + 2}{last}" in only(result).sentence or fault is wild
    (left,) = result.demonstrations
    assert (left.positions == np.delete(clean, lost, axis=0)).all()
    times = np.delete(np.arange(SAMPLES) / RATE, lost)
    assert (left.times == times - times[0]).all()


@pytest.mark.parametrize("count", [8, 30])
def test_repeats_are_left_out_when_the_motion_went_on(read: READ, count: int) -> None:
    clean, lost = reach(), slice(80, 80 + count)
    recorded = clean.copy()
    recorded[lost] = held(clean, lost)
    fault = only(read(recorded))
    assert f"{count} samples repeat the one before" in fault.sentence
    assert f"line 82 to line {81 + count}, left out" in fault.sentence
    assert fault.refused == (count == 30)  # 27 % of the extent go by meanwhile


def test_a_pause_is_no_repeat_and_no_gap(read: READ) -> None:
    clean = reach()
    there_and_on = np.vstack([clean, np.repeat(clean[-1:], 100, axis=0), reach(clean[-1], (0.9, 0.9, 0.9))])
    assert read(there_and_on).faults == ()


@pytest.mark.parametrize("fault", [zeros, elsewhere, wild])
@pytest.mark.parametrize("first", [70, 140])
def test_a_recording_that_lost_too_much_is_refused(read: READ, fault, first: int) -> None:
    clean, lost = reach(), slice(first, first + 60)
    recorded = clean.copy()
    recorded[lost] = fault(clean, lost)
    assert any(found.refused for found in read(recorded).faults)


@pytest.mark.parametrize(("first", "refused"), [(120, True), (190, False)])
def test_an_end_that_is_lost_in_motion_is_refused_and_one_at_rest_is_not(
    read, first: int, refused: bool
) -> None:
    recorded = reach()
    recorded[first:] = 0.0
    fault = only(read(recorded))
    assert fault.refused == refused
    assert ("still moving at line 121" in fault.sentence) == refused


def test_scattered_dropouts_are_all_left_out(read: READ) -> None:
    clean, recorded = reach(), reach()
    lost = np.random.default_rng(1).choice(np.arange(1, SAMPLES - 1), 20, replace=False)
    recorded[lost] = 0.0
    result = read(recorded)
    assert "20 samples are exactly zero" in only(result).sentence
    assert (result.demonstrations.demonstrations[0].positions == np.delete(clean, lost, axis=0)).all()


def test_given_velocities_go_with_their_samples(tmp_path: Path) -> None:
    clean = reach()
    velocities, recorded = np.gradient(clean, 1 / RATE, axis=0), clean.copy()
    recorded[60:64] = 0.0
    times = np.arange(SAMPLES) / RATE
    np.savez(tmp_path / "a.npz", positions=recorded, velocities=velocities, times=times)
    (read,) = read_demonstrations([tmp_path / "a.npz"]).demonstrations
    assert (read.velocities == np.delete(velocities, slice(60, 64), axis=0)).all()


def test_a_motion_that_ends_at_the_origin_or_passes_it_lost_nothing(read: READ) -> None:
    passing = np.linspace(-1, 1, 101)[:, None] * [1.0, 0.5, 0.2]
    assert (passing[50] == 0).all()
    resting = np.vstack([reach(end=(0, 0, 0)), np.zeros((50, 3))])
    for motion in (passing, resting, resting[::-1]):
        assert read(motion).faults == ()


# ------------------------------------------------------------------------------------- jumps and clocks


@pytest.mark.parametrize("pause", [0, 300])
def test_demonstrations_in_one_recording_are_refused_with_the_way_out(read: READ, pause: int) -> None:
    a, b, c = four()[:3]
    times = np.arange(3 * SAMPLES) + pause * np.repeat([0, 1, 2], SAMPLES)
    result = read(np.vstack([a, b, c]), times=times / RATE)
    fault = next(found for found in result.faults if found.kind == "jumps")
    assert fault.refused
    assert "back to its start, at line 202; it holds 3 demonstrations" in fault.sentence
    assert "column demo" in fault.sentence


@pytest.mark.parametrize(("by", "refused"), [(0.15, False), (0.5, True)])
def test_a_jump_for_good_is_told_from_one_that_is_taken_back(read: READ, by: float, refused: bool) -> None:
    recorded = reach()
    recorded[100:] += [0.0, by, 0.0]
    fault = only(read(recorded))
    assert (fault.kind, fault.refused) == ("jumps", refused)
    assert "at line 102; it goes on from there" in fault.sentence


@pytest.mark.parametrize("skip", [0.2, 10.0, 1.6e9])
def test_a_clock_that_jumps_is_set_right(read: READ, skip: float) -> None:
    times = np.arange(SAMPLES) / RATE
    result = read(reach(), times=np.where(np.arange(SAMPLES) < 80, times, times + skip))
    assert (only(result).kind, only(result).refused) == ("clock", skip > 0.25 * 2)
    assert "after line 81" in only(result).sentence
    # Differences of stamps of 1.6e9 s are exact to 2.4e-7 s; the usual step is the median of 200 of them.
    right = result.demonstrations.demonstrations[0].times
    np.testing.assert_allclose(right, times, atol=200 * 2.4e-7)


@pytest.mark.parametrize(("count", "refused"), [(25, False), (60, True)])
def test_a_way_without_samples_is_named_by_its_length(read: READ, count: int, refused: bool) -> None:
    kept = np.delete(np.arange(SAMPLES), slice(80, 80 + count))
    fault = only(read(reach()[kept], times=kept / RATE))
    way = np.linalg.norm(reach()[80 + count] - reach()[79])
    assert (fault.kind, fault.refused) == ("dropouts", refused)
    assert f"no samples on {way:.3g} m of the way" in fault.sentence
    assert "after line 81" in fault.sentence


# ------------------------------------------------------------------------------------- beside each other


@pytest.mark.parametrize(("away", "refused"), [(0.05, None), (0.12, False), (0.5, True)])
def test_an_end_apart_from_the_others_is_named(read: READ, away: float, refused: bool | None) -> None:
    motions = four()
    motions[2] = motions[2] + eased() * [0.0, 0.0, away]
    result = read(*motions)
    if refused is None:
        assert result.faults == ()
        return
    assert (only(result).kind, only(result).refused, only(result).demo) == ("ends", refused, 2)
    assert only(result).sentence.startswith(f"2.csv ends {away:.3g} m from the others")


def test_ends_that_all_scatter_are_one_fault_of_the_set(read: READ) -> None:
    result = read(*(reach(end=(0.3, 0.4, height)) for height in (0.0, 0.5, 1.0, 1.5)))
    assert (only(result).kind, only(result).refused, only(result).demo) == ("ends", True, None)
    assert "one motion to one target?" in only(result).sentence


def test_the_way_back_is_told_from_the_way(read: READ) -> None:
    motions = four()
    motions[0] = motions[0][::-1]
    result = read(*motions)
    assert (only(result).kind, only(result).refused, only(result).demo) == ("directions", True, 0)
    from_both_sides = [reach(start=(0.3 + aside, 0.4, 0.2)) for aside in (-0.5, 0.5)]
    assert read(*from_both_sides).faults == ()


def looped(size: float) -> FloatArray:
    """A line of one metre with a circle in it, as wide as ``size``."""
    line = np.linspace(0, 1, 101)[:, None] * [1.0, 0.0]
    turn = np.linspace(0, 2 * np.pi, 102)[1:-1]
    circle = line[50] + size / 2 * np.stack([np.sin(turn), 1 - np.cos(turn)], axis=1)
    return np.vstack([line[:51], circle, line[51:]])


@pytest.mark.parametrize(("size", "refused"), [(0.05, None), (0.1, False), (0.4, True)])
def test_a_motion_that_crosses_itself_is_refused(read: READ, size: float, refused: bool | None) -> None:
    faults = read(looped(size)).faults
    assert [fault.refused for fault in faults] == ([] if refused is None else [refused])
    for fault in faults:
        assert fault.kind == "crossings"
        assert "a skill goes one way from each place" in fault.sentence


def test_one_loop_among_many_motions_is_a_slip(read: READ) -> None:
    line = np.linspace(0, 1, 101)[:, None] * [1.0, 0.0]
    result = read(line, line, line, looped(0.4))
    assert (only(result).refused, only(result).demo) == (False, 3)


# ------------------------------------------------------------------------------------- nothing else


@pytest.mark.parametrize("rate", [10, 30, 100, 1000])
def test_clean_motions_have_no_faults_at_any_rate(read: READ, rate: int) -> None:
    random = np.random.default_rng(rate)
    rest = np.zeros((rate // 2, 3))
    for noise in (0.0, 1e-4, 1e-3):
        e = eased(2 * rate)
        motions = []
        for start in random.uniform(0.2, 0.9, (3, 3)):
            motion = start * (1 - e) + np.sin(np.pi * e) * [0.0, 0.0, 0.2] + 0.5
            motion = np.vstack([rest + motion[0], motion, rest + motion[-1]])
            motions.append(motion + noise * random.normal(size=motion.shape))
        assert read(*motions, times=np.arange(len(motions[0])) / rate).faults == ()


@pytest.mark.parametrize("name", ["Angle", "GShape", "Khamesh", "Leaf_2", "PShape", "Snake", "Worm", "heee"])
def test_handwriting_has_no_faults(lasa: Callable[[str], Path], name: str) -> None:
    assert read_demonstrations([lasa(name)]).faults == ()


# ------------------------------------------------------------------------------------- what follows


def test_the_hint_names_what_leaves_it_out_and_what_accepts_it(read: READ, tmp_path: Path) -> None:
    motions = four()
    motions[1] = motions[1] + eased() * [0.0, 0.0, 0.6]
    read(*motions)
    paths = sorted(tmp_path.glob("*.csv"))
    with pytest.raises(
        InputDataError, match=r"^1\.csv ends 0\.6 m from the others, .* at line 201\.$"
    ) as caught:
        Reading().read(paths)
    assert caught.value.hint == "Leave it out with --demos 0,2-3, or accept it with --accept ends."
    with pytest.raises(InputDataError) as caught:
        Reading(demos=(1, 2, 3), accept=("jumps",)).read(paths)
    assert "--demos 2-3," in caught.value.hint  # counted over all files, not over those that were chosen
    assert len(Reading(demos=(0, 2, 3)).read(paths).demonstrations) == 3
    assert len(Reading(accept=("ends",)).read(paths).demonstrations) == 4


def test_nothing_is_left_out_where_nothing_would_be_left() -> None:
    faults = [Fault("jumps", True, "a jumps.", 0), Fault("crossings", True, "b crosses.", 1)]
    with pytest.raises(InputDataError, match=r"^a jumps\. 2 faults are too large\.$") as caught:
        require_accepted(faults, (), (0, 1))
    assert caught.value.hint == "Accept all with --accept jumps,crossings."
    require_accepted(faults, ("crossings", "jumps"), (0, 1))


def test_many_faults_of_one_kind_are_told_in_few_sentences() -> None:
    faults = [Fault("dropouts", False, f"{i}.", i) for i in range(9)] + [Fault("ends", False, "e.", 1)]
    assert told(faults) == ("0.", "1.", "2.", "6 more demonstrations with dropouts.", "e.")
