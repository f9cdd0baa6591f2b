from __future__ import annotations

import json
from pathlib import Path

import pytest

from skillctl.demonstrations.reaching import reaching_demonstrations
from skillctl.demonstrations.writing import write_csv
from skillctl.errors import UsageError
from skillctl.evaluate.errors import HeldOut
from skillctl.evaluate.left_out import held_out, leave_out_in_turn
from skillctl.learning.options import LearnOptions
from skillctl.model.demonstration import DemonstrationSet

FAST = LearnOptions(preset="fast")


@pytest.fixture(scope="module")
def reaches() -> DemonstrationSet:
    return reaching_demonstrations("bottom-left", count=3)


def test_each_demonstration_is_left_out_once(reaches: DemonstrationSet) -> None:
    stages = []
    errors = held_out(leave_out_in_turn(reaches, FAST, progress=lambda *step: stages.append(step)))
    assert stages == [("validation", 1, 3), ("validation", 2, 3), ("validation", 3, 3)]
    assert (errors.demonstrations, errors.arrived) == (3, 3)
    assert errors.dtw is not None
    assert errors.worst_dtw is not None
    assert 0 < errors.dtw <= errors.worst_dtw < 0.2 * reaches.extent


def test_a_demonstration_unlike_the_others_shows_when_it_is_left_out(reaches: DemonstrationSet) -> None:
    mirrored = reaching_demonstrations("bottom-right", count=1).demonstrations
    mixed = DemonstrationSet((*reaches.demonstrations, *mirrored), reaches.space)
    usual, odd = (held_out(leave_out_in_turn(motions, FAST)) for motions in (reaches, mixed))
    assert usual.worst_dtw is not None
    assert odd.worst_dtw is not None
    assert odd.worst_dtw > 3 * usual.worst_dtw


def test_one_demonstration_cannot_be_left_out(reaches: DemonstrationSet) -> None:
    with pytest.raises(UsageError, match="only one"):
        leave_out_in_turn(DemonstrationSet(reaches.demonstrations[:1], reaches.space), FAST)


def test_errors_survive_being_recorded() -> None:
    errors = HeldOut(demonstrations=7, dtw=0.0012, worst_dtw=0.003, arrived=7)
    assert HeldOut.recorded({"objective": 1.0, **errors.results()}) == errors
    assert HeldOut.recorded({"objective": 1.0}) is None


def test_learn_and_inspect_report_what_was_left_out(run, tmp_path: Path) -> None:
    paths = [tmp_path / f"{index}.csv" for index in range(2)]
    for path, demonstration in zip(paths, reaching_demonstrations("top-centre", count=2), strict=True):
        write_csv(demonstration, path)
    arguments = ["learn", *paths, "-o", tmp_path / "s.h5", "--preset", "fast", "--validate"]
    learned = json.loads(run(*arguments, "--json").stdout)["held_out"]
    assert learned["demonstrations"] == 2
    assert "left out" in run("inspect", tmp_path / "s.h5").stdout
    again = json.loads(run(*arguments, "--json").stdout)
    assert (again["status"], again["held_out"]) == ("up to date", learned)
