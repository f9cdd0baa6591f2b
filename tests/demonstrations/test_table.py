"""Tables: what a header may look like, and what is refused by line and column."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from skillctl.demonstrations.reader import read_demonstrations
from skillctl.errors import InputDataError, UsageError

ROWS = [[0.0, 1.0, 2.0], [0.1, 1.5, 2.5], [0.2, 2.0, 2.25]]
PLAIN = "t,x,y\n0,1,2\n0.1,1.5,2.5\n0.2,2,2.25\n"


def only(result):
    (demonstration,) = result.demonstrations
    return demonstration


@pytest.mark.parametrize(
    "text",
    [
        PLAIN,
        "\ufeff" + PLAIN,
        PLAIN.encode("utf-16"),
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace("\n", "\r"),
        PLAIN.replace(",", ";"),
        PLAIN.replace(",", ";").replace(".", ","),
        PLAIN.replace(",", "\t"),
        PLAIN.replace(",", " "),
        PLAIN.replace(",", "   "),
        PLAIN.replace(",", " , "),
        PLAIN.replace("t,x,y", "Time,X,Y"),
        PLAIN.replace("t,x,y", "time [s],x,y"),
        PLAIN.replace("t,x,y", "# t,x,y"),
        PLAIN.replace("t,x,y", "t_s,x,y"),
        "t_ms,x,y\n0,1,2\n100,1.5,2.5\n200,2,2.25\n",
        "Timestamp [us],x,y\n0,1,2\n100000,1.5,2.5\n200000,2,2.25\n",
        "time(ns),x,y\n0,1,2\n100000000,1.5,2.5\n200000000,2,2.25\n",
        "# a comment\n\n" + PLAIN.replace("\n0.1", "\n# pause\n\n0.1") + "\n\n",
        '"t","x","y"\n"0","1","2"\n"0.1","1.5","2.5"\n"0.2","2","2.25"\n',
        "y,t,x\n2,0,1\n2.5,0.1,1.5\n2.25,0.2,2\n",
        ",t,x,y\n0,0,1,2\n1,0.1,1.5,2.5\n2,0.2,2,2.25\n",
        PLAIN.rstrip("\n"),
    ],
    ids=[
        "plain", "bom", "utf-16", "crlf", "cr",
        "semicolons", "decimal-commas", "tabs", "spaces", "runs-of-spaces",
        "padded", "capitals", "unit-of-time", "header-in-comment", "seconds",
        "milliseconds", "microseconds", "nanoseconds", "comments-and-blanks", "quoted",
        "any-order", "index-column", "no-final-newline",
    ],
)  # fmt: skip
def test_the_same_numbers_are_read_from_every_dialect(read_text, text: str | bytes) -> None:
    result = read_text(text)
    demonstration = only(result)
    assert np.column_stack([demonstration.times, demonstration.positions]).tolist() == ROWS
    assert (result.demonstrations.space.names, result.demonstrations.space.unit) == (("x", "y"), "m")
    assert (result.sources[0].importer, result.notes) == ("csv", ())


def test_velocities_are_central_differences(read_text) -> None:
    velocities = only(read_text("t,x,y\n0,0,0\n0.5,1,0\n1,4,2\n")).velocities
    assert velocities.tolist() == [[2, 0], [4, 2], [6, 4]]


def test_columns_choose_and_order_the_positions(read_text) -> None:
    text = "t,a,b,label,c\n0,1,2,open,3\n1,4,5,shut,6\n"
    result = read_text(text, columns=["c", "a"])
    assert only(result).positions.tolist() == [[3, 1], [6, 4]]
    assert result.demonstrations.space.names == ("c", "a")
    assert result.notes == ()


def test_of_a_pose_only_the_position_is_used_and_the_rest_is_reported(read_text) -> None:
    result = read_text("t,qx,z,y,x,grip\n0,9,3,2,1,open\n1,9,6,5,4,shut\n")
    assert only(result).positions.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert result.notes == ("the position is x, y, z; left aside: qx, grip; use --columns to choose others.",)


def test_without_x_and_y_every_column_counts(read_text) -> None:
    assert read_text("t,a,b\n0,1,2\n1,3,4\n").demonstrations.space.names == ("a", "b")
    assert only(read_text("t,x\n0,1\n1,3\n")).positions.tolist() == [[1], [3]]


def test_a_demo_column_tells_demonstrations_apart(read_text) -> None:
    result = read_text("demo,t,x\nb,0,1\nb,1,2\na,5,3\na,6,4\nb,2,9\n")
    assert [d.positions.ravel().tolist() for d in result.demonstrations] == [[1, 2, 9], [3, 4]]
    assert [d.times.tolist() for d in result.demonstrations] == [[0, 1, 2], [0, 1]]
    assert [d.source for d in result.demonstrations] == ["reach.csv, demo b", "reach.csv, demo a"]


def test_demonstrations_recorded_in_turns_keep_their_order(read_text) -> None:
    rows = [f"{i % 2},{i},{i}" for i in range(2_000)]
    for i, demonstration in enumerate(read_text("\n".join(["demo,t,x", *rows])).demonstrations):
        assert demonstration.positions.ravel().tolist() == list(range(i, 2_000, 2))


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
def test_a_demo_column_means_the_same_in_every_block(read_text, separator: str) -> None:
    n = 9_000  # more than one block; a comment makes the second be read with care
    lines = [f"take-{i // 3_000} {i % 3_000} {i}" for i in range(n)]
    text = "\n".join(["demo t x", *lines[:8_500], "# pause", *lines[8_500:]]).replace(" ", separator)
    result = read_text(text.replace(f"#{separator}", "# "), scale=1e-4)
    assert [d.source for d in result.demonstrations] == [f"reach.csv, demo take-{i}" for i in range(3)]
    assert [len(d.times) for d in result.demonstrations] == [3_000] * 3


def test_a_row_that_is_commented_out_stays_out(read_text) -> None:
    assert only(read_text("demo,t,x\n0,0,1\n#0,1,2\n0,2,3\n")).positions.ravel().tolist() == [1, 3]


@pytest.mark.parametrize("first", ["0,1,2,open", "0,1,2,9"])
@pytest.mark.parametrize("second", ["1,2,3", "1,2,3,4,5"])
def test_ragged_rows_are_found_beside_columns_that_are_not_read(read_text, first: str, second: str) -> None:
    with pytest.raises(InputDataError, match=r"line 3: [35] cells, but there are 4 columns"):
        read_text(f"t,x,y,grip\n{first}\n{second}\n")


def test_a_sheet_exported_as_tsv_is_read(read_text) -> None:
    """As spreadsheets write it: quoted names, CRLF, an empty last column, and a comma in a quoted note."""
    text = '"time [s]"\t"x"\t"y"\t"note"\t\r\n0\t1\t2\t"start, left"\t\r\n0.5\t2\t3\t""\t\r\n'
    result = read_text(text)
    assert only(result).positions.tolist() == [[1, 2], [2, 3]]
    assert result.notes == ("the position is x, y; left aside: note; use --columns to choose others.",)


def test_a_sheet_exported_with_decimal_commas_is_read(read_text) -> None:
    text = "t;x;y;grip\r\n0,0;1,5;-2,25e-1;auf\r\n0,5;2,5;3;zu\r\n"
    assert only(read_text(text)).positions.tolist() == [[1.5, -0.225], [2.5, 3]]


def test_without_time_the_period_is_asked_for(read_text) -> None:
    text = "x,y\n0,0\n1,1\n3,3\n"
    assert only(read_text(text, dt=0.5)).times.tolist() == [0, 0.5, 1]
    with pytest.raises(InputDataError, match="has no times") as refusal:
        read_text(text)
    assert "--dt" in refusal.value.hint


def test_a_time_column_wins_over_a_period(read_text) -> None:
    result = read_text(PLAIN, dt=7.0)
    assert only(result).times.tolist() == [0, 0.1, 0.2]
    assert result.notes == ("--dt is not used for files that contain times.",)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t,x,y\n0,1,2\n1,oops,3\n", "reach.csv, line 3, column 'x': 'oops' is not a number."),
        ("t,x,y\n0,1,2\n\n# pause\n1,2,\n", "reach.csv, line 5, column 'y': an empty cell."),
        ("t,x,y\nzero,1,2\n1,1,3\n", "reach.csv, line 2, column 't': 'zero' is not a number."),
        ("t,x,y\n0,1,2\n1,\x1b[2J,3\n", r"line 3, column 'x': '\x1b[2J' is not a number."),
        ("t,x,y\n0,1,2\n1,1,3,4\n", "reach.csv, line 3: 4 cells, but there are 3 columns."),
        ("t,x,y\n0,1,2\n1,1.5,2.5\n2,2", "reach.csv, line 4: 2 cells, but there are 3 columns."),
        ("# t,x\n0,1\n1,oops\n", "reach.csv, line 3, column 'x': 'oops' is not a number."),
        ("t,x,y\n0,1,2\n1,nan,3\n", "reach.csv, line 3, column 'x': nan is not a position."),
        ("t,x,y\n0,1,2\n1,1,-inf\n", "reach.csv, line 3, column 'y': -inf is not a position."),
        ("t,x,y\n0,1,2\n1,1,1e300\n", "reach.csv, line 3, column 'y': 1e+300 is not a position."),
        ("t,x,y\n0,1,2\nnan,1,3\n", "reach.csv, line 3: its time is not finite."),
        ("t,x\n0,1\n1,2\n\n1,3\n", "line 5: time stamp 1 s repeats the one before; time must increase."),
        ("t,x\n0,1\n2,2\n1,3\n", "line 4: time stamp 1 s follows 2 s; time must increase."),
        ("t,x\n0,1\n", "reach.csv: one point only; there is no motion to learn."),
        ("t,x\n0,1\n0,1\n", "reach.csv: one point only; there is no motion to learn."),
        ("t,x\n0,1\n1,1\n2,1\n", "reach.csv: all points are equal; there is no motion to learn."),
        ("0,1,2\n1,2,3\n", "reach.csv, line 1: numbers where the names of the columns should be."),
        ("# logged by hand\n0,1,2\n1,2,3\n", "line 2: numbers where the names of the columns should be."),
        ("t,x,y\n", "reach.csv: a header but no rows."),
        ("\n\n# nothing\n", "reach.csv: a table without rows."),
        ("t\n0\n1\n", "reach.csv: no position columns."),
        ("t,x,X,y\n0,1,2,3\n1,2,3,4\n", "reach.csv: two position columns of one name."),
    ],
)
def test_what_cannot_be_used_is_refused_by_place(read_text, text: str, words: str) -> None:
    with pytest.raises(InputDataError) as refusal:
        read_text(text)
    assert words in str(refusal.value)
    assert refusal.value.hint
    assert "\x1b" not in str(refusal.value)


def test_an_unknown_column_is_answered_with_the_known_ones(read_text) -> None:
    with pytest.raises(InputDataError, match="no column 'hand_z'; did you mean 'hand_x'") as refusal:
        read_text("t,hand_x,head\n0,1,2\n1,3,4\n", columns=["hand_z"])
    assert refusal.value.hint == "The columns are: t, hand_x, head."
    with pytest.raises(UsageError, match="each once"):
        read_text(PLAIN, columns=["x", "x"])


def test_text_of_another_encoding_is_refused(write) -> None:
    with pytest.raises(InputDataError, match="not UTF-8"):
        read_demonstrations([write("t,länge\n0,1\n1,2\n".encode("latin-1"))])
    with pytest.raises(InputDataError, match="not UTF-8"):
        read_demonstrations([write(PLAIN.encode("utf-16")[:-1])])


def test_a_long_table_is_read_whole_and_its_last_line_is_checked(read_text) -> None:
    n = 20_000  # more than two blocks
    lines = [f"{i},{2 * i}" for i in range(n)]
    demonstration = only(read_text("t,x\n" + "\n".join(lines)))
    assert (demonstration.positions[:, 0] == 2 * np.arange(n)).all()
    with pytest.raises(InputDataError, match=f"line {n + 2}, column 'x': 'end'"):
        read_text("t,x\n" + "\n".join([*lines, "99999,end"]))
    with pytest.raises(InputDataError, match=f"line {n + 3}: time stamp 5 s"):
        read_text("t,x\n\n" + "\n".join([*lines, "5,1"]))


def test_blank_lines_at_the_end_do_not_count_however_many(read_text) -> None:
    assert len(only(read_text(PLAIN + "\n" * 20_000)).times) == 3


# Any float64 that repr writes.
numbers = st.floats(-1e8, 1e8)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=50)
@given(
    hnp.arrays(np.float64, st.tuples(st.integers(2, 6), st.integers(1, 4)), elements=numbers), st.booleans()
)
def test_every_number_is_read_to_the_last_bit(write, positions, cell_by_cell: bool) -> None:
    positions[0] = positions[-1] + 1  # a motion
    names = [f"a{i}" for i in range(positions.shape[1])]
    lines = [",".join(["t", *names])] + [
        ",".join([str(i), *map(repr, row)]) for i, row in enumerate(positions.tolist())
    ]
    text = "\n".join([*lines, "# end"] if cell_by_cell else lines)  # a comment needs the careful path
    assert (only(read_demonstrations([write(text)])).positions == positions).all()


def test_a_cell_without_end_is_refused(write) -> None:
    with pytest.raises(InputDataError, match=r"not a table \(field larger than field limit"):
        read_demonstrations([write('t,x\n0,"' + 200_000 * "1" + '"\n')])
