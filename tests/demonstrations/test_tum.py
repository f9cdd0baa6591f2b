"""TUM trajectories: what they look like, and what only resembles them."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from skillctl.demonstrations.reader import ReadResult, read_demonstrations
from skillctl.errors import InputDataError

# As the benchmark's own files are: comments, seconds since 1970, four decimals.
COMMENTS = "# ground truth trajectory\n# file: 'desk.bag'\n# timestamp tx ty tz qx qy qz qw\n"
ROWS = (
    "1305031098.6659 1.3563 0.6305 1.6380 0.6132 0.5962 -0.3311 -0.3986\n"
    "1305031098.6758 1.3543 0.6306 1.6360 0.6129 0.5966 -0.3316 -0.3980\n"
    "1305031098.6858 1.3525 0.6307 1.6337 0.6128 0.5969 -0.3319 -0.3972\n"
)
POSITIONS = [[1.3563, 0.6305, 1.6380], [1.3543, 0.6306, 1.6360], [1.3525, 0.6307, 1.6337]]


@pytest.fixture
def read(write) -> Callable[..., ReadResult]:
    return lambda text, **options: read_demonstrations([write(text, "groundtruth.txt")], **options)


@pytest.mark.parametrize(
    "text",
    [
        COMMENTS + ROWS,
        ROWS,
        "\n" + ROWS.replace("\n", "\r\n"),
        ROWS.replace(" ", "   "),
        ROWS.replace(" ", "\t"),
        COMMENTS + ROWS + "# end\n\n",
        "timestamp tx ty tz qx qy qz qw\n" + ROWS,
        "#timestamp x y z qx qy qz qw\n" + ROWS,
        "# timestamp [s] and pose\n" + ROWS,
    ],
)
def test_positions_are_read_and_orientations_left_aside_if_asked(read, text: str) -> None:
    result = read(text, position_only=True)
    (demonstration,) = result.demonstrations
    assert demonstration.positions.tolist() == POSITIONS
    assert demonstration.times.tolist() == [
        0,
        1305031098.6758 - 1305031098.6659,
        1305031098.6858 - 1305031098.6659,
    ]
    assert result.sources[0].importer == "tum"
    assert result.demonstrations.space.names == ("x", "y", "z")
    assert (
        result.notes[0]
        == "the position is x, y, z; left aside: qx, qy, qz, qw; use --columns to choose others."
    )


def test_columns_choose_axes(read) -> None:
    assert read(ROWS, columns=["z", "x"]).demonstrations.space.names == ("z", "x")
    with pytest.raises(InputDataError, match="no column 'tx'") as error:
        read(ROWS, columns=["tx"])
    assert error.value.hint == "The columns are: timestamp, x, y, z, qx, qy, qz, qw."


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (ROWS + "1305031099 1 2 3\n", "line 4: 4 cells, but there are 8 columns."),
        (COMMENTS + ROWS + "1305031099 1 oops 3 0 0 0 1\n", "line 7, column 'y': 'oops' is not a number."),
        (ROWS + "1305031099 1 nan 3 0 0 0 1\n", "line 4, column 'y': nan is not a position."),
        (
            COMMENTS + ROWS + "1305031090 1 2 3 0 0 0 1\n",
            "line 7: time stamp 1305031090 s follows 1305031098.6858 s",
        ),
        (COMMENTS, "a table without rows."),
        ("timestamp tx ty tz qx qy qz qw\n", "a header but no rows."),
    ],
)
def test_bad_rows_are_refused_by_line(read, text: str, words: str) -> None:
    with pytest.raises(InputDataError) as error:
        read(text)
    assert words in str(error.value)


@pytest.mark.parametrize(
    "text",
    [
        "# t q1 q2 q3 q4 q5 q6 q7\n0 0 0 0 0 0 0 1\n1 0 0 0 1 0 0 0\n",  # an arm; its header counts
        "t a b c\n0 1 2 3\n1 3 4 5\n",
        "t,x,y,z,qx,qy,qz,qw\n0,1,2,3,0,0,0,1\n1,3,4,5,0,0,0,1\n",
    ],
)
def test_tables_stay_tables(read, text: str) -> None:
    assert read(text).sources[0].importer == "csv"


def test_eight_numbers_without_an_orientation_are_no_trajectory(read) -> None:
    text = "0 0 0 0 1 1 1 1\n1 0 0 1 1 1 1 1\n"
    with pytest.raises(InputDataError, match="line 1: numbers where the names of the columns should be"):
        read(text)
    (demonstration,) = read(text, input_format="tum", position_only=True).demonstrations
    assert demonstration.positions.tolist() == [[0, 0, 0], [0, 0, 1]]
