from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import asdict

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from PIL import Image

from skillctl.errors import GoalNotReachedError, UsageError
from skillctl.model.seds import SedsSkill
from skillctl.simulation.batch import BATCH_OUTCOMES, Row, run_batch, run_row
from skillctl.simulation.picture import FAILURE, PARTS, SUCCESS, encode_overview
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.tally import encode_rows, failures, medians
from skillctl.workers import Workers

# One start is out of reach, one within: both kinds of row come up among few episodes.
STARTS = np.array([[0.45, 0.0, 0.50], [1.50, 0.0, 0.50]])
SHORT = {"max_duration": 0.15, "sampling": {"start_scatter": 0.01}, "hand": "free"}


@pytest.fixture(scope="module")
def skill(linear: Callable[..., SedsSkill]) -> SedsSkill:
    return linear((0.5, 0.05, 0.5))


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return Scenario(episodes=6, seed=3, tolerance=0.06, settle_time=0.01, **SHORT)


@pytest.fixture(scope="module")
def rows(skill: SedsSkill, scenario: Scenario) -> tuple[Row, ...]:
    return run_batch(skill, scenario, STARTS, workers=Workers(2))


def test_neither_the_number_of_processes_nor_the_order_changes_an_episode(
    skill: SedsSkill, scenario: Scenario, rows: tuple[Row, ...]
) -> None:
    again = [run_row(skill, scenario, STARTS, index) for index in reversed(range(6))]
    assert encode_rows(again[::-1]) == encode_rows(rows)
    paths = [row.trace.path.tobytes() for row in again[::-1] if row.trace is not None]
    assert paths == [row.trace.path.tobytes() for row in rows if row.trace is not None]


def test_a_larger_batch_begins_with_the_smaller_one(
    skill: SedsSkill, scenario: Scenario, rows: tuple[Row, ...]
) -> None:
    longer = scenario.changed(episodes=7)
    assert encode_rows([run_row(skill, longer, STARTS, i) for i in range(6)]) == encode_rows(rows)


def test_what_was_drawn_can_be_run_by_itself(skill: SedsSkill, rows: tuple[Row, ...]) -> None:
    row = next(row for row in rows if row.metrics is not None)
    assert row.metrics is not None
    again = simulate(skill, row.scenario).metrics
    np.testing.assert_equal(asdict(again), asdict(row.metrics))  # to the last bit, NaN included


def test_an_episode_that_cannot_begin_is_a_row_and_not_the_end(rows: tuple[Row, ...]) -> None:
    refused = [row for row in rows if row.metrics is None]
    assert refused
    assert len(refused) < len(rows)
    assert {row.outcome for row in refused} == {"unreachable"}
    assert all("start" in row.detail for row in refused)
    far = {row.index for row in rows if row.scenario.start[0] > 1.0}
    assert {row.index for row in refused} == far
    assert failures(rows)["unreachable"] == len(refused)


def test_the_table_reads_back_exactly(rows: tuple[Row, ...]) -> None:
    table = list(csv.DictReader(io.StringIO(encode_rows(rows).decode())))
    assert [int(line["episode"]) for line in table] == list(range(6))
    for line, row in zip(table, rows, strict=True):
        assert line["outcome"] == row.outcome
        assert int(line["success"]) == row.success
        assert tuple(map(float, line["start"].split())) == row.scenario.start
        assert line["target"] == line["cup_x"] == ""
        assert line["detail"] == row.detail
        if row.metrics is None:
            assert line["final_error"] == line["part"] == ""
        else:
            assert float(line["final_error"]) == row.metrics.final_error
            assert line["part"] == "0"


def test_medians_are_those_of_the_episodes_that_have_the_figure(rows: tuple[Row, ...]) -> None:
    errors = sorted(row.metrics.final_error for row in rows if row.metrics is not None)
    middle = len(errors) // 2
    expected = errors[middle] if len(errors) % 2 else 0.5 * (errors[middle - 1] + errors[middle])
    assert medians(rows)["final_error"] == expected
    assert np.isnan(medians(rows)["cup_rise"])


def test_a_mistake_that_holds_for_all_is_raised(skill: SedsSkill, scenario: Scenario) -> None:
    with pytest.raises(UsageError, match="expected 3 numbers, got 2"):
        run_batch(skill, scenario, STARTS[:, :2])


def test_every_outcome_can_be_counted() -> None:
    assert BATCH_OUTCOMES[-1] == "crashed"
    assert failures([]) == {}


def count(picture: bytes, colour: tuple[int, int, int]) -> int:
    pixels = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), dtype=int)
    return int((np.abs(pixels - colour).max(axis=2) < 8).sum())


def test_an_overview_shows_what_came_of_it(rows: tuple[Row, ...]) -> None:
    ran = [row for row in rows if row.trace is not None]
    kinds = {row.success for row in ran}
    picture = encode_overview(rows, title="reach", verdict="some")
    assert picture == encode_overview(rows, title="reach", verdict="some")
    assert (count(picture, SUCCESS) > 30) == (True in kinds)
    assert count(picture, FAILURE) > 30  # the legend counts those that could not begin, too
    by_part = encode_overview(rows, title="reach", verdict="some", colour_by="part", parts=["the only one"])
    assert count(by_part, PARTS[0]) > 30
    assert count(by_part, SUCCESS) == 0


def test_an_overview_of_nothing_is_refused(rows: tuple[Row, ...]) -> None:
    with pytest.raises(GoalNotReachedError, match="no episode could begin"):
        encode_overview([row for row in rows if row.trace is None], title="", verdict="")


def test_an_overview_has_a_cup_of_each_episode_in_a_paler_colour(skill: SedsSkill) -> None:
    shelf = {"scene": {"kind": "shelf"}, "target": "cup", "start": (0.44, 0.0, 0.76), "max_duration": 0.02}
    batch = Scenario(seed=3, episodes=2, sampling={"cup_y_range": (-0.05, 0.05)}, **shelf)
    rows = [run_row(skill, batch, STARTS, index) for index in range(2)]
    assert [row.outcome for row in rows] == ["timeout", "timeout"]
    pixels = np.asarray(Image.open(io.BytesIO(encode_overview(rows, title="", verdict=""))).convert("RGB"))
    red, green, blue = pixels.astype(int).transpose(2, 0, 1)
    # 1 − 0.6 (1 − c) of the failures' (206, 44, 32): where light falls as where it does not, red leads so.
    pink = (red - green > 60) & (np.abs(green - blue) < 12) & (red > 120)
    assert pink.sum() > 400  # each cup is some 20 pixels wide and 40 high


def test_progress_counts_episodes_and_successes(skill: SedsSkill, scenario: Scenario) -> None:
    told: list[tuple[str, int, int]] = []
    rows = run_batch(
        skill, scenario.changed(episodes=2), STARTS, progress=lambda *report: told.append(report)
    )
    assert told[0] == ("starting", 0, 2)
    assert [report[1:] for report in told[1:]] == [(1, 2), (2, 2)]
    assert told[-1][0].startswith(f"{sum(row.success for row in rows)} of 2 succeeded, ")
