"""References that lead nowhere, and stores that cannot be written: an exit code, and nothing is changed."""

from __future__ import annotations

import os
import re
import resource
import shutil
import subprocess
import sys

import pytest

from skillctl import store


@pytest.mark.parametrize(
    ("reference", "code"),
    [
        ("reach@0", 2),
        ("reach@-1", 2),
        ("reach@1e3", 2),
        ("reach@1000000", 2),
        ("reach@", 2),
        ("Reach", 2),
        (".", 2),
        ("", 2),
        ("rea\nch", 2),
        ("x" * 65, 2),
        ("nowhere/x", 4),  # a slash makes it a file
        ("empty", 4),
        ("empty@latest", 4),
        ("reach@2", 4),
        ("reach@999999", 4),
        ("reach@release", 4),
        (f"reach@sha256:{'0' * 64}", 4),
    ],
)
def test_references_that_are_malformed_or_lead_nowhere(run, good, tmp_path, monkeypatch, reference, code):
    monkeypatch.chdir(tmp_path)  # whatever stands beside the checkout
    store.Registry(tmp_path / "skills").publish("reach", good)
    (tmp_path / "skills" / "empty").mkdir()
    result = run("inspect", "--store", tmp_path / "skills", "--", reference)
    assert (result.exit_code, result.stdout) == (code, "")
    error, hint = result.stderr.splitlines()
    assert error.startswith("error: ")
    assert hint.startswith("hint: ")


@pytest.fixture
def registry(library, tmp_path):
    """A store of curve and hook, and both, whose newest version is about to get a successor."""
    registry = store.Registry(tmp_path / "skills")
    for name, source in (("curve", "curve"), ("hook", "hook"), ("both", "curve")):
        registry.publish(name, (library / source / "1.h5").read_bytes())
    return registry


def combine(registry, place, prefix=(), **options):
    arguments = ["combine", "curve", "hook", "--store", registry.root, *place]
    command = [*prefix, sys.executable, "-m", "skillctl", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60, **options)


def files_of(registry):
    return {path: path.read_bytes() for path in registry.root.rglob("*") if path.is_file()}


def test_without_permission_nothing_changes(registry):
    prefix = []
    if os.geteuid() == 0:  # root has no need of permissions, unless it gives that up
        prefix = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"]
        if shutil.which("setpriv") is None or subprocess.run([*prefix, "true"], check=False).returncode:
            pytest.skip("root cannot give up its rights here")
    before, folders = files_of(registry), [registry.root, *registry.root.iterdir()]
    for folder in folders:
        folder.chmod(0o555)
    try:
        for place in (["--name", "both"], ["--name", "new"], ["-o", registry.root / "out.h5"]):
            result = combine(registry, place, prefix)
            assert (result.returncode, result.stdout) == (8, "")
            assert "Permission denied" in result.stderr
            assert "\nhint: Check the permissions" in result.stderr
    finally:
        for folder in folders:
            folder.chmod(0o755)
    assert files_of(registry) == before


def test_under_a_limit_on_the_size_of_files_nothing_changes(registry):
    before = files_of(registry)
    for place in (["--name", "both"], ["--name", "new"], ["-o", registry.root / "out.h5"]):
        limited = combine(
            registry, place, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
        )
        assert (limited.returncode, limited.stdout) == (8, "")
        assert "File too large" in limited.stderr
        assert "\nhint: The limit on file sizes" in limited.stderr
    assert files_of(registry) == before


@pytest.mark.parametrize(
    "command", ["ls", "ls curve", "log curve", "gc --keep-last 1", "lock", "tag curve@1 best"]
)
def test_a_store_that_is_not_there_is_said(run, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    refused = run(*command.split(), "--store", "typo")
    assert (refused.exit_code, refused.stdout) == (4, "")
    assert (
        f"error: {tmp_path / 'typo'}: there is no such store.\nhint: Check the path in --store"
        in refused.stderr
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("options", [[], ["--force"], ["--if-changed"]])
def test_no_command_writes_over_a_version(run, library, tmp_path, options):
    registry = store.Registry(tmp_path / "kept")
    path = registry.publish("both", (library / "hook" / "1.h5").read_bytes()).path
    make = ["combine", "curve", "hook", "--store", library, "-o", path, *options]
    refused = run(*make)
    assert (refused.exit_code, refused.stdout) == (2, "")
    assert (
        f"hint: Write it elsewhere, or publish the next version: --name both --store {registry.root}."
        in refused.stderr
    )
    assert path.read_bytes() == (library / "hook" / "1.h5").read_bytes()
    published = run(
        "combine", "curve", "hook", "--store", library, "-o", tmp_path / "both.h5", "--depfile", path
    )
    assert published.exit_code == 2
    assert path.read_bytes() == (library / "hook" / "1.h5").read_bytes()


def test_what_a_hint_names_can_be_typed(run, library, tmp_path, monkeypatch):
    """Hints give the version that was meant, and a place with as many coordinates as the skill has."""
    registry = store.Registry(tmp_path / "kept")
    registry.publish("hook", (library / "hook" / "1.h5").read_bytes())
    refused = run("rm", "hook", "--store", registry.root)
    (hint,) = re.findall("hint: Write (.*), or --all (.*) for every version", refused.stderr)
    assert hint == ("hook@1", "hook")
    refused = run("inspect", "hook", "--store", registry.root, "--at", "1,2,3")
    (place,) = re.findall("hint: Separate them by commas, as in (--at .*)[.]$", refused.stderr, re.MULTILINE)
    assert run("inspect", "hook", "--store", registry.root, *place.split()).exit_code == 0
    assert run("rm", hint[0], "--store", registry.root).exit_code == 0
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "a.npz").touch()
    refused = run("learn", tmp_path / "data", "-o", tmp_path / "a.h5")
    assert f"hint: Name its files: {tmp_path / 'data'}/*.npz" in refused.stderr
