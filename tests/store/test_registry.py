"""The store: whole, immutable, numbered versions, whatever stands in the way."""

import os
import secrets
import stat
from contextlib import suppress

import pytest

from skillctl import store
from skillctl.errors import ArtifactError, StoreError
from skillctl.store import errors, files, local


@pytest.fixture(params=["unnamed", "named"])
def registry(tmp_path, request, monkeypatch):
    """A store on a file system with, and one without, temporary files that have no name."""
    if request.param == "named":
        monkeypatch.setattr(local, "_open_unnamed", lambda _: None)
    return store.Registry(tmp_path / "skills")


def files_in(registry: store.Registry) -> list[str]:
    return sorted(str(path.relative_to(registry.root)) for path in registry.root.rglob("*"))


def test_versions_are_numbered_from_one_and_whole(registry, versions):
    published = [registry.publish("reach", data) for data in versions]

    assert [p.version for p in published] == [1, 2, 3, 4]
    assert all(p.created and p.name == "reach" for p in published)
    assert [p.path.read_bytes() for p in published] == versions
    assert [p.digest for p in published] == [store.digest_of(data) for data in versions]
    assert registry.versions("reach") == (1, 2, 3, 4)
    assert files_in(registry) == ["reach", *(f"reach/{n}.h5" for n in (1, 2, 3, 4))]


@pytest.mark.parametrize("umask", [0o000, 0o022, 0o777])
def test_versions_are_read_only_whatever_the_umask(registry, versions, umask):
    registry.root.mkdir()
    (registry.root / "reach").mkdir()
    old = os.umask(umask)
    try:
        path = registry.publish("reach", versions[0]).path
    finally:
        os.umask(old)
    assert stat.S_IMODE(path.stat().st_mode) == 0o444
    assert path.stat().st_nlink == 1


def test_a_race_lost_to_the_same_content_makes_no_second_version(registry, versions, monkeypatch):
    directory = registry.publish("reach", versions[0]).path.parent
    real_link, calls = os.link, []

    def beaten(*arguments, **options):
        calls.append(arguments)
        (directory / f"{len(calls) + 1}.h5").write_bytes(versions[len(calls)])  # another writer is faster
        return real_link(*arguments, **options)

    monkeypatch.setattr(os, "link", beaten)
    published = registry.publish("reach", versions[2])
    assert (published.version, published.created) == (3, False)
    assert len(calls) == 2  # 2 was taken by other content, 3 by the same


def test_content_counts_not_the_bytes_of_the_file(registry, hostile, nested):
    """Another HDF5 library may lay the same content out differently."""

    def move(body):
        values = body["model/means"][()]
        del body["model/means"]
        body.create_dataset("model/means", data=values, track_times=False)

    registry.publish("reach", store.encode(nested))
    assert not registry.publish("reach", hostile(move, honest=True)).created


def test_a_damaged_newest_version_is_passed_over(registry, versions):
    path = registry.publish("reach", versions[0]).path
    path.unlink()
    path.write_bytes(b"damaged")
    assert registry.publish("reach", versions[0]).version == 2
    assert path.read_bytes() == b"damaged"


def test_the_number_after_the_highest_is_next_even_after_gaps(registry, versions):
    registry.publish("reach", versions[0])
    (registry.root / "reach" / "7.h5").write_bytes(b"")
    (registry.root / "reach" / "0.h5").write_bytes(b"")
    (registry.root / "reach" / "08.h5").write_bytes(b"")
    (registry.root / "reach" / "notes.txt").write_bytes(b"")
    assert registry.versions("reach") == (1, 7)
    assert registry.publish("reach", versions[1]).version == 8


def test_names_are_the_skills_that_have_versions(registry, versions):
    assert registry.names() == ()
    for name in ("reach", "grasp"):
        registry.publish(name, versions[0])
    (registry.root / "empty").mkdir()
    (registry.root / "demonstrations").mkdir()
    (registry.root / "demonstrations" / "a.csv").touch()
    (registry.root / "Makefile").touch()
    (registry.root / "Upper").mkdir()
    (registry.root / "Upper" / "1.h5").touch()
    assert registry.names() == ("grasp", "reach")


# Links


def test_a_link_in_place_of_a_skills_directory_is_not_followed(registry, versions, tmp_path):
    registry.root.mkdir()
    (target := tmp_path / "target").mkdir()
    (target / "1.h5").write_bytes(versions[0])
    (registry.root / "reach").symlink_to(target)

    with pytest.raises(errors.UnsafeStoreError, match="reach is a symbolic link"):
        registry.publish("reach", versions[1])
    with pytest.raises(errors.UnsafeStoreError):
        registry.locate("reach")
    assert registry.names() == ()
    assert list(target.iterdir()) == [target / "1.h5"]


@pytest.mark.parametrize("dangling", [False, True])
def test_a_link_in_place_of_the_store_is_not_followed(tmp_path, versions, dangling):
    target = tmp_path / "target"
    if not dangling:
        target.mkdir()
    (root := tmp_path / "skills").symlink_to(target)
    for act in (
        lambda r: r.publish("reach", versions[0]),
        lambda r: r.locate("reach"),
        lambda r: r.names(),
    ):
        with pytest.raises(errors.UnsafeStoreError):
            act(store.Registry(root))
    assert not target.exists() or not list(target.iterdir())


@pytest.mark.parametrize("dangling", [False, True])
def test_a_planted_version_link_is_passed_over(registry, versions, tmp_path, dangling):
    registry.publish("reach", versions[0])
    target = tmp_path / "target"
    if not dangling:
        target.write_bytes(versions[1])
    (registry.root / "reach" / "2.h5").symlink_to(target)

    assert registry.publish("reach", versions[1]).version == 3
    assert target.exists() != dangling
    with pytest.raises(errors.NotAnArtifactError, match="a symbolic link"):
        store.read_skill(registry.locate("reach@2").path)


def test_a_link_in_place_of_a_temporary_file_is_not_written_through(
    registry, versions, tmp_path, monkeypatch
):
    """Names of temporary files cannot be guessed; even so, what stands there is left alone."""
    directory = registry.publish("reach", versions[0]).path.parent
    (target := tmp_path / "target").write_text("precious")
    monkeypatch.setattr(secrets, "token_hex", lambda n: "0" * 2 * n)
    planted = [directory / f".publishing-{'0' * 16}", directory / f".refs.toml.{'0' * 8}.tmp"]
    for path in planted:
        path.symlink_to(target)
    with suppress(StoreError):  # a file without a name needs none
        registry.publish("reach", versions[1])
    with pytest.raises(StoreError, match="File exists"):
        registry.tag("reach", 1, "release")
    assert all(path.is_symlink() for path in planted)
    assert target.read_text() == "precious"
    assert registry.aliases("reach") == {}


def test_a_link_in_place_of_the_aliases_is_not_written_through(registry, versions, tmp_path):
    directory = registry.publish("reach", versions[0]).path.parent
    (target := tmp_path / "target").write_text("precious")
    (directory / "refs.toml").symlink_to(target)
    with pytest.raises(ArtifactError, match="a symbolic link"):
        registry.tag("reach", 1, "release")
    assert target.read_text() == "precious"
    assert registry.versions("reach") == (1,)


@pytest.mark.parametrize("dangling", [False, True])
def test_a_link_in_place_of_a_mark_is_one_and_is_not_written_through(registry, versions, tmp_path, dangling):
    directory = registry.publish("reach", versions[0]).path.parent
    target = tmp_path / "target"
    if not dangling:
        target.write_text("precious")
    (directory / "1.removed").symlink_to(target)
    registry.remove("reach", [1])
    assert registry.publish("reach", versions[1]).version == 2
    assert target.exists() != dangling
    assert dangling or target.read_text() == "precious"


# When the system refuses


@pytest.mark.parametrize("call", ["fsync", "fchmod", "link", "write"])
def test_when_the_disk_refuses_old_versions_stay_whole_and_nothing_is_left(
    registry, versions, monkeypatch, call
):
    registry.publish("reach", versions[0])

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, call, full)
        with pytest.raises(
            StoreError, match=r"cannot publish reach in .*: No space left on device"
        ) as caught:
            registry.publish("reach", versions[1])
    assert "Nothing was published as reach." in str(caught.value)
    assert files_in(registry) == ["reach", "reach/1.h5"]
    assert registry.locate("reach").path.read_bytes() == versions[0]
    assert registry.publish("reach", versions[1]).version == 2


def test_an_interrupt_leaves_no_temporary_file(registry, versions, monkeypatch):
    registry.publish("reach", versions[0])

    def interrupt(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(os, "link", interrupt)
        with pytest.raises(KeyboardInterrupt):
            registry.publish("reach", versions[1])
    assert files_in(registry) == ["reach", "reach/1.h5"]


def test_a_file_in_place_of_a_directory(tmp_path, versions):
    (root := tmp_path / "skills").touch()
    with pytest.raises(StoreError, match="cannot publish"):
        store.Registry(root).publish("reach", versions[0])
    root.unlink()
    root.mkdir()
    (root / "reach").touch()
    with pytest.raises(StoreError, match="cannot publish"):
        store.Registry(root).publish("reach", versions[0])
    assert (root / "reach").read_bytes() == b""


def test_what_killed_writers_left_is_swept_but_not_what_others_are_writing(registry, versions):
    directory = registry.publish("reach", versions[0]).path.parent
    for name, age in {"old": 2 * files.STALE_SECONDS, "new": 0}.items():
        (path := directory / f".publishing-{name}").touch()
        os.utime(path, (path.stat().st_mtime - age,) * 2)
    registry.publish("reach", versions[1])
    assert sorted(path.name for path in directory.glob(".publishing-*")) == [".publishing-new"]


def test_what_a_killed_tag_left_is_swept_by_the_next(registry, versions):
    directory = registry.publish("reach", versions[0]).path.parent
    for name, age in {"0123abcd": 2 * files.STALE_SECONDS, "dcba3210": 0}.items():
        (path := directory / f".refs.toml.{name}.tmp").touch()
        os.utime(path, (path.stat().st_mtime - age,) * 2)
    registry.tag("reach", 1, "release")
    assert [path.name for path in directory.glob(".refs*")] == [".refs.toml.dcba3210.tmp"]


def test_what_cannot_be_swept_stays_and_hinders_nobody(registry, versions, tmp_path):
    directory = registry.publish("reach", versions[0]).path.parent
    (target := tmp_path / "target").write_text("precious")
    (directory / ".publishing-directory").mkdir()
    (directory / ".publishing-link").symlink_to(target)
    for path in directory.glob(".publishing-*"):
        os.utime(path, (0, 0), follow_symlinks=False)
    assert registry.publish("reach", versions[1]).version == 2
    assert [path.name for path in directory.glob(".publishing-*")] == [".publishing-directory"]
    assert target.read_text() == "precious"
