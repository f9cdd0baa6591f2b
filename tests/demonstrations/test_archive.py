"""NPZ archives: three layouts, and never a pickle."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest

from skillctl.demonstrations import archive
from skillctl.demonstrations.reader import read_demonstrations
from skillctl.errors import InputDataError


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
        ({"pos": np.ones((5, 2)), "vel": np.ones((5, 2))}, "form no demonstrations"),
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
