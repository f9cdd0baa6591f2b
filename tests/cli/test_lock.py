"""Pipelines that use the skills that were locked, and no others."""

from __future__ import annotations

import importlib.util
import json
from dataclasses import replace

import pytest

from skillctl import store

COMMANDS = [
    ["verify-stability", "curve"],
    ["inspect", "curve"],
    ["inspect", "curve", "--lineage"],
    ["diff", "curve", "curve"],
    ["export", "curve", "-o", "out.json"],
    ["merge", "curve", "curve", "-o", "out.h5"],
    ["combine", "curve", "hook", "-o", "out.h5"],
    ["run", "curve", "--log", "out.h5"],
    *([["simulate", "curve", "--log", "out.csv"]] if importlib.util.find_spec("pybullet") else []),
]


@pytest.fixture
def registry(tmp_path, library, monkeypatch):
    """A project with a store in it: two versions of curve, and hook; the second curve is new."""
    monkeypatch.chdir(tmp_path)
    registry = store.Registry(tmp_path / "skills")
    for name in ("curve", "hook"):
        registry.publish(name, (library / name / "1.h5").read_bytes())
    return registry


def publish_another(registry, name="curve"):
    """Publish the newest version of a skill again, as other content."""
    base = store.read_skill(registry.locate(name).path)
    operation = base.operation.model_copy(update={"note": f"after {base.digest}"})
    return registry.publish(name, store.encode(replace(base, operation=operation)))


def replace_version(registry, name, version, data):
    (path := registry.path_of(name, version)).chmod(0o644)
    path.write_bytes(data)


def document(result, code=0):
    assert (result.exit_code, result.stderr) == (code, "")
    return json.loads(result.stdout)


def skills_of(report):
    return [(skill["name"], skill["version"]) for skill in report["skills"]]


def test_lock_writes_each_skill_once_and_the_same_again(run, registry, tmp_path):
    report = document(run("lock", "hook", "curve", "curve", "--json"))
    assert skills_of(report) == [("curve", 1), ("hook", 1)]
    assert [skill["digest"] for skill in report["skills"]] == [
        store.read_skill(registry.path_of(name, 1)).digest for name in ("curve", "hook")
    ]
    text = (tmp_path / "skillctl.lock").read_text()
    assert document(run("lock", "curve", "hook", "--json"))["written"] is False
    assert document(run("lock", "--json"))["written"] is False
    (tmp_path / "skillctl.lock").unlink()
    assert run("lock").exit_code == 0  # without a lock: all of the store
    assert (tmp_path / "skillctl.lock").read_text() == text


def test_check_tells_of_newer_versions_and_lock_takes_them(run, registry, tmp_path):
    run("lock", "curve")
    text = (tmp_path / "skillctl.lock").read_text()
    assert run("lock", "--check").exit_code == 0
    publish_another(registry)
    publish_another(registry, "hook")  # not in the lock, so nothing changes because of it
    report = document(run("lock", "--check", "--json"), code=1)
    (change,) = report["changes"]
    assert (change["before"]["version"], change["after"]["version"]) == (1, 2)
    told = run("lock", "--check")
    assert (told.exit_code, told.stderr) == (1, "")
    assert "not up to date" in told.stdout
    assert (tmp_path / "skillctl.lock").read_text() == text
    assert skills_of(document(run("lock", "--json"))) == [("curve", 2)]
    assert run("lock", "--check").exit_code == 0
    assert run("lock", "--check", "curve", "hook").exit_code == 1


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: " ".join(command[:3]))
def test_every_command_uses_the_locked_version_and_nothing_else(run, registry, tmp_path, command):
    assert run("lock").exit_code == 0
    assert publish_another(registry).version == 2
    free = run(*command, "--json")
    assert "curve@2" in free.stdout
    if (tmp_path / "out.h5").exists():
        (tmp_path / "out.h5").unlink()
    bound = run(*command, "--json", "--locked")
    assert (bound.exit_code, bound.stderr) == (free.exit_code, "")
    assert "curve@1" in bound.stdout
    assert "curve@2" not in bound.stdout
    for path in tmp_path.glob("out.*"):
        path.unlink()
    refused = run(*[word.replace("curve", "curve@2") for word in command], "--locked")
    assert refused.exit_code == 7
    assert "names curve@1, not curve@2" in refused.stderr
    assert "hint: " in refused.stderr
    assert list(tmp_path.glob("out.*")) == []


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: " ".join(command[:3]))
def test_every_command_refuses_other_content_under_a_locked_version(
    run, registry, tmp_path, command, monkeypatch
):
    run("lock")
    base = store.read_skill(registry.path_of("curve", 1))
    other = replace(base, operation=base.operation.model_copy(update={"note": "another"}))
    replace_version(registry, "curve", 1, store.encode(other))  # whole, and sealed
    monkeypatch.setenv("SKILLCTL_LOCKED", "1")
    refused = run(*command)
    assert refused.exit_code == 7
    assert f"curve@1 holds {other.digest}, but" in refused.stderr
    assert list(tmp_path.glob("out.*")) == []
    assert run("lock", "--check").exit_code == 1


def test_a_file_is_allowed_by_its_content(run, registry, tmp_path):
    run("lock", "curve")
    assert run("verify-stability", "skills/curve/1.h5", "--locked").exit_code == 0
    refused = run("verify-stability", "skills/curve/1.h5", "skills/hook/1.h5", "--locked")
    assert refused.exit_code == 7
    assert "does not name skills/hook/1.h5" in refused.stderr
    assert "stable" in refused.stdout  # the other one is checked all the same
    assert run("lock", "skills/hook/1.h5").exit_code == 0
    assert run("verify-stability", "skills/hook/1.h5", "--locked").exit_code == 0
    assert 'file = "skills/hook/1.h5"' in (tmp_path / "skillctl.lock").read_text()


def test_only_locked_skills_of_the_store_help_with_a_task(run, registry, curve_files, tmp_path):
    for name, source in (("curved", "curve"), ("hooked", "hook")):
        registry.publish(name, registry.path_of(source, 1).read_bytes())
    task = ["merge", "--from-store", "--fit", curve_files[0], "-o", tmp_path / "out.h5", "--json"]
    run("lock", "curve", "hook")
    publish_another(registry)
    report = document(run(*task, "--locked"))
    assert report["task"]["candidates"] == 2
    assert {part["skill"] for part in report["parts"]} <= {"curve@1", "hook@1"}
    replace_version(registry, "hook", 1, registry.path_of("curve", 2).read_bytes())  # is not passed over
    refused = run(*task, "--locked", "--force")
    assert (refused.exit_code, refused.stdout) == (7, "")
    assert "hook@1 holds" in refused.stderr


def test_a_target_depends_on_the_lock(run, registry, tmp_path):
    run("lock")
    arguments = ["combine", "curve", "hook", "-o", "out.h5", "--depfile", "out.d"]
    assert run(*arguments, "--locked").exit_code == 0
    assert "skillctl.lock" in (tmp_path / "out.d").read_text()


def test_without_a_lock_nothing_is_used(run, registry):
    for arguments in (["inspect", "curve", "--locked"], ["lock", "--check"]):
        refused = run(*arguments)
        assert (refused.exit_code, refused.stdout) == (4, "")
        assert "no lock file" in refused.stderr
        assert "hint: `skillctl lock" in refused.stderr


def test_what_is_not_a_lock_is_neither_believed_nor_overwritten(run, registry, tmp_path):
    (lock := tmp_path / "skillctl.lock").write_text("precious")
    for arguments, code in (
        (["lock", "curve"], 2),
        (["lock"], 7),
        (["lock", "--check"], 7),
        (["inspect", "curve", "--locked"], 7),
    ):
        refused = run(*arguments)
        assert (refused.exit_code, refused.stdout) == (code, "")
        assert "skillctl.lock" in refused.stderr
        assert lock.read_text() == "precious"
    lock.unlink()
    run("lock")
    lock.write_text(lock.read_text() + "<<<<<<< ours\n")
    assert run("lock").exit_code == 7
    assert run("lock", "curve").exit_code == 0  # a lock that a merge broke is made anew


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["lock", "nothing"], 4),
        (["lock", "curve@9"], 4),
        (["lock", "none.h5"], 4),
        (["lock", "../x"], 4),
        (["lock", "Reach"], 2),
        (["lock", "--store", "empty"], 4),
        (["lock", "curve", "--file", "no/where.lock"], 8),
        (["lock", "curve", "--file", "skills"], 2),
    ],
)
def test_what_cannot_be_locked_leaves_no_lock(run, registry, tmp_path, arguments, code):
    before = sorted(tmp_path.rglob("*"))
    refused = run(*arguments)
    assert (refused.exit_code, refused.stdout) == (code, "")
    assert refused.stderr.startswith("error: ")
    assert "\nhint: " in refused.stderr
    assert sorted(tmp_path.rglob("*")) == before


def test_a_damaged_skill_is_not_locked(run, registry, tmp_path):
    data = bytearray(registry.path_of("curve", 1).read_bytes())
    data[-100] ^= 1
    replace_version(registry, "curve", 1, data)
    assert run("lock", "curve").exit_code == 7
    assert not (tmp_path / "skillctl.lock").exists()


def test_the_lock_is_found_from_below_and_by_the_variable(run, registry, tmp_path, monkeypatch):
    run("lock", "--file", "ci.lock", "curve")
    monkeypatch.setenv("SKILLCTL_LOCK", str(tmp_path / "ci.lock"))
    (tmp_path / "below").mkdir()
    monkeypatch.chdir(tmp_path / "below")
    assert run("inspect", "curve", "--locked").exit_code == 0
    assert run("inspect", "hook", "--locked").exit_code == 7
    monkeypatch.delenv("SKILLCTL_LOCK")
    assert run("inspect", "curve", "--locked").exit_code == 4
    assert run("inspect", "hook").exit_code == 0
