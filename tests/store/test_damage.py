"""Bytes that changed on the way, and things that are no artifacts: refused before HDF5 sees them."""

import os
import socket
import time

import h5py
import numpy as np
import pytest

from skillctl import store
from skillctl.errors import ArtifactError, NotFoundError, StoreError
from skillctl.store import errors, files, reader


@pytest.fixture
def place(tmp_path):
    def write(data: bytes, name: str = "skill.h5"):
        (path := tmp_path / name).write_bytes(data)
        return path

    return write


def flipped(data: bytes, bit: int) -> bytes:
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def test_every_bit_of_the_seal_and_samples_of_the_body_count(good):
    rng = np.random.default_rng(0)
    bits = [*range(8 * 512), *rng.integers(8 * 512, 8 * len(good), 2000).tolist()]
    for bit in bits:
        with pytest.raises(ArtifactError):
            store.decode(flipped(good, bit))


def test_one_flipped_bit_in_the_body_is_named_as_damage(good):
    with pytest.raises(errors.DamagedArtifactError, match=r"reach\.h5 is damaged: .* do not match its seal"):
        store.decode(flipped(good, 8 * 3000), "reach.h5")


def test_every_truncation_is_refused(good):
    for length in [*range(1200), *range(1200, len(good), 97), len(good) - 1]:
        with pytest.raises(ArtifactError):
            store.decode(good[:length])


@pytest.mark.parametrize("extra", [b"\0", b"\n", bytes(4096)])
def test_appended_bytes_are_refused(good, extra):
    with pytest.raises(errors.DamagedArtifactError, match=f"extended: {len(good) - 512 + len(extra)} bytes"):
        store.decode(good + extra)


def test_zeroed_and_swapped_blocks_are_refused(good):
    first, second = good[1024:1536], good[4096:4608]
    assert first != second
    zeroed_tail = good[:-1024] + bytes(1024)
    zeroed_block = good[:1024] + bytes(512) + good[1536:]
    swapped = good[:1024] + second + good[1536:4096] + first + good[4608:]
    for damaged in (zeroed_tail, zeroed_block, swapped):
        with pytest.raises(errors.DamagedArtifactError):
            store.decode(damaged)


@pytest.mark.parametrize("from_to", [(b"\r\n", b"\n"), (b"\n", b"\r\n"), (b"\r", b"\n")])
def test_a_text_mode_transfer_is_recognised(good, from_to):
    with pytest.raises(errors.DamagedArtifactError):
        store.decode(good.replace(*from_to))


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "the file is empty"),
        (b"t,x,y\n0,1,2\n", "does not begin with the signature"),
        (b"\x89PNG\r\n\x1a\n" + bytes(600), "does not begin with the signature"),
        (b"\x89HDF\r\n\x1a\n" + bytes(600), "plain HDF5 file"),
    ],
)
def test_another_file_is_called_what_it_is(place, data, reason):
    path = place(data, "notes.h5")
    with pytest.raises(
        errors.NotAnArtifactError, match=f"notes.h5 is not a skill artifact: .*{reason}"
    ) as caught:
        store.read_skill(path)
    assert "skillctl learn" in caught.value.hint


def test_a_plain_hdf5_body_without_its_seal_is_refused(good, place):
    with pytest.raises(errors.NotAnArtifactError, match="without the seal"):
        store.read_skill(place(good[512:]))


@pytest.fixture
def special(tmp_path, good, monkeypatch):
    """Paths at which something else than a file stands."""
    (directory := tmp_path / "directory.h5").mkdir()
    os.mkfifo(fifo := tmp_path / "fifo.h5")
    (target := tmp_path / "target.h5").write_bytes(good)
    (link := tmp_path / "link.h5").symlink_to(target)
    (dangling := tmp_path / "dangling.h5").symlink_to(tmp_path / "nothing")
    bound = socket.socket(socket.AF_UNIX)
    monkeypatch.chdir(tmp_path)  # the path of a socket may have 107 bytes only
    bound.bind("socket.h5")
    yield {
        "directory": directory,
        "pipe": fifo,
        "socket": tmp_path / "socket.h5",
        "device": "/dev/zero",
        "link": link,
        "dangling link": dangling,
    }
    bound.close()


@pytest.mark.parametrize("what", ["directory", "pipe", "socket", "device", "link", "dangling link"])
def test_what_is_not_a_regular_file_is_refused_at_once(special, what):
    start = time.monotonic()
    with pytest.raises(errors.NotAnArtifactError, match=r"not a regular file|a symbolic link|a directory"):
        store.read_skill(special[what])
    assert time.monotonic() - start < 1  # [s]; waiting for a pipe's writer would never end


def test_a_huge_file_is_refused_by_its_size(tmp_path, monkeypatch):
    path = tmp_path / "huge.h5"
    with path.open("wb") as file:
        file.truncate(10 << 30)
    monkeypatch.setattr(os, "fdopen", None)  # nothing is read
    with pytest.raises(errors.NotAnArtifactError, match="larger than 64 MiB"):
        store.read_skill(path)


def test_the_limit_itself_is_read(tmp_path):
    path = tmp_path / "limit.bin"
    with path.open("wb") as file:
        file.truncate(1024)
    assert files.read_once(path, 1024) == bytes(1024)
    with pytest.raises(errors.NotAnArtifactError):
        files.read_once(path, 1023)
    assert files.MAX_FILE_BYTES == 64 * 1024 * 1024


def test_a_file_swapped_after_it_was_opened_changes_nothing(good, place, monkeypatch):
    path, evil = place(good), place(b"evil", "evil")
    opened = []
    real_open = os.open

    def swapping_open(file, *args, **kwargs):
        descriptor = real_open(file, *args, **kwargs)
        if file == path:
            opened.append(file)
            evil.replace(path)
        return descriptor

    monkeypatch.setattr(os, "open", swapping_open)
    assert store.read_skill(path).digest == store.digest_of(good)
    assert opened == [path]
    assert path.read_bytes() == b"evil"


def test_a_missing_file_is_not_found_and_its_neighbour_is_suggested(good, place):
    path = place(good, "reach_left.h5")
    with pytest.raises(NotFoundError, match=r"reach_lift\.h5: there is no such file") as caught:
        store.read_skill(path.with_name("reach_lift.h5"))
    assert caught.value.hint == f"Did you mean {path}?"


def test_no_permission_is_the_systems_refusal(good, place, monkeypatch):
    path = place(good)

    def forbidden(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", forbidden)
    with pytest.raises(StoreError, match=r"cannot read .*: Permission denied") as caught:
        store.read_skill(path)
    assert "permissions" in caught.value.hint


def test_control_characters_of_a_name_are_never_echoed(good):
    with pytest.raises(errors.DamagedArtifactError) as caught:
        store.decode(good[:-1], "a\x1b[2J\u202e.h5")
    assert str(caught.value).isprintable()
    assert r"a\x1b[2J\u202e.h5" in str(caught.value)


@pytest.mark.parametrize("kind", [
    OSError, RuntimeError, ValueError, TypeError, KeyError, AttributeError, OverflowError, IndexError,
    UnicodeDecodeError, RecursionError, MemoryError, NotImplementedError, SystemError,
])  # fmt: skip
@pytest.mark.parametrize("place", ["File", "checked_datasets"])
def test_whatever_hdf5_raises_is_one_sentence(good, monkeypatch, kind, place):
    def raising(*_, **__):
        raise kind("utf-8", b"x", 0, 1, "y") if kind is UnicodeDecodeError else kind("\x1b[2J" * 99)

    owner = h5py if place == "File" else reader
    monkeypatch.setattr(owner, place, raising)
    with pytest.raises(
        errors.InvalidArtifactError, match=r"reach\.h5 .*HDF5 cannot read it \(\w+Error"
    ) as caught:
        store.decode(good, "reach.h5")
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 400
    assert isinstance(caught.value.__cause__, kind)


@pytest.mark.parametrize("kind", [KeyboardInterrupt, SystemExit])
def test_an_interrupt_is_no_damage(good, monkeypatch, kind):
    def raising(*_):
        raise kind

    monkeypatch.setattr(reader, "checked_datasets", raising)
    with pytest.raises(kind):
        store.decode(good)
