"""-o FILE: afterwards the file is old or new, whole, and nothing else is left."""

import errno
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from skillctl import store
from skillctl.errors import StoreError


def only(directory: Path) -> list[str]:
    return sorted(path.name for path in directory.iterdir())


def test_a_new_file_respects_the_umask(tmp_path):
    path = tmp_path / "skill.h5"
    old = os.umask(0o027)
    try:
        store.write_file(path, b"new")
    finally:
        os.umask(old)
    assert path.read_bytes() == b"new"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert only(tmp_path) == ["skill.h5"]


def test_an_existing_file_is_replaced_whole(tmp_path):
    path = tmp_path / "skill.h5"
    path.write_bytes(b"old")
    other_name = tmp_path / "hard link"
    other_name.hardlink_to(path)

    store.write_file(path, b"new")

    assert path.read_bytes() == b"new"
    assert other_name.read_bytes() == b"old"  # a new file took the name; the old one was not written into


def test_a_planted_link_is_replaced_and_its_target_untouched(tmp_path):
    (target := tmp_path / "target").write_bytes(b"old")
    (path := tmp_path / "skill.h5").symlink_to(target)

    store.write_file(path, b"new")

    assert target.read_bytes() == b"old"
    assert not path.is_symlink()
    assert path.read_bytes() == b"new"


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EFBIG])
def test_when_the_disk_refuses_the_old_file_stays_and_nothing_else(tmp_path, monkeypatch, number):
    (path := tmp_path / "skill.h5").write_bytes(b"old")

    def full(_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StoreError, match=f"cannot write .*skill.h5: {os.strerror(number)}") as caught:
        store.write_file(path, b"new")
    assert caught.value.hint
    assert path.read_bytes() == b"old"
    assert only(tmp_path) == ["skill.h5"]


def test_an_interrupt_leaves_nothing_behind(tmp_path, monkeypatch):
    def interrupt(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        store.write_file(tmp_path / "skill.h5", b"new")
    assert only(tmp_path) == []


def test_a_limit_on_file_sizes_is_said(tmp_path):
    code = (
        "import resource, sys; from pathlib import Path; from skillctl import store\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1024, 1024))\n"
        "store.write_file(Path(sys.argv[1]), bytes(4096))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "skill.h5")], capture_output=True, text=True, check=False
    )
    assert "StoreError: cannot write" in run.stderr
    assert "File too large" in run.stderr
    assert only(tmp_path) == []


@pytest.mark.parametrize("what", ["directory", "pipe", "device"])
def test_only_a_regular_file_is_replaced(tmp_path, what):
    path = {"directory": tmp_path / "d", "pipe": tmp_path / "p", "device": Path(os.devnull)}[what]
    if what == "directory":
        path.mkdir()
    if what == "pipe":
        os.mkfifo(path)
    before = path.stat().st_mode

    with pytest.raises(StoreError, match="exists and is not a regular file"):
        store.write_file(path, b"new")

    assert path.stat().st_mode == before


@pytest.mark.parametrize(
    ("path", "cause", "hint"),
    [
        ("missing/skill.h5", "No such file or directory", "mkdir"),
        ("file/skill.h5", "Not a directory", "a directory is needed"),
        ("x" * 300, "File name too long", "shorter name"),
    ],
)
def test_a_place_where_no_file_can_be(tmp_path, path, cause, hint):
    (tmp_path / "file").touch()
    with pytest.raises(StoreError, match=cause) as caught:
        store.write_file(tmp_path / path, b"new")
    assert hint in caught.value.hint
    assert only(tmp_path) == ["file"]
