"""What other programs get is the same skill: checked by what they would compute from it."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.io
from scipy.stats import multivariate_normal

from skillctl import store
from skillctl.usecases.combine import combine
from skillctl.usecases.export import export
from skillctl.usecases.files import load, save


def regression(priors, mu, sigma, x):
    """Return the GMR of the SEDS tools, E[ẋ | x], written from the textbook: x is relative to the target."""
    d, k = len(x), priors.shape[1]
    logs = np.log(priors[0]) + [multivariate_normal.logpdf(x, mu[:d, i], sigma[:d, :d, i]) for i in range(k)]
    weights = np.exp(logs - logs.max())  # far from the data all densities are below the smallest float
    means = [
        mu[d:, i] + sigma[d:, :d, i] @ np.linalg.solve(sigma[:d, :d, i], x - mu[:d, i]) for i in range(k)
    ]
    return weights @ means / weights.sum()


@pytest.mark.parametrize("speed", [1.0, 1.5])
def test_matlab_gets_the_mixture_whose_regression_is_the_skill(library, tmp_path, speed):
    skill = replace(load("reach", store=library).leaves[0], speed=speed)
    report = export(save(skill, tmp_path / "a.h5"), tmp_path / "a.mat")
    assert report.variables == ("Priors", "Mu", "Sigma", "attractor")
    found = scipy.io.loadmat(tmp_path / "a.mat")
    assert (found["Priors"].shape, found["Mu"].shape, found["Sigma"].shape) == ((1, 3), (6, 3), (6, 6, 3))
    assert (found["attractor"][:, 0] == skill.attractor).all()
    rng = np.random.default_rng(0)
    for x in rng.normal(0, 0.1, (20, 3)):
        expected = skill.velocity((skill.attractor + x)[None])[0]
        got = regression(found["Priors"], found["Mu"], found["Sigma"], x)
        # Two ways through a 3 × 3 system conditioned like Σ: a few digits of float64 are lost on each.
        condition = max(np.linalg.cond(sigma) for sigma in skill.covariances)
        assert np.abs(got - expected).max() <= 1e3 * np.finfo(float).eps * condition * np.linalg.norm(
            expected
        )


@pytest.mark.parametrize("ending", ["mat", "json", "npz"])
def test_the_same_skill_gives_the_same_bytes(library, tmp_path, ending, monkeypatch):
    export("curve", tmp_path / f"a.{ending}", store=library)
    monkeypatch.setattr("time.asctime", lambda *_: "Thu Jan  1 00:00:00 1970")
    export("curve", tmp_path / f"b.{ending}", store=library)
    assert (tmp_path / f"a.{ending}").read_bytes() == (tmp_path / f"b.{ending}").read_bytes()


@pytest.fixture
def both(tmp_path, library):
    combine(["curve", "hook"], output=tmp_path / "both.h5", store=library)
    return tmp_path / "both.h5"


def test_json_and_npz_hold_every_array_and_the_metadata(both, tmp_path):
    export(both, tmp_path / "a.json")
    export(both, tmp_path / "a.npz")
    skill, document = store.read_skill(both), json.loads((tmp_path / "a.json").read_text())
    with np.load(tmp_path / "a.npz", allow_pickle=False) as arrays:
        assert set(document["arrays"]) | {"digest", "meta.json"} == set(arrays.files)
        assert document["digest"] == str(arrays["digest"]) == skill.digest
        assert document["meta"] == json.loads(str(arrays["meta.json"]))
        stacked = np.concatenate([leaf.system_matrices for leaf in skill.skill.leaves])
        for found in (arrays["model/system_matrices"], np.array(document["arrays"]["model/system_matrices"])):
            assert (found == stacked).all()


def test_one_leaf_of_many_can_be_written_for_matlab(both, tmp_path, library):
    export(both, tmp_path / "second.mat", leaf=2)
    export("hook", tmp_path / "hook.mat", store=library)
    assert (tmp_path / "second.mat").read_bytes() == (tmp_path / "hook.mat").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["-o", "a.mat"], "--leaf 1 to 2"),
        (["-o", "a.mat", "--leaf", "3"], "no leaf 3"),
        (["-o", "a.mat", "--leaf", "0"], "no leaf 0"),
        (["-o", "a.npz", "--leaf", "1"], "--leaf is for .mat"),
        (["-o", "a.txt"], "ending"),
        (["-o", "a"], "ending"),
        ([], "--output"),
    ],
)
def test_what_cannot_be_exported_is_refused(run, both, tmp_path, monkeypatch, arguments, word):
    monkeypatch.chdir(tmp_path)
    result = run("export", both, *arguments)
    assert (result.exit_code, result.stdout) == (2, "")
    assert word in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["both.h5"]


# The schema


def agrees(value, schema, definitions):
    """Tell whether a JSON value is what a schema allows, by the few rules that ours uses."""
    if "$ref" in schema:
        return agrees(value, definitions[schema["$ref"].rpartition("/")[2]], definitions)
    for several in ("anyOf", "oneOf"):
        if several in schema:
            return any(agrees(value, one, definitions) for one in schema[several])
    kinds = {
        "object": dict, "array": list, "string": str, "integer": int, "number": (int, float),
        "boolean": bool, "null": type(None),
    }  # fmt: skip
    if "const" in schema:
        return value == schema["const"]
    if "enum" in schema:
        return value in schema["enum"]
    if "type" in schema and not isinstance(value, kinds[schema["type"]]):
        return False
    if isinstance(value, dict):
        known, extra = schema.get("properties", {}), schema.get("additionalProperties", True)
        if set(schema.get("required", ())) - set(value) or (extra is False and set(value) - set(known)):
            return False
        return all(agrees(v, known[k], definitions) for k, v in value.items() if k in known)
    if isinstance(value, list) and "items" in schema:
        return all(agrees(item, schema["items"], definitions) for item in value)
    return not isinstance(value, str) or re.search(schema.get("pattern", ""), value) is not None


def test_the_schema_describes_what_is_written_and_refuses_what_is_not(run, both):
    schema = json.loads(run("schema").stdout)
    assert schema["$schema"].endswith("2020-12/schema")
    assert json.loads(run("schema", "--json").stdout)["schema"] == schema
    meta = store.metadata_of(store.read_skill(both))
    definitions = schema["$defs"]
    assert agrees(meta, schema, definitions)
    assert not agrees({**meta, "more": 1}, schema, definitions)
    assert not agrees({key: value for key, value in meta.items() if key != "skill"}, schema, definitions)
    assert not agrees({**meta, "format": 3}, schema, definitions)
    lied = {**meta["provenance"], "parents": [{**meta["provenance"]["parents"][0], "digest": "sha256:0"}]}
    assert not agrees({**meta, "provenance": lied}, schema, definitions)
    assert "\\\\z" not in json.dumps(schema)
