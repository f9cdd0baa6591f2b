"""Words for versions, kept as text; and numbers that stay taken when their version is removed."""

import os
import signal
import subprocess
import sys
import time

import pytest

from skillctl import store
from skillctl.errors import NotFoundError, StoreError, UsageError
from skillctl.store import errors, files
from skillctl.usecases.versions import collect


@pytest.fixture
def registry(tmp_path, versions):
    registry = store.Registry(tmp_path / "skills")
    for data in versions[:3]:
        registry.publish("reach", data)
    return registry


def test_aliases_are_text_that_a_review_can_read(registry):
    for version, alias in ((3, "release"), (1, "v1.0")):
        registry.tag("reach", version, alias)
    text = (registry.root / "reach" / "refs.toml").read_text(encoding="utf-8")
    assert [line for line in text.splitlines() if not line.startswith("#")] == [
        "[aliases]", "release = 3", '"v1.0" = 1',
    ]  # fmt: skip


@pytest.mark.parametrize("alias", [
    "3", "latest", "sha256:0123abcd", "", "-x", "Release", "a b", "a\n", "x" * 65, "a@b", "\x1b", "ä",
], ids=repr)  # fmt: skip
def test_what_cannot_be_an_alias(registry, alias):
    with pytest.raises(UsageError, match="cannot be an alias") as caught:
        registry.tag("reach", 1, alias)
    assert str(caught.value).isprintable()
    assert not (registry.root / "reach" / "refs.toml").exists()


def entries_of(registry):
    return [path.name for path in (registry.root / "reach").iterdir()]


BROKEN = [
    (b"[aliases\nrelease = 1", "not TOML"),
    (b"<<<<<<< HEAD\n", "not TOML"),
    (b"\xff\xfe", "not TOML"),
    (b"a = " + b"[" * 100_000, "not TOML"),
    (b"release = 1", "expected one table"),
    (b"aliases = 3", "expected one table"),
    (b"[aliases]\n[more]\n", "expected one table"),
    (b"[aliases]\nrelease = '1'", "is not a version number"),
    (b"[aliases]\nrelease = true", "is not a version number"),
    (b"[aliases]\nrelease = 0", "is not a version number"),
    (b"[aliases]\nrelease = 1000000", "is not a version number"),
    (b"[aliases]\nv1.0 = 1", "is not a version number"),
    (b"[aliases]\nlatest = 1", "cannot be an alias"),
    (b'[aliases]\n"\\u001b[2J" = 1', "cannot be an alias"),
    (b"#" * ((1 << 20) + 1), "larger than"),
]


@pytest.mark.parametrize(("content", "cause"), BROKEN, ids=range(len(BROKEN)))
def test_a_broken_file_is_one_clear_error_and_stays_as_it_is(registry, content, cause):
    (path := registry.root / "reach" / "refs.toml").write_bytes(content)
    for act in (
        lambda: registry.locate("reach@release"),
        lambda: registry.tag("reach", 1, "release"),
        lambda: registry.untag("reach", "release"),
        lambda: registry.remove("reach", [1]),
    ):
        with pytest.raises(errors.InvalidRefsError, match=cause) as caught:
            act()
        assert "refs.toml" in str(caught.value)
        assert str(caught.value).isprintable()
    assert path.read_bytes() == content
    assert registry.versions("reach") == (1, 2, 3)
    assert registry.locate("reach@2").version == 2  # what names no alias still works


def test_a_link_in_place_of_the_file_is_not_followed(registry, tmp_path):
    (target := tmp_path / "target").write_text("[aliases]\nrelease = 1\n")
    (registry.root / "reach" / "refs.toml").symlink_to(target)
    with pytest.raises(errors.InvalidRefsError, match="a symbolic link"):
        registry.locate("reach@release")


def test_an_alias_of_a_version_that_is_gone_says_so(registry):
    registry.tag("reach", 2, "release")
    (registry.root / "reach" / "2.h5").unlink()
    with pytest.raises(NotFoundError, match="reach@release is version 2, which does not exist"):
        registry.locate("reach@release")


def test_when_the_disk_refuses_the_aliases_stay_what_they_were(registry, monkeypatch):
    registry.tag("reach", 1, "release")

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(StoreError, match="No space left"):
            registry.tag("reach", 2, "release")
    assert registry.aliases("reach") == {"release": 1}
    assert sorted(entries_of(registry)) == ["1.h5", "2.h5", "3.h5", "refs.toml"]


# Removal


@pytest.mark.parametrize("step", ["unlink", "fsync"])
def test_a_removal_that_is_cut_short_frees_no_number(registry, versions, monkeypatch, step):
    def refuse(*_, **__):
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(os, step, refuse)
        with pytest.raises(StoreError):
            registry.remove("reach", [3])
    assert registry.versions("reach") == (1, 2, 3)
    assert registry.publish("reach", versions[3]).version == 4


WRITERS = {
    "publish": lambda registry, data: registry.publish("reach", data),
    "tag": lambda registry, _: registry.tag("reach", 1, "release"),
    "remove": lambda registry, _: registry.remove("reach", [1]),
}


@pytest.mark.parametrize(
    ("call", "said", "left"),
    [(1, "Nothing was removed.", (1, 2, 3)), (2, "Removed before that: reach@1, reach@release.", (2, 3))],
)
def test_a_removal_that_the_disk_refuses_says_what_is_gone(registry, monkeypatch, call, said, left):
    registry.tag("reach", 1, "release")
    synced, calls = os.fsync, iter(range(1, 100))

    def full(descriptor):  # first the aliases are synced, then the directory without the version
        if next(calls) >= call:
            raise OSError(28, "No space left on device")
        synced(descriptor)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(StoreError, match="No space left on device") as caught:
            registry.remove("reach", [1])
    assert str(caught.value).endswith(said)
    assert registry.versions("reach") == left


def test_what_is_gone_is_said_even_if_what_is_kept_cannot_be_counted(registry, monkeypatch):
    listed = store.Registry.versions

    def refusing(self, name):
        if not self.path_of(name, 1).exists():
            raise StoreError("cannot list it.")
        return listed(self, name)

    monkeypatch.setattr(store.Registry, "versions", refusing)
    with pytest.raises(StoreError, match=r"cannot list it\. Removed before that: reach@1, reach@2\."):
        collect(["reach"], keep_last=1, store=registry.root)


def test_a_version_that_was_tagged_meanwhile_is_kept_or_refused(registry):
    registry.tag("reach", 1, "release")
    assert registry.remove("reach", [1, 2], tagged="keep") == ((2,), {})
    with pytest.raises(UsageError, match=r"reach@1 is reach@release; nothing was removed\."):
        registry.remove("reach", [1], tagged="refuse")
    assert registry.versions("reach") == (1, 3)
    assert registry.aliases("reach") == {"release": 1}


@pytest.mark.parametrize("writer", WRITERS)
def test_signatures_of_a_version_that_is_gone_are_removed_by_the_next_writer(registry, versions, writer):
    """A removal may be killed when the version is gone and its signatures are not."""
    directory = registry.root / "reach"
    for name in ("2.h5.sig", "3.h5.sig", "notes.h5.sig", "02.h5.sig"):
        (directory / name).write_text("# Signatures\n")
    (directory / "3.h5").unlink()
    (directory / "3.removed").touch()
    WRITERS[writer](registry, versions[3])
    assert sorted(directory.glob("*.sig")) == [
        directory / name for name in ("02.h5.sig", "2.h5.sig", "notes.h5.sig")
    ]


def test_halves_of_signatures_are_removed_once_they_are_old(registry):
    directory = registry.root / "reach"
    for name, age in {"01234567": 2 * files.STALE_SECONDS, "76543210": 0}.items():
        (path := directory / f".9.h5.sig.{name}.tmp").touch()
        os.utime(path, (path.stat().st_mtime - age,) * 2)
    registry.tag("reach", 1, "release")
    assert [path.name for path in directory.glob("*.tmp")] == [".9.h5.sig.76543210.tmp"]


def test_a_version_that_is_still_there_has_its_signatures(registry, monkeypatch):
    (signatures := registry.root / "reach" / "2.h5.sig").write_text("# Signatures\n")
    unlink = os.unlink

    def refuse(path, **options):
        if path == "2.h5":
            raise OSError(5, "Input/output error")
        unlink(path, **options)

    with monkeypatch.context() as patch:
        patch.setattr(os, "unlink", refuse)
        with pytest.raises(StoreError):
            registry.remove("reach", [1, 2])
    assert registry.versions("reach") == (2, 3)
    assert signatures.exists()
    registry.remove("reach", [2])
    assert not signatures.exists()


CHURN = """
import sys
from dataclasses import replace
from pathlib import Path
from skillctl import store
registry, base = store.Registry(Path(sys.argv[1])), store.read_skill(Path(sys.argv[2]))
for index in range(100_000):
    operation = store.Operation(command="learn", results={"round": sys.argv[3], "index": index})
    version = registry.publish("reach", store.encode(replace(base, operation=operation))).version
    print(version, flush=True)
    registry.remove("reach", [version])
"""


def test_numbers_stay_taken_whenever_a_process_that_removes_is_killed(tmp_path, versions):
    (template := tmp_path / "template.h5").write_bytes(versions[0])
    given: list[int] = []
    for round_number in range(6):
        process = subprocess.Popen(
            [sys.executable, "-c", CHURN, tmp_path / "skills", template, str(round_number)],
            stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        first = process.stdout.readline()
        time.sleep(0.013 * round_number)
        process.send_signal(signal.SIGKILL)
        given += [int(line) for line in (first + process.communicate(timeout=60)[0]).split()]
    assert given == sorted(set(given))
    assert store.Registry(tmp_path / "skills").publish("reach", versions[3]).version > given[-1]
