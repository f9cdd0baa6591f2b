"""What each command answers when all is well: on standard output, for people and for programs."""

from __future__ import annotations

import importlib.util
import json
import os
import pty

import numpy as np
import pytest

from skillctl.cli.render import SCHEMA_VERSION

needs_pybullet = pytest.mark.skipif(
    importlib.util.find_spec("pybullet") is None, reason="PyBullet has no wheel for this Python"
)


def document(result, code=0):
    """Return the JSON document of a command that succeeded and said nothing else."""
    assert (result.exit_code, result.stderr) == (code, "")
    parsed = json.loads(result.stdout)
    assert parsed["schema_version"] == SCHEMA_VERSION
    return parsed


def test_learn_reports_each_demonstration_and_the_proof(run, curve_files, tmp_path):
    result = run("learn", *curve_files, "-o", tmp_path / "a.h5", "--preset", "fast", "--components", "3")
    assert result.exit_code == 0
    assert result.stderr.startswith("note: the optimiser used all of its 12 steps")
    for path in curve_files:
        assert path.name in result.stdout
    for word in ("stable", "decay rate", "Hz or faster", "sha256:", str(tmp_path / "a.h5")):
        assert word in result.stdout


def test_learn_twice_says_up_to_date_and_leaves_the_file_alone(run, curve_files, tmp_path):
    arguments = ["learn", *curve_files, "-o", tmp_path / "a.h5", "--preset", "fast", "--components", "3"]
    assert document(run(*arguments, "--json"))["status"] == "learned"
    before = (tmp_path / "a.h5").stat()
    again = run(*arguments, "--if-changed")
    assert again.exit_code == 0
    assert "up to date" in again.stdout
    assert (tmp_path / "a.h5").stat().st_mtime_ns == before.st_mtime_ns
    assert document(run(*arguments, "--json"))["status"] == "up to date"
    forced = document(run(*arguments, "--json", "--force"))
    assert (forced["status"], forced["written"]["created"]) == ("learned", False)


@pytest.fixture
def lossy_files(curve_files, tmp_path):
    """Four demonstrations: one lost three samples, and one ends 30 mm, 13 % of the extent, away."""
    tables = [np.loadtxt(path, delimiter=",", skiprows=1) for path in curve_files]
    tables[1][40:43, 1:] = 0
    tables[3][:, 1] += np.linspace(0, 0.03, 101) ** 2 / 0.03
    paths = [tmp_path / path.name for path in curve_files]
    for path, table in zip(paths, tables, strict=True):
        np.savetxt(path, table, delimiter=",", header="t,x,y", comments="", fmt="%.6f")
    return paths


def test_what_is_wrong_with_recordings_is_said_kept_and_shown(run, lossy_files, tmp_path):
    arguments = ["learn", *lossy_files, "-o", tmp_path / "a.h5", "--preset", "fast", "--components", "3"]
    lost = "curve-1.csv: 3 samples are exactly zero, up to 0."
    apart = "curve-3.csv ends 0.03 m from the others, 13% of the extent, at line 102."
    for more in ("-q", "-q"):  # learned, and up to date
        first, second = run(*arguments, more).stderr.splitlines()
        assert first.startswith(f"warning: {lost}")
        assert first.endswith("m off the motion at line 42 to line 44, left out.")
        assert second == f"warning: {apart}"
    kept = document(run(*arguments, "--json"))
    assert kept["warnings"][1] == apart
    shown = run("inspect", tmp_path / "a.h5").stdout
    assert all(sentence in shown for sentence in kept["warnings"])


def test_how_far_demonstrations_were_moved_is_shown(run, lossy_files, tmp_path):
    arguments = ["learn", *lossy_files, "-o", tmp_path / "a.h5", "--preset", "fast", "--components", "3"]
    *others, apart = document(run(*arguments, "--json"))["demonstrations"]
    # The others end at one place, which is the target; rounded to a micrometre in the files.
    assert all(
        other["moved"] <= 2e-6 and other["dtw_unmoved"] == pytest.approx(other["dtw"]) for other in others
    )
    assert apart["moved"] == pytest.approx(0.03, abs=2e-6)
    # A motion from its true start begins on it, and ends 30 mm off.
    assert apart["dtw"] < apart["dtw_unmoved"] < 0.03
    heading = next(line for line in run("inspect", tmp_path / "a.h5").stdout.splitlines() if "DTW" in line)
    assert "moved" in heading
    assert "DTW unmoved" in heading


def test_a_recording_that_is_too_bad_is_refused_unless_it_is_accepted(run, curve_files, tmp_path):
    table = np.loadtxt(curve_files[2], delimiter=",", skiprows=1)
    table[60:, 1:] = 0.9, 0.9
    np.savetxt(bad := tmp_path / "bad.csv", table, delimiter=",", header="t,x,y", comments="")
    arguments = ["learn", *curve_files[:2], bad, "-o", tmp_path / "a.h5", "--preset", "fast"]
    refused = run(*arguments)
    assert refused.exit_code == 5
    assert refused.stderr.startswith("error: bad.csv: 41 samples jump aside")
    assert "still moving at line 61" in refused.stderr
    hint = "hint: Leave all out with --demos 0-1, or accept all with --accept dropouts,ends."
    assert refused.stderr.splitlines()[1] == hint
    assert not (tmp_path / "a.h5").exists()
    assert run(*arguments, "--demos", "0-1").exit_code == 0
    accepted = run(*arguments, "--accept", "dropouts,ends", "--force")
    assert accepted.exit_code == 0
    assert "warning: bad.csv: 41 samples jump aside" in accepted.stderr
    wrong = run(*arguments, "--accept", "end")
    assert wrong.exit_code == 2
    assert "'end' is not one of dropouts, jumps" in wrong.stderr


def test_a_skill_that_does_not_follow_its_demonstrations_is_warned_of(run, tmp_path):
    turn = np.linspace(0, 1.5 * np.pi, 101)
    there = np.column_stack([np.linspace(0, 2, 101), np.cos(turn), np.sin(turn)])
    np.savetxt(path := tmp_path / "a.csv", there, delimiter=",", header="t,x,y", comments="")
    arguments = ["learn", path, "-o", tmp_path / "a.h5", "--components", "1", "--metric", "euclidean"]
    arguments += ["--coordinates", "identity"]
    report = document(run(*arguments, "--preset", "fast", "--json"))
    share = report["demonstrations"][0]["dtw"] / np.sqrt(8)
    assert share > 0.04
    assert any(f"off on average, {share:.0%} of the extent." in sentence for sentence in report["warnings"])


def test_notes_about_the_input_go_to_standard_error(run, curve_files, tmp_path):
    first = curve_files[0].read_text().splitlines()
    rows = [f"{line},1" for line in first[1:]]
    (path := tmp_path / "extra.csv").write_text("\n".join([f"{first[0]},force", *rows]))
    arguments = ["learn", path, "-o", tmp_path / "a.h5", "--components", "3", "--preset", "fast"]
    result = run(*arguments)
    assert result.exit_code == 0
    assert result.stderr.startswith("note: ")
    assert "force" in result.stderr
    assert "note:" not in result.stdout
    quiet = run(*arguments, "-q", "--force")
    assert quiet.stderr == ""
    assert any("force" in note for note in document(run(*arguments, "--json", "--force"))["notes"])


def test_merge_and_combine_report_parts_and_proof(run, library, tmp_path):
    merged = document(run("merge", "curve", "hook", "--store", library, "-o", tmp_path / "m.h5", "--json"))
    assert [part["skill"] for part in merged["parts"]] == ["curve@1", "hook@1"]
    assert merged["certificate"]["rate"] > 0
    assert merged["attractor"] == pytest.approx([0.05, 0.025], abs=1e-3)  # the mean of both ends; 1 mm drift
    combined = document(
        run("combine", "curve", "hook", "--store", library, "-o", tmp_path / "c.h5", "--json")
    )
    assert combined["certificate"]["verdict"] == "stable"
    assert len(combined["attractors"]) == 2
    assert [part["kept"] for part in combined["coverage"]] == [1.0, 1.0]
    for arguments in (["merge"], ["combine"]):
        text = run(*arguments, "curve", "hook", "--store", library, "-o", tmp_path / "x.h5")
        assert (text.exit_code, text.stderr) == (0, "")
        assert "curve@1" in text.stdout
        assert "stable" in text.stdout


@pytest.mark.parametrize("gate", ["latched", "instantaneous"])
def test_a_part_that_seldom_acts_where_it_was_taught_is_told_though_all_is_proved(
    run, library, tmp_path, gate
):
    one_end = ["--align", "--target", "0,0", "--gate", gate, "-o", tmp_path / "c.h5"]
    command = ["combine", "curve", "hook", "--store", library, *one_end]
    even = run(*command)
    assert "warning" not in even.stderr
    result = run(*command, "--priors", "1,1e-200")
    assert (result.exit_code, "stable" in result.stdout) == (0, True)
    told = " ".join(result.stderr.split())
    assert "warning: 4 of the 4 demonstrations of part 2, left out in turn, start where another part" in told
    assert "of part 1, left out" not in told
    assert "--calibrate" in told
    assert "left out" not in run(*command, "--priors", "1,1e-200", "--force", "--quiet").stderr


def test_the_same_part_twice_is_allowed_and_said(run, library, tmp_path):
    result = run("merge", "curve", "curve", "--store", library, "-o", tmp_path / "m.h5")
    assert result.exit_code == 0
    assert "same motion" in result.stderr


def test_what_is_not_guaranteed_is_said_plainly(run, library, tmp_path):
    arguments = ["combine", "curve", "hook", "--gate", "instantaneous", "--store", library]
    result = run(*arguments, "-o", tmp_path / "i.h5")
    assert result.exit_code == 0
    assert "warning: not guaranteed: " in result.stderr
    report = document(run(*arguments, "-o", tmp_path / "i.h5", "--json"))
    assert report["certificate"]["verdict"] != "stable"
    assert report["certificate"]["failures"] + report["certificate"]["evidence"]
    assert run("verify-stability", tmp_path / "i.h5").exit_code == 3  # no proof, and no witness


def test_instantaneous_and_aligned_needs_and_gets_a_common_proof(run, library, tmp_path):
    result = run(
        *("combine", "curve", "plain", "--gate", "instantaneous", "--align", "--store", library),
        *("-o", tmp_path / "c.h5", "--json"),
    )
    report = document(result)
    proved = report["certificate"]
    assert (proved["verdict"], proved["scope"], proved["failures"]) == ("stable", "global", [])


def test_inspect_shows_everything_and_json_the_numbers(run, library, tmp_path):
    run("merge", "curve", "hook", "--weights", "3,1", "--store", library, "-o", tmp_path / "m.h5")
    text = run("inspect", tmp_path / "m.h5")
    assert (text.exit_code, text.stderr) == (0, "")
    for word in ("merged (superposition; shares 0.75, 0.25", "x, y in m", "curve@1", "4 of 4", "stable"):
        assert word in text.stdout
    assert "hook-3.csv" not in text.stdout
    assert "hook-3.csv" in run("inspect", tmp_path / "m.h5", "--demos").stdout
    both = run("inspect", tmp_path / "m.h5", "--lineage", "--at", "0,0")
    assert (both.exit_code, both.stdout) == (2, "")
    report = document(run("inspect", tmp_path / "m.h5", "--json"))
    assert [leaf["n_components"] for leaf in report["leaves"]] == [3, 3]
    assert np.shape(report["leaves"][0]["joint_mixture"]["covariances"]) == (3, 4, 4)
    assert report["provenance"]["parents"][0]["name"] == "curve"
    assert report["certificate"]["digest"] == report["digest"]


def test_verify_stability_exits_zero_only_when_all_are_proved(run, library, tmp_path, save_with_matrix):
    result = run("verify-stability", "curve", "hook", "reach", "--store", library)
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.count("stable") == 3
    barely = np.diag([-1.0, 1e-9])  # and only this one
    save_with_matrix("curve", 1, barely, tmp_path / "bad.h5")
    result = run("verify-stability", "curve", tmp_path / "bad.h5", "--store", library)
    assert (result.exit_code, result.stderr) == (1, "")
    assert "not proved" in result.stdout
    assert "leaf 1, component 2:" in result.stdout
    report = document(run("verify-stability", tmp_path / "bad.h5", "--json"), code=1)
    proved = [part["proved"] for part in report["skills"][0]["certificate"]["parts"][0]["components"]]
    assert proved == [True, False, True]


def test_verification_as_json_tells_about_unreadable_skills_too(run, library, tmp_path):
    (bad := tmp_path / "bad.h5").write_text("x")
    result = run("verify-stability", "curve", bad, "--store", library, "--json")
    assert result.exit_code == 7
    first, second = json.loads(result.stdout)["skills"]
    assert (first["error"], second["certificate"]) == (None, None)
    assert second["error"]["code"] == 7
    assert json.loads(result.stderr)["code"] == 7


def test_ls_lists_names_and_versions(run, library):
    report = document(run("ls", "--store", library, "--json"))
    assert [skill["name"] for skill in report["skills"]] == ["curve", "hook", "plain", "reach"]
    assert report["skills"][0]["versions"] == [1]
    assert "curve" in run("ls", "--store", library).stdout


def test_names_of_the_store_get_versions(run, curve_files, tmp_path):
    learned = ["learn", *curve_files, "--name", "a", "--store", tmp_path, "--preset", "fast", "--json"]
    assert document(run(*learned, "--components", "2"))["written"]["skill"] == "a@1"
    assert document(run(*learned, "--components", "3"))["written"]["skill"] == "a@2"
    assert document(run(*learned, "--components", "3"))["written"]["skill"] == "a@2"
    digests = {
        reference: document(run("inspect", reference, "--store", tmp_path, "--json"))["digest"]
        for reference in ("a", "a@1", "a@2", "a@latest")
    }
    assert digests["a"] == digests["a@2"] == digests["a@latest"] != digests["a@1"]


def test_the_store_is_found_as_documented(shell, run, library, tmp_path):
    below = tmp_path / "project" / "deep"
    below.mkdir(parents=True)
    (tmp_path / "project" / "skills").symlink_to(library, target_is_directory=True)
    environment = {**os.environ, "XDG_DATA_HOME": str(tmp_path / "data")}
    empty = shell("ls", "--json", env=environment)
    assert json.loads(empty.stdout)["store"] == str(tmp_path / "data" / "skillctl" / "skills")
    by_variable = shell("ls", "--json", env={**environment, "SKILLCTL_STORE": str(library)})
    assert len(json.loads(by_variable.stdout)["skills"]) == 4
    explicit = shell("ls", "--json", "--store", tmp_path, env={**environment, "SKILLCTL_STORE": str(library)})
    assert json.loads(explicit.stdout)["skills"] == []


@needs_pybullet
def test_simulate_reaches_reports_and_writes(run, library, tmp_path):
    log, picture = tmp_path / "l.csv", tmp_path / "p.png"
    result = run("simulate", "reach", "--demo", "0", "--store", library, "--log", log, "--picture", picture)
    assert result.exit_code == 0
    assert "reached" in result.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")
    report = json.loads(run("simulate", "reach", "--demo", "0", "--store", library, "--json").stdout)
    assert report["success"] is True
    assert report["metrics"]["final_error"] < 2e-3
    assert report["metrics"]["tracking_p95"] < 3e-3


@needs_pybullet
def test_the_same_simulation_gives_the_same_log_in_another_process(shell, library, tmp_path):
    for name in ("a.csv", "b.csv"):
        assert shell("simulate", "curve", "--demo", "1", "--store", library, "--log", name).returncode == 0
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


@needs_pybullet
def test_pybullet_prints_nothing_on_standard_output(shell, library):
    result = shell("simulate", "reach", "--store", library, "--json")
    json.loads(result.stdout)


@needs_pybullet
@pytest.mark.parametrize(
    ("arguments", "code", "word"),
    [
        (["reach", "--target", "3,0,0.5"], 1, "unreachable"),
        (["reach", "--start", "0,0,9"], 1, "unreachable"),
        (["reach", "--target", "0.5,0"], 2, "3"),
        (["reach", "--target", "nan,0,0.5"], 2, "finite"),
        (["reach", "--target", "630,0,-760"], 2, "millimetres, which are 0.63,0,-0.76?"),
        (["reach", "--demo", "7"], 2, "counted from 0"),
        (["reach", "--demo", "0", "--start", "0.4,0,0.5"], 2, "--demo"),
        (["reach", "--picture", "no/such/p.png"], 8, "no/such"),
        (["curve", "--scale", "-1"], 2, "scale"),
        (["reach", "--target", "cup"], 2, "something to stand on"),
        (["reach", "--target", "cup", "--scene", "shelf", "--cup", "0.3,0"], 2, "is not on a board"),
        (["reach", "--push", "1,0.5,10"], 2, "'--push': expected 5 numbers"),
        (["reach", "--scenario", "none.toml"], 4, "none.toml"),
        (["reach", "--log", "reach.txt"], 2, ".h5"),
        ([], 2, "SKILL"),
        (["curve", "--plane", "zz"], 2, "--plane"),
    ],
)
def test_a_simulation_that_cannot_be_is_refused(run, library, arguments, code, word):
    result = run("simulate", *arguments, "--store", library)
    assert (result.exit_code, result.stdout) == (code, "")
    assert word in result.stderr
    assert result.stderr.count("\n") == 2


@needs_pybullet
def test_a_goal_not_reached_is_an_answer_with_exit_code_one(run, library):
    result = run("simulate", "reach", "--demo", "0", "--max-duration", "0.2", "--store", library)
    assert result.exit_code == 1
    assert "timeout" in result.stdout


def test_a_terminal_gets_rules_and_colour_and_a_pipe_does_not(shell, library):
    main, terminal = pty.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "100"}
    result = shell(
        "verify-stability",
        "curve",
        "--store",
        library,
        capture_output=False,
        stdout=terminal,
        env=environment,
    )
    assert result.returncode == 0
    shown = os.read(main, 65536).decode()
    os.close(main)
    os.close(terminal)
    assert "─" in shown
    assert "\x1b[32mstable" in shown
    piped = shell("verify-stability", "curve", "--store", library, env=environment).stdout
    assert "\x1b" not in piped
    assert "─" not in piped


def test_a_printed_scenario_is_read_back(run, tmp_path):
    typed = ["--scene", "shelf", "--target", "cup", "--cup", "0.6,0.2,bottom", "--push", "1,0.5,0,40,0"]
    printed = run("simulate", *typed, "--print-scenario", "--start", "home").stdout
    (file := tmp_path / "s.toml").write_text(printed)
    assert run("simulate", "--scenario", file, "--print-scenario").stdout == printed
    moved = run("simulate", "--scenario", file, "--cup", "0.6,0.1", "--seed", "3", "--print-scenario").stdout
    assert "position = [0.6, 0.1]" in moved
    assert 'board = "bottom"' in moved
    assert "seed = 3" in moved


def test_a_bad_scenario_is_bad_input(run, tmp_path):
    (file := tmp_path / "s.toml").write_text("[cup]\nmas = 1\n")
    result = run("simulate", "any", "--scenario", file)
    assert result.exit_code == 5
    assert f"{file}: cup.mas: there is no such key. Did you mean mass?" in result.stderr


@needs_pybullet
def test_a_failure_is_told_in_words(run, library):
    typed = ["--scene", "shelf", "--target", "cup", "--cup", "0.62,0,bottom", "--max-duration", "0.4"]
    report = json.loads(run("simulate", "reach", *typed, "--store", library, "--json").stdout)
    assert report["outcome"] == "timeout"
    assert report["detail"].endswith("after 0.4 s")
    assert report["scenario"]["cup"]["board"] == "bottom"
    assert report["metrics"]["clearance"] > 0
    shown = run("simulate", "reach", *typed, "--store", library)
    assert shown.exit_code == 1
    assert "timeout: the hand was" in shown.stdout
