"""MATLAB files: the bytes against SciPy's reader and writer, and the two layouts demonstrations come in."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from skillctl.demonstrations import matlab, read_demonstrations
from skillctl.errors import InputDataError

EPS = np.finfo(np.float64).eps


def variables(path: Path) -> matlab.Variables:
    return matlab.variables(path.read_bytes(), path)


# ------------------------------------------------------------------------------------- the bytes


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize(
    "dtype", ["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "?"]
)  # every class of numbers that MATLAB has
def test_numbers_of_every_class_arrive(save_mat, dtype: str, compressed: bool) -> None:
    array = np.arange(12).reshape(3, 4).astype(dtype)
    found = variables(save_mat({"a": array, "scalar": array[1, 1], "row": array[0]}, compressed))
    assert (found["a"] == array).all()
    assert found["scalar"].item() == float(array[1, 1])
    assert found["row"].shape == (1, 4)


def test_three_dimensions_and_empty_matrices_keep_their_shape(save_mat) -> None:
    cube = np.random.default_rng(0).normal(size=(2, 3, 4))
    found = variables(save_mat({"cube": cube, "empty": np.zeros((0, 3))}))
    assert (found["cube"] == cube).all()
    assert found["empty"].shape == (0, 3)
    assert matlab.matrix(found["cube"]) is None
    assert matlab.matrix(found["empty"]) is None


def test_cells_and_structs_nest(save_mat, cell) -> None:
    inner = {"pos": np.eye(2), "name": "reach"}
    found = variables(save_mat({"c": cell(inner, np.ones((1, 2)), cell(np.zeros((1, 1))))}))
    struct_array, row, nested = found["c"].items
    assert struct_array.items[0]["pos"].tolist() == [[1, 0], [0, 1]]
    assert isinstance(struct_array.items[0]["name"], matlab.Other)
    assert row.tolist() == [[1, 1]]
    assert nested.items[0].tolist() == [[0]]


def test_what_demonstrations_are_not_made_of_is_told_apart(save_mat) -> None:
    found = variables(save_mat({"z": np.array([[1j]]), "s": "text", "sparse": scipy.sparse.eye_array(2)}))
    assert all(isinstance(value, matlab.Other) for value in found.values())
    assert matlab.described(found) == "z other, s other, sparse other"


def test_cells_come_column_by_column(save_mat) -> None:
    cells = np.empty((2, 2), dtype=object)
    for (i, j), _ in np.ndenumerate(cells):
        cells[i, j] = np.full((1, 1), 10 * i + j)
    found = variables(save_mat({"c": cells}))
    assert [value.item() for value in found["c"].items] == [0, 10, 1, 11]


def element(kind: int, data: bytes, order: str) -> bytes:
    return struct.pack(f"{order}II", kind, len(data)) + data + bytes(-len(data) % 8)


def by_hand(order: str, shape: tuple[int, int], name: bytes) -> bytes:
    """A file with one array of six numbers, from the format's description: flags, sizes, name, data."""
    array = b"".join(
        [
            element(6, struct.pack(f"{order}II", 6, 0), order),
            element(5, struct.pack(f"{order}ii", *shape), order),
            name,
            element(9, np.arange(6.0).astype(f"{order}f8").tobytes(), order),
        ]
    )
    end = b"\x00\x01IM" if order == "<" else b"\x01\x00MI"
    return bytes(124) + end + element(14, array, order)


@pytest.mark.parametrize("order", ["<", ">"])
def test_both_byte_orders_are_read(write, order: str) -> None:
    path = write(by_hand(order, (2, 3), element(1, b"a", order)), "hand.mat")
    assert variables(path)["a"].tolist() == [[0, 2, 4], [1, 3, 5]]


def test_sizes_that_lie_are_refused(write) -> None:
    long_name, short_name = struct.pack("<HHI", 1, 5, 0), struct.pack("<HH4s", 1, 4, b"abcd")
    assert variables(write(by_hand("<", (2, 3), short_name)))["abcd"].shape == (2, 3)
    for shape, name in (((-1, 3), short_name), ((2, 2), short_name), ((2, 3), long_name)):
        with pytest.raises(InputDataError, match="not an intact MATLAB 5 file"):
            variables(write(by_hand("<", shape, name)))


def test_what_unpacks_to_too_much_is_refused(save_mat, monkeypatch) -> None:
    both = {name: np.zeros(1000) for name in "ab"}
    unpacked = len(save_mat(both).read_bytes()) - 128  # after the header
    path = save_mat(both, compressed=True)
    for limit in (unpacked - 1, unpacked // 2, 100):  # the second is one variable too many
        monkeypatch.setattr(matlab, "MAX_BYTES", limit)
        with pytest.raises(InputDataError, match=r"not an intact MATLAB 5 file .*too large"):
            variables(path)
    monkeypatch.setattr(matlab, "MAX_BYTES", unpacked)
    assert set(variables(path)) == {"a", "b"}


def test_cells_nested_without_end_are_refused(save_mat, cell) -> None:
    value: object = np.ones((1, 1))
    for _ in range(20):
        value = cell(value)
    with pytest.raises(InputDataError, match="nested too deeply"):
        variables(save_mat({"data": value}))


# ------------------------------------------------------------------------------------- LASA


def test_lasa_motions_are_read_as_scipy_reads_them_but_in_metres(lasa) -> None:
    files = sorted(lasa("Angle").parent.glob("*.mat"))
    assert len(files) == 30
    for path in files:
        result = read_demonstrations([path])
        cells = scipy.io.loadmat(path)["demos"].ravel()
        assert len(result.demonstrations) == len(cells) == 7
        for demonstration, fields in zip(result.demonstrations, (c[0, 0] for c in cells), strict=True):
            # Division by 1000 is correctly rounded on both sides: no tolerance.
            assert (demonstration.positions == fields["pos"].T / 1000).all()
            assert (demonstration.velocities == fields["vel"].T / 1000).all()
            assert (demonstration.times == fields["t"].ravel() - fields["t"][0, 0]).all()
        assert result.sources[0].importer == "lasa"
        assert result.demonstrations.space.names == ("x", "y")
        assert result.notes == ()


def lasa_like(cell, curve, **changes: object) -> dict[str, object]:
    x = curve(dimension=2).T
    fields = {"pos": x, "vel": 2 * x, "t": np.arange(20.0), "acc": x, "dt": 1.0} | changes
    return {"demos": cell(fields, fields)}


def test_a_file_like_lasas_is_recognised(save_mat, cell, curve) -> None:
    result = read_demonstrations([save_mat(lasa_like(cell, curve), compressed=True)], units="m")
    first, _ = result.demonstrations
    assert (first.positions == curve()).all()
    assert first.source == "reach.mat, demonstration 0"


@pytest.mark.parametrize(
    "change", [{"t": np.arange(19.0)}, {"vel": np.ones((2, 3))}, {"pos": "gone"}, {"pos": np.zeros((0, 0))}]
)
def test_lasa_fields_that_do_not_match_are_refused(save_mat, cell, curve, change) -> None:
    with pytest.raises(InputDataError, match=r"reach.mat, demonstration 0: pos, vel and t are not"):
        read_demonstrations([save_mat(lasa_like(cell, curve, **change))])


# ------------------------------------------------------------------------------------- LPV-DS


def test_lpvds_matrices_hold_positions_above_velocities(save_mat, cell, curve) -> None:
    x, v, y = curve(dimension=3), curve(dimension=3, seed=1), curve(samples=9, dimension=3, seed=2)
    cells = cell(np.hstack([x, v]).T, np.hstack([y, y]).T)
    result = read_demonstrations([save_mat({"data": cells, "dt": 0.25})])
    first, second = result.demonstrations
    assert (first.positions == x).all()
    assert (first.velocities == v).all()
    assert first.times.tolist() == (0.25 * np.arange(20)).tolist()
    assert len(second.times) == 9
    assert (result.sources[0].importer, result.demonstrations.space.names) == ("lpvds", ("x", "y", "z"))


def test_without_dt_the_period_follows_from_steps_and_velocities(save_mat, cell) -> None:
    # Constant speed: every step is exactly one period long. One sample is lost, the median does not care.
    t = 0.02 * np.delete(np.arange(50.0), 20)
    motion = np.stack([3 * t, 4 * t, np.full(49, 3.0), np.full(49, 4.0)])
    path = save_mat({"data": cell(motion)})
    result = read_demonstrations([path])
    (demonstration,) = result.demonstrations
    # Differences of numbers up to 4, each rounded, against steps of 0.1.
    assert demonstration.times[-1] == pytest.approx(0.02 * 48, rel=4 * 4 * EPS / 0.1)
    assert "the sampling period follows from the velocities: 20 ms." in result.notes
    (given,) = read_demonstrations([path], dt=0.5).demonstrations
    assert given.times[-1] == 24.0


def test_without_dt_and_without_motion_the_period_is_asked_for(save_mat, cell) -> None:
    with pytest.raises(InputDataError, match="says nothing about time"):
        read_demonstrations([save_mat({"data": cell(np.vstack([np.eye(2), np.zeros((2, 2))]))})])


@pytest.mark.parametrize("bad", [np.ones((3, 5)), "text", np.zeros((0, 0))])
def test_a_cell_that_is_no_such_matrix_is_refused(save_mat, cell, bad) -> None:
    with pytest.raises(InputDataError, match=r"demonstration 1: not a matrix with as many rows"):
        read_demonstrations([save_mat({"data": cell(np.ones((4, 5)), bad), "dt": 0.1})])


# ------------------------------------------------------------------------------------- other layouts


@pytest.mark.parametrize("contents", [{"x": np.eye(2), "y": "text"}, {"data": np.eye(2)}, {"demos": 1.0}, {}])
def test_unknown_layouts_are_refused_with_what_was_found(save_mat, contents) -> None:
    path = save_mat(contents)
    with pytest.raises(InputDataError, match="of unknown layout") as refusal:
        read_demonstrations([path])
    assert all(name in str(refusal.value) for name in contents or ["no variables"])
    for forced, words in (("lasa", "not laid out as LASA"), ("lpvds", "not laid out as LPV-DS")):
        with pytest.raises(InputDataError, match=words):
            read_demonstrations([path], input_format=forced)


def test_version_7_3_and_other_bytes_are_refused(write) -> None:
    with pytest.raises(InputDataError, match=r"a MATLAB 7\.3 file") as refusal:
        read_demonstrations([write(b"MATLAB 7.3 MAT-file".ljust(600, b"\0"), "new.mat")])
    assert "save -v7" in refusal.value.hint
    with pytest.raises(InputDataError, match="not an intact MATLAB 5 file"):
        read_demonstrations([write("t,x\n0,1\n1,2\n")], input_format="lasa")
