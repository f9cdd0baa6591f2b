"""Chains in lists, histories, exports, verdicts and pages, and where they are refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

from skillctl.compose.options import ChainOptions
from skillctl.model.chained import ChainedSkill
from skillctl.usecases.chain import chain
from skillctl.usecases.files import load, save
from skillctl.usecases.history import lineage, log
from skillctl.usecases.inspect import inspect


@pytest.fixture(scope="module")
def shelf(library, tmp_path_factory):
    """A store with the chain take: curve, then hook."""
    store = tmp_path_factory.mktemp("chains") / "skills"
    store.mkdir()
    for name in ("curve", "hook"):
        _copied(library / name, store / name)
    options = ChainOptions(event=((1, "close"), (1, "wait 0.5")), within=((None, (0.01, "")),))
    chain(["curve", "hook"], name="take", store=store, options=options, note="takes it")
    return store


def _copied(one, other):
    other.mkdir()
    for path in one.glob("*.h5"):
        (other / path.name).write_bytes(path.read_bytes())


def test_lists_and_histories_name_it(run, shelf):
    (row,) = [line for line in run("ls", "--store", shelf).stdout.splitlines() if line.startswith("take@1")]
    assert row.split()[2] == "chain"
    (entry,) = log("take", store=shelf).entries
    assert (entry.command, entry.note) == ("chain", "takes it")
    assert [parent.shown for parent in entry.parents] == ["curve@1", "hook@1"]
    assert "curve@1, hook@1" in run("log", "take", "--store", shelf).stdout
    tree = lineage("take", store=shelf)
    assert tree.complete
    assert [(one.skill, one.role, one.presence) for one in tree.lineage.parents] == [
        ("curve@1", "stage 1", "present"), ("hook@1", "stage 2", "present"),
    ]  # fmt: skip


def test_a_program_that_reads_an_export_has_the_whole_chain(run, shelf, tmp_path):
    skill = load("take", store=shelf)
    assert isinstance(skill, ChainedSkill)
    for ending in ("json", "npz"):
        assert run("export", "take", "-o", tmp_path / f"take.{ending}", "--store", shelf).exit_code == 0
    text = json.loads((tmp_path / "take.json").read_text())
    arrays = np.load(tmp_path / "take.npz")
    for meta in (text["meta"], json.loads(str(arrays["meta.json"]))):
        node = meta["skill"]
        assert (node["kind"], node["events"]) == ("chain", [["close", "wait 0.5"], []])
        assert node["levels"] == skill.levels.tolist()
        assert (node["on_jump"], node["disturbance_distance"]) == ("stay", skill.disturbance_distance)
        assert [part["leaf"] for part in node["parts"]] == [0, 1]
    assert np.array_equal(arrays["model/attractors"], text["arrays"]["model/attractors"])
    assert (arrays["model/attractors"] == [stage.attractors[0] for stage in skill.parts]).all()


def test_a_matlab_file_holds_one_stage(run, shelf, tmp_path):
    refused = run("export", "take", "-o", tmp_path / "take.mat", "--store", shelf)
    assert refused.exit_code == 2
    assert "--leaf" in refused.stderr
    assert run("export", "take", "-o", tmp_path / "take.mat", "--leaf", 2, "--store", shelf).exit_code == 0


def test_it_is_saved_and_read_again_with_the_same_bytes(shelf, tmp_path):
    skill = load("take", store=shelf)
    one = save(skill, tmp_path / "one.h5").read_bytes()
    assert save(load(tmp_path / "one.h5"), tmp_path / "other.h5").read_bytes() == one


def test_a_verdict_says_what_is_proved_stage_by_stage(run, shelf):
    shown = run("verify-stability", "take", "--store", shelf)
    assert shown.exit_code == 0
    assert "\n  part 1, stage 1  stable" in shown.stdout
    assert "\n  part 2, stage 2  stable" in shown.stdout
    assert "\ntake@1 is a chain\n" in shown.stdout
    proof = inspect("take", store=shelf).certificate.proof
    told = [sentence for sentence in proof if f"  {sentence}\n" in shown.stdout]
    assert len(told) == len(proof) - 2  # the table has what the parts do
    assert any(sentence.startswith("Stage 2 is over") for sentence in told)


def test_pictures_and_a_page_of_it(run, shelf, tmp_path):
    for name in ("take.png", "proof.svg"):
        command = ("inspect", "take") if name == "take.png" else ("verify-stability", "take")
        assert run(*command, "--plot", tmp_path / name, "--store", shelf).exit_code == 0
        assert (tmp_path / name).stat().st_size > 10_000
    assert run("inspect", "take", "--html", tmp_path / "take.html", "--store", shelf).exit_code == 0
    page = (tmp_path / "take.html").read_text(encoding="utf-8")
    for words in ("chain of 2 stages", "close, wait 0.5", "<th>begins</th>", "stage 2", "What is proved"):
        assert words in page
    assert "What it learned" not in page


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("merge", "curve", "take"), "merge: skill 2 is a chain; its stages have targets of their own."),
        (("combine", "take", "curve"), "combine: skill 1 is a chain; its stages have targets of their own."),
        (("chain", "take", "curve"), "chain: skill 1 is a chain"),
    ],
)
def test_it_is_no_part_of_another_skill(run, shelf, tmp_path, arguments, said):
    refused = run(*arguments, "-o", tmp_path / "x.h5", "--store", shelf)
    assert refused.exit_code == 2
    assert said in refused.stderr
    assert "hint: Name its stages instead" in refused.stderr
    assert not (tmp_path / "x.h5").exists()


def test_it_is_not_adapted(run, shelf, tmp_path):
    task = tmp_path / "task.toml"
    task.write_text(run("adapt", "--print-task", *_demonstrations(tmp_path)).stdout)
    refused = run("adapt", task, "take", "-o", tmp_path / "x.h5", "--store", shelf)
    assert (refused.exit_code, "adapt: skill 1 is a chain" in refused.stderr) == (2, True)


def _demonstrations(folder):
    s = np.linspace(0, 1, 50)[:, None]
    paths = []
    for i in range(3):
        rows = np.hstack([2 * s, (1 - s) ** 2 * [0.2 + 0.01 * i, 0.1]])
        np.savetxt(path := folder / f"d{i}.csv", rows, delimiter=",", header="t,x,y", comments="")
        paths.append(path)
    return paths
