"""Options that are written on one line, and the choices that the rooms define."""

from __future__ import annotations

from typing import get_args, get_type_hints

import pytest
import typer

from skillctl.adapt.options import FIT_LEVELS
from skillctl.cli import options, scene
from skillctl.demonstrations.formats import FORMATS
from skillctl.demonstrations.recording import Unit
from skillctl.learning.options import METRICS, OBJECTIVES, PRESETS
from skillctl.model.gates import COMBINE_GATES, MERGE_GATES
from skillctl.simulation.arms import ARMS
from skillctl.simulation.scenario import CONTROLS, HANDS, PLANES, SCENES
from skillctl.usecases.verify_stability import Requirements


@pytest.mark.parametrize(
    ("spelt", "defined"),
    [
        (options.InputFormat, [form.name for form in FORMATS]),
        (options.Units, get_args(Unit)),
        (options.Objective, OBJECTIVES),
        (options.Metric, METRICS),
        (options.Preset, PRESETS),
        (options.MergeGate, tuple(gate.name for gate in MERGE_GATES)),
        (options.CombineGate, tuple(gate.name for gate in COMBINE_GATES)),
        (options.FitLevel, FIT_LEVELS),
        (options.Scope, get_args(get_type_hints(Requirements)["scope"])),
        (options.Plane, PLANES),
        (options.Hand, HANDS),
        (scene.SceneKind, SCENES),
        (scene.Control, CONTROLS),
    ],
)
def test_the_choices_are_those_of_the_rooms(spelt, defined):
    assert set(get_args(spelt)) == set(defined)


def test_the_arms_offered_are_those_there_are():
    assert tuple(ARMS) == options.ARMS


@pytest.mark.parametrize(
    ("read", "text", "value"),
    [
        (options.read_numbers, "1,-2.5, 3e-1", (1.0, -2.5, 0.3)),
        (options.read_numbers, "7", (7.0,)),
        (options.read_words, "hand_x, hand_y", ("hand_x", "hand_y")),
        (options.read_indices, "0,2,5-7", (0, 2, 5, 6, 7)),
        (options.read_indices, "3-3", (3,)),
        (options.read_components, "auto", "auto"),
        (options.read_components, "4", 4),
        (scene.read_start, "home", "home"),
        (scene.read_start, "0,1", (0.0, 1.0)),
        (scene.read_target, "cup", "cup"),
        (scene.read_target, "0,1", (0.0, 1.0)),
        (scene.read_cup, "0.6,-0.1", (0.6, -0.1, "")),
        (scene.read_cup, "0.6,-0.1,bottom", (0.6, -0.1, "bottom")),
    ],
)
def test_lists_are_read(read, text, value):
    assert read(text) == value


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (options.read_numbers, ""),
        (options.read_numbers, "1,,2"),
        (options.read_numbers, "1;2"),
        (options.read_words, "x,"),
        (options.read_indices, "-1"),
        (options.read_indices, "3-1"),
        (options.read_indices, "a"),
        (options.read_indices, "1-2-3"),
        (options.read_components, "some"),
        (scene.read_start, "here"),
        (scene.read_target, "cop"),
        (scene.read_cup, "0.6"),
        (scene.read_cup, "0.6,0,middle"),
        (scene.read_cup, "0.6,0,0.7"),
    ],
)
def test_what_is_no_list_is_refused(read, text):
    with pytest.raises(typer.BadParameter):
        read(text)
