from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from PIL import Image

from skillctl.workers import WorkerDied, processes

SHORT = ("--max-duration", "0.1", "--hand", "free")


def test_a_batch_is_reported_counted_and_drawn(run, library: Path, tmp_path: Path) -> None:
    table, overview = tmp_path / "t.csv", tmp_path / "o.png"
    arguments = ("simulate", "reach", "--episodes", 3, "--seed", 4, "--store", library, *SHORT)
    result = run(*arguments, "--table", table, "--overview", overview, "--json")
    assert (result.exit_code, result.stderr) == (1, "")
    report = json.loads(result.stdout)
    assert (report["episodes"], report["successes"], report["failures"]) == (3, 0, {"timeout": 3})
    assert report["interval"][0] == 0.0
    assert (report["enough"], report["seed"]) == (False, 4)
    assert [failed["episode"] for failed in report["failed"]] == [0, 1, 2]
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert len({row["start"] for row in rows}) == 3
    with Image.open(overview) as picture:
        assert picture.format == "PNG"

    for_people = run(*arguments, "--jobs", 2)
    assert for_people.exit_code == 1
    for words in ("0 of 3: 0% (95% interval 0.0% to 56.1%)", "no, 100% was asked for", "timeout", "0, 1, 2"):
        assert words in for_people.stdout

    assert run(*arguments, "--min-success", 0, "-q").exit_code == 0


def test_one_episode_of_a_batch_can_be_looked_at(run, library: Path, tmp_path: Path) -> None:
    batch_of_two = run("simulate", "reach", "--episodes", 2, "--store", library, *SHORT, "--json")
    film, log = tmp_path / "one.gif", tmp_path / "one.csv"
    one = run(
        *("simulate", "reach", "--episode", 1, "--store", library, *SHORT),
        *("--video", film, "--log", log, "--json"),
    )
    errors = json.loads(batch_of_two.stdout)["medians"]["final_error"]
    first = run("simulate", "reach", "--episode", 0, "--store", library, *SHORT, "--json")
    both = [json.loads(result.stdout)["metrics"]["final_error"] for result in (first, one)]
    assert sum(both) / 2 == pytest.approx(errors, rel=1e-15)  # the median of two is their mean
    with Image.open(film) as picture:
        assert picture.format == "GIF"
    assert log.read_text().startswith("t,")


def test_a_crashed_episode_is_one_failure(run, library: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def with_a_crash(task, items, jobs):
        yield items[1], WorkerDied()
        yield items[0], task(items[0])

    monkeypatch.setattr(processes, "run_in_processes", with_a_crash)
    result = run("simulate", "reach", "--episodes", 2, "--store", library, *SHORT, "--json")
    assert result.exit_code == 1
    report = json.loads(result.stdout)
    assert report["failures"] == {"timeout": 1, "crashed": 1}
    assert report["failed"][1] == {"episode": 1, "outcome": "crashed", "detail": "its process died"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--episodes", 2, "--video", "a.gif"), "--video is about one episode"),
        (("--episodes", 2, "--log", "a.csv"), "--log is about one episode"),
        (("--overview", "a.png"), "--overview is about many episodes"),
        (("--episode", 1, "--table", "a.csv"), "--table is about many episodes"),
        (("--episode", 1, "--jobs", 2), "--jobs is about many episodes"),
        (("--episodes", 0), "episodes"),
        (("--episodes", 2, "--jobs", 0), "jobs: must be at least 1"),
        (("--episodes", 2, "--min-success", 90), "a share from 0 to 1"),
        (("--min-success", 1), "--min-success is about many episodes"),
        (("--check", "--min-success", 1), "--min-success is about a run; with --check nothing moves"),
        (("--check", "--picture", "p.png"), "--picture is about a run"),
        (("--check", "--log", "l.csv"), "--log is about a run"),
        (("--check", "--video", "v.gif"), "--video is about a run"),
        (("--check", "--episodes", 2), "--episodes are runs"),
        (("--episode", -1), "episode: counted from 0"),
        (("--video", "a.avi"), "a video is a .gif or an .mp4"),
    ],
)
def test_what_makes_no_sense_is_refused(
    run, library: Path, arguments: tuple[object, ...], words: str
) -> None:
    result = run("simulate", "reach", "--store", library, *arguments)
    assert (result.exit_code, result.stdout) == (2, "")
    assert words in result.stderr
    assert "hint:" in result.stderr


def test_equal_episodes_are_told(run, library: Path) -> None:
    result = run(
        *("simulate", "reach", "--episodes", 2, "--start", "0.4,0,0.5", "--store", library, *SHORT),
    )
    assert "nothing differs between the episodes" in result.stderr
