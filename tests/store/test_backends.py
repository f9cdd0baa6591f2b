"""What a store promises wherever its files are: in a directory, or in any other place of the same methods."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from skillctl import store
from skillctl.errors import ArtifactError, NotFoundError, StoreError, UsageError
from skillctl.store.errors import NotAnArtifactError
from skillctl.store.files import MAX_FILE_BYTES
from skillctl.store.local import LocalBackend


class MemoryBackend:
    """Folders of files in a dictionary; `copies` is a directory for those that are wanted as files."""

    def __init__(self, copies: Path) -> None:
        self.place = "memory:"
        self.copies = copies
        self.kept: dict[str, dict[str, bytes]] = {}
        self.lock = threading.RLock()

    def folders(self) -> tuple[str, ...]:
        return tuple(self.kept)

    def files(self, folder: str) -> tuple[str, ...]:
        return tuple(self.kept.get(folder, ()))

    def read(self, folder: str, file: str, limit: int = MAX_FILE_BYTES) -> bytes:
        data = self.kept.get(folder, {}).get(file)
        if data is None:
            raise NotFoundError(f"{folder}/{file}: there is no such file.")
        if len(data) > limit:
            raise NotAnArtifactError(file, "larger than it may be")
        return data

    def beginning(self, folder: str, file: str, length: int) -> tuple[bytes, int]:
        data = self.read(folder, file)
        return data[:length], len(data)

    @contextmanager
    def create(self, folder: str, data: bytes) -> Iterator[Callable[[str], None]]:
        def call(name: str) -> None:
            with self.lock:
                if name in self.kept.setdefault(folder, {}):
                    raise FileExistsError(name)
                self.kept[folder][name] = data

        yield call

    def replace(self, folder: str, file: str, data: bytes) -> None:
        self.kept[folder][file] = data

    def delete(self, folder: str, files: Iterable[str]) -> None:
        for file in files:
            self.kept[folder].pop(file, None)

    @contextmanager
    def locked(self, folder: str, *, shared: bool = False) -> Iterator[None]:
        with self.lock:
            yield

    def path(self, folder: str, file: str) -> Path:
        path = self.copies / folder / file
        if file in self.files(folder) and not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(self.kept[folder][file])
        return path


BACKENDS = {"directory": LocalBackend, "memory": MemoryBackend}


@pytest.fixture(params=BACKENDS)
def empty(tmp_path, request):
    return store.Registry(BACKENDS[request.param](tmp_path / "skills"))


@pytest.fixture
def registry(empty, versions):
    for data in versions[:3]:
        empty.publish("reach", data)
    return empty


def test_versions_are_numbered_from_one_and_whole(empty, versions):
    published = [empty.publish("reach", data) for data in versions]
    assert [p.version for p in published] == [1, 2, 3, 4]
    assert all(p.created and p.name == "reach" for p in published)
    assert [p.path.read_bytes() for p in published] == versions
    assert [p.digest for p in published] == [store.digest_of(data) for data in versions]
    assert [empty.header("reach", p.version).digest for p in published] == [p.digest for p in published]
    assert empty.versions("reach") == (1, 2, 3, 4)
    assert sorted(empty.backend.files("reach")) == ["1.h5", "2.h5", "3.h5", "4.h5"]


def test_references_lead_to_versions(registry, versions):
    digests = [store.digest_of(data) for data in versions]
    registry.tag("reach", 2, "release")
    for selector, version in (("", 3), ("@latest", 3), ("@1", 1), ("@release", 2), (f"@{digests[0]}", 1)):
        located = registry.locate(f"reach{selector}")
        assert (located.name, located.version) == ("reach", version)
        assert store.read_skill(located.path).digest == digests[version - 1]
    for unknown in ("rech", "reach@4", "reach@next", f"reach@{digests[3]}"):
        with pytest.raises(NotFoundError):
            registry.locate(unknown)


def test_names_are_the_skills_that_have_versions(empty, versions):
    assert empty.names() == ()
    for name in ("reach", "grasp"):
        empty.publish(name, versions[0])
    with empty.backend.create("notes", b"") as call:
        call("refs.toml")
    with empty.backend.create("Upper", b"") as call:
        call("1.h5")
    assert empty.names() == ("grasp", "reach")


def test_nothing_is_published_that_could_not_be_read(empty, versions):
    with pytest.raises(ArtifactError, match="the new version of reach is damaged"):
        empty.publish("reach", versions[0][:-1])
    assert empty.backend.folders() == ()


def test_what_is_not_named_leaves_nothing(empty):
    with pytest.raises(ZeroDivisionError), empty.backend.create("reach", b"data"):
        raise ZeroDivisionError
    assert empty.backend.files("reach") == ()


def test_a_name_is_given_once(empty):
    with empty.backend.create("reach", b"first") as call:
        call("1.h5")
    with empty.backend.create("reach", b"second") as call:
        with pytest.raises(FileExistsError):
            call("1.h5")
        call("2.h5")
    assert [empty.backend.read("reach", file) for file in ("1.h5", "2.h5")] == [b"first", b"second"]


def test_a_full_skill_is_said(empty, versions):
    with empty.backend.create("reach", b"") as call:
        call("999999.h5")
    with pytest.raises(StoreError, match="reach has 999999 versions; no more fit"):
        empty.publish("reach", versions[1])


def test_versions_published_at_once_have_numbers_of_their_own(empty, versions):
    threads = [threading.Thread(target=empty.publish, args=("reach", data)) for data in versions]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert empty.versions("reach") == (1, 2, 3, 4)
    assert sorted(empty.header("reach", n).digest for n in range(1, 5)) == sorted(
        map(store.digest_of, versions)
    )


@pytest.mark.parametrize("writer", ["publish", "tag", "remove"])
def test_signatures_of_a_version_that_is_gone_go_with_the_next_writer(registry, versions, writer):
    for number in (2, 3):
        registry.backend.replace("reach", f"{number}.h5.sig", b"# Signatures\n")
    registry.backend.delete("reach", ["3.h5"])
    {
        "publish": lambda: registry.publish("reach", versions[3]),
        "tag": lambda: registry.tag("reach", 1, "release"),
        "remove": lambda: registry.remove("reach", [1]),
    }[writer]()
    signatures = {name for name in registry.backend.files("reach") if name.endswith(".sig")}
    assert signatures == {"2.h5.sig"}


@pytest.mark.parametrize("name", ["../x", "a/b", "", ".", "-rf", "Reach", "a\0", "x" * 65, "x.h5"])
def test_nothing_is_published_under_a_bad_name(empty, versions, name):
    with pytest.raises(UsageError):
        empty.publish(name, versions[0])
    with pytest.raises(UsageError):
        empty.versions(name)
    assert empty.backend.folders() == ()


def test_what_the_newest_version_holds_is_not_published_again(empty, versions):
    first = empty.publish("reach", versions[0])
    again = empty.publish("reach", versions[0])
    assert (again.version, again.created, again.path, again.digest) == (1, False, first.path, first.digest)

    empty.publish("reach", versions[1])
    assert empty.publish("reach", versions[0]).version == 3  # going back is a new version
    assert empty.publish("other", versions[0]).version == 1


def test_an_alias_names_a_version_until_it_is_moved_or_removed(registry):
    assert registry.tag("reach", 2, "release") is None
    assert registry.locate("reach@release").version == 2
    assert registry.tag("reach", 3, "release") == 2
    assert registry.tag("reach", 1, "v1.0") is None
    assert registry.aliases("reach") == {"release": 3, "v1.0": 1}
    assert registry.locate("reach@v1.0").version == 1
    assert registry.untag("reach", "release") == 3
    with pytest.raises(NotFoundError, match="reach has no alias release") as caught:
        registry.locate("reach@release")
    assert "It has v1.0" in caught.value.hint


def test_only_what_exists_can_be_tagged_and_untagged(registry):
    with pytest.raises(NotFoundError, match="reach has no version 9"):
        registry.tag("reach", 9, "release")
    with pytest.raises(NotFoundError, match="no skill rech"):
        registry.tag("rech", 1, "release")
    with pytest.raises(NotFoundError, match="no alias release"):
        registry.untag("reach", "release")


def test_aliases_given_at_once_are_all_kept(registry):
    names = [f"a{index}" for index in range(24)]
    threads = [threading.Thread(target=registry.tag, args=("reach", 1, name)) for name in names]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(registry.aliases("reach")) == sorted(names)


def test_a_removed_version_loses_its_alias_and_leaves_the_others(registry):
    registry.tag("reach", 2, "release")
    registry.tag("reach", 3, "next")
    assert registry.remove("reach", [2]) == ((2,), {"release": 2})
    assert registry.versions("reach") == (1, 3)
    assert registry.aliases("reach") == {"next": 3}
    with pytest.raises(NotFoundError, match="reach has no version 2: it was removed"):
        registry.locate("reach@2")


@pytest.mark.parametrize("removed", [[3], [2, 3], [1, 2, 3]])
def test_the_number_of_a_removed_version_is_never_given_again(registry, versions, removed):
    registry.remove("reach", removed)
    assert registry.publish("reach", versions[3]).version == 4
    registry.remove("reach", [4])
    assert registry.publish("reach", versions[3]).version == 5
    files = registry.backend.files("reach")
    assert [name for name in files if name.endswith(".removed")] == ["4.removed"]


def test_removing_an_old_version_needs_no_mark(registry):
    registry.remove("reach", [1])
    assert sorted(registry.backend.files("reach")) == ["2.h5", "3.h5"]


def test_a_skill_without_versions_is_not_listed(registry):
    registry.remove("reach", [1, 2, 3])
    assert registry.names() == ()
    with pytest.raises(NotFoundError):
        registry.remove("reach", [1])


def test_signatures_of_a_version_are_kept_with_it(registry, versions):
    signatures = [
        store.Signature(f"ed25519:{key * 64}", store.digest_of(versions[2]), "0" * 128) for key in "01"
    ]
    located = registry.locate("reach")
    assert store.read_signatures(located) == ()
    assert [store.add_signature(located, signature) for signature in (*signatures, signatures[0])] == [
        True,
        True,
        False,
    ]
    assert store.read_signatures(registry.locate("reach@3")) == tuple(signatures)
    assert "3.h5.sig" in registry.backend.files("reach")
    registry.remove("reach", [3])
    assert [name for name in registry.backend.files("reach") if name.endswith(".sig")] == []
