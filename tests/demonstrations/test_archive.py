"""NPZ archives: three layouts, and never a pickle."""

from __future__ import annotations

import zipfile
from itertools import permutations

import numpy as np
import pytest

from skillctl.demonstrations import archive
from skillctl.demonstrations.reader import read_demonstrations
from skillctl.errors import InputDataError, UsageError


def test_one_motion_with_times_and_velocities(save_npz, curve) -> None:
    x, v, t = curve(), curve(seed=1), 0.5 + np.arange(20.0) / 7
    result = read_demonstrations([save_npz(positions=x, velocities=v, times=t)])
    (demonstration,) = result.demonstrations
    assert (demonstration.positions == x).all()
    assert (demonstration.velocities == v).all()
    assert (demonstration.times == t - 0.5).all()
    assert (result.sources[0].importer, demonstration.source) == ("npz", "reach.npz")
    assert result.demonstrations.space.names == ("x", "y")


@pytest.mark.parametrize("times", [np.arange(20) / 10, np.arange(60).reshape(3, 20) / 10])
def test_a_stack_of_motions(save_npz, curve, times) -> None:
    x = np.stack([curve(seed=i) for i in range(3)])
    demonstrations = read_demonstrations([save_npz(positions=x, times=times)]).demonstrations
    assert np.stack([d.positions for d in demonstrations]).tolist() == x.tolist()
    starts = np.broadcast_to(times, (3, 20))[:, :1]
    assert np.stack([d.times for d in demonstrations]).tolist() == (times - starts).tolist()
    assert demonstrations.demonstrations[2].source == "reach.npz, demonstration 2"


def test_arrays_named_per_demonstration(save_npz, curve) -> None:
    path = save_npz(demo_2=curve(5), demo_10=curve(8), demo_10_times=np.arange(8.0), dt=0.1, day="Monday")
    result = read_demonstrations([path])
    first, second = result.demonstrations
    assert np.allclose(first.times, [0, 0.1, 0.2, 0.3, 0.4], rtol=0, atol=np.finfo(float).eps)
    assert second.times.tolist() == list(range(8))
    assert first.source == "reach.npz, array demo_2"
    assert result.notes == ("left aside: day; use --columns to choose others.",)


def test_integers_and_single_precision_are_numbers(save_npz) -> None:
    for dtype in (np.int32, np.float32):
        path = save_npz(positions=np.array([[1, 2], [3, 4]], dtype=dtype), dt=1)
        (demonstration,) = read_demonstrations([path]).demonstrations
        assert demonstration.positions.tolist() == [[1, 2], [3, 4]]


def test_columns_choose_among_the_default_names(save_npz, curve) -> None:
    x = curve(dimension=3)
    result = read_demonstrations([save_npz(positions=x, velocities=2 * x, dt=0.1)], columns=["z", "x"])
    (demonstration,) = result.demonstrations
    assert (demonstration.positions == x[:, [2, 0]]).all()
    assert (demonstration.velocities == 2 * x[:, [2, 0]]).all()
    assert result.demonstrations.space.names == ("z", "x")
    with pytest.raises(InputDataError, match="no column 'w'"):
        read_demonstrations([save_npz(positions=x, dt=0.1)], columns=["w"])


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"positions": np.zeros(5), "dt": 0.1}, "found positions (5,), dt ()"),
        ({"positions": np.zeros((5, 2)), "times": np.arange(4.0)}, "form no demonstrations"),
        ({"positions": np.zeros((5, 2)), "velocities": np.zeros((4, 2))}, "form no demonstrations"),
        ({"demo_0": np.ones((5, 2)), "demo_0_times": np.arange(4.0)}, "form no demonstrations"),
        ({"left": np.ones((5, 2)), "right": np.ones((5, 2))}, "form no demonstrations"),
        ({"labels": np.arange(3)}, "form no demonstrations"),
        ({"positions": np.ones((5, 2)), "dt": -1.0}, "dt must be one positive number"),
        ({"positions": np.ones((5, 2)), "dt": np.ones(2)}, "dt must be one positive number"),
        ({"positions": np.ones((5, 2), dtype=complex), "dt": 0.1}, "holds complex128, not real numbers"),
        ({"positions": np.array([["a"]]), "dt": 0.1}, "holds <U1, not real numbers"),
        ({"positions": np.array([[0.0, 1.0], [np.nan, 2.0]]), "dt": 0.1}, "sample 1, column 'x': nan"),
    ],
)
def test_other_layouts_are_refused_with_what_was_found(save_npz, arrays, words: str) -> None:
    with pytest.raises(InputDataError) as refusal:
        read_demonstrations([save_npz(**arrays)])
    assert words in str(refusal.value)
    assert refusal.value.hint


def test_pickled_objects_are_never_read(save_npz) -> None:
    path = save_npz(positions=np.array([{"a": 1}, None], dtype=object), dt=0.1)
    with pytest.raises(InputDataError, match="pickled Python objects"):
        read_demonstrations([path])


def test_an_archive_that_unpacks_to_too_much_is_refused_before_it_does(save_npz, curve, monkeypatch) -> None:
    path = save_npz(positions=curve(), velocities=curve(), dt=0.1)
    monkeypatch.setattr(archive, "MAX_BYTES", 800)  # two arrays of 20 x 2 numbers need 640 bytes and headers
    with pytest.raises(InputDataError, match="at most 800 are read"):
        read_demonstrations([path])


def test_a_spreadsheet_is_told_from_an_archive(tmp_path) -> None:
    with zipfile.ZipFile(tmp_path / "reach.xlsx", "w") as spreadsheet:
        spreadsheet.writestr("[Content_Types].xml", "<Types/>")
    with pytest.raises(InputDataError, match="export its table as CSV"):
        read_demonstrations([tmp_path / "reach.xlsx"])


# ------------------------------------------------------------------------------------- axes


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_axes_in_any_order_are_told_apart_by_their_sizes(save_npy, curve, order) -> None:
    motions = np.stack([curve(40, 3, seed=i) for i in range(9)])
    result = read_demonstrations([save_npy(motions.transpose(order))], dt=0.1)
    assert np.stack([d.positions for d in result.demonstrations]).tolist() == motions.tolist()
    names = ",".join(("demo", "time", "dim")[axis] for axis in order)
    shape = tuple(np.array((9, 40, 3))[list(order)].tolist())
    said = (f"the axes are read as {names}, by their sizes {shape}; --axes says otherwise.",)
    assert [note for note in result.notes if "axes" in note] == [*(said if order != (0, 1, 2) else ())]


def test_axes_that_sizes_do_not_tell_are_asked_for(save_npy, curve) -> None:
    motions = np.stack([curve(40, 3, seed=i) for i in range(3)])
    path = save_npy(motions.transpose(1, 0, 2))
    with pytest.raises(InputDataError, match=r"sizes \(40, 3, 3\) of its axes do not tell") as error:
        read_demonstrations([path], dt=0.1)
    assert "--axes demo,time,dim" in error.value.hint
    result = read_demonstrations([path], dt=0.1, axes=["time", "demo", "dim"])
    assert np.stack([d.positions for d in result.demonstrations]).tolist() == motions.tolist()
    with pytest.raises(UsageError, match="time,dim are not demo,time,dim, in any order"):
        read_demonstrations([path], dt=0.1, axes=["time", "dim"])


def test_times_tell_which_axis_is_time_even_if_it_is_short(save_npz, curve) -> None:
    motions = np.stack([curve(5, 2, seed=i) for i in range(30)])
    across = motions.transpose(1, 2, 0)
    path = save_npz(positions=across, velocities=across, times=np.arange(5.0))
    result = read_demonstrations([path])
    assert np.stack([d.positions for d in result.demonstrations]).tolist() == motions.tolist()
    assert np.stack([d.velocities for d in result.demonstrations]).tolist() == motions.tolist()


def test_one_motion_may_lie_across(save_npy, curve) -> None:
    result = read_demonstrations([save_npy(curve(40, 3).T)], dt=0.1)
    (demonstration,) = result.demonstrations
    assert (demonstration.positions == curve(40, 3)).all()
    assert result.notes == ("the axes are read as dim,time, by their sizes (3, 40); --axes says otherwise.",)


def test_a_clock_and_a_quaternion_are_no_coordinates(save_npy, curve) -> None:
    times = np.round(0.02 * np.arange(40), 6)
    angle = np.linspace(0, 1, 40)
    turned = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle, 0 * angle])
    result = read_demonstrations([save_npy(np.column_stack([times, curve(40, 3), turned]))])
    (demonstration,) = result.demonstrations
    assert (demonstration.positions == curve(40, 3)).all()
    assert demonstration.times.tolist() == times.tolist()
    assert result.notes == (
        "column 0 rises evenly and is read as the time.",
        "columns 4 to 7 are unit quaternions and left aside; --orientation xyzw or wxyz reads them.",
    )


def test_seven_joints_are_no_quaternion(save_npy, curve) -> None:
    result = read_demonstrations([save_npy(curve(40, 7))], dt=0.1, units="rad")
    assert (result.demonstrations.dimension, result.notes) == (7, ())


def test_dimensions_are_bounded(save_npy, write, curve) -> None:
    path = save_npy(curve(40, 12))
    with pytest.raises(InputDataError, match=r"none of its axes \(40, 12\) has at most 7 dimensions"):
        read_demonstrations([path], dt=0.1)
    with pytest.raises(InputDataError, match="12 dimensions; a motion has at most 7") as error:
        read_demonstrations([path], dt=0.1, axes=["time", "dim"])
    assert "--max-dimension 12" in error.value.hint
    assert read_demonstrations([path], dt=0.1, max_dimension=12).demonstrations.dimension == 12
    chosen = read_demonstrations([path], dt=0.1, axes=["time", "dim"], columns=["q12", "q1"])
    assert (chosen.demonstrations.demonstrations[0].positions == curve(40, 12)[:, [11, 0]]).all()


def test_columns_of_arrays_are_renamed(save_npy, curve) -> None:
    result = read_demonstrations([save_npy(curve(40, 3))], dt=0.1, columns=["x=z", "y"])
    assert result.demonstrations.space.names == ("x", "y")
    assert (result.demonstrations.demonstrations[0].positions == curve(40, 3)[:, [2, 1]]).all()


@pytest.mark.parametrize(
    ("name", "per_second", "since"), [("t", 1, 0), ("time_ms", 1e3, 0), ("stamps", 1e9, 1_700_000_000)]
)
def test_an_array_with_the_name_of_a_time_is_one(save_npz, curve, name, per_second, since) -> None:
    times = 0.1 * np.arange(20)
    arrays = {
        "pos": curve(),
        "vel": 2 * curve(),
        "gripper": np.ones((20, 1)),
        name: (since + times) * per_second,
    }
    result = read_demonstrations([save_npz(**arrays)])
    (demonstration,) = result.demonstrations
    assert (demonstration.positions == curve()).all()
    assert np.abs(demonstration.times - times).max() < 3e-7  # as doubles of seconds since 1970 are rounded
    assert result.notes == ("left aside: vel, gripper; use --columns to choose others.",)


def test_one_of_several_arrays_that_may_be_times_is_that_of_the_right_size(save_npz, curve) -> None:
    path = save_npz(xyz=curve(), time_of_start=np.arange(3.0), stamps=np.arange(20.0))
    (demonstration,) = read_demonstrations([path]).demonstrations
    assert demonstration.times.tolist() == list(range(20))
