"""MATLAB files: what becomes of SciPy's values, and the two layouts demonstrations come in."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from skillctl.demonstrations import matlab
from skillctl.demonstrations.files import File
from skillctl.demonstrations.reader import read_demonstrations
from skillctl.errors import InputDataError

EPS = np.finfo(np.float64).eps


@pytest.fixture
def variables(child) -> Callable[[Path], matlab.Variables]:
    return lambda path: matlab.variables(File(path, path.read_bytes(), None, child))


# ------------------------------------------------------------------------------------- values


@pytest.mark.parametrize("compressed", [False, True])
def test_numbers_of_every_class_arrive(save_mat, variables, compressed: bool) -> None:
    array = np.arange(12).reshape(3, 4)
    classes = ["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "?"]  # all that MATLAB has
    arrays = {f"a{dtype.strip('?')}": array.astype(dtype) for dtype in classes}
    found = variables(
        save_mat({**arrays, "scalar": 7, "row": array[0], "empty": np.zeros((0, 3))}, compressed)
    )
    for name, written in arrays.items():
        assert found[name].dtype == np.float64
        assert (found[name] == written).all()
    assert found["scalar"].tolist() == [[7]]
    assert found["row"].shape == (1, 4)
    assert found["empty"].shape == (0, 3)


def test_only_matrices_with_numbers_are_matrices() -> None:
    assert matlab.matrix(np.eye(2)).tolist() == [[1, 0], [0, 1]]
    others: list[matlab.Value] = [np.zeros((2, 2, 2)), np.zeros((0, 3)), [np.eye(2)], {}, None]
    for other in others:
        assert matlab.matrix(other) is None


def test_cells_and_structs_nest(save_mat, variables, cell) -> None:
    inner = {"pos": np.eye(2), "name": "reach"}
    structs = np.array([[(1, 5), (3, 7)], [(2, 6), (4, 8)]], dtype=[("a", object), ("b", object)])
    found = variables(save_mat({"c": cell(inner, np.ones((1, 2)), cell(np.zeros((1, 1)))), "s": structs}))
    struct, row, (zero,) = found["c"]
    assert struct["pos"].tolist() == [[1, 0], [0, 1]]
    assert struct["name"] is None
    assert row.tolist() == [[1, 1]]
    assert zero.tolist() == [[0]]
    assert [(item["a"].item(), item["b"].item()) for item in found["s"]] == [(1, 5), (2, 6), (3, 7), (4, 8)]


def test_what_demonstrations_are_not_made_of_is_told_apart(save_mat, variables, cell) -> None:
    found = variables(
        save_mat(
            {
                "z": np.array([[1j]]), "s": "text", "sparse": scipy.sparse.eye_array(2),
                "f": {"a": 1}, "c": cell(1.0), "n": np.eye(3),
            }
        )
    )  # fmt: skip
    assert matlab.described(found) == "z other, s other, sparse other, f struct, c cells, n (3, 3)"


def test_cells_come_column_by_column(save_mat, variables) -> None:
    cells = np.empty((2, 2), dtype=object)
    for (i, j), _ in np.ndenumerate(cells):
        cells[i, j] = np.full((1, 1), 10 * i + j)
    assert [value.item() for value in variables(save_mat({"c": cells}))["c"]] == [0, 10, 1, 11]


def test_what_unpacks_to_too_much_is_refused(save_mat, variables) -> None:
    path = save_mat({"data": np.zeros(2**25 + 1)}, compressed=True)
    assert path.stat().st_size < 2**20
    with pytest.raises(InputDataError, match="too large: more than 256 MiB of numbers"):
        variables(path)


def test_cells_nested_without_end_are_refused(save_mat, variables, cell) -> None:
    value: object = np.ones((1, 1))
    for _ in range(20):
        value = cell(value)
    with pytest.raises(InputDataError, match="nested too deeply"):
        variables(save_mat({"data": value}))


# ------------------------------------------------------------------------------------- LASA


def test_lasa_motions_are_read_as_scipy_reads_them_but_in_metres(lasa) -> None:
    files = sorted(lasa("Angle").parent.glob("*.mat"))
    assert len(files) == 30
    result = read_demonstrations(files)
    cells = [cell[0, 0] for path in files for cell in scipy.io.loadmat(path)["demos"].ravel()]
    assert len(result.demonstrations) == len(cells) == 30 * 7
    for demonstration, fields in zip(result.demonstrations, cells, strict=True):
        # Division by 1000 is correctly rounded on both sides: no tolerance.
        assert (demonstration.positions == fields["pos"].T / 1000).all()
        assert (demonstration.velocities == fields["vel"].T / 1000).all()
        assert (demonstration.times == fields["t"].ravel() - fields["t"][0, 0]).all()
    assert {source.importer for source in result.sources} == {"lasa"}
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
    with pytest.raises(InputDataError, match="has no times"):
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


# ------------------------------------------------------------------------------------- DAMM


@pytest.mark.parametrize("count", [1, 3])
def test_poses_of_damm_are_positions_by_their_own_clock(save_mat, cell, curve, count: int) -> None:
    motions = [curve(samples=20 + i, dimension=3, seed=i) for i in range(count)]
    clocks = [np.cumsum(np.random.default_rng(i).uniform(0.001, 0.003, 20 + i)) for i in range(count)]
    quaternion = np.array([[0.0], [0.0], [0.6], [0.8]])
    poses = [
        {
            "pose": np.vstack([motion.T, np.tile(quaternion, len(motion)), clock]),
            "dt": float(np.diff(clock).mean()),
            "origin": "panda_link0",
        }
        for motion, clock in zip(motions, clocks, strict=True)
    ]
    result = read_demonstrations(
        [save_mat({"bag_dir": "all", "data_ee_pose": cell(*poses)})], position_only=True
    )
    assert result.sources[0].importer == "damm"
    for demonstration, motion, clock in zip(result.demonstrations, motions, clocks, strict=True):
        assert (demonstration.positions == motion).all()
        assert (demonstration.times == clock - clock[0]).all()


def test_poses_of_another_shape_are_refused(save_mat, cell) -> None:
    path = save_mat({"data_ee_pose": cell({"pose": np.ones((8, 9))}, {"pose": np.ones((7, 9))})})
    with pytest.raises(InputDataError, match="demonstration 1: no matrix of poses") as error:
        read_demonstrations([path])
    assert "pose (8, T)" in error.value.hint
    with pytest.raises(InputDataError, match="not laid out as DAMM demonstrations"):
        read_demonstrations([save_mat({"data": np.eye(3)})], input_format="damm")
