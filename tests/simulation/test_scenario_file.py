from __future__ import annotations

import string
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillctl.errors import InputDataError, NotFoundError, UsageError
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.scenario_file import overridden, read_scenario, to_toml
from skillctl.simulation.values import LARGEST, LONGEST

FULL = """
arm = "panda"
start = [0.4, 0, 0.55]
target = "cup"
noise = 0.003

[scene]
kind = "shelf"
boards = [0.4, 0.7]
walls = true

[cup]
position = [0.62, 0.1]
board = "bottom"

[sampling]
mass_range = [0.1, 0.5]

[[disturbances]]
kind = "move-target"
time = 0.8
offset = [0, 0.08, 0]

[[disturbances]]
kind = "push"
time = 1
duration = 0.5
force = [0, 40, 0]
"""


def read(tmp_path: Path, text: str) -> Scenario:
    (file := tmp_path / "s.toml").write_text(text, encoding="utf-8")
    return read_scenario(file)


def test_a_file_says_what_python_says(tmp_path: Path) -> None:
    assert read(tmp_path, FULL) == Scenario(
        start=(0.4, 0.0, 0.55),
        target="cup",
        noise=0.003,
        scene={"kind": "shelf", "boards": (0.4, 0.7), "walls": True},
        cup={"position": (0.62, 0.1), "board": "bottom"},
        sampling={"mass_range": (0.1, 0.5)},
        disturbances=(
            {"kind": "move-target", "time": 0.8, "offset": (0.0, 0.08, 0.0)},
            {"kind": "push", "time": 1.0, "duration": 0.5, "force": (0.0, 40.0, 0.0)},
        ),
    )


def test_what_is_written_reads_back_the_same(tmp_path: Path) -> None:
    for scenario in (Scenario(), read(tmp_path, FULL)):
        again = read(tmp_path, to_toml(scenario))
        assert again == scenario
        assert to_toml(again) == to_toml(scenario)


@given(
    start=st.lists(st.floats(-LARGEST, LARGEST), min_size=1, max_size=3),
    noise=st.floats(0, LARGEST),
    seed=st.integers(0, 2**63 - 1),
    name=st.text(st.characters(exclude_categories=["Cs"])),
)
def test_every_number_and_name_survives(
    tmp_path_factory: pytest.TempPathFactory, start: list[float], noise: float, seed: int, name: str
) -> None:
    scenario = Scenario(start=tuple(start), noise=noise, seed=seed, arm=f"{name}.urdf")
    assert read(tmp_path_factory.mktemp("s"), to_toml(scenario)) == scenario


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("max_sped = 1", "max_sped: there is no such key. Did you mean max_speed?"),
        ("[cup]\nheigth = 1", "cup.heigth: there is no such key. Did you mean height?"),
        ("scale = '1'", "scale: must be a number, got '1'"),
        ("scale = true", "scale: must be a number, got True"),
        ("noise = nan", "noise: must be a finite number"),
        ("target = 'cop'", "target: must be 'cup' or a list, got 'cop'"),
        ("[scene]\nkind = 'desk'", "scene: its kind must be 'shelf', 'table'"),
        ("[scene]\nheight = 1", "scene: its kind must be given"),
        (
            "[scene]\nkind = 'shelf'\nx_range = [0.8, 0.5]",
            "scene.x_range: the first number must not be",
        ),
        ("[cup]\nmass = 0.1", "cup: it needs something to stand on"),
        ("[scene]\nkind='shelf'\n[cup]\nposition=[0.3,0]", "cup.position: (0.3, 0) is not on a board"),
        ("[scene]\nkind='shelf'\n[cup]\nmass = 0.0", "cup.mass: must be greater than 0, got 0.0"),
        ("[grasp]\nlift = 0.01", "grasp.lift: must not be less than rise"),
        ("[[disturbances]]\nkind = 'push'\ntime = 1\nforce=[1,1,1]", "disturbances.0.duration: is missing"),
        (
            "[[disturbances]]\nkind='displace'\ntime=1\noffset=[1,1]",
            "disturbances.0.offset: number 3 is",
        ),
        ("[sampling]\nstart_x_range = [0.1, 0.2]", "sampling.start_x_range, start_y_range and start_z_range"),
        ("seed = 1.5", "seed: must be a whole number"),
        ("scene = 1979-05-27", "scene: must be a table"),
        ("scene = ", "is not TOML"),
        ("a = " + "[" * 5000, "is not TOML"),
    ],
)
def test_an_error_names_file_key_and_what_was_expected(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputDataError) as refusal:
        read(tmp_path, text)
    message = str(refusal.value)
    assert message.startswith(f"{tmp_path / 's.toml'}: ")
    assert words in message
    assert "\n" not in message
    assert refusal.value.hint


def test_a_file_that_is_not_there_or_not_text_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NotFoundError, match=r"none\.toml: there is no such file"):
        read_scenario(tmp_path / "none.toml")
    (file := tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputDataError, match="is not TOML"):
        read_scenario(file)
    file.write_bytes(b"#" * (1 << 20) + b"#")
    with pytest.raises(InputDataError, match="bytes"):
        read_scenario(file)


def test_a_name_may_hold_any_character(tmp_path: Path) -> None:
    scenario = Scenario(arm='a "quoted"\\path\t\x7f\x00\u2028.urdf')
    assert read(tmp_path, to_toml(scenario)) == scenario


def test_what_is_typed_comes_on_top_of_the_file(tmp_path: Path) -> None:
    scenario = read(tmp_path, FULL)
    push = {"kind": "push", "time": 2.0, "duration": 1.0, "force": (1.0, 0.0, 0.0)}
    changed = overridden(
        scenario,
        {"start": None, "scene": "shelf", "cup": {"position": (0.6, 0.0)}, "disturbances": [push], "seed": 7},
    )
    assert changed.start is None
    assert changed.scene == scenario.scene  # of that kind already: its own measures stay
    assert changed.cup is not None
    assert (changed.cup.position, changed.cup.board) == ((0.6, 0.0), "bottom")
    assert [event.time for event in changed.disturbances] == [0.8, 1.0, 2.0]
    assert changed.noise == scenario.noise


def test_another_scene_takes_the_place_of_the_one_in_the_file(tmp_path: Path) -> None:
    scenario = read(tmp_path, FULL)
    table = overridden(scenario, {"scene": "table"})
    assert table.scene is not None
    assert table.scene.kind == "table"
    bare = overridden(scenario, {"scene": "none"})
    assert (bare.scene, bare.cup, bare.target) == (None, None, None)
    with pytest.raises(UsageError, match="cup: it needs something to stand on"):
        overridden(Scenario(), {"target": "cup"})


def test_keys_are_bare_words() -> None:
    """Nothing that ``to_toml`` writes as a key would need quotes."""
    lines = [
        line for line in to_toml(Scenario(scene={"kind": "shelf"}, cup={})).splitlines() if " = " in line
    ]
    keys = {line.partition(" = ")[0] for line in lines}
    assert len(lines) > 20
    assert all(set(key) <= set(string.ascii_lowercase + "_") for key in keys)


def test_held_joints_of_any_name_read_back(tmp_path: Path) -> None:
    scenario = Scenario(arm="mine.urdf", hold={"torso_lift_joint": 0.2, "arm.left/1": -0.5})
    path = tmp_path / "held.toml"
    path.write_text(to_toml(scenario))
    assert read_scenario(path) == scenario


def numbers(value: object, path: tuple[object, ...] = ()) -> Iterator[tuple[object, ...]]:
    """Yield the path of every number of a document that is no count."""
    if isinstance(value, float):
        yield path
    elif isinstance(value, dict | list | tuple):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from numbers(part, (*path, key))


DISTURBED = Scenario(
    start=(0.4, 0.0, 0.5),
    origin=(0.0, 0.0, 0.0),
    scale=1.0,
    base_yaw=0.0,
    max_duration=1.0,
    scene={"kind": "shelf"},
    target="cup",
    cup={"position": (0.62, 0.1)},
    obstacles=[{"kind": "box", "position": (0.2, 0.6, 0.2), "size": (0.1, 0.1, 0.1)}],
    disturbances=[
        {"kind": "push", "time": 0.0, "duration": 0.1, "force": (1.0, 0.0, 0.0)},
        {"kind": "move-target", "time": 0.0, "offset": (0.0, 0.01, 0.0)},
        {"kind": "displace", "time": 0.0, "offset": (0.0, 0.01, 0.0)},
        {"kind": "knock", "time": 0.0, "offset": (0.0, 0.1, 0.0)},
    ],
).model_dump(exclude_none=True)
TIMES = {
    "time",
    "duration",
    "max_duration",
    "settle_time",
    "close_time",
    "open_time",
    "lift_time",
    "hold_time",
}


@pytest.mark.parametrize("path", [*numbers(DISTURBED)], ids=str)
def test_no_number_may_be_so_large_that_a_run_would_not_end(path: tuple[object, ...]) -> None:
    bound = LONGEST if path[-1] in TIMES else LARGEST
    for number in (1.001 * bound, 1e308, -1e308):
        document = deepcopy(DISTURBED)
        table: Any = document
        for key in path[:-1]:
            table[key] = list(table[key]) if isinstance(table[key], tuple) else table[key]
            table = table[key]
        table[path[-1]] = number
        with pytest.raises(UsageError, match=str(path[0])) as caught:
            Scenario(**document)
        if number > 0:
            assert f"less than or equal to {bound:.0f}" in str(caught.value)


def test_a_file_is_told_the_bound_on_simulated_time(tmp_path: Path) -> None:
    with pytest.raises(
        InputDataError, match=r"max_duration: must be less than or equal to 600, got 100000\.0"
    ):
        read(tmp_path, "max_duration = 1e5")
