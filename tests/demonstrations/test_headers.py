"""Tables as public tools write them: which columns are the position and the time, and in which unit."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from skillctl.demonstrations.reader import ReadResult
from skillctl.errors import InputDataError

SAMPLES = 30
STEP = 0.02  # [s]
WHOLE = 1_700_000_000  # [s], since 1970
DONE = np.linspace(0, 1, SAMPLES) ** 2
MOTION = np.round(np.array([0.35, -0.2, 0.27]) + np.outer(DONE, [0.2, 0.3, 0.18]), 6)  # [m]
TIMES = np.round(STEP * np.arange(SAMPLES), 6)
ROUNDING = 2e-6  # of coordinates written with six decimals of a metre or three of a millimetre
TICK = 3e-7  # [s], between doubles of seconds since 1970

Cells = Sequence[str]
X, Y, Z = ([f"{value:.6f}" for value in column] for column in MOTION.T)
MM = [[f"{1000 * value:.3f}" for value in column] for column in MOTION.T]
T = [f"{time:.2f}" for time in TIMES]
FRAMES = [str(i) for i in range(SAMPLES)]
NANOSECONDS = [str(WHOLE * 10**9 + round(1e9 * time)) for time in TIMES]
CLOCK = [f"23:59:{59 + time:06.3f}" if time < 1 else f"00:00:{time - 1:06.3f}" for time in (2 * TIMES)]
ISO = [f"2024-03-0{5 if cell > '1' else 6}T{cell}Z" for cell in CLOCK]
ONE = ["0.5"] * SAMPLES
QUATERNION = [["0"] * SAMPLES] * 3 + [["1"] * SAMPLES]


def table(header: str, *columns: Cells, sep: str = ",", above: str = "", decimal: str = ".") -> str:
    rows = [sep.join(cells).replace(".", decimal) for cells in zip(*columns, strict=True)]
    return above + "\n".join([header, *rows]) + "\n"


def comma(columns: Sequence[Cells]) -> list[Cells]:
    return [[cell.replace(".", ",") for cell in column] for column in columns]


MOTIVE = (
    "Format Version,1.23,Take Name,a,Export Frame Rate,50.000000,Length Units,Millimeters\n\n"
    ",Type,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body\n"
    ",Name,Hand,Hand,Hand,Hand,Hand,Hand,Hand\n,ID,1,1,1,1,1,1,1\n"
    ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position\n"
)
TRC = (
    "PathFileType\t4\t(X/Y/Z)\ta.trc\n"
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n"
    "50.00\t50.00\t30\t2\tmm\t50.00\t1\t30\nFrame#\tTime\tWrist\t\t\tElbow\t\t\n"
)
QUALISYS = "NO_OF_FRAMES\t30\nNO_OF_MARKERS\t2\nFREQUENCY\t50\nANALOG_FREQUENCY\t0\nTIME_STAMP\t2012-12-05\n"
VICON = "Trajectories\n50\n,,Hand:Wrist,,\nFrame,Sub Frame,X,Y,Z\n"
HAND: dict[str, object] = {"columns": ["hand"]}
WRIST: dict[str, object] = {"columns": ["Wrist"]}

TABLES: dict[str, tuple[str, dict[str, object]]] = {
    "rostopic": (table("%time,field.header.seq,field.x,field.y,field.z", NANOSECONDS, FRAMES, X, Y, Z), {}),
    "bagpy": (
        table(
            "Time,header.stamp.secs,header.frame_id,pose.position.x,pose.position.y,pose.position.z,"
            "pose.orientation.x,pose.orientation.y,pose.orientation.z,pose.orientation.w",
            T, ONE, ["base"] * SAMPLES, X, Y, Z, *QUATERNION,
        ),
        {},
    ),
    "seconds and nanoseconds": (
        table("sec,nanosec,x,y,z", [str(WHOLE)] * SAMPLES, [str(round(1e9 * t)) for t in TIMES], X, Y, Z),
        {},
    ),
    "microseconds since 1970": (table("timestamp,x,y,z", [cell[:-3] for cell in NANOSECONDS], X, Y, Z), {}),
    "milliseconds since 1970": (table("ts,x,y,z", [cell[:-6] for cell in NANOSECONDS], X, Y, Z), {}),
    "EuRoC": (
        table(
            "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], "
            "q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1]",
            NANOSECONDS, X, Y, Z, *QUATERNION, X, Y, Z,
        ),
        {},
    ),
    "PlotJuggler": (table("__time,/ee/position/x,/ee/position/y,/ee/position/z", T, X, Y, Z), {}),
    "pandas": (table(",elapsed_time,eef_x,eef_y,eef_z,gripper_width", FRAMES, T, X, Y, Z, ONE), {}),
    "pandas with times as its index": (table(",x,y,z", T, X, Y, Z), {}),
    "pandas with dates as its index": (
        table(",x,y,z", [f"2024-03-05 14:02:07.{round(1e6 * t):06}" for t in TIMES], X, Y, Z),
        {},
    ),
    "R": (table('"t" "x" "y" "z"', [f'"{i + 1}"' for i in range(SAMPLES)], T, X, Y, Z, sep=" "), {}),
    "Unity": (table("Time,PosX,PosY,PosZ,RotX,RotY,RotZ,RotW", T, X, Y, Z, *QUATERNION), {}),
    "Universal Robots": (
        table("t " + " ".join(f"actual_TCP_pose_{i}" for i in range(6)), T, X, Y, Z, X, Y, Z, sep=" "),
        {},
    ),
    "robosuite": (
        table("t,eef_pos_0,eef_pos_1,eef_pos_2,eef_quat_0,eef_quat_1,eef_quat_2,eef_quat_3", T, X, Y, Z,
              *QUATERNION),
        {},
    ),
    "KUKA": (table("Zeit [s];X [mm];Y [mm];Z [mm];A;B;C", *comma([T, *MM, X, Y, Z]), sep=";"), {}),
    "suffixes": (table("t_ms,x_mm,y_mm,z_mm", [f"{1000 * t:g}" for t in TIMES], *MM), {}),
    "a row of units": (table("s,mm,mm,mm", T, *MM, above="Time,X,Y,Z\n"), {}),
    "quoted names": (table('"Time, s","Position, X (mm)","Position, Y (mm)","Position, Z (mm)"', T, *MM), {}),
    "axes in front": (table("t,x_ee,y_ee,z_ee,x_ee_dot", T, X, Y, Z, ONE), {}),
    "forces beside": (table("t,tx,ty,tz,Fx [N],Fy [N],Fz [N]", T, X, Y, Z, ONE, ONE, ONE), {}),
    "Motive": (table("Frame,Time (Seconds),X,Y,Z,W,X,Y,Z", FRAMES, T, *QUATERNION, *MM, above=MOTIVE), {}),
    "Vicon": (
        table(",,mm,mm,mm", FRAMES, ONE, *MM, above=VICON),
        {},
    ),
    "TRC": (table("\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n", FRAMES, T, *MM, *MM, sep="\t", above=TRC), WRIST),
    "Qualisys": (
        table("MARKER_NAMES\thand\telbow", *MM, *MM, sep="\t", above=QUALISYS), {**HAND, "units": "mm"}
    ),
    "a unit in a comment": (table("t,x,y,z", T, *MM, above="# units: mm\n"), {}),
    "a rate in a comment": (table("frame,x,y,z", FRAMES, X, Y, Z, above="# lab\n# rate: 50 Hz\n"), {}),
    "Excel": (table("t;x;y;z", *comma([T, X, Y, Z]), sep=";", above="\ufeffsep=;\n"), {}),
    "separators at the end": (table("t;x;y;z", *comma([T, X, Y, Z]), [""] * SAMPLES, sep=";"), {}),
    "quoted decimal commas": (
        table("t,x,y,z", *[[f'"{cell}"' for cell in column] for column in comma([T, X, Y, Z])]), {}
    ),
    "pipes": (table("t|x|y|z", T, X, Y, Z, sep="|"), {}),
    "a tail of text": (table("t,a,b,c,label", T, X, Y, Z, ["open"] * SAMPLES), {"columns": ["a", "b", "c"]}),
    "renamed": (table("clock,a (mm),b (mm),c", T, *MM), {"columns": ["t=clock", "x=a", "y=b (mm)", "z=c"]}),
    "an unknown clock": (
        table("foo,a,b,c", [f"{1000 * t:g}" for t in TIMES], X, Y, Z),
        {"columns": ["t_ms=foo", "x=a", "y=b", "z=c"]},
    ),
}  # fmt: skip


@pytest.mark.parametrize("tool", TABLES)
def test_the_same_motion_is_read_from_the_files_of_every_tool(read_text, tool: str) -> None:
    text, options = TABLES[tool]
    (demonstration,) = read_text(text, **options).demonstrations
    assert np.abs(demonstration.positions[:, :3] - MOTION).max() <= ROUNDING
    assert np.abs(demonstration.times - TIMES).max() <= TICK


@pytest.mark.parametrize("tool", [tool for tool in TABLES if tool not in ("a tail of text",)])
def test_the_axes_of_one_thing_are_called_x_y_z_so_that_skills_go_together(read_text, tool: str) -> None:
    text, options = TABLES[tool]
    space = read_text(text, **options).demonstrations.space
    assert (space.names[:3], space.unit) == (("x", "y", "z"), "m")


@pytest.mark.parametrize("stamps", [ISO, CLOCK, [cell.replace("T", " ").replace(".", ",") for cell in ISO]])
def test_dates_and_times_of_day_pass_midnight(read_text, stamps: Cells) -> None:
    (demonstration,) = read_text(table("time;x;y;z", stamps, X, Y, Z, sep=";")).demonstrations
    assert np.abs(demonstration.times - 2 * TIMES).max() <= 1e-9  # of milliseconds, in doubles of a minute


def test_time_zones_count(read_text) -> None:
    stamps = ["2024-03-05T14:00:00+01:00", "2024-03-05T13:00:01Z", "2024-03-05T18:30:02+05:30"]
    (demonstration,) = read_text(table("time,x", stamps, X[:3])).demonstrations
    assert demonstration.times.tolist() == [0, 1, 2]


def test_what_is_taken_and_what_is_left_is_said(read_text) -> None:
    text = table("t,ee_x,ee_y,ee_z,qw,grip,index", T, X, Y, Z, ONE, ONE, FRAMES)
    assert read_text(text).notes == (
        "the position is ee_x, ee_y, ee_z; left aside: qw, grip, index; use --columns to choose others.",
    )


@pytest.mark.parametrize(
    ("header", "taken", "left"),
    [
        ("t,q1,q2,q3,dq1,tau1", "q1, q2, q3", "dq1, tau1"),
        ("t,shoulder_pan.pos,elbow_flex.pos,wrist_roll.pos,gripper.pos,step",
         "shoulder_pan.pos, elbow_flex.pos, wrist_roll.pos", "gripper.pos, step"),
        ("__time,/joint1/position,/joint2/position,/joint3/position,/joint1/velocity,/joint1/effort",
         "/joint1/position, /joint2/position, /joint3/position", "/joint1/velocity, /joint1/effort"),
    ],
)  # fmt: skip
def test_joint_angles_are_known_by_their_names(read_text, header: str, taken: str, left: str) -> None:
    result = read_text(table(header, T, X, Y, Z, ONE, ONE))
    assert result.demonstrations.space.unit == "rad"
    assert result.notes[0].startswith(f"the position is {taken}; left aside: {left};")
    assert result.notes[1] == "joint angles are taken as radians; degrees need --units deg."


HEADERS_IN_DEGREES: list[tuple[str, dict[str, object]]] = [
    ("t,j1 (deg)", {}),
    ("t,j1_deg", {}),
    ("# unit=deg\nt,j1", {}),
    ("t,j1", {"units": "deg"}),
]


def test_degrees_become_radians(read_text) -> None:
    degrees = [f"{180 * value:.6f}" for value in MOTION[:, 0]]
    for header, options in HEADERS_IN_DEGREES:
        (demonstration,) = read_text(table(header, T, degrees), **options).demonstrations
        assert np.abs(demonstration.positions[:, 0] - np.pi * MOTION[:, 0]).max() <= ROUNDING
    with pytest.raises(InputDataError, match=r"joint angles up to 99; are they degrees\?"):
        read_text(table("t,j1", T, degrees))


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        (table("t,x_mm,y_m", T, X, Y), {}, "'x_mm' is in mm and 'y_m' is in m."),
        (table("t,x_mm,y_mm", T, X, Y), {"units": "m"}, "positions are in mm, and --units says m."),
        (table("t,x [px],y [px]", T, X, Y), {}, "its positions are in pixels."),
        (table("foo,a,b", T, X, Y), {}, "column 'foo' rises evenly, as a clock or a counter does;"),
        (table("t,l_x,l_y,r_x,r_y", T, X, Y, X, Y), {}, "4 columns could be positions; which are?"),
        (table("t,x,y", [f"{1e9 * t:g}" for t in TIMES], X, Y), {}, "than a day; its times are no seconds."),
        (table("t,x", ["03/05/2024 14:02:07"] * SAMPLES, X), {}, "'03/05/2024 14:02:07' is no time"),
        (table("t,x", [*ISO[:-1], "later"], X), {}, "line 31, column 't': 'later' is no time."),
        (table("x;y", ["1,750"] * SAMPLES, ["2,001"] * SAMPLES, sep=";"), {"dt": 0.1},
         "1,750 is 1.750 with a decimal comma, and 1750 with a comma between thousands"),
        (table("t,x,y\n0,1", T, X, Y), {}, "line 2: 2 cells, but there are 3 columns."),
        (table("t,a,b", T, X, Y), {"columns": ["x=c"]}, "there is no column 'c'"),
    ],
)  # fmt: skip
def test_what_is_doubtful_is_refused(read_text, text: str, options: dict[str, object], words: str) -> None:
    with pytest.raises(InputDataError) as refusal:
        read_text(text, **options)
    assert words in str(refusal.value)
    assert refusal.value.hint


@pytest.mark.parametrize(
    ("cells", "numbers"),
    [
        (["1,061", "999", "1,650"], [1061, 999, 1650]),  # as 999 is followed by 1,000
        (["1,234.5", "1,000.0", "998.5"], [1234.5, 1000, 998.5]),
        (["1,234,567", "1,234,569", "1,234,570"], [1234567, 1234569, 1234570]),
        (["1.234,5", "1.000,0", "998,5"], [1234.5, 1000, 998.5]),
        (["0,350", "1,061", "300"], [0.35, 1.061, 300]),
        (["1,5", "1,061", "300"], [1.5, 1.061, 300]),
    ],
)
def test_commas_are_decimal_or_separate_thousands(read_text, cells: Cells, numbers: list[float]) -> None:
    for separator, quote in ((";", ""), (",", '"'), ("\t", '"')):
        quoted = [f"{quote}{cell}{quote}" for cell in cells]
        (demonstration,) = read_text(
            table(f"n{separator}x", FRAMES[:3], quoted, sep=separator), dt=1.0
        ).demonstrations
        assert demonstration.positions.ravel().tolist() == numbers


@pytest.mark.parametrize(
    ("cells", "numbers"),
    [
        (["1.061", "999", "1.650"], [1061, 999, 1650]),
        (["1.061", "2.999", "1.650"], [1.061, 2.999, 1.650]),  # as everywhere
        (["1.061", "999", "1.65"], [1.061, 999, 1.65]),
        (["1.234,5", "1.061", "999,5"], [1234.5, 1061, 999.5]),
    ],
)
def test_points_separate_thousands_only_where_nothing_else_makes_sense(read_text, cells, numbers) -> None:
    for separator in (";", "\t"):
        result = read_text(table(f"n{separator}x", FRAMES[:3], cells, sep=separator), dt=1.0)
        assert result.demonstrations.demonstrations[0].positions.ravel().tolist() == numbers
        said = "points in numbers are read as separators between thousands." in result.notes
        assert said == (numbers == [1061, 999, 1650])


@pytest.mark.parametrize("name", ["trial", "episode_index", "Demo ID", "run"])
def test_columns_that_tell_demonstrations_apart_are_known_by_their_names(read_text, name: str) -> None:
    which = ["0"] * 15 + ["1"] * 15
    result = read_text(table(f"{name},t,x,y", which, T, X, Y))
    assert [len(d.times) for d in result.demonstrations] == [15, 15]
    assert f"the column '{name}' tells demonstrations apart." in result.notes


def test_a_column_in_no_reserved_word_can_be_made_what_it_is(read_text) -> None:
    which = ["ann"] * 15 + ["bob"] * 15
    result = read_text(table("who,t,x,y", which, T, X, Y), columns=["demo=who", "x", "y"])
    assert [d.source for d in result.demonstrations] == ["reach.csv, demo ann", "reach.csv, demo bob"]


def test_a_table_may_begin_with_its_numbers_far_below(read_text: Callable[..., ReadResult]) -> None:
    text = table("t,x,y", T, X, Y, above="# made by hand\n" * 100 + "\n\n")
    assert len(read_text(text).demonstrations.demonstrations[0].times) == SAMPLES
