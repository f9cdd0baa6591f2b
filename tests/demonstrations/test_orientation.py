"""Orientations: in the conventions of files, against SciPy; what is wrong with them; and their names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skillctl.arrays import FloatArray
from skillctl.demonstrations.orientation import LENGTHS, STILL
from skillctl.demonstrations.reader import read_demonstrations
from skillctl.errors import InputDataError, UsageError
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.pose import Pose

SAMPLES = 40
TIMES = np.linspace(0, 1.95, SAMPLES)
DONE = 10 * (t := TIMES / 1.95) ** 3 - 15 * t**4 + 6 * t**5
MOTION = np.array([0.35, -0.2, 0.27]) + np.outer(DONE, [0.2, 0.3, 0.18])
# A hand that points down, as most do: half a turn from the base's axes, where rotation vectors change sign.
END = Rotation.from_rotvec([3.1, 0.2, 0.1])
TURNED = END * Rotation.from_rotvec(np.outer(1 - DONE, [0.3, -0.9, 0.5]))
WRITTEN = 1e-8  # of numbers with nine decimals
CLOSE = 1e-14  # [rad]: of conversions in float64

Text = Callable[..., Any]


def table(header: str, *columns: FloatArray) -> str:
    rows = np.column_stack([TIMES, MOTION, *columns])
    return "\n".join([header, *(",".join(f"{value:.9f}" for value in row) for row in rows)]) + "\n"


def turned(demonstrations: DemonstrationSet) -> Rotation:
    """Return the orientations of the only demonstration."""
    (demonstration,) = demonstrations
    assert isinstance(demonstrations.space, Pose)
    assert np.abs(demonstration.positions[:, :3] - MOTION).max() <= WRITTEN
    return Rotation.from_rotvec(np.array(demonstration.positions[:, 3:]))


def apart(rotations: Rotation, others: Rotation = TURNED) -> float:
    return float((others.inv() * rotations).magnitude().max())


def homogeneous(rotations: Rotation = TURNED) -> FloatArray:
    matrices = np.tile(np.eye(4), (SAMPLES, 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = rotations.as_matrix(), MOTION
    return matrices


def numbered(count: int, stem: str = "actual_TCP_pose") -> str:
    return ",".join(f"{stem}_{i}" for i in range(count))


QUATERNIONS = TURNED.as_quat()
W_FIRST = QUATERNIONS[:, [3, 0, 1, 2]]
ANGLES = TURNED.as_euler("xyz")  # in SciPy small letters mean fixed axes
MATRICES = TURNED.as_matrix().reshape(SAMPLES, 9)
HEADERS = {  # the header, and the columns behind t, x, y and z
    "ROS": ("t,pose.position.x,pose.position.y,pose.position.z,"
            + ",".join(f"pose.orientation.{axis}" for axis in "xyzw"), QUATERNIONS),
    "PlotJuggler": ("__time,/ee/pose/position/x,/ee/pose/position/y,/ee/pose/position/z,"
                    + ",".join(f"/ee/pose/orientation/{axis}" for axis in "wxyz"), W_FIRST),
    "EuRoC": ("#timestamp [s],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []",
              W_FIRST),
    "plain": ("t,x,y,z,qx,qy,qz,qw", QUATERNIONS),
    "quat": ("t,ee_x,ee_y,ee_z,quat_w,quat_x,quat_y,quat_z", W_FIRST),
    "Unity": ("Time,PosX,PosY,PosZ,RotX,RotY,RotZ,RotW", QUATERNIONS),
    "Universal Robots": (f"time,{numbered(6)}", TURNED.as_rotvec()),
    "rotation vector": ("t,x,y,z,rx,ry,rz", TURNED.as_rotvec()),
    "roll, pitch, yaw": ("t,x,y,z,roll,pitch,yaw", ANGLES),
    "degrees": ("t,x,y,z,yaw (deg),pitch (deg),roll (deg)", np.rad2deg(ANGLES[:, ::-1])),
    "matrix": ("t,x,y,z," + ",".join(f"r{i}{k}" for i in "123" for k in "123"), MATRICES),
    "matrix from zero": ("t,x,y,z," + ",".join(f"R[{i}][{k}]" for i in "012" for k in "012"), MATRICES),
    "both": ("t,x,y,z,roll,pitch,yaw,qw,qx,qy,qz", np.hstack([0 * ANGLES, W_FIRST])),
    "beside other columns": ("t,x,y,z,grip,roll,pitch,yaw,wrench.force.x",
                             np.hstack([ANGLES[:, :1], ANGLES, ANGLES[:, :1]])),
    "two things": ("t,hand_x,hand_y,hand_z,hand_qx,hand_qy,hand_qz,hand_qw,head_qx,head_qy,head_qz,head_qw",
                   np.hstack([QUATERNIONS, 0 * QUATERNIONS + 0.5])),
}  # fmt: skip


@pytest.mark.parametrize("name", HEADERS)
def test_a_header_names_the_orientation(read_text: Text, name: str) -> None:
    result = read_text(table(HEADERS[name][0], HEADERS[name][1]))
    assert apart(turned(result.demonstrations)) <= 10 * WRITTEN
    assert result.demonstrations.space.names == ("x", "y", "z", "rx", "ry", "rz")
    assert result.notes[0].startswith("the orientation is ")
    assert result.notes[0].endswith("; --position-only leaves it aside.")


def test_libfranka_writes_transforms_column_by_column(read_text: Text) -> None:
    columns = homogeneous().transpose(0, 2, 1).reshape(SAMPLES, 16)
    header = "t," + ",".join(f"O_T_EE[{i}]" for i in range(16))
    rows = np.column_stack([TIMES, columns])
    text = "\n".join([header, *(",".join(f"{value:.9f}" for value in row) for row in rows)]) + "\n"
    assert apart(turned(read_text(text).demonstrations)) <= 10 * WRITTEN


DOUBTFUL = {
    "numbered": ("t,x,y,z,quat_0,quat_1,quat_2,quat_3", QUATERNIONS, "xyzw"),
    "numbered, w first": ("t,x,y,z,quat_0,quat_1,quat_2,quat_3", W_FIRST, "wxyz"),
    "a pose": (f"t,{numbered(7, 'tcp_pose')}", W_FIRST, "wxyz"),
    "degrees": ("t,x,y,z,rx [deg],ry [deg],rz [deg]", np.rad2deg(ANGLES), "rpy"),
    "Euler": ("t,x,y,z,euler_x,euler_y,euler_z", ANGLES, "rpy"),
    "matrix": ("t,x,y,z," + ",".join(f"rot_{i}" for i in range(9)), MATRICES, "matrix"),
}


@pytest.mark.parametrize("name", DOUBTFUL)
def test_a_convention_that_no_name_tells_is_asked_for(read_text: Text, name: str) -> None:
    header, columns, convention = DOUBTFUL[name]
    result = read_text(table(header, columns))
    assert result.demonstrations.dimension == 3
    (note, rest) = result.notes
    assert "is left aside, because its name does not tell its convention; --orientation " in note
    assert convention in note
    assert rest.startswith("the position is ")
    told = read_text(table(header, columns), orientation=convention)
    assert apart(turned(told.demonstrations)) <= 10 * WRITTEN


ARRAYS = {
    "xyzw": QUATERNIONS,
    "wxyz": W_FIRST,
    "rotvec": TURNED.as_rotvec(),
    "rotvec-deg": TURNED.as_rotvec(degrees=True),
    "rpy": ANGLES,
    "rpy-deg": np.rad2deg(ANGLES),
    "matrix": MATRICES,
}


@pytest.mark.parametrize("convention", ARRAYS)
@pytest.mark.parametrize("clock", [False, True])
def test_arrays_hold_the_orientation_behind_the_position(save_npy, convention: str, clock: bool) -> None:
    array = np.hstack([*([TIMES[:, None]] if clock else []), MOTION, ARRAYS[convention]])
    dt = None if clock else 0.05
    result = read_demonstrations([save_npy(array)], orientation=convention, dt=dt)
    assert apart(turned(result.demonstrations)) <= CLOSE


@pytest.mark.parametrize("by_column", [False, True])
@pytest.mark.parametrize("flat", [False, True])
def test_arrays_may_hold_homogeneous_matrices(save_npz, by_column: bool, flat: bool) -> None:
    matrices = homogeneous().transpose(0, 2, 1) if by_column else homogeneous()
    array = matrices.reshape(SAMPLES, 16) if flat else matrices
    path = save_npz(positions=array[None], dt=0.05)
    assert apart(turned(read_demonstrations([path], orientation="matrix").demonstrations)) <= CLOSE


@pytest.mark.parametrize("matrices", [False, True])
def test_archives_may_hold_orientations_in_an_array_of_their_own(save_npz, matrices: bool) -> None:
    turns = TURNED.as_matrix() if matrices else W_FIRST
    path = save_npz(positions=[MOTION], rotations=[turns], velocities=[0 * MOTION], times=TIMES, grip=TIMES)
    assert read_demonstrations([path]).demonstrations.dimension == 3
    result = read_demonstrations([path], orientation="matrix" if matrices else "wxyz")
    assert apart(turned(result.demonstrations)) <= CLOSE
    assert result.notes[1] == "left aside: grip; use --columns to choose others."


def test_given_velocities_of_the_position_are_kept(save_npz) -> None:
    pose = np.hstack([MOTION, QUATERNIONS])
    path = save_npz(positions=pose, velocities=0 * pose + 0.25, times=TIMES)
    (demonstration,) = read_demonstrations([path], orientation="xyzw").demonstrations
    assert (demonstration.velocities[:, :3] == 0.25).all()
    step = (TURNED[2] * TURNED[0].inv()).as_rotvec() / (TIMES[2] - TIMES[0])
    assert np.abs(demonstration.velocities[1, 3:] - step).max() <= CLOSE / (TIMES[2] - TIMES[0])


def test_both_signs_of_a_quaternion_are_one_orientation(read_text: Text) -> None:
    signs = np.where(np.arange(SAMPLES) % 3, 1.0, -1.0)[:, None]
    result = read_text(table("t,x,y,z,qx,qy,qz,qw", signs * QUATERNIONS))
    assert apart(turned(result.demonstrations)) <= 10 * WRITTEN
    assert (len(result.notes), result.faults) == (1, ())
    (demonstration,) = result.demonstrations
    steps = np.linalg.norm(np.diff(demonstration.positions[:, 3:], axis=0), axis=1)
    assert steps.max() < 1  # [rad]; a change of sign would be a jump by about a turn


def test_columns_are_renamed_to_an_orientation(read_text: Text) -> None:
    text = table("t,a,b,c,d,e,f,g", QUATERNIONS)
    columns = ["x=a", "y=b", "z=c", "qx=d", "qy=e", "qz=f", "qw=g"]
    assert apart(turned(read_text(text, columns=columns).demonstrations)) <= 10 * WRITTEN
    assert read_text(text, columns=columns[:3]).demonstrations.space.names == ("x", "y", "z")


def test_of_a_thing_that_is_chosen_the_orientation_is_read_too(read_text: Text) -> None:
    header, columns = HEADERS["two things"]
    text = table(header, columns)
    assert apart(turned(read_text(text, columns=["hand"]).demonstrations)) <= 10 * WRITTEN
    one_by_one = read_text(text, columns=["hand_x", "hand_y", "hand_z"])
    assert one_by_one.demonstrations.dimension == 3


@pytest.mark.parametrize(
    "header", ["t,x,y,z,roll,pitch,yaw", "t,hand_x,hand_y,hand_z,head_rx,head_ry,head_rz", "t,x,y,z,qx,qy,qz"]
)
def test_of_positions_only_the_note_says_what_is_left(read_text: Text, header: str) -> None:
    only = header.startswith("t,x,y,z,roll")
    result = read_text(table(header, ANGLES), position_only=only)
    left = ", ".join(header.split(",")[4:])
    assert result.demonstrations.dimension == 3 or not only
    if only or "head" in header:
        assert f"left aside: {left}; use --columns" in result.notes[0]


def test_an_orientation_that_is_none_everywhere_was_not_measured(read_text: Text, write) -> None:
    nothing = np.tile([0.0, 0, 0, 1], (SAMPLES, 1))
    text = table("t,x,y,z,qx,qy,qz,qw", nothing)
    assert read_text(text).demonstrations.dimension == 3
    assert apart(turned(read_text(text, orientation="xyzw").demonstrations), Rotation.identity(SAMPLES)) == 0
    paths = [write(text, "a.csv"), write(table("t,x,y,z,qx,qy,qz,qw", QUATERNIONS), "b.csv")]
    assert read_demonstrations(paths).demonstrations.dimension == 6


@pytest.mark.parametrize(("angle", "still"), [(0.0, True), (0.9 * STILL, True), (1.1 * STILL, False)])
def test_a_still_orientation_is_kept(read_text: Text, angle: float, still: bool) -> None:
    rotations = END * Rotation.from_rotvec(np.outer(1 - DONE, [0, angle, 0]))
    result = read_text(table("t,x,y,z,qx,qy,qz,qw", rotations.as_quat()))
    assert apart(turned(result.demonstrations), rotations) <= 10 * WRITTEN
    assert result.demonstrations.space == Pose(length=LENGTHS[1])
    assert ("the orientation does not change; the skill keeps it." in result.notes) == still


def test_a_row_is_repeated_only_if_its_orientation_is_too(read_text: Text) -> None:
    header, *rows = table("t,x,y,z,qx,qy,qz,qw", QUATERNIONS).splitlines()
    result = read_text("\n".join([header, *rows[:5], rows[4], *rows[5:]]))
    assert "1 repeated rows were dropped" in result.notes[-1]
    other = ",".join([*rows[4].split(",")[:4], "0,0,0,1"])
    with pytest.raises(InputDataError, match=r"line 7: time stamp 0\.2 s repeats the one before"):
        read_text("\n".join([header, *rows[:5], other, *rows[5:]]))


def test_the_characteristic_length_is_the_ratio_of_the_spreads(write) -> None:
    # A hand that moves straight by 0.2 m while it turns by 0.8 rad about one axis has 0.25 m/rad everywhere.
    paths: list[Path] = []
    for way in (t, DONE):
        rows = np.column_stack([TIMES, np.outer(1 - way, [0.2, 0, 0, 0, 0, 0.8])])
        lines = [",".join(map(repr, row)) for row in rows.tolist()]
        paths.append(write("\n".join(["t,x,y,z,rx,ry,rz", *lines]), f"{len(paths)}.csv"))
    space = read_demonstrations(paths).demonstrations.space
    assert isinstance(space, Pose)
    assert abs(space.length - 0.25) <= CLOSE


# ------------------------------------------------------------------------------------------- data sets


def test_quaternions_of_robomimic_are_x_y_z_w(save_robomimic) -> None:
    path = save_robomimic(
        [MOTION], robot0_eef_quat=lambda _: QUATERNIONS, robot0_eef_quat_site=lambda _: W_FIRST
    )
    for columns in (None, ["robot0_eef_pos"]):
        result = read_demonstrations([path], columns=columns)
        assert apart(turned(result.demonstrations)) <= CLOSE
    result = read_demonstrations([path])
    assert result.notes[0].startswith("the orientation is robot0_eef_quat: a quaternion x, y, z, w; ")
    assert "left aside: robot0_eef_quat_site; use --columns" in result.notes[1]
    assert read_demonstrations([path], position_only=True).demonstrations.dimension == 3
    one_by_one = [f"robot0_eef_pos_{i}" for i in range(3)]
    assert read_demonstrations([path], columns=one_by_one).demonstrations.dimension == 3
    named = [*one_by_one, *(f"robot0_eef_quat_{axis}" for axis in "xyzw")]
    assert apart(turned(read_demonstrations([path], columns=named).demonstrations)) <= CLOSE


def test_poses_of_maniskill_are_w_x_y_z(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "trajectory.h5", "w") as file:
        file["traj_0/obs/extra/tcp_pose"] = np.hstack([MOTION, W_FIRST])
        file["traj_0/obs/agent/qpos"] = np.zeros((SAMPLES, 9))
    result = read_demonstrations([tmp_path / "trajectory.h5"], dt=0.05)
    assert apart(turned(result.demonstrations)) <= CLOSE


def test_poses_of_damm_are_x_y_z_w(save_mat, cell) -> None:
    pose = np.vstack([MOTION.T, QUATERNIONS.T, TIMES])
    path = save_mat({"data_ee_pose": cell({"pose": pose}, {"pose": pose})})
    assert apart(turned(read_demonstrations([path], demos=[1]).demonstrations)) <= CLOSE


def test_tum_trajectories_are_poses(write) -> None:
    rows = np.column_stack([TIMES, MOTION, QUATERNIONS])
    text = "".join(" ".join(f"{value:.9f}" for value in row) + "\n" for row in rows)
    result = read_demonstrations([write(text, "groundtruth.txt")])
    assert result.sources[0].importer == "tum"
    assert apart(turned(result.demonstrations)) <= 10 * WRITTEN


def test_reversed_poses_turn_back_to_where_they_began(read_text) -> None:
    result = read_text(table("t,x,y,z,qx,qy,qz,qw", QUATERNIONS), reverse=True)
    (demonstration,) = result.demonstrations
    assert np.abs(demonstration.positions[:, :3] - MOTION[::-1]).max() <= WRITTEN
    found = Rotation.from_rotvec(np.array(demonstration.positions[:, 3:]))
    assert apart(found, TURNED[::-1]) <= 10 * WRITTEN
    ahead = (TURNED[::-1][1:] * TURNED[::-1][:-1].inv()).as_rotvec() / np.diff(TIMES)[:, None]
    between = 0.5 * (ahead[1:] + ahead[:-1])  # of turns about nearly one axis, the central difference
    assert np.abs(demonstration.velocities[1:-1, 3:] - between).max() <= 1e-3 * np.abs(between).max()


# -------------------------------------------------------------------------------------------- refusals


def changed(columns: FloatArray, sample: int, values: Sequence[float] | FloatArray) -> FloatArray:
    changed = columns.copy()
    changed[sample] = values
    return changed


LINE = 12  # of sample 10, behind the header
MIRROR = (TURNED[10].as_matrix() @ np.diag([1, 1, -1])).ravel()


@pytest.mark.parametrize(
    ("header", "columns", "words"),
    [
        (
            "qx,qy,qz,qw",
            changed(QUATERNIONS, 10, [0, 0, 0, 0]),
            "its orientation is all zeros, which is none",
        ),
        ("qx,qy,qz,qw", changed(QUATERNIONS, 10, 1.06 * QUATERNIONS[10]), "not of length one, by 6%"),
        ("qx,qy,qz,qw", changed(QUATERNIONS, 10, [np.nan, 0, 0, 1]), "its orientation is not finite"),
        (HEADERS["matrix"][0][8:], changed(MATRICES, 10, MIRROR), "it mirrors (its determinant is -1)"),
        (HEADERS["matrix"][0][8:], changed(MATRICES, 10, 1.1 * MATRICES[10]), "not orthonormal, by 21%"),
        ("roll,pitch,yaw", changed(ANGLES, 10, [0, 0, 179]), "has angles up to 179; are they degrees?"),
        ("rx,ry,rz", changed(ANGLES, 10, [0, 90, 0]), "has angles up to 90; are they degrees?"),
    ],
)
def test_what_is_no_orientation_is_refused_by_line(read_text: Text, header, columns, words) -> None:
    with pytest.raises(InputDataError) as error:
        read_text(table(f"t,x,y,z,{header}", columns))
    assert f"reach.csv, line {LINE}: " in str(error.value)
    assert words in str(error.value)
    hint = "--orientation r" if "degrees" in words else "--position-only"
    assert hint in error.value.hint
    assert read_text(table(f"t,x,y,z,{header}", columns), position_only=True).demonstrations.dimension == 3


@pytest.mark.parametrize("factor", [1.011, 0.96])
def test_quaternions_of_about_length_one_are_corrected_with_a_note(read_text: Text, factor: float) -> None:
    result = read_text(table("t,x,y,z,qx,qy,qz,qw", factor * QUATERNIONS))
    assert apart(turned(result.demonstrations)) <= 10 * WRITTEN
    assert f"not of length one, by {abs(factor - 1):.1%}; they are corrected." in result.notes[-1]


def test_rounded_matrices_become_the_nearest_rotations(read_text: Text) -> None:
    result = read_text(table(HEADERS["matrix"][0], np.round(MATRICES, 3)))
    # The nearest rotation to a matrix is that of its polar decomposition, by singular values.
    u, _, v = np.linalg.svd(np.round(TURNED.as_matrix(), 3))
    assert (
        apart(turned(result.demonstrations), Rotation.from_matrix(u @ v)) <= 1e-6
    )  # they agree to second order
    assert len(result.notes) == 1


@pytest.mark.parametrize(("angle", "fits"), [(3.1, True), (3.2, False), (9.0, False)])
@pytest.mark.parametrize("axis", [[0, 0, 1], [0.6, 0, 0.8]])
def test_a_hand_that_turns_by_half_a_turn_or_more_is_refused(read_text: Text, angle, fits, axis) -> None:
    rotations = END * Rotation.from_rotvec(np.outer(angle * (1 - DONE), axis))
    text = table("t,x,y,z,qx,qy,qz,qw", rotations.as_quat())
    if fits:
        assert apart(turned(read_text(text).demonstrations), rotations) <= 10 * WRITTEN
        return
    with pytest.raises(
        InputDataError, match=f"line 2 its orientation is {np.rad2deg(angle):.0f}° from its end"
    ):
        read_text(text)


def test_the_option_has_to_fit_the_file(read_text: Text, save_npy) -> None:
    text = table("t,x,y,z,qx,qy,qz,qw", QUATERNIONS)
    with pytest.raises(InputDataError, match="no orientation rpy is found beside the position"):
        read_text(text, orientation="rpy")
    assert (
        apart(turned(read_text(text, orientation="wxyz").demonstrations)) <= 10 * WRITTEN
    )  # names are certain
    with pytest.raises(InputDataError, match="6 columns, where a position and an orientation wxyz are 7"):
        read_demonstrations([save_npy(np.hstack([MOTION, ANGLES]))], orientation="wxyz", dt=0.05)
    with pytest.raises(UsageError, match="exclude each other"):
        read_text(text, orientation="xyzw", position_only=True)
    with pytest.raises(UsageError, match="zyx is none of xyzw, wxyz, rotvec"):
        read_text(text, orientation="zyx")


def test_files_with_an_orientation_and_without_make_no_skill_together(write) -> None:
    paths = [write(table("t,x,y,z,qx,qy,qz,qw", QUATERNIONS), "a.csv"), write(table("t,x,y,z"), "b.csv")]
    with pytest.raises(InputDataError, match=r"b\.csv: it has no orientation that is read, but .*a\.csv has"):
        read_demonstrations(paths)
    assert read_demonstrations(paths, position_only=True).demonstrations.dimension == 3


# --------------------------------------------------------------------------------------------- judgement


def test_wild_orientations_are_left_out_with_a_warning(read_text: Text) -> None:
    wild = (Rotation.from_rotvec([0, 0, 1.5]) * TURNED[10]).as_quat()
    result = read_text(table("t,x,y,z,qx,qy,qz,qw", changed(QUATERNIONS, 10, wild)))
    (fault,) = result.faults
    assert (fault.kind, fault.refused) == ("dropouts", False)
    assert fault.sentence.startswith("reach.csv, orientation: 1 sample jumps aside, up to 8")
    assert f"at line {LINE}, left out." in fault.sentence
    (demonstration,) = result.demonstrations
    assert demonstration.times.tolist() == np.delete(np.round(TIMES, 9), 10).tolist()


@pytest.mark.parametrize(("angle", "refused"), [(0.3, False), (1.0, True)])
def test_an_orientation_that_jumps_for_good_is_told(read_text: Text, angle: float, refused: bool) -> None:
    slow = END * Rotation.from_rotvec(np.outer(1 - DONE, [0.1, -0.4, 0.2]))
    jumped = Rotation.concatenate([slow[:8], Rotation.from_rotvec([0, 0, angle]) * slow[8:]])
    result = read_text(table("t,x,y,z,qx,qy,qz,qw", jumped.as_quat()))
    (fault,) = result.faults
    assert (fault.kind, fault.refused) == ("jumps", refused)
    assert "orientation: it jumps by " in fault.sentence
    assert "at line 10" in fault.sentence


def test_shaking_orientations_are_no_faults(read_text: Text) -> None:
    shaking = TURNED * Rotation.from_rotvec(np.random.default_rng(0).normal(0, STILL, (SAMPLES, 3)))
    assert read_text(table("t,x,y,z,qx,qy,qz,qw", shaking.as_quat())).faults == ()


@pytest.mark.parametrize(("angle", "refused"), [(15, None), (30, False), (70, True)])
def test_ends_that_are_turned_apart_are_told(write, angle: float, refused: bool | None) -> None:
    other = Rotation.from_rotvec([0, np.deg2rad(angle), 0]) * TURNED
    quaternions = [QUATERNIONS, QUATERNIONS, other.as_quat()]
    paths = [write(table("t,x,y,z,qx,qy,qz,qw", q), f"{i}.csv") for i, q in enumerate(quaternions)]
    faults = [(fault.kind, fault.refused, fault.demo) for fault in read_demonstrations(paths).faults]
    assert faults == ([] if refused is None else [("ends", refused, 2)])


def test_a_hand_that_turns_the_other_way_is_told(write) -> None:
    ways = [TURNED, TURNED, END * Rotation.from_rotvec(np.outer(1 - DONE, [-0.6, 1.8, -1.0]))]
    paths = [write(table("t,x,y,z,qx,qy,qz,qw", r.as_quat()), f"{i}.csv") for i, r in enumerate(ways)]
    (fault,) = read_demonstrations(paths).faults
    assert (fault.kind, fault.refused, fault.demo) == ("directions", True, 2)
    assert fault.sentence.startswith("2.csv: it turns another way to its end than the others, on average 91°")
