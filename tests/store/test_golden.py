"""Artifacts of every past format stay readable, and what they hold stays what it was."""

import importlib.util
import json
import re
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from skillctl import store
from skillctl.model.combined import CombinedSkill
from skillctl.model.merged import MergedSkill
from skillctl.model.skill import CombineGate, MergeGate

ARCHIVES = Path(__file__).parents[1] / "archives"
TABLE = (ARCHIVES / "v1" / "README.md").read_text(encoding="utf-8")
BY_COMMAND = set(re.findall(r"^\| `(\S+)` \| `skillctl", TABLE, re.MULTILINE))
DIGESTS = json.loads((ARCHIVES / "v1" / "digests.json").read_text())


@pytest.mark.parametrize("name", DIGESTS)
def test_archived_artifacts_keep_their_identity(name):
    assert store.read_skill(ARCHIVES / "v1" / name).digest == DIGESTS[name]


def test_every_archived_artifact_is_pinned():
    assert {path.name for path in (ARCHIVES / "v1").glob("*.h5")} == set(DIGESTS)


def test_every_kind_gate_and_shape_is_archived():
    seen = {"bare": 0, "rad": 0, "nested": 0, "aligned": 0}
    for name in DIGESTS:
        artifact = store.read_skill(ARCHIVES / "v1" / name)
        skill = artifact.skill
        for part in (skill, *getattr(skill, "parts", ())):
            what = f"{type(part).__name__} {getattr(part, 'gate', '')}".strip()
            seen[what] = seen.get(what, 0) + 1
            seen["nested"] += any(isinstance(below, MergedSkill) for below in getattr(part, "parts", ()))
        seen["bare"] += artifact.demonstrations == (None,)
        seen["rad"] += skill.space.unit == "rad"
        seen["aligned"] += isinstance(skill, CombinedSkill) and skill.aligned
    merged = {f"MergedSkill {gate}" for gate in get_args(MergeGate)}
    combined = {f"CombinedSkill {gate}" for gate in get_args(CombineGate)}
    assert set(seen) >= {"SedsSkill"} | merged | combined
    assert all(seen.values())


def test_what_commands_made_names_its_inputs_and_parents():
    assert set(DIGESTS) >= BY_COMMAND
    for name in BY_COMMAND:
        read = store.read_skill(ARCHIVES / "v1" / name)
        (line,) = [line for line in TABLE.splitlines() if f"-o {name}`" in line]
        assert f"skillctl {read.operation.command} " in line
        for parent in read.provenance.parents:
            assert parent.name in line
            assert parent.digest == DIGESTS[parent.name]


def test_this_build_makes_the_same_content():
    spec = importlib.util.spec_from_file_location("make_v1", ARCHIVES / "v1" / "make.py")
    make = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make)
    made = {name: store.decode(store.encode(artifact)).digest for name, artifact in make.archive().items()}
    assert made == {name: digest for name, digest in DIGESTS.items() if name not in BY_COMMAND}


def test_archived_numbers_are_the_ones_that_were_written():
    read = store.read_skill(ARCHIVES / "v1" / "combined.h5")
    merged, other = read.skill.parts
    left, right = merged.parts
    assert (read.skill.gate, read.skill.disturbance_distance, read.skill.speed) == ("latched", 0.0625, 2.0)
    assert (merged.gate, dict(merged.parameters), merged.speed) == ("experts", {"sharpness": 2.0}, 0.5)
    assert merged.part_weights.tolist() == [0.25, 0.75]
    assert (right.means - left.means == 1).all()
    assert other.attractor.tolist() == [3.0, 4.0]
    assert left.system_matrices[1].tolist() == [[-2.0, 0.0], [0.25, -0.5]]
    assert read.demonstrations[0] is None
    assert [d.source for d in read.demonstrations[1]] == ["motion_4.csv", "motion_3.csv"]
    assert (read.demonstrations[1].demonstrations[0].positions[-1] == np.array([1.5, 0.75])).all()
    assert (read.operation.command, read.operation.options["weights"]) == ("combine", (0.5, 1))
    assert read.operation.note == "slower near the shelf"
    assert (read.provenance.date, read.provenance.parents[0].version) == ("2020-02-29T12:00:00Z", 3)
    assert read.reports[0].dtw == 0.001953125
