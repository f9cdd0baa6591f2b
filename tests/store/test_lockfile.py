"""The lock file: text that says by content which skills may be used."""

import sys

import pytest

from skillctl import store
from skillctl.errors import NotFoundError, UsageError
from skillctl.store.errors import InvalidLockError, NotLockedError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

DIGESTS = [f"sha256:{digit * 64}" for digit in "123"]
REACH = store.LockedSkill("reach@release", DIGESTS[0], "reach", 3)
PLACE = store.LockedSkill("place", DIGESTS[1], "place", 1)
PART = store.LockedSkill('parts/ünï "quoted" \\ part.h5', DIGESTS[2])


@pytest.fixture
def place(tmp_path):
    return tmp_path / "skillctl.lock"


def test_a_lock_is_read_as_it_was_written_whatever_the_order(place):
    text = store.lock_text([PART, REACH, PLACE])
    assert text == store.lock_text([REACH, PLACE, PART])
    place.write_text(text, encoding="utf-8")
    assert store.read_lock(place) == store.Lock(place, (PLACE, REACH, PART))
    assert store.is_lock(place)
    tables = tomllib.loads(text)["skill"]  # as another program reads it
    assert tables[1] == {"reference": "reach@release", "name": "reach", "version": 3, "digest": DIGESTS[0]}
    assert tables[2] == {"file": PART.reference, "digest": DIGESTS[2]}


def test_an_unchanged_lock_is_left_alone(place):
    text = store.lock_text([REACH])
    assert store.write_changed(place, text.encode())
    before = place.stat().st_mtime_ns, place.stat().st_ino
    assert not store.write_changed(place, text.encode())
    assert (place.stat().st_mtime_ns, place.stat().st_ino) == before
    assert [path.name for path in place.parent.iterdir()] == [place.name]


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda text: "<<<<<<< mine\n" + text, "not TOML"),
        (lambda text: "[" * 100_000, "not TOML"),
        (lambda text: "", "format"),
        (lambda text: text.replace("format = 1", "format = 2"), "format 2"),
        (lambda text: text.replace("format = 1", "format = true"), "format True"),
        (lambda text: text + "\n[more]\n", "expected a format"),
        (lambda text: text.replace("[[skill]]", "[skill]"), "tables"),
        (lambda text: text.replace("version", "vision"), "expected digest, name, reference, version"),
        (lambda text: text.replace("version = 3", "version = 0"), "name no version"),
        (lambda text: text.replace("version = 3", 'version = "3"'), "name no version"),
        (lambda text: text.replace("version = 3", "version = true"), "name no version"),
        (lambda text: text.replace('"reach"', '"../x"'), "name no version"),
        (lambda text: text.replace('"reach"', "7"), "are texts"),
        (lambda text: text.replace("reach@release", "place"), "not one to reach"),
        (lambda text: text.replace("sha256:1", "sha256:"), "not a content digest"),
    ],
)
def test_a_lock_that_says_something_else_is_refused(place, change, cause):
    place.write_text(change(store.lock_text([REACH])))
    with pytest.raises(InvalidLockError, match=cause) as refused:
        store.read_lock(place)
    assert str(place) in str(refused.value)
    assert "skillctl lock" in refused.value.hint


def test_bytes_that_are_no_text_and_links_are_refused(place, tmp_path):
    place.write_bytes(b"\xff\xfe")
    with pytest.raises(InvalidLockError, match="not TOML"):
        store.read_lock(place)
    assert not store.is_lock(place)
    (tmp_path / "link").symlink_to(place)
    with pytest.raises(InvalidLockError, match="symbolic link"):
        store.read_lock(tmp_path / "link")
    with pytest.raises(NotFoundError, match="no lock file"):
        store.read_lock(tmp_path / "none")


def test_the_lock_is_the_variables_else_the_nearest_else_a_new_one_here(place, tmp_path, monkeypatch):
    (below := tmp_path / "a" / "b").mkdir(parents=True)
    monkeypatch.chdir(below)
    assert store.locate_lock() == below / "skillctl.lock"
    place.touch()
    assert store.locate_lock() == place
    monkeypatch.setenv("SKILLCTL_LOCK", "other.lock")
    assert store.locate_lock() == below / "other.lock"


# ---------------------------------------------------------------------------------------------------------
# What a reference means under a lock


@pytest.fixture
def registry(tmp_path, wrap, make_seds):
    """Versions 1 to 4 of reach, the second with an alias, and place."""
    registry = store.Registry(tmp_path / "skills")
    for seed in range(4):
        registry.publish("reach", store.encode(wrap(make_seds(seed))))
    registry.publish("place", store.encode(wrap(make_seds(9))))
    registry.tag("reach", 2, "release")
    return registry


def locked(registry, *references):
    path = registry.root.parent / "skillctl.lock"
    entries = []
    for reference in references:
        located = registry.locate(reference)
        entries.append(store.locked_skill(reference, located, store.read_skill(located.path).digest, path))
    return store.Lock(path, tuple(entries))


@pytest.mark.parametrize("reference", ["reach", "reach@latest"])
def test_a_name_means_the_version_that_was_locked(registry, reference):
    registry.remove("reach", [4])
    lock = locked(registry, reference)
    registry.publish("reach", registry.path_of("place", 1).read_bytes())
    for asked in ("reach", "reach@latest"):
        assert registry.locate(asked).version == 5
        assert lock.locate(asked, registry.root).version == 3
    with pytest.raises(NotLockedError, match="names reach@3, not reach@5"):
        lock.locate("reach@5", registry.root)


def test_an_alias_that_was_locked_stays_and_another_must_agree(registry):
    lock = locked(registry, "reach@release")
    registry.tag("reach", 4, "release")
    registry.tag("reach", 2, "old")
    registry.tag("reach", 3, "other")
    for asked in ("reach@release", "reach@old", "reach", "reach@2"):
        assert lock.locate(asked, registry.root).version == 2
    with pytest.raises(NotLockedError, match=r"reach@other is reach@3, and .* names reach@2"):
        lock.locate("reach@other", registry.root)
    with pytest.raises(NotFoundError):
        lock.locate("reach@none", registry.root)


def test_a_name_at_two_versions_has_to_be_told(registry):
    lock = locked(registry, "reach@1", "reach@3")
    assert lock.locate("reach@3", registry.root).version == 3
    with pytest.raises(UsageError, match="locked at 2 versions: reach@1, reach@3"):
        lock.locate("reach", registry.root)


def test_what_the_lock_does_not_name_is_refused_whether_it_exists_or_not(registry):
    lock = locked(registry, "reach")
    for asked in ("place", "place@1", "nothing"):
        with pytest.raises(NotLockedError, match=f"does not name {asked}"):
            lock.locate(asked, registry.root)


def test_other_content_under_a_locked_version_is_refused(registry):
    lock = locked(registry, "reach@1", "place")
    located = registry.locate("reach@1")
    lock.require(located, lock.skills[0].digest)
    with pytest.raises(NotLockedError, match=r"reach@1 holds sha256:.*, but .* names sha256:") as refused:
        lock.require(located, lock.skills[1].digest)  # a content that is locked, but under another name
    assert str(located.path) in refused.value.hint


def test_of_a_file_the_content_counts_and_not_the_place(registry, tmp_path):
    path = tmp_path / "elsewhere.h5"
    path.write_bytes(registry.path_of("reach", 1).read_bytes())
    lock = locked(registry, "reach@1")
    located = lock.locate(str(path), registry.root)
    lock.require(located, lock.skills[0].digest)
    with pytest.raises(NotLockedError, match="does not name"):
        lock.require(located, store.read_skill(registry.path_of("reach", 2)).digest)
    with pytest.raises(NotFoundError):
        lock.locate(str(tmp_path / "none.h5"), registry.root)


def test_a_locked_version_that_is_gone_is_not_found(registry):
    lock = locked(registry, "reach")
    registry.remove("reach", [4])
    with pytest.raises(NotFoundError, match="no version 4"):
        lock.locate("reach", registry.root)


def test_a_file_is_named_as_seen_from_the_lock(registry, tmp_path, monkeypatch):
    (tmp_path / "sub").mkdir()
    path = tmp_path / "a.h5"
    path.write_bytes(registry.path_of("reach", 1).read_bytes())
    monkeypatch.chdir(tmp_path / "sub")
    entry = store.locked_skill("../a.h5", store.Located(path), DIGESTS[0], tmp_path / "skillctl.lock")
    assert entry == store.LockedSkill("a.h5", DIGESTS[0])
    assert store.locate_again(entry, tmp_path / "skillctl.lock").path == path
    with pytest.raises(UsageError, match=r"\\x1b"):
        store.locked_skill("", store.Located(tmp_path / "\x1b.h5"), DIGESTS[0], tmp_path / "skillctl.lock")
