"""Options that are written on one line, and what the rooms declare against what they check."""

from __future__ import annotations

import pytest
import typer

from skillctl.cli.app import load_command
from skillctl.cli.parameters import parser
from skillctl.compose.options import CombineOptions, MergeOptions
from skillctl.demonstrations import options as reading
from skillctl.demonstrations.units import UNITS
from skillctl.learning.options import LearnOptions, read_components
from skillctl.options import options_of, read_numbers, read_ranges, read_words
from skillctl.simulation.ik import HAND_PITCH
from skillctl.simulation.options import (
    ScenarioOptions,
    read_bound,
    read_knock,
    read_push,
    read_standing,
    read_start,
    read_target,
)
from skillctl.simulation.scenario import Scenario


def declared(kind, field):
    """Return how a field is offered."""
    (found,) = [each for each in options_of(kind) if each.field == field]
    return found


@pytest.mark.parametrize(
    ("kind", "field", "defined"),
    [
        (ScenarioOptions, "hand", HAND_PITCH),
    ],
)
def test_the_choices_are_those_of_the_rooms(kind, field, defined):
    assert set(declared(kind, field).choices) == set(defined)


def test_the_units_that_can_be_typed_are_units_of_positions():
    typed = declared(reading.Reading, "units").choices
    assert {UNITS[name].base for name in typed} == {"m", "rad"}


def test_what_can_be_typed_about_a_scenario_is_in_scenarios():
    fields = {each.field for each in options_of(ScenarioOptions)}
    assert fields - set(Scenario.model_fields) == {"push", "move_target", "displace", "knock"}


@pytest.mark.parametrize(
    ("command", "kinds"),
    [
        ("learn", [LearnOptions, reading.Reading]),
        ("merge", [MergeOptions, reading.Reading]),
        ("combine", [CombineOptions]),
    ],
)
def test_commands_have_the_options_and_defaults_of_the_rooms(command, kinds):
    parameters = {parameter.opts[0]: parameter for parameter in load_command(command).params}
    for each in (each for kind in kinds for each in options_of(kind)):
        for one in each.option.named:
            assert parameters[f"--{one.name}"].default == one.default
        if not each.option.named:
            assert parameters[f"--{each.key}"].default == each.default


@pytest.mark.parametrize(
    ("read", "text", "value"),
    [
        (read_numbers, "1,-2.5, 3e-1", (1.0, -2.5, 0.3)),
        (read_numbers, "7", (7.0,)),
        (read_words, "hand_x, hand_y", ("hand_x", "hand_y")),
        (read_ranges, "0,2,5-7", (0, 2, 5, 6, 7)),
        (read_ranges, "3-3", (3,)),
        (read_components, "auto", "auto"),
        (read_components, "4", 4),
        (read_start, "home", "home"),
        (read_start, "0,1", (0.0, 1.0)),
        (read_target, "cup", "cup"),
        (read_target, "0,1", (0.0, 1.0)),
        (read_standing, "0.6,-0.1", {"position": (0.6, -0.1)}),
        (read_standing, "0.6,-0.1,bottom", {"position": (0.6, -0.1), "board": "bottom"}),
        (read_bound, "1=cup", ("1", "cup")),
        (read_bound, " 12 = 0.5,-1,2", ("12", (0.5, -1.0, 2.0))),
        (read_knock, "1,0.2,0,0", {"kind": "knock", "time": 1.0, "offset": [0.2, 0.0, 0.0]}),
        (read_push, "1,0.2,0,0,9", {"kind": "push", "time": 1.0, "duration": 0.2, "force": [0.0, 0.0, 9.0]}),
    ],
)
def test_lists_are_read(read, text, value):
    assert read(text) == value


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (read_numbers, ""),
        (read_numbers, "1,,2"),
        (read_numbers, "1;2"),
        (read_words, "x,"),
        (read_ranges, "-1"),
        (read_ranges, "3-1"),
        (read_ranges, "a"),
        (read_ranges, "1-2-3"),
        (read_components, "some"),
        (read_start, "here"),
        (read_target, "cop"),
        (read_standing, "0.6"),
        (read_standing, "0.6,0,middle"),
        (read_standing, "0.6,0,0.7"),
        (read_bound, "cup"),
        (read_bound, "first=cup"),
        (read_bound, "1=cop"),
        (read_knock, "1,0.2"),
        (read_push, "1,0.2,0,0"),
    ],
)
def test_what_is_no_list_is_refused(read, text):
    with pytest.raises(typer.BadParameter):
        parser(read)(text)
