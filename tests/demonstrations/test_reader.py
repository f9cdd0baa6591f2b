"""Files of all formats together: what is chosen, converted, refused, and what the user is told."""

from __future__ import annotations

import hashlib
import os
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from skillctl.demonstrations.arm import RecordedArm
from skillctl.demonstrations.formats import FORMATS
from skillctl.demonstrations.reader import read_demonstrations
from skillctl.errors import InputDataError, NotFoundError, UsageError

PLAIN = "t,x,y\n0,1,2\n0.1,1.5,2.5\n0.2,2,2.25\n"


# ------------------------------------------------------------------------------------- many files


def test_files_of_many_formats_make_one_set(write, save_npz, lasa) -> None:
    table = write("demo,t,x,y\n0,0,0.01,0.02\n0,1,0,0\n1,0,0.03,0.01\n1,1,0,0\n", "a.csv")
    archive = save_npz(positions=np.array([[0.02, 0.02], [0.0, 0.0]]), dt=1.0)
    result = read_demonstrations([table, archive, lasa("Angle")])
    assert len(result.demonstrations) == 2 + 1 + 7
    assert [(s.path, s.importer) for s in result.sources] == [
        (table, "csv"),
        (archive, "npz"),
        (lasa("Angle"), "lasa"),
    ]
    for source in result.sources:
        assert source.sha256 == hashlib.sha256(source.path.read_bytes()).hexdigest()


def test_robots_and_cameras_make_one_set(write, save_robomimic, curve) -> None:
    motion = curve(dimension=3)
    rows = "".join(f"{i / 20} {x!r} {y!r} {z!r} 0 0 0 1\n" for i, (x, y, z) in enumerate(motion.tolist()))
    table = "t,x,y,z\n" + "".join(
        f"{i / 20},{x!r},{y!r},{z!r}\n" for i, (x, y, z) in enumerate(motion.tolist())
    )
    paths = [save_robomimic([motion]), write(rows, "hand.txt"), write(table)]
    result = read_demonstrations(paths)
    assert [source.importer for source in result.sources] == ["robomimic", "tum", "csv"]
    for demonstration in result.demonstrations:
        assert (demonstration.positions == motion).all()


def test_the_format_is_chosen_by_content_not_by_name(write, save_npz, save_mat, cell, curve) -> None:
    archive = save_npz(positions=curve(), dt=0.1).read_bytes()
    matlab = save_mat({"data": cell(np.vstack([curve().T] * 2)), "dt": 0.1}).read_bytes()
    for content, name in ((PLAIN, "csv"), (archive, "npz"), (matlab, "lpvds")):
        (source,) = read_demonstrations([write(content, "reach.dat")]).sources
        assert source.importer == name


def test_a_forced_format_is_not_second_guessed(write, save_npz, curve) -> None:
    archive = save_npz(positions=curve(), dt=0.1)
    for name in (form.name for form in FORMATS):
        if name == "npz":
            read_demonstrations([archive], input_format=name)
        else:
            with pytest.raises(InputDataError):
                read_demonstrations([archive], input_format=name)
    with pytest.raises(InputDataError, match="not an intact NPZ archive"):
        read_demonstrations([write(PLAIN)], input_format="npz")
    with pytest.raises(UsageError, match="'xml' is none of csv, tum, npz, robomimic, lasa, lpvds"):
        read_demonstrations([archive], input_format="xml")


def test_select_counts_over_all_files_and_leaves_the_others_unchecked(write) -> None:
    first = write("demo,t,x\na,0,1\na,1,2\nb,0,nan\nb,0,nan\n", "1.csv")
    second = write("t,x\n0,5\n1,6\n", "2.csv")
    result = read_demonstrations([first, second], demos=[2, 0, 2])
    assert [d.positions.ravel().tolist() for d in result.demonstrations] == [[5, 6], [1, 2]]
    assert len(result.sources) == 2
    with pytest.raises(UsageError, match="demonstration 3 does not exist; there are 3, counted from 0"):
        read_demonstrations([first, second], demos=[0, 3])
    with pytest.raises(UsageError, match="demonstration -1 does not exist"):
        read_demonstrations([second], demos=[-1])


def test_nothing_to_read_is_refused(write) -> None:
    with pytest.raises(InputDataError, match="no demonstrations"):
        read_demonstrations([])
    with pytest.raises(InputDataError, match="no demonstrations"):
        read_demonstrations([write(PLAIN)], demos=[])


def test_files_of_other_dimensions_or_columns_are_refused_by_name(write, save_npz) -> None:
    plane, space = write(PLAIN, "plane.csv"), write("t,x,y,z\n0,1,2,3\n1,2,3,4\n", "space.csv")
    with pytest.raises(InputDataError, match=r"space\.csv: columns x, y, z, but .*plane\.csv has x, y\."):
        read_demonstrations([plane, space])
    joints = write("t,a,b\n0,1,2\n1,2,3\n", "joints.csv")
    with pytest.raises(InputDataError, match=r"joints\.csv: columns a, b, but .*plane\.csv has x, y\."):
        read_demonstrations([plane, joints])
    archive = save_npz(positions=np.eye(3), dt=1.0)
    with pytest.raises(InputDataError, match=r"reach\.npz: 3 dimensions, but .*plane\.csv has x, y\."):
        read_demonstrations([archive, plane])


# ------------------------------------------------------------------------------------- units


def test_millimetres_become_metres_and_scale_comes_on_top(write) -> None:
    path = write("t,x,y\n0,360,0\n1,120,7\n")
    (demonstration,) = read_demonstrations([path], units="mm", scale=2.0).demonstrations
    assert demonstration.positions.tolist() == [[0.72, 0.0], [0.24, 0.014]]
    assert demonstration.velocities[0].tolist() == [0.24 - 0.72, 0.014]


def test_every_unit_applies_to_given_velocities_too(save_npz, curve) -> None:
    path = save_npz(positions=curve(), velocities=1000 * curve(), dt=0.1)
    (demonstration,) = read_demonstrations([path], units="mm", scale=0.5).demonstrations
    assert (demonstration.velocities == 1000 * curve() * 0.5 / 1000).all()
    assert (demonstration.positions == curve() * 0.5 / 1000).all()


def test_positions_and_angles_make_no_skill_together(write) -> None:
    first, second = write("t,x\n0,1\n1,2\n", "a.csv"), write("t,j1 (deg)\n0,1\n1,2\n", "b.csv")
    with pytest.raises(InputDataError, match=r"b\.csv: in deg, but .*a\.csv is in m\."):
        read_demonstrations([first, second])


def test_files_in_different_units_make_one_set(write) -> None:
    paths = [write(f"t,x_{unit}\n0,{n}\n1,{2 * n}\n", f"{unit}.csv") for unit, n in (("mm", 500), ("cm", 50))]
    for demonstration in read_demonstrations(paths).demonstrations:
        assert demonstration.positions.tolist() == [[0.5], [1.0]]


def test_radians_make_a_joint_space(save_npz, write) -> None:
    result = read_demonstrations([save_npz(positions=np.eye(7)[:2], dt=0.1)], units="rad", frame="joints")
    space = result.demonstrations.space
    assert (space.unit, space.frame, space.names[0], space.names[-1]) == ("rad", "joints", "q1", "q7")
    assert result.notes == ()
    result = read_demonstrations([write("t,a1\n0,20\n1,1\n")], units="rad")
    assert result.demonstrations.space.names == ("a1",)
    assert result.notes == ()  # 19 rad are no reason to think of millimetres


def test_columns_of_joint_formats_go_by_their_default_names(save_npz) -> None:
    path = save_npz(positions=np.eye(3), dt=0.1)
    assert read_demonstrations([path], units="rad", columns=["q2"]).demonstrations.space.names == ("q2",)


@pytest.mark.parametrize(
    "option", [{"dt": 0.0}, {"dt": -1.0}, {"scale": 0.0}, {"scale": np.inf}, {"dt": np.nan}]
)
def test_numbers_that_make_no_sense_are_refused(write, option) -> None:
    with pytest.raises(UsageError, match="must be a positive number"):
        read_demonstrations([write(PLAIN)], **option)


@pytest.mark.parametrize("times", [("0", "1e-320"), ("-1e308", "1e308")])
def test_times_beyond_any_clock_are_refused_in_words(write, times) -> None:
    with pytest.raises(InputDataError, match="must be finite"):
        read_demonstrations([write(f"t,x\n{times[0]},0\n{times[1]},1\n")])


# ------------------------------------------------------------------------------------- files


def test_a_missing_file_is_not_found(tmp_path: Path, write) -> None:
    for path in (tmp_path / "gone.csv", write(PLAIN) / "below-a-file.csv"):
        with pytest.raises(NotFoundError, match="there is no such file"):
            read_demonstrations([path])


def test_what_is_no_file_is_refused_at_once(tmp_path: Path, write) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, words in (
        (tmp_path, "is a folder"),
        (tmp_path / "pipe", "not a regular file"),
        (Path("/dev/zero"), "not a regular file"),
        (write("", "empty.csv"), "the file is empty"),
        (tmp_path / "a\0b", "cannot be read"),
        (tmp_path / ("n" * 300), "cannot be read"),
    ):
        with pytest.raises(InputDataError, match=words) as refusal:
            read_demonstrations([path])
        assert refusal.value.hint


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_an_unreadable_file_is_refused(write) -> None:
    path = write(PLAIN)
    path.chmod(stat.S_IWUSR)
    with pytest.raises(InputDataError, match="cannot be read"):
        read_demonstrations([path])


def test_a_huge_file_is_refused_unread(tmp_path: Path) -> None:
    with (tmp_path / "huge.csv").open("wb") as file:
        file.truncate(2**33)  # sparse
    with pytest.raises(InputDataError, match="8192 MiB; at most 256 MiB are read"):
        read_demonstrations([tmp_path / "huge.csv"])


@pytest.mark.parametrize(
    ("start", "words"),
    [
        (b"\x89SKILL\r\n\x1a\n1 ", "a skill, not a demonstration"),
        (b"\x89HDF\r\n\x1a\n", "not an intact HDF5 file"),
        (b"\x93NUMPY\x01\x00", "not an intact NPY array"),
        (b"\x1f\x8b\x08", "compressed with gzip"),
        (b"%PDF-1.7", "a PDF document"),
        (b"\x89PNG\r\n", "a picture"),
        (b"PK\x03\x04 broken", "not an intact NPZ archive"),
        (b"ELF\0\0", "neither text nor a format that skillctl knows"),
    ],
)
def test_foreign_files_are_told_apart(write, start: bytes, words: str) -> None:
    with pytest.raises(InputDataError, match=words) as refusal:
        read_demonstrations([write(start, "given.csv")])
    assert refusal.value.hint


# ------------------------------------------------------------------------------------- repairs and notes


def table(times, positions) -> str:
    rows = "".join(f"{t!r},{x!r}\n" for t, x in zip(list(times), list(positions), strict=True))
    return "t,x\n" + rows


def test_rows_written_twice_are_dropped_and_reported(write) -> None:
    path = write("t,x\n5,1\n5,1\n6,2\n7,3\n7,3\n7,3\n8,3\n")
    result = read_demonstrations([path])
    (demonstration,) = result.demonstrations
    assert demonstration.times.tolist() == [0, 1, 2, 3]
    assert demonstration.positions.ravel().tolist() == [1, 2, 3, 3]
    assert result.notes == (f"3 repeated rows were dropped, in {path}.",)


def test_velocities_and_places_follow_the_rows_that_stay(write, save_npz) -> None:
    path = save_npz(
        positions=np.array([[1.0], [1], [2], [3]]),
        velocities=np.array([[7.0], [7], [8], [9]]),
        times=np.array([0.0, 0, 1, 2]),
    )
    (demonstration,) = read_demonstrations([path]).demonstrations
    assert demonstration.velocities.tolist() == [[7], [8], [9]]
    with pytest.raises(InputDataError, match="line 5: time stamp 1 s follows 2 s"):
        read_demonstrations([write("t,x\n0,1\n0,1\n2,2\n1,3\n")])
    notes = read_demonstrations([write("t,x\n0,1\n0,1\n1,2\n2,3\n9,4\n10,5\n11,6\n")]).notes
    assert notes[1].endswith("after line 5.")


def test_reversed_recordings_run_back_to_where_they_began(write, save_npz) -> None:
    times, positions = [3.0, 4, 6, 7], [0.0, 1, 5, 8]
    (demonstration,) = read_demonstrations([write(table(times, positions))], reverse=True).demonstrations
    assert demonstration.times.tolist() == [0, 1, 3, 4]
    assert demonstration.positions.ravel().tolist() == [8, 5, 1, 0]
    assert demonstration.velocities.ravel().tolist() == np.gradient([8.0, 5, 1, 0], [0.0, 1, 3, 4]).tolist()
    measured = save_npz(
        positions=np.array([[0.0], [0], [1], [5]]),
        velocities=np.array([[1.0], [1], [2], [4]]),
        times=np.array([0.0, 0, 1, 3]),
    )
    (demonstration,) = read_demonstrations([measured], reverse=True, units="cm", scale=2.0).demonstrations
    assert demonstration.times.tolist() == [0, 2, 3]
    assert demonstration.velocities.ravel().tolist() == [-0.08, -0.04, -0.02]


def test_of_reversed_joints_the_hand_goes_back(write) -> None:
    arm = RecordedArm(
        "arm", "hand", ("j1", "j2"), (-3.0,) * 2, (3.0,) * 2, lambda q: np.c_[np.cos(q), q[:, :1]]
    )
    path = write("t,j1,j2\n0,0,1\n1,0.5,1\n3,1,0\n")
    (demonstration,) = read_demonstrations([path], arm=arm, reverse=True).demonstrations
    assert demonstration.times.tolist() == [0, 2, 3]
    assert demonstration.positions[:, 2].tolist() == [1, 0.5, 0]
    assert demonstration.positions[-1, :2] == pytest.approx([1, np.cos(1)], abs=1e-15)


def test_a_reversed_recording_is_judged_as_it_was_recorded(write) -> None:
    twice = 2 * np.linspace(0, 1, 20).tolist()
    path = write(table(np.arange(40.0).tolist(), twice))
    forwards, reverse = read_demonstrations([path]).faults, read_demonstrations([path], reverse=True).faults
    assert forwards[0] == reverse[0]
    assert "back to its start, at line 22" in reverse[0].sentence
    backwards = write(table([0.0, 2, 1], [0.0, 1, 2]), "clock.csv")
    with pytest.raises(InputDataError, match="line 4: time stamp 1 s follows 2 s"):
        read_demonstrations([backwards], reverse=True)


def test_recordings_that_begin_apart_end_apart_when_they_are_reversed(write) -> None:
    there = np.linspace(0, 1, 20)
    paths = [
        write(table(np.arange(20.0).tolist(), (start + (1 - start) * there).tolist()), f"{n}.csv")
        for n, start in enumerate([0.0, 0.01, 0.0, 0.6])
    ]
    assert not read_demonstrations(paths).faults
    (fault,) = read_demonstrations(paths, reverse=True).faults
    assert (fault.kind, fault.demo) == ("ends", 3)


def test_a_gap_in_time_is_reported_with_its_place(write) -> None:
    times = [0.0, 0.1, 0.2, 0.3, 0.9, 1.0, 1.1]
    even = write(table(np.arange(7.0).tolist(), [1.0, 2, 3, 4, 5, 6, 7]), "even.csv")
    path = write(table(times, [1.0, 2, 3, 4, 5, 6, 7]), "gap.csv")
    notes = read_demonstrations([even, path]).notes
    assert notes[0] == f"1 of 2 demonstrations with gaps in time; the longest, 0.6 s, in {path} after line 5."
    assert read_demonstrations([even]).notes == ()


def test_uneven_steps_are_reported(write) -> None:
    steps = np.tile([0.008, 0.012, 0.010], 20)
    path = write(table(np.cumsum(steps).tolist(), np.arange(60.0).tolist()))
    assert read_demonstrations([path], scale=0.1).notes == ()  # spread 40 % of the median: a usual clock
    steps = np.tile([0.005, 0.015, 0.010], 20)
    path = write(table(np.cumsum(steps).tolist(), np.arange(60.0).tolist()))
    (note,) = read_demonstrations([path], scale=0.1).notes
    assert note == f"{path} with uneven time steps; worst {path}, where they spread by 100% of their median."


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t,x\n0,0\n1,250\n", "extends over 250 m; if it does not, say the unit, as in --units mm."),
        ("t,x\n0,0\n1,0.001\n", "extends over 0.001 m only; check --units and --scale."),
        ("t,x\n0,0\n2000,1\n", "lasts 2000 s; if its times are not seconds, say so in the header: t_ms."),
        (
            "t,a,b,c,d\n0,0,0,0,0\n1,1,1,1,1\n",
            "4 dimensions are taken as metres; joint angles need --units rad or --units deg.",
        ),
    ],
)
def test_doubtful_units_are_reported(write, text: str, words: str) -> None:
    (note,) = read_demonstrations([write(text)]).notes
    assert note.endswith(words)


def test_the_same_content_twice_is_reported(write) -> None:
    a, b = write(PLAIN, "a.csv"), write(PLAIN, "b.csv")
    result = read_demonstrations([a, b])
    assert len(result.demonstrations) == 2
    assert result.notes == (f"{b} has the same content as {a}.",)
    assert read_demonstrations([a, a]).notes == (f"{a} has the same content as {a}.",)


def test_a_velocity_that_is_not_finite_is_refused_with_its_place(save_npz, curve) -> None:
    velocities = np.ones((20, 2))
    velocities[7, 1] = np.nan
    with pytest.raises(InputDataError, match=r"reach\.npz, sample 7: its velocity is not finite"):
        read_demonstrations([save_npz(positions=curve(), velocities=velocities, dt=0.1)])


# ------------------------------------------------------------------------------------- start-up


def test_reading_any_format_loads_neither_scipy_nor_hdf5(lasa) -> None:
    code = (
        "import sys; from skillctl.demonstrations.reader import read_demonstrations\n"
        "read_demonstrations([sys.argv[1]])\n"
        "print(sorted({'scipy', 'h5py', 'pydantic', 'typer', 'pybullet', 'matplotlib'} & set(sys.modules)))"
    )
    command = [sys.executable, "-c", code, str(lasa("Sshape"))]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip() == "[]"
