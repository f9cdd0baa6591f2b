"""Artifacts of every past format stay readable, and what they hold stays what it was."""

import importlib.util
import json
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from skillctl import store
from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.gates import COMBINE_GATES, MERGE_GATES
from skillctl.model.merged import MergedSkill
from skillctl.store.migrations import READABLE_FORMATS
from skillctl.store.tree import model_arrays, node_of

ARCHIVES = Path(__file__).parents[1] / "archives"
FORMATS = [f"v{version}" for version in READABLE_FORMATS]
DIGESTS = {
    (form, name): digest
    for form in FORMATS
    for name, digest in json.loads((ARCHIVES / form / "digests.json").read_text()).items()
}
TABLE = (ARCHIVES / "v1" / "README.md").read_text(encoding="utf-8")
BY_COMMAND = set(re.findall(r"^\| `(\S+)` \| `skillctl", TABLE, re.MULTILINE))


@cache
def read(form, name):
    return store.read_skill(ARCHIVES / form / name)


@cache
def made(form):
    """What the script of an archive makes today, by file name."""
    spec = importlib.util.spec_from_file_location(f"make_{form}", ARCHIVES / form / "make.py")
    make = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make)
    return make.archive()


@pytest.mark.parametrize(("form", "name"), DIGESTS)
def test_archived_artifacts_keep_their_identity(form, name):
    path = ARCHIVES / form / name
    header = store.read_header(path)
    assert f"v{header.format}" == form
    assert read(form, name).digest == header.digest == DIGESTS[form, name]
    assert store.digest_of(path.read_bytes()) == DIGESTS[form, name]


@pytest.mark.parametrize("form", FORMATS)
def test_every_archived_artifact_is_pinned(form):
    there = {(form, path.name) for path in (ARCHIVES / form).glob("*.h5")}
    assert there == {pinned for pinned in DIGESTS if pinned[0] == form}


@pytest.mark.parametrize(("form", "name"), [pinned for pinned in DIGESTS if pinned[1] not in BY_COMMAND])
def test_archived_skills_are_the_ones_that_were_written(form, name):
    there, wanted = read(form, name).skill, made(form)[name].skill
    assert node_of(there) == node_of(wanted)
    for path, array in model_arrays(wanted).items():
        assert model_arrays(there)[path].tobytes() == array.tobytes(), path


def test_this_build_makes_the_same_content():
    newest = FORMATS[-1]
    digests = {name: store.decode(store.encode(artifact)).digest for name, artifact in made(newest).items()}
    assert digests == {name: digest for (form, name), digest in DIGESTS.items() if form == newest}


@pytest.mark.parametrize("form", FORMATS)
def test_every_kind_gate_and_shape_is_archived(form):
    seen = {"bare": 0, "rad": 0, "nested": 0, "aligned": 0}
    for name in (name for archive, name in DIGESTS if archive == form):
        artifact = read(form, name)
        skill = artifact.skill
        for part in (skill, *getattr(skill, "parts", ())):
            how = getattr(part, "on_jump" if isinstance(part, ChainedSkill) else "gate", "")
            what = f"{type(part).__name__} {how}".strip()
            seen[what] = seen.get(what, 0) + 1
            seen["nested"] += any(isinstance(below, MergedSkill) for below in getattr(part, "parts", ()))
        seen["bare"] += artifact.demonstrations == (None,)
        seen["rad"] += skill.space.unit == "rad"
        seen["aligned"] += isinstance(skill, CombinedSkill) and skill.aligned
    merged = {f"MergedSkill {gate.name}" for gate in MERGE_GATES}
    combined = {f"CombinedSkill {gate.name}" for gate in COMBINE_GATES}
    jumps = set() if form == "v1" else {"ChainedSkill stay", "ChainedSkill back"}
    assert set(seen) >= {"SedsSkill"} | merged | combined | jumps
    assert all(seen.values())


def test_what_commands_made_names_its_inputs_and_parents():
    assert {name for _, name in DIGESTS} >= BY_COMMAND
    for name in BY_COMMAND:
        artifact = read("v1", name)
        (line,) = [line for line in TABLE.splitlines() if f"-o {name}`" in line]
        assert f"skillctl {artifact.operation.command} " in line
        for parent in artifact.provenance.parents:
            assert parent.name in line
            assert parent.digest == DIGESTS["v1", parent.name]


@pytest.mark.parametrize("form", FORMATS)
def test_archived_numbers_and_words_are_the_ones_that_were_written(form):
    artifact = read(form, "combined.h5")
    merged, other = artifact.skill.parts
    left, right = merged.parts
    combined = artifact.skill
    assert (combined.gate, combined.disturbance_distance, combined.speed) == ("latched", 0.0625, 2.0)
    assert (merged.gate, dict(merged.parameters), merged.speed) == ("experts", {"sharpness": 2.0}, 0.5)
    assert merged.part_weights.tolist() == [0.25, 0.75]
    assert (right.means - left.means == 1).all()
    assert other.attractor.tolist() == [3.0, 4.0]
    assert left.system_matrices[1].tolist() == [[-2.0, 0.0], [0.25, -0.5]]
    assert artifact.demonstrations[0] is None
    assert [d.source for d in artifact.demonstrations[1]] == ["motion_4.csv", "motion_3.csv"]
    assert (artifact.demonstrations[1].demonstrations[0].positions[-1] == np.array([1.5, 0.75])).all()
    assert (artifact.operation.command, artifact.operation.options["weights"]) == ("combine", (0.5, 1))
    assert artifact.operation.note == "slower near the shelf"
    assert (artifact.provenance.date, artifact.provenance.parents[0].version) == ("2020-02-29T12:00:00Z", 3)
    assert artifact.reports[0].dtw == 0.001953125
