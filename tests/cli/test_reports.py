"""Reports of verify-stability: in the forms other programs read, complete whatever is wrong with a skill."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import sarif_pydantic
from junitparser import Error, Failure, JUnitXml

from skillctl import store
from skillctl.compose.options import CombineOptions
from skillctl.store.source import open_skill
from skillctl.usecases.combine import combine
from skillctl.usecases.files import load, save


@pytest.fixture
def mixed(library, tmp_path, save_with_matrix):
    """Four references: proved, not proved, unreadable, and not there."""
    save_with_matrix("curve", 1, np.diag([-1.0, 1e-9]), tmp_path / "bad%,:.h5")
    (tmp_path / "noise\x1b.h5").write_text("x")
    return [
        "curve",
        tmp_path / "bad%,:.h5",
        tmp_path / "noise\x1b.h5",
        tmp_path / "gone.h5",
        "--store",
        library,
    ]


@pytest.fixture
def digest(library):
    return open_skill("curve", library).artifact.digest


def test_junit_tells_proved_failed_and_unreadable_apart(run, mixed, digest, tmp_path):
    result = run("verify-stability", *mixed, "--report", f"junit={tmp_path / 'r.xml'}")
    assert result.exit_code == 7
    document = JUnitXml.fromfile(str(tmp_path / "r.xml"))
    (suite,) = document
    assert (suite.tests, suite.failures, suite.errors, suite.skipped) == (4, 1, 2, 0)
    cases = list(suite)
    assert cases[0].name == "curve@1"
    assert [[type(entry) for entry in case.result] for case in cases] == [[], [Failure], [Error], [Error]]
    assert digest in cases[0].system_out
    assert "component 2" in cases[1].result[0].message


def test_sarif_names_every_skill_with_its_digest(run, mixed, digest, tmp_path):
    run("verify-stability", *mixed, "--report", f"sarif={tmp_path / 'r.sarif'}")
    document = json.loads((tmp_path / "r.sarif").read_text(encoding="utf-8"))
    sarif_pydantic.Sarif.model_validate(document)
    # What the standard requires and the model leaves open (sections 3.13, 3.14, 3.19, 3.27, 3.49).
    assert document["version"] == "2.1.0"
    (run_,) = document["runs"]
    rules = run_["tool"]["driver"]["rules"]
    assert run_["tool"]["driver"]["name"]
    assert len({rule["id"] for rule in rules}) == len(rules)
    assert [r["level"] for r in run_["results"]] == ["none", "error", "error", "error"]
    for result in run_["results"]:
        assert rules[result["ruleIndex"]]["id"] == result["ruleId"]
        assert result["kind"] in ("pass", "fail")
        assert (result["kind"] == "pass") == (result["level"] == "none")  # section 3.27.10
        assert result["message"]["text"]
        uri = result["locations"][0]["physicalLocation"]["artifactLocation"]["uri"]
        assert not set(uri) & set(" \x1b,")
    assert run_["results"][0]["partialFingerprints"] == {"skillContent/v1": digest}
    assert "%25" in run_["results"][1]["locations"][0]["physicalLocation"]["artifactLocation"]["uri"]


def test_the_json_report_is_what_json_prints(run, mixed, tmp_path):
    result = run("verify-stability", *mixed, "--json", "--report", f"json={tmp_path / 'r.json'}")
    assert json.loads((tmp_path / "r.json").read_text()) == json.loads(result.stdout)


def test_annotations_are_one_escaped_line_a_skill(run, mixed):
    result = run("verify-stability", *mixed, "--format", "github")
    lines = result.stdout.splitlines()
    assert len(lines) == 4
    assert all(line.startswith("::error file=") for line in lines[:3])
    assert "bad%25%2C%3A.h5,title=skillctl verify-stability%3A not proved::" in lines[0]
    assert "\x1b" not in result.stdout
    assert lines[3] == "1 of 4 skills proved."
    assert run("verify-stability", *mixed, "--format", "github", "--json").exit_code == 2


def test_several_reports_at_once_but_each_in_its_own_file(run, library, tmp_path):
    one, two = tmp_path / "a.xml", tmp_path / "b.sarif"
    arguments = ["verify-stability", "curve", "--store", library, "--report", f"junit={one}"]
    assert run(*arguments, "--report", f"sarif={two}").exit_code == 0
    assert one.exists()
    assert two.exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.xml", "b.sarif"]  # nothing temporary
    assert run(*arguments, "--report", f"json={one}").exit_code == 2
    for wrong in ("xml=a", "junit=", "junit"):
        assert run("verify-stability", "curve", "--report", wrong).exit_code == 2
    assert run(*arguments[:-2], "--report", f"junit={tmp_path / 'no' / 'x.xml'}").exit_code == 8


def test_a_period_and_a_rate_can_be_required(run, library):
    proved = open_skill("curve", library)
    document = json.loads(run("verify-stability", "curve", "--store", library, "--json").stdout)
    certificate = document["skills"][0]["certificate"]
    assert document["skills"][0]["digest"] == certificate["digest"] == proved.artifact.digest
    for option, proved_value, above in (("--period", "period", 1.01), ("--min-rate", "rate", 1.01)):
        exactly = certificate[proved_value]
        arguments = ["verify-stability", "curve", "--store", library, option]
        assert run(*arguments, repr(exactly)).exit_code == 0
        refused = run(*arguments, repr(above * exactly))
        assert refused.exit_code == 1
        row, told = refused.stdout.splitlines()[1], refused.stdout.split("\n\n")[1]
        # The skill is stable, and that is not enough: each is said where it belongs.
        assert row.split()[1:4] == ["stable", "not", "proved"]
        assert told.splitlines()[0] == "curve@1: what is required is not proved"
        assert "Required is a" in told
        verdict = json.loads(run(*arguments, repr(above * exactly), "--json").stdout)["skills"][0]
        assert (verdict["certificate"]["verdict"], verdict["outcome"]) == ("stable", "not proved")
        for wrong in ("0", "-1", "nan"):
            assert run(*arguments, wrong).exit_code == 2


def test_a_local_proof_is_enough_where_that_is_required(run, library, tmp_path):
    path = tmp_path / "i.h5"
    combine(["curve", "hook"], output=path, store=library, options=CombineOptions(gate="instantaneous"))
    usual = json.loads(run("verify-stability", path, "--json").stdout)["skills"][0]
    assert usual["certificate"]["scope"] == "local"
    assert run("verify-stability", path).exit_code == 3  # no proof, and no witness
    assert run("verify-stability", path, "--require", "local").exit_code == 0
    document = json.loads(run("verify-stability", path, "--require", "local", "--json").stdout)
    assert (document["skills"][0]["outcome"], document["required"]["scope"]) == ("proved", "local")
    told = run("verify-stability", path, "--require", "local").stdout
    assert told.splitlines()[0].split()[:3] == ["skill", "verdict", "required"]
    assert told.splitlines()[1].split()[1:4] == [usual["certificate"]["verdict"], "proved", "local"]
    assert f"{path}: what is required is proved" in told


def test_a_period_that_is_too_long_for_a_local_proof_is_not_proved_rather_than_open(run, library, tmp_path):
    path = tmp_path / "i.h5"
    combine(["curve", "hook"], output=path, store=library, options=CombineOptions(gate="instantaneous"))
    usual = json.loads(run("verify-stability", path, "--json").stdout)["skills"][0]
    assert (usual["certificate"]["verdict"], usual["certificate"]["scope"]) == ("inconclusive", "local")
    longer = repr(1.01 * usual["certificate"]["period"])
    assert run("verify-stability", path, "--require", "local", "--period", longer).exit_code == 1
    assert run("verify-stability", path, "--period", longer).exit_code == 3  # whether it arrives is open


def test_bounds_of_motions_are_required_and_reported(run, library, tmp_path):
    """The curve's demonstrations start between x = 0.20 and 0.23, at y = 0.1, and end at the origin."""
    arguments = ["verify-stability", "curve", "--store", library, "--start-box"]
    (verdict,) = json.loads(run(*arguments, "demos", "--json").stdout)["skills"]
    reach = verdict["reach"]
    # Rests are cut off: a demonstration begins once it has covered a small share of its way.
    assert reach["start_low"] == pytest.approx([0.20, 0.1], abs=2e-3)
    assert reach["start_high"] == pytest.approx([0.23, 0.1], abs=2e-3)
    assert reach["low"][0] < reach["measured"]["low"][0] <= 0 < 0.23 < reach["high"][0]
    assert reach["measured"]["arrival"] < reach["arrival"]
    assert reach["period"] == 0.5 * verdict["certificate"]["period"]
    exactly = ",".join(f"{low!r}:{high!r}" for low, high in zip(reach["low"], reach["high"], strict=True))
    assert run(*arguments, "demos", "--stay-in", exactly).exit_code == 0
    assert run(*arguments, "demos", "--stay-in", ":,:").exit_code == 0
    less = 0.97 * reach["high"][0]  # beyond all starts
    junit = tmp_path / "r.xml"
    refused = run(*arguments, "demos", "--stay-in", f":{less!r},:", "--report", f"junit={junit}")
    assert refused.exit_code == 1
    (case,) = next(iter(JUnitXml.fromfile(str(junit))))
    for text in (refused.stdout, case.result[0].message):
        assert f"Motions may leave the box: required is x ≤ {less:g} m; proved is ≤ " in text
        assert "x ≥" not in text
    assert "from the start box stays in x from -" in case.system_out
    assert (
        "Motions leave the box: required is x ≤ 0.22 m"
        in run(*arguments, "demos", "--stay-in", ":0.22,:").stdout
    )


def test_bounds_are_those_of_the_start_box_and_the_period(run, library):
    def reach(*options):
        result = run("verify-stability", "curve", "--store", library, *options, "--json")
        return json.loads(result.stdout)["skills"][0]["reach"]

    near, far = reach("--start-box", "0.1,0.05:0.06"), reach("--start-box", "0.1:0.2,-0.1:0.1")
    assert (near["start_low"], near["start_high"]) == ([0.1, 0.05], [0.1, 0.06])
    assert near["high"][0] < far["high"][0]
    assert near["parts"][0]["level"] < far["parts"][0]["level"]
    assert near["arrival"] < far["arrival"]
    period = 0.1 * near["period"]
    assert reach("--start-box", "0.1,0.05:0.06", "--period", repr(period))["period"] == period
    assert reach("--start-box", "0.1,0.05:0.06", "--period", "1000") is None
    assert reach() is None


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--stay-in", "0:1,0:1"], "where the motions start is not given"),
        (["--start-box", "0.1"], "a range for each coordinate of curve@1 (x, y), got 1"),
        (
            ["--start-box", "demos", "--stay-in", ":,:,:"],
            "a range for each coordinate of curve@1 (x, y), got 3",
        ),
        (["--start-box", "0.2:0.1,0"], "must not end before it starts, got 0.2:0.1"),
        (["--start-box", "0.2:,0"], "both ends must be finite, got 0.2:inf"),
        (["--start-box", "nan,0"], "must not end before it starts"),
        (["--start-box", "0.2,y"], "is not a range for each coordinate"),
        (["--start-box", "0.2,0", "--stay-in", "0.2,,0"], "is not a range for each coordinate"),
    ],
)
def test_a_box_that_makes_no_sense_is_refused(run, library, options, reason):
    result = run("verify-stability", "curve", "--store", library, *options)
    assert (result.exit_code, result.stdout) == (2, "")
    assert reason in result.stderr


def test_without_demonstrations_or_a_proof_nothing_is_bounded(run, library, tmp_path, save_with_matrix):
    bare = save(load("curve", store=library), tmp_path / "bare.h5")
    result = run("verify-stability", bare, "--start-box", "demos")
    assert (result.exit_code, result.stdout) == (2, "")
    assert f"start-box: {bare} carries no demonstrations." in result.stderr
    bad = save_with_matrix("curve", 1, np.eye(2), tmp_path / "bad.h5")
    verdict = json.loads(run("verify-stability", bad, "--start-box", "0.1,0.1", "--json").stdout)["skills"][0]
    assert (verdict["outcome"], verdict["reach"]) == ("not proved", None)
    longer = run("verify-stability", bare, "--start-box", "0,0", "--stay-in", ":,:", "--period", "1000")
    assert longer.exit_code == 1
    assert "no bound of their way is proved" in longer.stdout


def test_golden_motions_are_required_and_reported(run, library, tmp_path):
    report = tmp_path / "r.xml"
    options = ["--golden", "--store", library, "--report", f"junit={report}"]
    result = run("verify-stability", "curve", *options)
    assert result.exit_code == 0
    assert "is 0 m, where" in result.stdout
    names = [case.name for case in next(iter(JUnitXml.fromfile(str(report))))]
    assert names == ["curve@1", "curve@1: golden motions"]
    (verdict,) = json.loads(run("verify-stability", "curve", *options, "--json").stdout)["skills"]
    assert verdict["golden"]["agrees"] is True
    assert verdict["golden"]["largest"] == 0
    assert (
        json.loads(run("verify-stability", "curve", "--store", library, "--json").stdout)["golden"] is False
    )


def test_golden_motions_that_are_missed_are_not_proved(run, library, tmp_path):
    artifact = open_skill("curve", library).artifact
    states = artifact.golden.states.copy()
    states[1, 7, 0] += 3e-6
    (tmp_path / "other.h5").write_bytes(
        store.encode(replace(artifact, golden=replace(artifact.golden, states=states)))
    )
    result = run(
        "verify-stability", tmp_path / "other.h5", "--golden", "--report", f"junit={tmp_path / 'r.xml'}"
    )
    assert result.exit_code == 1
    assert "It does not agree with its golden motions" in result.stdout
    assert "3e-06 m, where" in " ".join(result.stdout.split())
    (suite,) = JUnitXml.fromfile(str(tmp_path / "r.xml"))
    assert (suite.tests, suite.failures) == (2, 2)
    assert run("verify-stability", tmp_path / "other.h5").exit_code == 0


def test_without_golden_motions_it_is_open_whether_they_agree(run, library, tmp_path):
    artifact = open_skill("curve", library).artifact
    (tmp_path / "old.h5").write_bytes(store.encode(replace(artifact, golden=None)))
    result = run("verify-stability", tmp_path / "old.h5", "--golden")
    assert result.exit_code == 3
    assert "It holds no golden motions" in result.stdout
