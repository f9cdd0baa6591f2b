"""Bad input, command by command: one sentence, a hint, the exit code, and nothing written."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from skillctl import errors
from skillctl.cli.exit_codes import ExitCode
from skillctl.store.errors import NotAnArtifactError

GOOD = "t,x,y\n0,0,0\n0.1,0.1,0\n0.2,0.2,0.1\n0.3,0.3,0.1\n"

BAD_TABLES = {
    "empty": ("", 5, ["empty"]),
    "header-only": ("t,x,y\n", 5, ["no rows"]),
    "not-a-number": (GOOD.replace("0.2,0.1", "0.2,abc"), 5, ["line 4", "'y'", "abc"]),
    "nan": (GOOD.replace("0.2,0.1", "nan,0.1"), 5, ["line 4", "'x'"]),
    "one-point": ("t,x,y\n0,0,0\n", 5, ["one point"]),
    "all-equal": ("t,x,y\n0,1,2\n0.1,1,2\n0.2,1,2\n", 5, ["all points are equal"]),
    "time-backwards": ("t,x,y\n0,0,0\n0.2,1,0\n0.1,2,0\n", 5, ["line 4", "time"]),
    "no-time": ("x,y\n0,0\n1,1\n2,1\n", 5, ["--dt"]),
    "binary": ("t,x\n\x00\x01\x02", 5, ["format"]),
}


def refusal(result, code):
    """Return the one line that says what is wrong, after checking the form of the whole answer."""
    assert (result.exit_code, result.stdout) == (code, ""), result.stderr
    error, hint = result.stderr.splitlines()
    assert error.startswith("error: ")
    assert hint.startswith("hint: ")
    assert error.endswith((".", "?"))
    assert hint[len("hint: ") :].strip()
    assert "Traceback" not in result.stderr
    return result.stderr


@pytest.mark.parametrize("name", BAD_TABLES)
def test_a_bad_table_is_refused_with_file_and_place(run, tmp_path, name):
    text, code, words = BAD_TABLES[name]
    (path := tmp_path / f"{name}.csv").write_text(text)
    said = refusal(run("learn", path, "-o", tmp_path / "a.h5"), code)
    assert str(path) in said
    for word in words:
        assert word in said
    assert sorted(entry.name for entry in tmp_path.iterdir()) == [path.name]


@pytest.mark.parametrize("name", BAD_TABLES)
def test_the_same_refusal_as_json_is_one_document(run, tmp_path, name):
    text, code, words = BAD_TABLES[name]
    (path := tmp_path / f"{name}.csv").write_text(text)
    result = run("learn", path, "-o", tmp_path / "a.h5", "--json")
    assert (result.exit_code, result.stdout) == (code, "")
    document = json.loads(result.stderr)
    assert document["code"] == code
    assert all(word in document["message"] + document["hint"] for word in words)
    assert document["hint"]


def test_repeated_times_are_refused_with_file_and_line(run, tmp_path):
    (path := tmp_path / "twice.csv").write_text(GOOD.replace("0.2,0.2,0.1", "0.1,0.2,0.1"))
    said = refusal(run("learn", path, "-o", tmp_path / "a.h5", "--components", "1"), 5)
    assert "twice.csv, line 4: time stamp 0.1 s repeats" in said


def test_a_missing_demonstration_file_is_not_found(run, tmp_path):
    said = refusal(run("learn", tmp_path / "nowhere.csv", "-o", tmp_path / "a.h5"), 4)
    assert "nowhere.csv" in said
    assert list(tmp_path.iterdir()) == []


def test_a_directory_is_no_demonstration(run, tmp_path):
    refusal(run("learn", tmp_path, "-o", tmp_path / "a.h5"), 5)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_an_unreadable_demonstration_is_refused(run, tmp_path):
    (path := tmp_path / "secret.csv").write_text(GOOD)
    path.chmod(0)
    assert "Permission denied" in refusal(run("learn", path, "-o", tmp_path / "a.h5"), 5)


def test_demonstrations_of_different_dimensions_are_refused(run, tmp_path, curve_files, reach_files):
    said = refusal(run("learn", curve_files[0], reach_files[0], "-o", tmp_path / "a.h5"), 5)
    assert reach_files[0].name in said
    assert "columns" in said


def test_learn_needs_a_place_to_put_the_skill(run, curve_files):
    assert "--name NAME" in refusal(run("learn", *curve_files), 2)


def test_learn_takes_one_place_only(run, curve_files, tmp_path):
    refusal(run("learn", *curve_files, "-o", tmp_path / "a.h5", "--name", "a"), 2)


@pytest.mark.parametrize("name", ["../x", "a/b", ".", "", "-rf", "A", "x" * 65, "a.h5"])
def test_a_bad_name_is_refused_before_any_work(run, curve_files, tmp_path, name):
    refusal(run("learn", *curve_files, f"--name={name}", "--store", tmp_path), 2)
    assert list(tmp_path.iterdir()) == []


def test_a_missing_output_directory_is_refused_before_any_work(run, curve_files, tmp_path):
    assert "mkdir -p" in refusal(run("learn", *curve_files, "-o", tmp_path / "no" / "a.h5"), 8)


def test_a_file_that_is_no_skill_is_never_overwritten(run, curve_files, tmp_path):
    (path := tmp_path / "notes.txt").write_text("mine")
    refusal(run("learn", *curve_files, "-o", path), 2)
    assert path.read_text() == "mine"


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (["--components", "0"], 2, ["components"]),
        (["--components", "500"], 2, ["components", "500"]),
        (["--seed", "-1"], 2, ["seed"]),
        (["--scale", "0"], 2, ["scale"]),
        (["--demos", "99"], 2, ["99"]),
        (["--columns", "x,q"], 5, ["'q'"]),
        (["--input-format", "lasa"], 5, ["not an intact MATLAB 5 file"]),
    ],
)
def test_learning_options_out_of_range_are_refused(run, curve_files, tmp_path, options, code, words):
    said = refusal(run("learn", *curve_files, "-o", tmp_path / "a.h5", *options), code)
    assert all(word in said for word in words)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["inspect", "simulate"])
def test_an_unknown_skill_is_not_found_and_the_nearest_named(run, library, command):
    assert "Did you mean curve?" in refusal(run(command, "curv", "--store", library), 4)


@pytest.mark.parametrize("command", ["merge", "combine", "chain"])
def test_skills_of_different_dimensions_are_refused(run, library, tmp_path, command):
    said = refusal(run(command, "curve", "reach", "--store", library, "-o", tmp_path / "a.h5"), 2)
    assert "3 dimensions" in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "arguments",
    [
        ["merge", "curve"],
        ["merge", "curve", "hook", "--weights", "1"],
        ["merge", "curve", "hook", "--weights", "1,0"],
        ["merge", "curve", "hook", "--weights", "1,nan"],
        ["merge", "curve", "hook", "--sharpness", "2"],
        ["merge", "curve", "hook", "--gate", "experts", "--sharpness", "0.5"],
        ["merge", "curve", "hook", "--speed", "0"],
        ["merge", "curve", "hook", "--target", "1,2,3"],
        ["combine", "curve"],
        ["combine", "curve", "hook", "--target", "0,0"],
        ["combine", "curve", "hook", "--priors", "1,-1"],
        ["combine", "curve", "hook", "--disturbance-distance", "-1"],
        ["combine", "curve", "hook", "--within", "5mm"],
        ["combine", "curve", "hook", "--gate", "sequence", "--align"],
        ["combine", "curve", "hook", "--gate", "sequence", "--priors", "1,2"],
        ["combine", "curve", "hook", "--gate", "sequence", "--target", "0,0"],
        ["chain", "curve"],
        ["chain", "curve", "hook", "--within", "0"],
        ["chain", "curve", "hook", "--within", "nan"],
        ["chain", "curve", "hook", "--within", "5 km"],
        ["chain", "curve", "hook", "--within", "2deg"],
        ["chain", "curve", "hook", "--within", "3:5mm"],
        ["chain", "curve", "hook", "--within", "x:5mm"],
        ["chain", "curve", "hook", "--event", "close"],
        ["chain", "curve", "hook", "--event", "0:close"],
        ["chain", "curve", "hook", "--event", "1:Close"],
        ["chain", "curve", "hook", "--event", "1:wait"],
        ["chain", "curve", "hook", "--event", "1:wait a"],
        ["chain", "curve", "hook", "--event", "1:wait -1"],
        ["chain", "curve", "hook", "--on-jump", "forward"],
        ["chain", "curve", "hook", "--turn"],
        ["chain", "curve", "hook", "--target", "0,0"],
        ["chain", "curve", "hook", "--target", "3=0,0"],
        ["chain", "curve", "hook", "--target", "1=0,0,0"],
        ["chain", "curve", "hook", "--target", "1=0,0", "--target", "1=1,0"],
        ["chain", "curve", "hook", "--target", "1=0,0", "--turn"],
        ["chain", "curve", "hook", "--disturbance-distance", "0"],
    ],
)
def test_compositions_that_make_no_sense_are_refused(run, library, tmp_path, arguments):
    refusal(run(*arguments, "--store", library, "-o", tmp_path / "a.h5"), 2)
    assert list(tmp_path.iterdir()) == []


def test_a_combined_skill_cannot_be_merged(run, library, tmp_path):
    assert run("combine", "curve", "hook", "--store", library, "-o", tmp_path / "c.h5").exit_code == 0
    said = refusal(run("merge", tmp_path / "c.h5", "curve", "--store", library, "-o", tmp_path / "m.h5"), 2)
    assert "combined" in said


@pytest.mark.parametrize("command", ["inspect", "verify-stability", "simulate"])
def test_one_flipped_byte_is_refused(run, library, tmp_path, command):
    data = bytearray((library / "curve" / "1.h5").read_bytes())
    data[len(data) // 2] ^= 1
    (path := tmp_path / "flipped.h5").write_bytes(data)
    result = run(command, path)
    assert result.exit_code == 7
    assert "flipped.h5 is damaged" in result.stderr


def test_a_foreign_file_is_refused_in_words(run, tmp_path):
    (path := tmp_path / "notes.h5").write_text("not a skill")
    assert "not a skill artifact" in refusal(run("inspect", path), 7)


def test_verification_names_every_bad_file_and_checks_the_rest(run, library, tmp_path):
    (bad := tmp_path / "bad.h5").write_text("x")
    gone = tmp_path / "gone.h5"
    skills = ["curve", bad, "hook", gone, "reach"]
    result = run("verify-stability", *skills, "--store", library)
    assert result.exit_code == 7
    assert result.stderr.count("error: ") == 2
    assert str(bad) in result.stderr
    assert str(gone) in result.stderr
    assert all(f"{name}@1" in result.stdout for name in ("curve", "hook", "reach"))
    assert result.stdout.count("unreadable") == 2


def test_verification_of_missing_skills_alone_is_not_found(run, library):
    assert run("verify-stability", "curve", "nothing", "--store", library).exit_code == 4


WITHOUT_PYBULLET = "import sys; sys.modules['pybullet'] = None; from skillctl.__main__ import main; main()"


def test_simulate_without_pybullet_says_in_one_line_what_to_install(library, tmp_path):
    arguments = ["simulate", "reach", "--store", str(library), "--picture", "p.png", "--log", "l.csv"]
    result = subprocess.run(
        [sys.executable, "-c", WITHOUT_PYBULLET, *arguments],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (result.returncode, result.stdout) == (4, "")
    error, hint = result.stderr.splitlines()
    assert "PyBullet" in error
    assert "pip install pybullet" in hint
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "arguments",
    [
        ["inspect", "curve"],
        ["verify-stability", "curve"],
        ["merge", "curve", "hook", "-o", "m.h5"],
        ["combine", "curve", "hook", "-o", "c.h5"],
        ["ls"],
    ],
)
def test_everything_else_works_without_pybullet(library, tmp_path, arguments):
    result = subprocess.run(
        [sys.executable, "-c", WITHOUT_PYBULLET, *arguments, "--store", str(library)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr


class _TwofoldError(errors.NotFoundError, OSError):
    """An error of two kinds."""


@pytest.mark.parametrize(
    ("kind", "code"),
    [
        (errors.UsageError, 2),
        (errors.NotFoundError, 4),
        (errors.StateError, 5),
        (errors.InvalidModelError, 5),
        (NotAnArtifactError, 7),
        (PermissionError, 8),
        (_TwofoldError, 4),
        (ZeroDivisionError, 70),
        (KeyboardInterrupt, 130),
        (BrokenPipeError, 141),
        (errors.Terminated, 143),
    ],
)
def test_the_nearest_class_of_an_error_decides_the_exit_code(kind, code):
    assert ExitCode.of(kind.__new__(kind)) == code
