"""``skillctl adapt`` as a user sees it: verdicts, exit codes, files."""

from __future__ import annotations

import importlib.util
import json

import pytest
from junitparser import JUnitXml

from skillctl.adapt.task_file import read_task
from skillctl.store import read_skill

CURVE = """
[target]
position = [0.0, 0.0]
tolerance = 0.01

[start]
low = [0.2, 0.1]
high = [0.23, 0.11]

[[via]]
name = "bend"
point = [0.11, 0.1]
within = 0.06

[limits]
period = 0.01
"""
BOTTLE = """
[[keep-out]]
name = "bottle"
kind = "ball"
centre = [0.0, 0.02]
radius = 0.03
"""


@pytest.fixture
def task_file(tmp_path):
    path = tmp_path / "task.toml"
    path.write_text(CURVE)
    return path


def adapt(run, task, library, *arguments):
    return run("adapt", task, "curve", "hook", "--store", library, *arguments)


def test_a_task_is_done_proved_written_and_up_to_date(run, task_file, library, tmp_path):
    result = adapt(run, task_file, library, "-o", tmp_path / "a.h5", "--json")
    assert (result.exit_code, result.stderr.strip()) == (0, "")
    report = json.loads(result.stdout)
    assert (report["status"], report["holds"], report["held"], report["starts"]) == (
        "adapted",
        True,
        200,
        200,
    )
    assert report["certificate"]["verdict"] == "stable"
    clauses = {each["clause"]: each for each in report["clauses"]}
    assert set(clauses) == {"target", "bend", "limits.period"}
    assert clauses["target"]["proved"]
    assert clauses["limits.period"]["bound"] == pytest.approx(report["certificate"]["period"] - 0.01)
    assert clauses["bend"]["bound"] is None  # measured only
    artifact = read_skill(tmp_path / "a.h5")
    assert artifact.operation.command == "adapt"
    assert "[[via]]" in tuple(artifact.operation.results["task"])
    assert {parent.name for parent in artifact.provenance.parents} <= {"curve", "hook"}
    assert artifact.skill.attractors.tolist() == [[0.0, 0.0]]
    task_file.write_text(f"# A remark changes nothing.\n{CURVE}")
    again = adapt(run, task_file, library, "-o", tmp_path / "a.h5", "--json")
    assert again.exit_code == 0
    assert json.loads(again.stdout)["status"] == "up to date"


def test_the_same_task_gives_the_same_bytes(run, task_file, library, tmp_path):
    for name in ("a.h5", "b.h5"):
        assert adapt(run, task_file, library, "-o", tmp_path / name).exit_code == 0
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_an_adapted_skill_shows_its_task(run, task_file, library, tmp_path):
    adapt(run, task_file, library, "-o", tmp_path / "a.h5")
    shown = run("inspect", tmp_path / "a.h5", "--html", tmp_path / "a.html")
    assert shown.exit_code == 0
    page = (tmp_path / "a.html").read_text()
    for words in (shown.stdout, page):
        assert "clause of its task" in words
        assert "limits.period" in words
    assert "The task" in page


def test_an_impossible_task_is_refused_by_the_name_of_its_clause(run, task_file, library, tmp_path):
    task_file.write_text(CURVE + BOTTLE)
    result = adapt(run, task_file, library, "-o", tmp_path / "a.h5", "--plot", tmp_path / "a.svg")
    assert result.exit_code == 1
    assert "bottle fails by" in result.stdout
    assert "nothing was written" in result.stdout
    # The ball of 3 cm lies around a point that is 2 cm beside the target.
    assert "bottle fails at the target itself, by 0.01 m" in result.stderr
    assert not (tmp_path / "a.h5").exists()
    assert (tmp_path / "a.svg").read_bytes().startswith(b"<?xml")  # shows where it fails
    anyway = adapt(run, task_file, library, "-o", tmp_path / "a.h5", "--anyway")
    assert anyway.exit_code == 1
    assert read_skill(tmp_path / "a.h5").operation.command == "adapt"
    assert (
        adapt(run, task_file, library, "-o", tmp_path / "a.h5").exit_code == 1
    )  # up to date, and still not done


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("tolerance", "tolerence"), "target.tolerence: there is no such key. Did you mean tolerance?"),
        (("[[via]]", "[[vai]]"), "Did you mean via?"),
        (("within = 0.06", 'within = "6 cm"'), "within: must be a number"),
        (("low = [0.2, 0.1]", "low = [0.3, 0.1]"), "none above it"),
        (("point = [0.11, 0.1]", "point = [0.11, 0.1, 0.0]"), "bend.point: expected 2 numbers"),
        (("[start]", "[start"), "is not TOML"),
    ],
    ids=lambda value: value[1] if isinstance(value, tuple) else "",
)
def test_a_bad_task_file_is_bad_input(run, task_file, library, tmp_path, change, said):
    task_file.write_text(CURVE.replace(*change))
    result = adapt(run, task_file, library, "-o", tmp_path / "a.h5")
    assert result.exit_code == 5
    assert said in result.stderr
    assert str(task_file) in result.stderr


def test_what_is_not_there_is_not_found(run, task_file, library, tmp_path):
    assert adapt(run, tmp_path / "none.toml", library, "-o", tmp_path / "a.h5").exit_code == 4
    task_file.write_text(f'scene = "none.toml"\n{CURVE}')
    assert adapt(run, task_file, library, "-o", tmp_path / "a.h5").exit_code == 4


def test_no_candidate_has_its_own_exit_code(run, task_file, library, tmp_path):
    task_file.write_text(CURVE.replace("0.0, 0.0]", "0.0, 0.0, 0.0, 0.0]"))
    task_file.write_text(
        "[target]\nposition = [0, 0, 0, 0.0]\n[start]\nlow = [0, 0, 0, 1.0]\nhigh = [0, 0, 0, 1.0]\n"
    )
    result = run("adapt", task_file, "--from-store", "--store", library, "-o", tmp_path / "a.h5")
    assert result.exit_code == 6
    assert "0 skills" in result.stderr


def test_skills_are_chosen_from_the_store(run, task_file, library, tmp_path):
    result = run("adapt", task_file, "--from-store", "--store", library, "-o", tmp_path / "a.h5", "--explain")
    assert result.exit_code == 0
    assert "worst clause" in result.stdout
    assert "merged, superposition" in result.stdout


def test_skills_and_store_exclude_each_other(run, task_file, library, tmp_path):
    assert adapt(run, task_file, library, "--from-store", "-o", tmp_path / "a.h5").exit_code == 2
    assert run("adapt", task_file, "--store", library, "-o", tmp_path / "a.h5").exit_code == 2


def test_a_task_is_printed_from_demonstrations_and_done(run, curve_files, library, tmp_path):
    printed = run("adapt", "--print-task", curve_files[0])
    assert printed.exit_code == 0
    (tmp_path / "shown.toml").write_text(printed.stdout)
    task = read_task(tmp_path / "shown.toml")
    assert task.target.position == pytest.approx((0.0, 0.0), abs=1e-4)
    assert task.start.low == task.start.high == pytest.approx((0.2, 0.1), abs=1e-4)
    result = adapt(run, tmp_path / "shown.toml", library, "-o", tmp_path / "a.h5", "--json")
    assert result.exit_code == 0
    assert "demonstrations" in {each["clause"] for each in json.loads(result.stdout)["clauses"]}
    assert len(read_skill(tmp_path / "a.h5").provenance.inputs) == 1


def test_a_task_is_printed_from_a_scenario_with_its_bodies(run, tmp_path):
    (tmp_path / "s.toml").write_text(
        'target = "cup"\nstart = [0.4, 0.0, 0.55]\n[scene]\nkind = "shelf"\n[cup]\nposition = [0.6, 0.1]\n'
        '[[obstacles]]\nkind = "box"\nname = "crate"\nposition = [0.5, -0.3, 0.1]\nsize = [0.2, 0.2, 0.2]\n'
    )
    (tmp_path / "t.toml").write_text(run("adapt", "--print-task", tmp_path / "s.toml").stdout)
    task = read_task(tmp_path / "t.toml")
    assert task.target.position == pytest.approx((0.6, 0.1, 0.76))
    assert [body.name for body in task.keep_out] == ["lower board", "upper board", "rear panel", "crate"]


def test_to_be_like_a_skill_is_judged_by_its_motions(run, task_file, library, tmp_path):
    task_file.write_text(CURVE + '[[like]]\nskill = "curve"\ntolerance = 0.02\n')
    result = adapt(run, task_file, library, "-o", tmp_path / "a.h5", "--json")
    report = json.loads(result.stdout)
    margins = {each["clause"]: each["margin"] for each in report["clauses"]}
    assert result.exit_code == 0
    assert 0 < margins["like"] <= 0.02


def test_verification_judges_clauses_and_a_clause_is_a_test_case(run, task_file, library, tmp_path):
    assert adapt(run, task_file, library, "-o", tmp_path / "a.h5").exit_code == 0
    kept = run("verify-stability", tmp_path / "a.h5", "--task", task_file)
    assert kept.exit_code == 0
    assert "bend" in kept.stdout
    task_file.write_text(CURVE + BOTTLE)
    report = tmp_path / "junit.xml"
    failed = run("verify-stability", tmp_path / "a.h5", "--task", task_file, "--report", f"junit={report}")
    assert failed.exit_code == 1
    assert "bottle fails by" in failed.stdout
    suite = next(iter(JUnitXml.fromfile(str(report))))
    cases = {case.name.rpartition(": ")[2]: case for case in suite}
    assert [name for name, case in cases.items() if case.result] == [str(tmp_path / "a.h5"), "bottle"]
    assert "margin -" in cases["bottle"].result[0].message
    assert (suite.tests, suite.failures) == (5, 2)


@pytest.mark.skipif(importlib.util.find_spec("pybullet") is None, reason="PyBullet is not installed")
def test_a_simulated_motion_is_judged_by_the_clauses(run, library, tmp_path):
    text = (
        "[target]\nposition = [0.6, 0.1, 0.5]\n[start]\npoints = [[0.4, 0.0, 0.5]]\n"
        '[[via]]\nname = "above"\npoint = [0.5, 0.05, HEIGHT]\nwithin = 0.02\n'
    )
    task = tmp_path / "t.toml"
    arguments = ("simulate", "reach", "--store", library, "--demo", "0", "--task", task, "--json")
    reports = {}
    for height in ("0.58", "0.50"):  # the demonstrations bend up by 8 cm
        task.write_text(text.replace("HEIGHT", height))
        result = run(*arguments)
        reports[height] = (result.exit_code, json.loads(result.stdout))
    (kept, above), (failed, below) = reports.values()
    assert (kept, above["success"], failed, below["success"]) == (0, True, 1, False)
    margins = {clause["clause"]: clause["margin"] for clause in below["task"]["clauses"]}
    assert -0.08 < margins["above"] < -0.04
    assert margins["target"] > 0
