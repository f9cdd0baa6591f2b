"""Skills saved from Python and loaded again; and sealed files whose records do not fit what they hold."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from skillctl import store
from skillctl.errors import NotFoundError, UsageError
from skillctl.model.seds import SedsSkill
from skillctl.store.artifact import arrays_of
from skillctl.store.layout import META, content_digest
from skillctl.store.migrations import FORMAT_VERSION
from skillctl.store.seal import seal
from skillctl.store.writer import body_of
from skillctl.toml_files import parse_toml
from skillctl.usecases.files import load, save
from skillctl.usecases.verify_stability import verify


def load_learned(reference: str | Path, store: Path | None = None) -> SedsSkill:
    skill = load(reference, store=store)
    assert isinstance(skill, SedsSkill)
    return skill


@pytest.fixture
def curve(library: Path) -> SedsSkill:
    return load_learned("curve", library)


def test_a_path_is_always_a_file(curve, library, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written = save(curve, tmp_path / "a.h5")
    for name in ("plain", "x.skill", "curve", "curve@1"):
        written.rename(tmp_path / name)
        assert (load_learned(Path(name), library).means == curve.means).all()
        assert verify(Path(name), store=library).verdict == verify(curve).verdict
        (tmp_path / name).rename(written)
    with pytest.raises(NotFoundError, match="there is no such file"):
        load(Path("curve"), store=library)
    assert (load_learned("curve", library).means == curve.means).all()


@pytest.mark.parametrize("name", ["x.skill", "x", "x@3", "X", "x y", "", "a\0"])
@pytest.mark.parametrize("kind", [str, Path])
def test_nothing_is_saved_that_no_text_could_name(curve, tmp_path, monkeypatch, name, kind):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match="by this name the file could not be loaded again") as caught:
        save(curve, kind(name))
    assert str(caught.value).isprintable()
    assert ".h5" in caught.value.hint
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["x.h5", "./x.skill", "folder/X"])
def test_what_is_saved_by_a_text_is_loaded_by_it(curve, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    assert save(curve, name) == Path(name)
    assert (load_learned(name).means == load_learned(Path(name)).means).all()


def test_a_skill_of_any_kind_that_is_saved_says_that_python_made_it(run, curve, library, tmp_path):
    assert run("combine", "curve", "hook", "--store", library, "-o", tmp_path / "both.h5").exit_code == 0
    for skill in (curve, load(tmp_path / "both.h5")):
        artifact = store.read_skill(save(skill, tmp_path / "saved.h5"))
        operation = artifact.operation
        assert (operation.command, operation.options, operation.results) == ("python", {}, {})
        said = run("inspect", tmp_path / "saved.h5").stdout
        assert f"Python, with skillctl {artifact.provenance.tool}" in said


# Sealed by somebody who knows the format


def sealed(artifact, version=FORMAT_VERSION, gate=None, **stated):
    """The file of an artifact with another operation, gate or version, though the format forbids it."""
    arrays = arrays_of(artifact)
    meta = json.loads(arrays[META].tobytes())
    meta["operation"].update(stated)
    if gate is not None:
        meta["skill"]["gate"] = gate
    arrays[META] = np.frombuffer(json.dumps(meta, sort_keys=True, separators=(",", ":")).encode(), np.uint8)
    body = body_of(arrays, version)
    return seal(body, meta["skill"]["kind"], content_digest(arrays, version), version) + body


@pytest.mark.parametrize("command", ["merge", "combine"])
@pytest.mark.parametrize("fault", ["empty results", "another tree"])
def test_a_skill_whose_records_do_not_fit_is_refused_and_made_again(
    run, curve, library, tmp_path, command, fault
):
    make = [command, "curve", "hook", "--store", library, "-o", tmp_path / "made.h5"]
    assert run(*make).exit_code == 0
    artifact = store.read_skill(tmp_path / "made.h5")
    if fault == "empty results":
        data = sealed(artifact, results={})
    else:
        saved = store.read_skill(save(curve, tmp_path / "curve.h5"))
        data = sealed(saved, **artifact.operation.model_dump(mode="json"))
    for path in (tmp_path / "bad.h5", tmp_path / "made.h5"):
        path.write_bytes(data)
    for act in (["inspect"], ["combine", "curve", "--store", library, "-o", tmp_path / "x.h5"]):
        refused = run(*act, tmp_path / "bad.h5")
        assert refused.exit_code == 7
        assert "is not a valid skill artifact: /meta.json: operation." in refused.stderr
    assert run(*make).exit_code == 0  # a target that cannot be read is made again
    assert store.read_skill(tmp_path / "made.h5").digest == artifact.digest


def test_a_merger_of_format_1_that_lacks_its_results_is_made_again(run, library, tmp_path):
    """Python could leave them out then; the command cannot say what is there without them."""
    make = ["merge", "curve", "hook", "--store", library, "-o", tmp_path / "made.h5"]
    assert run(*make).exit_code == 0
    artifact = store.read_skill(tmp_path / "made.h5")
    arrays = arrays_of(replace(artifact, golden=None))  # format 1 has none
    meta = json.loads(arrays[META].tobytes())
    meta["operation"]["results"], meta["format"] = {}, 1
    meta["skill"]["sharpness"] = 1.0
    del meta["skill"]["parameters"]
    arrays[META] = np.frombuffer(json.dumps(meta).encode(), np.uint8)
    body = body_of(arrays, 1)
    (tmp_path / "made.h5").write_bytes(seal(body, "merged", content_digest(arrays, 1), 1) + body)
    assert store.read_skill(tmp_path / "made.h5").operation.results == {}
    again = run(*make, "--json")
    assert again.exit_code == 0
    assert json.loads(again.stdout)["reasons"] == ["it does not say what came of it"]
    assert store.read_skill(tmp_path / "made.h5").digest == artifact.digest


@pytest.mark.parametrize(
    "later", [{"version": FORMAT_VERSION + 1}, {"gate": "avoiding"}], ids=["format", "feature"]
)
def test_a_file_of_a_later_build_is_not_overwritten(run, library, tmp_path, later):
    make = ["combine", "curve", "hook", "--store", library, "-o"]
    assert run(*make, tmp_path / "made.h5").exit_code == 0
    data = sealed(store.read_skill(tmp_path / "made.h5"), **later)
    (tmp_path / "made.h5").write_bytes(data)
    for options in ([], ["--force"]):
        refused = run(*make, tmp_path / "made.h5", *options)
        assert refused.exit_code == 2
        assert "made.h5 exists and is a skill that only a later skillctl can use; it will" in refused.stderr
        assert "hint: Upgrade skillctl, or give another name after -o." in refused.stderr
        assert (tmp_path / "made.h5").read_bytes() == data


def test_a_name_whose_newest_version_is_of_a_later_build_gets_one_more(run, library, tmp_path):
    assert run("combine", "curve", "hook", "--store", library, "-o", tmp_path / "made.h5").exit_code == 0
    data = sealed(store.read_skill(tmp_path / "made.h5"), gate="avoiding")
    assert store.Registry(tmp_path).publish("both", data).version == 1
    skills = [library / name / "1.h5" for name in ("curve", "hook")]
    made = run("combine", *skills, "--store", tmp_path, "--name", "both", "--json")
    assert json.loads(made.stdout)["written"]["skill"] == "both@2"
    assert (tmp_path / "both" / "1.h5").read_bytes() == data


def test_a_toml_file_may_begin_with_a_byte_order_mark():
    assert parse_toml("\ufeffa = 1".encode()) == {"a": 1}


def test_nothing_is_saved_over_a_version(curve, library):
    before = (library / "hook" / "1.h5").read_bytes()
    for name in ("1.h5", "2.h5", "mine.h5"):
        with pytest.raises(UsageError, match="lies in a store, where versions never change"):
            save(curve, library / "hook" / name)
    assert [path.name for path in (library / "hook").iterdir()] == ["1.h5"]
    assert (library / "hook" / "1.h5").read_bytes() == before
