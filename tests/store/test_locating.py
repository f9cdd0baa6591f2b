"""Where references lead, and which store they are looked up in."""

from pathlib import Path

import pytest

from skillctl import store
from skillctl.errors import NotFoundError, UsageError
from skillctl.store.folder import Folder


@pytest.fixture
def filled(tmp_path, versions):
    registry = store.Registry(tmp_path / "skills")
    for data in versions[:3]:
        registry.publish("reach", data)
    registry.publish("reach-left", versions[0])
    (registry.root / "empty").mkdir()
    return registry


@pytest.mark.parametrize(
    ("reference", "version"),
    [
        ("reach", 3),
        ("reach@latest", 3),
        ("reach@1", 1),
        ("reach@2", 2),
        ("reach@3", 3),
    ],
)
def test_references_lead_to_versions(filled, reference, version):
    path = filled.root / "reach" / f"{version}.h5"
    assert filled.locate(reference).path == path
    assert store.locate(reference, filled.root).path == path
    assert store.locate(reference, filled.root) == store.Located(path, "reach", version)


@pytest.mark.parametrize("digits", [8, 9, 63, 64])
def test_a_digest_pins_a_version(filled, versions, digits):
    digest = store.digest_of(versions[1])
    assert filled.locate(f"reach@{digest[: len('sha256:') + digits]}").version == 2


def test_a_digest_beginning_that_fits_two_contents_is_refused(filled, monkeypatch):
    fake = {n: f"sha256:{'a' * 10}{n}" for n in (1, 2, 3)}
    monkeypatch.setattr(Folder, "stated_digest", lambda _, number: fake[number])
    with pytest.raises(UsageError, match="3 versions of reach have a content digest beginning") as caught:
        filled.locate("reach@sha256:aaaaaaaa")
    assert fake[2] in caught.value.hint


def test_equal_content_is_not_ambiguous(filled, versions):
    filled.publish("reach", versions[0])
    assert filled.locate(f"reach@{store.digest_of(versions[0])[:15]}").version == 4


@pytest.mark.parametrize(
    ("reference", "cause", "hint"),
    [
        ("reach@4", "reach has no version 4", "versions 1 to 3"),
        ("reach@champion", "reach has no alias champion", "skillctl tag reach@N champion"),
        (
            "reach@sha256:00000000",
            "no version of reach has a content digest beginning sha256:00000000",
            "1 to 3",
        ),
        ("rech", "has no skill rech", "Did you mean reach"),
        ("zzz", "has no skill zzz", "It has reach, reach-left"),
        ("empty", "has no skill empty", ""),
        ("empty@1", "has no skill empty", ""),
        ("no/such.h5", r"no/such\.h5: there is no such file", "Check the path"),
        ("such.h5", r"such\.h5: there is no such file", "Check the path"),
    ],
)
def test_what_is_not_there_is_not_found(filled, reference, cause, hint):
    with pytest.raises(NotFoundError, match=cause) as caught:
        filled.locate(reference)
    assert hint in caught.value.hint


def test_in_a_store_that_does_not_exist_yet_there_is_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir("/")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    with pytest.raises(NotFoundError, match="has no skill reach") as caught:
        store.locate("reach")
    assert "skillctl learn" in caught.value.hint
    with pytest.raises(NotFoundError, match="nowhere: there is no such store"):
        store.locate("reach", tmp_path / "nowhere")


def test_a_file_that_looks_like_a_name_is_pointed_out(filled, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("skill").touch()
    with pytest.raises(NotFoundError) as caught:
        filled.locate("skill")
    assert caught.value.hint == "For the file of that name, write ./skill."


def test_a_file_needs_no_store(tmp_path, monkeypatch):
    monkeypatch.setenv("SKILLCTL_STORE", "/nowhere")
    (path := tmp_path / "skill.h5").touch()
    assert store.locate(str(path)) == store.Located(path)


# Which store


def test_the_store_is_the_one_given_else_the_variable_else_the_nearest_else_the_users(tmp_path, monkeypatch):
    project, home = tmp_path / "project", tmp_path / "home"
    (deep := project / "a" / "b").mkdir(parents=True)
    monkeypatch.chdir(deep)
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.delenv("XDG_DATA_HOME", raising=False)
    monkeypatch.delenv("SKILLCTL_STORE", raising=False)
    assert store.locate_store() == home / ".local" / "share" / "skillctl" / "skills"
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    assert store.locate_store() == tmp_path / "data" / "skillctl" / "skills"
    (project / "skills").mkdir()
    assert store.locate_store() == project / "skills"
    (project / "a" / "skills").touch()  # a file is no store
    assert store.locate_store() == project / "skills"
    monkeypatch.setenv("SKILLCTL_STORE", str(tmp_path / "variable"))
    assert store.locate_store() == tmp_path / "variable"
    assert store.locate_store(tmp_path / "given") == tmp_path / "given"
    monkeypatch.setenv("SKILLCTL_STORE", "")
    assert store.locate_store() == project / "skills"


def test_a_link_to_a_store_is_followed_where_the_user_names_it(tmp_path):
    (target := tmp_path / "target").mkdir()
    (link := tmp_path / "link").symlink_to(target)
    assert store.locate_store(link) == target


# What a store keeps


def test_a_store_that_was_named_must_exist(tmp_path, monkeypatch):
    (tmp_path / "skills").mkdir()
    with pytest.raises(NotFoundError, match=r"skils: there is no such store") as caught:
        store.existing_store(tmp_path / "skils")
    assert caught.value.hint == f"Did you mean {tmp_path / 'skills'}?"
    (tmp_path / "file").touch()
    with pytest.raises(NotFoundError, match=r"file: there is no such store"):
        store.existing_store(tmp_path / "file")
    monkeypatch.setenv("SKILLCTL_STORE", str(tmp_path / "elsewhere"))
    with pytest.raises(NotFoundError, match=r"elsewhere: there is no such store") as caught:
        store.existing_store()
    assert "SKILLCTL_STORE" in caught.value.hint
    monkeypatch.delenv("SKILLCTL_STORE")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.chdir("/")
    assert store.existing_store() == tmp_path / "data" / "skillctl" / "skills"  # nothing was learned yet


@pytest.mark.parametrize("root", ["skills", "elsewhere"])
@pytest.mark.parametrize("file", ["1.h5", "2.h5", "mine.h5"])
@pytest.mark.parametrize("named", [True, False])
def test_no_file_is_written_among_versions(tmp_path, monkeypatch, versions, root, file, named):
    monkeypatch.chdir(tmp_path)
    registry = store.Registry(tmp_path / root)
    path = registry.publish("reach", versions[0]).path
    if named:
        path.chmod(0o644)  # as Git leaves it
    (tmp_path / "link").symlink_to(path.parent)
    for folder in (path.parent, Path(root) / "reach", Path("link")):
        with pytest.raises(UsageError, match="lies in a store, where versions never change") as caught:
            store.require_outside_store(folder / file, registry.root if named else None)
        assert f"--name reach --store {tmp_path / root}" in caught.value.hint
    if root == "skills" or not named:
        for number in (1, 2):  # whatever asks for it
            with pytest.raises(UsageError, match="versions never change"):
                store.write_file(path.parent / f"{number}.h5", b"")
    assert path.read_bytes() == versions[0]
    assert [entry.name for entry in path.parent.iterdir()] == ["1.h5"]


@pytest.mark.parametrize("file", ["skills/reach.h5", "skills/build/straight.h5", "out/reach/1.h5", "1.h5"])
def test_a_file_beside_a_store_or_in_another_directory_is_written(tmp_path, monkeypatch, file):
    monkeypatch.chdir(tmp_path)
    (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
    for _ in range(2):  # it may be replaced, too
        store.require_outside_store(Path(file))
        store.write_file(Path(file), b"a skill")


def test_a_file_that_would_become_a_version_is_not_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        with pytest.raises(UsageError, match="versions never change"):
            store.write_file(Path("skills/reach/1.h5"), b"a skill")
        (tmp_path / "skills" / "reach").mkdir(parents=True, exist_ok=True)
