"""What is there already is not made again; whatever decides the result is a reason to, and is named."""

from __future__ import annotations

import os
import shutil

import pytest

from skillctl import store


@pytest.fixture
def skills(tmp_path, library, curve_files, monkeypatch):
    """A store of curve, hook and plain, and demonstrations, in the working directory."""
    monkeypatch.chdir(tmp_path)
    registry = store.Registry(tmp_path / "skills")
    for name in ("curve", "hook", "plain"):
        registry.publish(name, (library / name / "1.h5").read_bytes())
    for path in curve_files:
        shutil.copy(path, tmp_path)
    return registry


MERGE = ["merge", "curve", "hook"]
COMBINE = ["combine", "curve", "hook"]
CHAIN = ["chain", "curve", "hook"]
FIT = ["merge", "curve", "hook", "--fit", "curve-0.csv"]
SEARCH = ["merge", "--from-store", "--fit", "curve-0.csv"]


def made(run, command, *more):
    """Run a command that succeeds; return why it made something, or None if that was up to date."""
    result = run(*command, *more, "--explain")
    assert result.exit_code == 0, result.stderr
    reasons = [line.removeprefix("because: ") for line in result.stderr.splitlines() if "because" in line]
    assert ("is up to date" in result.stdout) == (not reasons)
    return reasons or None


@pytest.mark.parametrize("command", [MERGE, COMBINE, FIT, SEARCH], ids=lambda command: " ".join(command[:4]))
@pytest.mark.parametrize("place", [["-o", "out.h5"], ["--name", "out"]], ids=["file", "store"])
def test_the_same_again_is_up_to_date_and_the_file_stays(run, skills, tmp_path, command, place):
    assert made(run, command, *place) == ["there is no readable skill yet"]
    path = tmp_path / "out.h5" if "-o" in place else skills.path_of("out", 1)
    before = path.read_bytes(), path.stat().st_ino
    assert made(run, command, *place) is None
    assert made(run, command, *place, "--force") == ["it was asked for"]
    assert (path.read_bytes(), path.stat().st_ino) == before  # the same bytes are not written again
    assert "out" not in skills.names() or skills.versions("out") == (1,)


@pytest.mark.parametrize(
    ("command", "change", "reason"),
    [
        (MERGE, ["--weights", "2,1"], "part_weights is 2.0,1.0 and was not set"),
        (MERGE, ["--gate", "density"], "gate is density and was superposition"),
        (MERGE, ["--speed", "2"], "speed is 2.0 and was not set"),
        (MERGE, ["--target", "0.1,0"], "target is 0.1,0.0 and was not set"),
        (MERGE, ["--no-refit"], "refit is False and was True"),
        (MERGE, ["-m", "new"], "the note is another one"),
        (COMBINE, ["--align"], "align is True and was False"),
        (COMBINE, ["--priors", "2,1"], "part_priors is 2.0,1.0 and was not set"),
        (COMBINE, ["--calibrate"], "calibrate is True and was False"),
        (COMBINE, ["--gate", "instantaneous"], "gate is instantaneous and was latched"),
        (CHAIN, ["--within", "1mm"], "within is 0.001m and was not set"),
        (CHAIN, ["--event", "1:close"], "event is 1:close and was not set"),
        (CHAIN, ["--on-jump", "back"], "on_jump is back and was stay"),
        (CHAIN, ["--target", "2=0,0.01"], "target is 2=0.0,0.01 and was not set"),
        (CHAIN, ["--disturbance-distance", "0.1"], "disturbance_distance is 0.1 and was not set"),
        (COMBINE, ["--no-refit"], "refit is False and was not set"),
        (FIT, ["--fit", "curve-1.csv"], "it was made from 1 files, not 2"),
        (FIT, ["--fit-level", "component"], "fit_level is component and was part"),
        (FIT, ["--target", "0,0.01"], "target is 0.0,0.01 and was not set"),
    ],
)
def test_every_option_that_decides_is_a_reason(run, skills, command, change, reason):
    made(run, command, "-o", "out.h5")
    assert made(run, [*command, *change], "-o", "out.h5") == [reason]
    assert made(run, [*command, *change], "-o", "out.h5") is None


@pytest.mark.parametrize("command", [MERGE, COMBINE, CHAIN, FIT], ids=lambda command: " ".join(command[:4]))
def test_other_parents_are_a_reason_and_the_same_under_other_names_are_none(run, skills, tmp_path, command):
    made(run, command, "-o", "out.h5")
    shutil.copy(skills.path_of("curve", 1), tmp_path / "copy.h5")
    renamed = [word.replace("curve", "copy.h5") if word == "curve" else word for word in command]
    assert made(run, renamed, "-o", "out.h5") is None  # content counts
    skills.publish("curve", skills.path_of("plain", 1).read_bytes())
    (reason,) = made(run, command, "-o", "out.h5")
    assert "curve@2" in reason or "skills to choose from" in reason
    assert made(run, command, "-o", "out.h5") is None
    (reason,) = made(run, [command[0], "hook", "curve", *command[3:]], "-o", "out.h5")[:1]
    assert "1 is hook@1" in reason or "skills to choose from" in reason


def test_another_number_of_parents_is_a_reason(run, skills):
    made(run, COMBINE, "-o", "out.h5")
    reasons = made(run, [*COMBINE, "plain"], "-o", "out.h5")
    assert reasons == ["it was made from 2 skills, not 3"]


def test_skills_of_the_store_that_come_and_go_are_a_reason(run, skills):
    made(run, SEARCH, "-o", "out.h5")
    run("combine", "curve", "hook", "--name", "both")  # combined skills cannot be merged, so nothing changes
    assert made(run, SEARCH, "-o", "out.h5") is None
    assert run("rm", "--all", "plain").exit_code == 0
    assert made(run, SEARCH, "-o", "out.h5") == ["the skills to choose from are others"]


def test_an_edited_demonstration_is_a_reason_and_a_touched_one_is_none(run, skills, tmp_path):
    made(run, FIT, "-o", "out.h5")
    os.utime(tmp_path / "curve-0.csv")
    assert made(run, FIT, "-o", "out.h5") is None
    lines = (tmp_path / "curve-0.csv").read_text().splitlines()
    (tmp_path / "curve-0.csv").write_text("\n".join(lines[:-1]) + "\n")
    assert made(run, FIT, "-o", "out.h5") == ["curve-0.csv has changed"]


def test_a_damaged_result_and_one_of_another_command_are_made_again(run, skills, tmp_path):
    made(run, MERGE, "-o", "out.h5")
    data = (tmp_path / "out.h5").read_bytes()
    (tmp_path / "out.h5").write_bytes(data[:-1])
    assert made(run, MERGE, "-o", "out.h5") == ["there is no readable skill yet"]
    assert (tmp_path / "out.h5").read_bytes() == data
    assert made(run, COMBINE, "-o", "out.h5")
    assert made(run, COMBINE, "-o", "out.h5") is None


def test_another_version_of_the_program_is_a_reason(run, skills, monkeypatch):
    made(run, MERGE, "-o", "out.h5")
    monkeypatch.setattr("skillctl.__version__", "9.9.9")
    (reason,) = made(run, MERGE, "-o", "out.h5")
    assert "and this is 9.9.9" in reason


@pytest.mark.parametrize("command", [MERGE, COMBINE, CHAIN, FIT], ids=lambda command: " ".join(command[:4]))
def test_what_is_up_to_date_is_reported_as_when_it_was_made(run, skills, command):
    import json

    first, second = (json.loads(run(*command, "-o", "out.h5", "--json").stdout) for _ in range(2))
    created = [report["written"].pop("created") for report in (first, second)]
    assert (created, second["status"]) == ([True, False], "up to date")
    changed = {"status", "reasons", "notes", "task"}
    assert {key: first[key] for key in first.keys() - changed} == {
        key: second[key] for key in second.keys() - changed
    }
