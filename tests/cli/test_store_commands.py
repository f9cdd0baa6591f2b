"""The store from the command line: what is there, what it is called, and how it goes."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from io import BytesIO

import h5py
import numpy as np
import pytest

from skillctl import store
from skillctl.store.migrations import FORMAT_VERSION
from skillctl.usecases.files import load, save


@pytest.fixture
def shelf(tmp_path, library):
    """A store with five versions of curve, and hook."""
    registry = store.Registry(tmp_path / "skills")
    base = store.read_skill(library / "curve" / "1.h5")
    for index in range(5):
        operation = base.operation.model_copy(update={"results": {"index": index}})
        registry.publish("curve", store.encode(replace(base, operation=operation)))
    registry.publish("hook", (library / "hook" / "1.h5").read_bytes())
    return registry


def document(result, code=0):
    assert (result.exit_code, result.stderr) == (code, "")
    return json.loads(result.stdout)


def test_ls_says_of_each_version_what_it_is(run, shelf):
    shelf.tag("curve", 2, "release")
    report = document(run("ls", "--store", shelf.root, "--json"))
    curve, hook = report["skills"]
    assert (curve["name"], curve["versions"], hook["versions"]) == ("curve", [1, 2, 3, 4, 5], [1])
    assert [entry["aliases"] for entry in curve["entries"]] == [[], ["release"], [], [], []]
    for entry in curve["entries"]:
        path = shelf.path_of("curve", entry["version"])
        assert (entry["kind"], entry["digest"]) == ("seds", store.read_skill(path).digest)
        assert (entry["bytes"], entry["verified"], entry["problem"]) == (path.stat().st_size, None, None)
    text = run("ls", "--store", shelf.root)
    assert "curve@5" in text.stdout
    assert "release=2" in text.stdout
    assert run("ls", "curve", "--store", shelf.root).stdout.count("curve@") == 5


def test_ls_goes_on_past_a_damaged_version_and_check_finds_a_flipped_bit(run, shelf):
    (path := shelf.path_of("curve", 3)).chmod(0o644)
    data = bytearray(path.read_bytes())
    data[-100] ^= 1
    path.write_bytes(data)
    shelf.path_of("hook", 1).chmod(0o644)
    shelf.path_of("hook", 1).write_text("x")
    unread = run("ls", "--store", shelf.root)
    assert unread.exit_code == 0
    assert "hook/1.h5 is not a skill artifact" in unread.stderr
    checked = run("ls", "--check", "--store", shelf.root, "--json")
    assert checked.exit_code == 7
    entries = json.loads(checked.stdout)["skills"][0]["entries"]
    assert [entry["verified"] for entry in entries] == [True, True, False, True, True]
    assert "do not match its seal" in entries[2]["problem"]


def test_check_finds_what_was_sealed_but_is_no_valid_skill(run, shelf):
    """Whoever changes a file can seal it again, so the seal alone verifies nothing."""
    path = shelf.path_of("curve", 2)
    good = path.read_bytes()
    file = BytesIO(good)
    with h5py.File(file, "r+") as body:
        body["model/priors"][0] = np.nan
    body = file.getvalue()[512:]
    digest = store.read_header(path).digest
    lines = f"{FORMAT_VERSION} {len(body)} {hashlib.sha256(body).hexdigest()}\nseds {digest}\n".encode()
    path.chmod(0o644)
    path.write_bytes((good[:10] + lines).ljust(512, b"\0") + body)
    assert run("ls", "curve", "--store", shelf.root).exit_code == 0  # it says nothing of what it did not read
    checked = run("ls", "curve", "--check", "--store", shelf.root, "--json")
    assert checked.exit_code == 7
    entries = json.loads(checked.stdout)["skills"][0]["entries"]
    assert [entry["verified"] for entry in entries] == [True, False, True, True, True]
    assert "/model/priors: must be finite" in entries[1]["problem"]


def test_broken_aliases_do_not_hide_the_skills(run, shelf):
    (shelf.root / "curve" / "refs.toml").write_text("<<<<<<<")
    listed = run("ls", "--store", shelf.root)
    assert listed.exit_code == 0
    assert "refs.toml cannot be read" in listed.stderr
    refused = run("inspect", "curve@release", "--store", shelf.root)
    assert (refused.exit_code, refused.stdout) == (7, "")
    assert refused.stderr.count("\n") == 2


def test_an_alias_names_a_skill_in_every_command(run, shelf, tmp_path):
    assert document(run("tag", "curve@2", "release", "--store", shelf.root, "--json"))["before"] is None
    digest = store.read_skill(shelf.path_of("curve", 2)).digest
    shown = document(run("inspect", "curve@release", "--store", shelf.root, "--json"))
    assert (shown["skill"], shown["digest"]) == ("curve@2", digest)
    combined = run(
        "combine", "curve@release", "hook", "-o", tmp_path / "m.h5", "--store", shelf.root, "--json"
    )
    assert [part["skill"] for part in document(combined)["parts"]] == ["curve@2", "hook@1"]
    assert run("verify-stability", "curve@release", "--store", shelf.root).exit_code == 0
    moved = run("tag", f"curve@{digest[:20]}", "release", "--store", shelf.root)
    assert moved.stdout == "curve@release is curve@2\n"
    assert "it was curve@2" in run("tag", "curve", "release", "--store", shelf.root).stdout
    assert "curve@5" in run("untag", "curve", "release", "--store", shelf.root).stdout
    assert run("inspect", "curve@release", "--store", shelf.root).exit_code == 4


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["tag", "curve@9", "release"], 4),
        (["tag", "curve@1", "3"], 2),
        (["tag", "curve@1", "latest"], 2),
        (["tag", "./a.h5", "release"], 2),
        (["untag", "curve", "release"], 4),
        (["untag", "../x", "release"], 2),
        (["rm", "curve"], 2),
        (["rm", "--all", "curve@1"], 2),
        (["rm", "curve@1", "curve@9"], 4),
        (["rm", "./a.h5"], 2),
        (["gc", "--keep-last", "0"], 2),
        (["gc"], 2),
        (["gc", "nothing", "--keep-last", "1"], 4),
        (["ls", "nothing"], 4),
    ],
)
def test_what_makes_no_sense_changes_nothing(run, shelf, arguments, code):
    before = sorted(shelf.root.rglob("*"))
    result = run(*arguments, "--store", shelf.root)
    assert (result.exit_code, result.stdout) == (code, "")
    assert result.stderr.startswith("error: ")
    assert "\nhint: " in result.stderr
    assert sorted(shelf.root.rglob("*")) == before


def test_versions_are_removed_and_their_numbers_are_not_given_again(run, shelf):
    planned = document(run("rm", "curve@4", "curve@5", "--dry-run", "--store", shelf.root, "--json"))
    assert (planned["dry_run"], len(planned["removed"])) == (True, 2)
    assert shelf.versions("curve") == (1, 2, 3, 4, 5)
    removed = document(run("rm", "curve@4", "curve@5", "--store", shelf.root, "--json"))
    assert [removal["skill"] for removal in removed["removed"]] == ["curve@4", "curve@5"]
    assert shelf.publish("curve", shelf.path_of("hook", 1).read_bytes()).version == 6


def test_a_version_with_an_alias_is_removed_only_by_force(run, shelf):
    shelf.tag("curve", 2, "release")
    refused = run("rm", "curve@1", "curve@2", "--store", shelf.root)
    assert refused.exit_code == 2
    assert "curve@2 is curve@release" in refused.stderr
    assert shelf.versions("curve") == (1, 2, 3, 4, 5)
    assert run("rm", "curve@2", "--force", "--store", shelf.root).exit_code == 0
    assert (shelf.versions("curve"), shelf.aliases("curve")) == ((1, 3, 4, 5), {})
    assert run("rm", "--all", "curve", "--store", shelf.root).exit_code == 0
    assert shelf.names() == ("hook",)


@pytest.mark.parametrize(("keep_tagged", "left"), [(True, (1, 4, 5)), (False, (4, 5))])
def test_gc_keeps_the_newest_and_if_asked_the_tagged(run, shelf, keep_tagged, left):
    shelf.tag("curve", 1, "release")
    options = ["--keep-tagged"] if keep_tagged else []
    arguments = ["gc", "--keep-last", "2", *options, "--store", shelf.root, "--json"]
    planned = document(run(*arguments, "--dry-run"))
    assert shelf.versions("curve") == (1, 2, 3, 4, 5)
    done = document(run(*arguments))
    assert done["removed"] == planned["removed"]
    assert done["kept"] == len(left) + 1
    assert (shelf.versions("curve"), shelf.versions("hook")) == (left, (1,))
    assert shelf.aliases("curve") == ({"release": 1} if keep_tagged else {})


def test_what_python_saved_can_be_published_and_listed(run, shelf, tmp_path):
    path = save(load("curve@1", store=shelf.root), tmp_path / "s.h5")
    assert shelf.publish("saved", path.read_bytes()).version == 1
    assert "saved@1" in run("ls", "--store", shelf.root).stdout
