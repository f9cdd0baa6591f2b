"""Notes, the versions of a skill, and the tree of what it was made from."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import pytest

from skillctl import store
from skillctl.errors import NotFoundError, UsageError
from skillctl.usecases.combine import combine
from skillctl.usecases.history import lineage, log
from skillctl.usecases.learn import learn


@pytest.fixture
def shelf(tmp_path, library):
    """A store with curve and hook, twins combined from them, and triplets combined from twins and hook."""
    shutil.copytree(library, root := tmp_path / "skills")
    combine(["curve", "hook"], name="twins", store=root, note="first try")
    combine(["twins", "hook"], name="triplets", store=root)
    return root


def forms(report):
    return [(ancestor.skill, ancestor.presence) for ancestor in report.lineage.all()]


def test_a_note_is_kept_with_the_skill_and_shown_in_its_history(run, curve_files, tmp_path):
    arguments = [
        "learn",
        *curve_files,
        "--name",
        "a",
        "--store",
        tmp_path,
        "--preset",
        "fast",
        "--components",
        2,
    ]
    assert run(*arguments, "-m", "slower near the shelf").exit_code == 0
    again = run(*arguments)
    assert "up to date" in again.stdout
    assert "up to date" in run(*arguments, "-m", "slower near the shelf").stdout
    assert run(*arguments, "-m", "reviewed").exit_code == 0
    store.Registry(tmp_path).tag("a", 1, "release")
    report = json.loads(run("log", "a", "--store", tmp_path, "--json").stdout)
    assert [(entry["version"], entry["note"], entry["aliases"]) for entry in report["entries"]] == [
        (2, "reviewed", []),
        (1, "slower near the shelf", ["release"]),
    ]
    assert [entry["inputs"] for entry in report["entries"]] == [4, 4]
    shown = run("log", "a", "-n", "1", "--store", tmp_path)
    assert "reviewed" in shown.stdout
    assert "slower" not in shown.stdout
    inspected = json.loads(run("inspect", "a@1", "--store", tmp_path, "--json").stdout)
    assert inspected["operation"]["note"] == "slower near the shelf"


@pytest.mark.parametrize("note", ["", "x" * 1001, "\n" * 600])
def test_a_note_that_cannot_be_kept_is_refused_before_any_work(curve_files, tmp_path, note):
    with pytest.raises(UsageError, match="a note has 1 to 1000 characters"):
        learn(curve_files, output=tmp_path / "a.h5", note=note)


def test_a_note_obeys_no_terminal(library, tmp_path):
    combine(["curve", "hook"], output=tmp_path / "a.h5", store=library, note="a\x1b[2J\nb")
    assert store.read_skill(tmp_path / "a.h5").operation.note == r"a\x1b[2J\nb"


def test_the_history_names_what_cannot_be_read_and_goes_on(shelf):
    path = shelf / "twins" / "1.h5"
    path.with_name("2.h5").write_bytes(path.read_bytes()[:-1])
    damaged, first = log("twins", store=shelf).entries
    assert "is damaged" in damaged.problem
    assert [parent.name for parent in first.parents] == ["curve", "hook"]
    assert (first.command, first.note) == ("combine", "first try")
    with pytest.raises(NotFoundError, match="no skill twin"):
        log("twin", store=shelf)


def test_the_tree_of_parents_goes_down_to_the_learned_skills(shelf):
    report = lineage("triplets", store=shelf)
    assert report.complete
    assert forms(report) == [
        ("triplets@1", "present"),
        ("twins@1", "present"),
        ("curve@1", "present"),
        ("hook@1", "present"),
        ("hook@1", "present"),
    ]
    assert report.lineage.parents[0].note == "first try"
    assert [parent.role for parent in report.lineage.parents] == ["part 1", "part 2"]


def test_a_parent_that_is_gone_is_missing_with_all_before_it(shelf):
    store.Registry(shelf).remove("twins", [1])
    report = lineage("triplets", store=shelf)
    assert not report.complete
    assert forms(report) == [("triplets@1", "present"), ("twins@1", "missing"), ("hook@1", "present")]


def test_a_parent_with_other_content_is_changed(shelf):
    (path := shelf / "hook" / "1.h5").chmod(0o644)
    path.write_bytes((shelf / "curve" / "1.h5").read_bytes())
    assert ("hook@1", "changed") in forms(lineage("twins", store=shelf))
    path.write_bytes(b"damaged")
    assert ("hook@1", "changed") in forms(lineage("twins", store=shelf))


def test_a_parent_is_found_by_its_content_under_another_number(shelf):
    (shelf / "hook" / "1.h5").rename(shelf / "hook" / "7.h5")
    report = lineage("twins", store=shelf)
    assert report.complete
    assert ("hook@7", "present") in forms(report)


def test_parents_that_were_files_are_looked_for_beside_their_child(library, tmp_path):
    for name in ("curve", "hook"):
        shutil.copy(library / name / "1.h5", tmp_path / f"{name}.h5")
    combine([tmp_path / "curve.h5", tmp_path / "hook.h5"], output=tmp_path / "both.h5")
    assert lineage(tmp_path / "both.h5").complete
    (tmp_path / "curve.h5").unlink()
    report = lineage(tmp_path / "both.h5")
    assert [parent.presence for parent in report.lineage.parents] == ["missing", "present"]


@pytest.mark.parametrize("version", [None, 1])
def test_a_parents_name_leads_nowhere_else(library, tmp_path, version):
    (hidden := tmp_path / "hidden.h5").write_bytes((library / "hook" / "1.h5").read_bytes())
    (below := tmp_path / "below").mkdir()
    original = store.read_skill(library / "hook" / "1.h5")
    parent = store.ParentRecord(name="../hidden.h5", version=version, digest=original.digest, role="part 1")
    liar = replace(original, provenance=original.provenance.model_copy(update={"parents": (parent,)}))
    store.write_file(below / "liar.h5", store.encode(liar))
    assert hidden.exists()
    assert [p.presence for p in lineage(below / "liar.h5", store=below).lineage.parents] == ["missing"]


def test_inspect_shows_the_tree(run, shelf):
    result = run("inspect", "triplets", "--lineage", "--store", shelf)
    assert (result.exit_code, result.stderr) == (0, "")
    assert "\n  twins@1" in result.stdout
    assert "\n    curve@1" in result.stdout
    document = json.loads(run("inspect", "triplets", "--lineage", "--store", shelf, "--json").stdout)
    assert document["complete"] is True
