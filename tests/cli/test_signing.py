"""Signing and verifying from the command line."""

from __future__ import annotations

import json
import os
import pty
import shutil
import subprocess
import sys
from dataclasses import replace

import pytest

from skillctl import store

pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")


def openssl(*arguments):
    subprocess.run(["openssl", *map(str, arguments)], capture_output=True, check=True, timeout=60)


@pytest.fixture
def registry(tmp_path, library, monkeypatch):
    """A project with a store of curve and hook, and the keys of two people."""
    monkeypatch.chdir(tmp_path)
    for name in ("ours", "theirs"):
        openssl("genpkey", "-algorithm", "ed25519", "-out", f"{name}.pem")
        openssl("pkey", "-in", f"{name}.pem", "-pubout", "-out", f"{name}.pub")
    registry = store.Registry(tmp_path / "skills")
    for name in ("curve", "hook"):
        registry.publish(name, (library / name / "1.h5").read_bytes())
    return registry


def document(result, code=0):
    assert (result.exit_code, result.stderr) == (code, "")
    return json.loads(result.stdout)


def replace_version(registry, name, data):
    (path := registry.path_of(name, 1)).chmod(0o644)
    path.write_bytes(data)


def test_a_skill_is_signed_beside_its_file_which_stays_as_it_is(run, registry):
    path = registry.path_of("curve", 1)
    before = path.read_bytes(), path.stat().st_mtime_ns
    made = document(run("sign", "curve", "--key", "ours.pem", "--json"))
    assert (made["skill"], made["path"], made["created"]) == ("curve@1", f"{path}.sig", True)
    assert document(run("sign", "curve", "--key", "ours.pem", "--json"))["created"] is False
    assert (path.read_bytes(), path.stat().st_mtime_ns) == before
    verified = document(run("verify-signature", "curve", "--key", "ours.pub", "--json"))
    assert (verified["state"], verified["digest"]) == ("valid", store.read_skill(path).digest)
    assert verified["key"] == made["key"]
    # The store lists, names and removes as before.
    listed = document(run("ls", "--json"))
    assert [(skill["name"], skill["versions"]) for skill in listed["skills"]] == [
        ("curve", [1]),
        ("hook", [1]),
    ]
    assert run("rm", "curve@1").exit_code == 0
    assert sorted(path.name for path in path.parent.iterdir()) == ["1.removed"]


def test_gc_takes_signatures_along(run, registry):
    base = store.read_skill(registry.path_of("curve", 1))
    run("sign", "curve@1", "--key", "ours.pem")
    noted = replace(base, operation=base.operation.model_copy(update={"note": "second"}))
    registry.publish("curve", store.encode(noted))
    run("sign", "curve@2", "--key", "ours.pem")
    assert run("gc", "--keep-last", "1").exit_code == 0
    assert sorted(path.name for path in (registry.root / "curve").iterdir()) == ["2.h5", "2.h5.sig"]


def test_what_is_not_signed_by_the_key_exits_one_and_says_why(run, registry):
    def state(words):
        result = run("verify-signature", "curve", "--key", "ours.pub")
        assert (result.exit_code, result.stderr) == (1, "")
        assert words in result.stdout
        return document(run("verify-signature", "curve", "--key", "ours.pub", "--json"), code=1)["state"]

    path = store.signatures_path(registry.path_of("curve", 1))
    assert state("there are no signatures") == "unsigned"
    run("sign", "curve", "--key", "theirs.pem")
    assert state("has not signed curve@1; there are signatures of ed25519:") == "other key"
    run("sign", "curve", "--key", "ours.pem")
    *others, own = path.read_text().splitlines()
    key = document(run("sign", "curve", "--key", "ours.pem", "--json"))["key"]
    lines = [line for line in [*others, own] if line.startswith(key)]
    last = "0" if lines[0][-1] != "0" else "1"
    path.write_text(f"{lines[0][:-1]}{last}\n")
    assert state("was changed") == "invalid"
    path.write_text(f"{lines[0]}\n")
    assert run("verify-signature", "curve", "--key", "ours.pub").exit_code == 0
    replace_version(registry, "curve", registry.path_of("hook", 1).read_bytes())  # whole, and sealed
    assert state("has signed other content than curve@1 holds now") == "other content"


def test_a_damaged_skill_or_signature_file_is_refused(run, registry):
    run("sign", "curve", "--key", "ours.pem")
    path = registry.path_of("curve", 1)
    good, signatures = path.read_bytes(), store.signatures_path(path)
    replace_version(registry, "curve", good[:-1])
    for command in (
        ["verify-signature", "curve", "--key", "ours.pub"],
        ["sign", "curve", "--key", "ours.pem"],
    ):
        refused = run(*command)
        assert (refused.exit_code, refused.stdout) == (7, "")
    replace_version(registry, "curve", good)
    signatures.write_text("not a signature\n")
    for command in (
        ["verify-signature", "curve", "--key", "ours.pub"],
        ["sign", "curve", "--key", "ours.pem"],
    ):
        refused = run(*command)
        assert (refused.exit_code, refused.stdout) == (7, "")
        assert "1.h5.sig cannot be read: line 1 is not a signature" in refused.stderr
    assert run("inspect", "curve").exit_code == 0  # who asks for no signature gets on without one


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["sign", "curve", "--key", "ours.pub"], 5),
        (["sign", "curve", "--key", "skills/curve/1.h5"], 5),
        (["sign", "curve", "--key", "none.pem"], 4),
        (["sign", "curve", "--key", "skills"], 8),
        (["sign", "nothing", "--key", "ours.pem"], 4),
        (["sign", "Curve", "--key", "ours.pem"], 2),
        (["sign", "curve"], 2),
        (["verify-signature", "curve", "--key", "ours.pem"], 5),
        (["verify-signature", "curve"], 2),
        (["verify-signature", "nothing", "--key", "ours.pub"], 4),
        (["verify-stability", "curve", "--require-signature", "none.pub"], 4),
        (["verify-stability", "curve", "--require-signature", "ours.pem"], 5),
    ],
)
def test_what_cannot_be_signed_or_verified_changes_nothing(run, registry, tmp_path, arguments, code):
    before = sorted(tmp_path.rglob("*"))
    refused = run(*arguments)
    assert (refused.exit_code, refused.stdout) == (code, "")
    assert refused.stderr.startswith("error: ")
    assert "\nhint: " in refused.stderr
    assert sorted(tmp_path.rglob("*")) == before


def test_a_required_signature_is_part_of_the_verdict(run, registry, tmp_path):
    run("sign", "curve", "--key", "ours.pem")
    command = ["verify-stability", "curve", "hook", "--require-signature", "ours.pub"]
    assert run("verify-stability", "curve", "--require-signature", "ours.pub").exit_code == 0
    report = document(run(*command, "--json", "--report", "sarif=r.sarif", "--report", "junit=r.xml"), code=1)
    outcomes = [(skill["outcome"], skill["signature"]) for skill in report["skills"]]
    assert outcomes == [("proved", "valid"), ("not signed", "unsigned")]
    assert report["required"]["signer"].startswith("ed25519:")
    assert all(skill["certificate"]["verdict"] == "stable" for skill in report["skills"])
    results = json.loads((tmp_path / "r.sarif").read_text())["runs"][0]["results"]
    assert [result["ruleId"] for result in results] == ["SKILL000", "SKILL004"]
    assert 'failures="1"' in (tmp_path / "r.xml").read_text()
    told = run(*command)
    assert (told.exit_code, told.stderr) == (1, "")
    assert "hook@1: not signed" in told.stdout
    assert "Required is a signature; hook@1 is not signed" in told.stdout
    assert "::error" in run(*command, "--format", "github").stdout
    run("sign", "hook", "--key", "ours.pem")
    assert run(*command).exit_code == 0
    store.signatures_path(registry.path_of("hook", 1)).write_text("rubbish\n")
    assert run(*command).exit_code == 7


def test_an_unstable_skill_stays_unproved_whoever_signed_it(run, registry, tmp_path, make_skill):
    import numpy as np

    from skillctl.usecases.files import save

    skill = make_skill(np.random.default_rng(1))
    save(replace(skill, system_matrices=-skill.system_matrices), tmp_path / "bad.h5")
    run("sign", "bad.h5", "--key", "ours.pem")
    command = ["verify-stability", "bad.h5", "--json", "--require-signature"]
    for key, state in (("ours.pub", "valid"), ("theirs.pub", "other key")):
        report = document(run(*command, key), code=1)
        assert (report["skills"][0]["outcome"], report["skills"][0]["signature"]) == ("not proved", state)


def test_an_encrypted_key_is_refused_in_a_pipeline_and_asked_for_at_a_terminal(run, registry, tmp_path):
    openssl("pkey", "-in", "ours.pem", "-aes256", "-passout", "pass:sesame", "-out", "locked.pem")
    refused = run("sign", "curve", "--key", "locked.pem")
    assert (refused.exit_code, refused.stdout) == (5, "")
    assert "is encrypted" in refused.stderr
    terminal, inside = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-m", "skillctl", "sign", "curve", "--key", "locked.pem", "--json"],
        stdin=inside,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
        start_new_session=True,  # so that getpass finds no other terminal than its input
    ) as process:
        assert process.stderr.read(8) == b"Password"  # what is typed before the question is thrown away
        os.write(terminal, b"sesame\n")
        said, _ = process.communicate(timeout=60)
    os.close(inside)
    os.close(terminal)
    assert process.returncode == 0
    assert json.loads(said)["created"] is True
    assert b"sesame" not in said
    assert run("verify-signature", "curve", "--key", "ours.pub").exit_code == 0


def test_without_the_package_only_signing_is_missing(registry, tmp_path):
    (tmp_path / "without" / "cryptography").mkdir(parents=True)
    (tmp_path / "without" / "cryptography" / "__init__.py").write_text("raise ImportError")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "without")}

    def call(*arguments):
        return subprocess.run(
            [sys.executable, "-m", "skillctl", *arguments],
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
        )

    for arguments in (
        ["sign", "curve", "--key", "ours.pem"],
        ["verify-signature", "curve", "--key", "ours.pub"],
        ["verify-stability", "curve", "--require-signature", "ours.pub"],
    ):
        refused = call(*arguments)
        assert (refused.returncode, refused.stdout) == (4, "")
        assert "cryptography is not installed" in refused.stderr
        assert "hint: Install it: pip install cryptography" in refused.stderr
    assert call("verify-stability", "curve").returncode == 0
