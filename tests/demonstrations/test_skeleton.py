"""Skeleton tables: many joints, of which the user names the one that moves."""

from __future__ import annotations

import numpy as np
import pytest

from skillctl.demonstrations.reader import read_demonstrations
from skillctl.errors import InputDataError, UsageError

JOINTS = ["SpineBase", "Neck", "ElbowRight", "HandRight", "HandLeft"]
HAND = JOINTS.index("HandRight")
EPS = np.finfo(np.float64).eps


@pytest.fixture
def motion() -> np.ndarray:
    """Positions of five joints, (samples, joint, axis)."""
    t = np.linspace(0, 1, 30)[:, None, None]
    return np.random.default_rng(0).uniform(-0.2, 0.2, size=(1, len(JOINTS), 3)) * (1 + t)


def kinect(motion: np.ndarray, column: str = "{joint}_{axis}", axes: str = "XYZ", state: bool = True) -> str:
    """A table as recorders for depth cameras write it: every joint with its tracking state."""
    header, rows = ["Timestamp"], []
    for joint in JOINTS:
        header += [column.format(joint=joint, axis=axis) for axis in axes] + [f"{joint}_State"] * state
    for sample, joints in enumerate(motion.tolist()):
        cells = [f"{sample / 30!r}"]
        for position in joints:
            cells += [repr(value) for value in position[: len(axes)]] + ["Tracked"] * state
        rows.append(",".join(cells))
    return "\n".join([",".join(header), *rows])


@pytest.mark.parametrize(
    "column",
    [
        "{joint}_{axis}",
        "{joint}.{axis}",
        "{joint}{axis}",
        "{joint} {axis}",
        "{joint}:{axis}",
        "{joint}-{axis}",
    ],
)
@pytest.mark.parametrize("axes", ["XYZ", "xyz"])
def test_a_joint_stands_for_its_columns(read_text, motion, column: str, axes: str) -> None:
    result = read_text(kinect(motion, column, axes), columns=["HandRight"])
    (demonstration,) = result.demonstrations
    assert (demonstration.positions == motion[:, HAND]).all()
    assert np.allclose(demonstration.times, np.arange(30) / 30, rtol=2 * EPS, atol=0)
    assert result.demonstrations.space.names == ("x", "y", "z")
    assert result.notes == ()


def test_two_hands_make_six_dimensions_that_keep_their_names(read_text, motion) -> None:
    result = read_text(kinect(motion, "{joint}.{axis}", "xyz"), columns=["HandLeft", "HandRight"])
    names = result.demonstrations.space.names
    assert names == ("HandLeft.x", "HandLeft.y", "HandLeft.z", "HandRight.x", "HandRight.y", "HandRight.z")
    positions = result.demonstrations.demonstrations[0].positions
    assert (positions == np.hstack([motion[:, HAND + 1], motion[:, HAND]])).all()


def test_joints_in_the_plane_of_a_picture_are_joints_too(read_text, motion) -> None:
    result = read_text(kinect(motion, axes="XY"), columns=["HandRight"])
    assert result.demonstrations.space.names == ("x", "y")
    assert (result.demonstrations.demonstrations[0].positions == motion[:, HAND, :2]).all()


def test_columns_of_a_joint_can_still_be_named_one_by_one(read_text, motion) -> None:
    result = read_text(kinect(motion), columns=["HandRight_Z", "HandRight_X"])
    assert result.demonstrations.space.names == ("HandRight_Z", "HandRight_X")
    assert (result.demonstrations.demonstrations[0].positions == motion[:, HAND, [2, 0]]).all()


def test_a_column_wins_over_a_joint_of_the_same_name(read_text) -> None:
    text = "t,hand,hand_x,hand_y\n0,1,2,3\n1,4,5,6\n"
    assert read_text(text, columns=["hand"]).demonstrations.demonstrations[0].positions.tolist() == [[1], [4]]


def test_without_a_choice_the_joints_are_listed(read_text, motion) -> None:
    with pytest.raises(
        InputDataError, match=r"reach\.csv: 15 columns could be positions; which are\?"
    ) as error:
        read_text(kinect(motion))
    assert error.value.hint == (
        "Choose with --columns, as in --columns SpineBase. "
        "The joints are: SpineBase, Neck, ElbowRight, HandRight, HandLeft."
    )


def test_without_joints_the_columns_are_listed(read_text) -> None:
    names = [f"s{i}" for i in range(8)]
    rows = [",".join(map(str, [t, *range(t, t + 8)])) for t in range(3)]
    with pytest.raises(InputDataError, match="8 columns could be positions") as error:
        read_text("\n".join([",".join(["t", *names]), *rows]))
    assert error.value.hint.endswith(f"The columns are: {', '.join(names)}.")
    seven = read_text("\n".join([",".join(["t", *names[1:]]), *(row.partition(",")[2] for row in rows)]))
    assert seven.demonstrations.dimension == 7  # the joints of an arm


def test_a_wrong_joint_is_answered_with_the_nearest(read_text, motion) -> None:
    with pytest.raises(InputDataError, match="no column 'HandRigth'; did you mean 'HandRight'"):
        read_text(kinect(motion), columns=["HandRigth"])
    with pytest.raises(UsageError, match="each once"):
        read_text(kinect(motion), columns=["HandRight", "HandRight_X"])


def test_a_cell_of_the_joint_that_is_empty_is_found_and_others_do_not_matter(read_text, motion) -> None:
    lines = kinect(motion).splitlines()
    cells = lines[9].split(",")
    neck, hand = 1 + 4 * JOINTS.index("Neck"), 1 + 4 * HAND
    cells[neck] = ""
    lines[9] = ",".join(cells)
    assert len(read_text("\n".join(lines), columns=["HandRight"]).demonstrations) == 1
    cells[hand] = ""
    lines[9] = ",".join(cells)
    with pytest.raises(InputDataError, match=r"line 10, column 'HandRight_X': an empty cell"):
        read_text("\n".join(lines), columns=["HandRight"])


def test_names_of_joints_are_safe_to_print(write) -> None:
    names = [f"\x1b[{i}m_{axis}" for i in range(4) for axis in "xyz"]
    text = "\n".join(
        [",".join(["t", *names]), ",".join(map(str, range(13))), ",".join(map(str, range(1, 14)))]
    )
    with pytest.raises(InputDataError) as error:
        read_demonstrations([write(text)])
    assert error.value.hint.isprintable()
    assert r"--columns \x1b[0m." in error.value.hint
