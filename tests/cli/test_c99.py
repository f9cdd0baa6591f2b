"""``export --format c99`` and ``verify-stability FILE.h``: files, exit codes and sentences."""

from __future__ import annotations

import json
import shutil

import pytest

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")


@needs_compiler
def test_a_header_is_checked_and_says_which_skill_it_is(run, library, tmp_path):
    header = tmp_path / "curve.h"
    exported = run("export", "curve", "--check", "-o", header, "--store", library, "--json")
    assert exported.exit_code == 0
    report = json.loads(exported.stdout)
    assert "curve_step" in report["variables"]
    assert (report["check"]["states"], report["check"]["problem"]) == (10_000, "")
    verified = run("verify-stability", header, "--store", library, "--json")
    assert verified.exit_code == 0
    (verdict,) = json.loads(verified.stdout)["skills"]
    assert verdict["digest"] == report["digest"]
    assert verdict["skill"] == f"{header}, of curve@1"


def test_any_ending_will_do_if_the_format_is_named(run, library, tmp_path):
    for name, options in (("a.h", ()), ("a.hpp", ("--format", "c99"))):
        assert run("export", "curve", "-o", tmp_path / name, *options, "--store", library).exit_code == 0
    assert (tmp_path / "a.h").read_bytes() == (tmp_path / "a.hpp").read_bytes()


def test_what_cannot_be_done_with_a_header_is_said(run, library, tmp_path):
    def refused(code, *arguments):
        result = run("export", "curve", *arguments, "--store", library)
        assert result.exit_code == code
        return result.stderr

    assert "--check is for headers" in refused(2, "--check", "-o", tmp_path / "a.json")
    assert "--leaf is for .mat" in refused(2, "--leaf", "1", "-o", tmp_path / "a.h")
    assert not list(tmp_path.iterdir())


def test_without_a_compiler_nothing_is_written(run, library, tmp_path, monkeypatch):
    monkeypatch.setenv("CC", "nowhere-cc")
    result = run("export", "curve", "--check", "-o", tmp_path / "a.h", "--store", library)
    assert result.exit_code == 4
    assert result.stderr.startswith("error: nowhere-cc: there is no C compiler to check with.\nhint: ")
    assert not (tmp_path / "a.h").exists()


@needs_compiler
def test_a_header_that_commands_something_else_is_not_written(run, library, tmp_path, monkeypatch):
    from skillctl.codegen import check

    monkeypatch.setattr(check, "TOLERANCE", 1e-20)
    monkeypatch.setattr(check, "LAST_BITS", 0.0)
    result = run("export", "curve", "--check", "-o", tmp_path / "a.h", "--store", library)
    assert result.exit_code == 1
    assert "not written" in result.stdout
    assert "Commands differ by" in result.stdout
    assert not (tmp_path / "a.h").exists()


def test_a_header_of_no_known_skill_is_refused(run, library, tmp_path):
    header = tmp_path / "curve.h"
    run("export", "curve", "-o", header, "--store", library)
    absent = run("verify-stability", header, "--store", tmp_path)
    assert absent.exit_code == 4
    assert "it was made of sha256:" in absent.stderr
    header.write_text(header.read_text().replace("0x1.", "0x1.1", 1))
    changed = run("verify-stability", header, "--store", library)
    assert changed.exit_code == 7
    assert "was changed after it was written" in changed.stderr
    header.write_bytes(b"\xff\xfe")
    assert run("verify-stability", header, "--store", library).exit_code == 7
    assert run("verify-stability", tmp_path / "nowhere.h", "--store", library).exit_code == 4
