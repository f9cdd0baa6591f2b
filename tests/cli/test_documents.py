"""Every JSON document is what its published schema says: no key more, no key less, no other type."""

from __future__ import annotations

import copy
import importlib.util
import json
import shutil
from functools import lru_cache

import numpy as np
import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, PrivateFormat, PublicFormat
from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError

from skillctl.cli.app import COMMANDS
from skillctl.cli.schema import OUTPUTS, schema_of_output
from skillctl.cli.schemas import described_attributes, schemas_of
from skillctl.usecases.files import load, save

HAS_PYBULLET = importlib.util.find_spec("pybullet") is not None

# (name of the output, arguments, exit code); LIBRARY, FILES and HERE stand for the fixtures' places.
# A new form of an output needs a line here.
RUNS = [
    ("learn", "learn FILES -o HERE/a.h5 --preset fast --components 2 --validate", 0),
    ("learn", "learn FILES -o HERE/a.h5 --preset fast --components 2 --validate", 0),  # up to date
    ("learn", "learn --batch HERE/many.toml --store HERE/batch", 5),
    ("merge", "merge curve hook -o HERE/m.h5 --store LIBRARY", 0),
    ("merge", "merge curve hook -o HERE/m.h5 --store LIBRARY", 0),  # up to date
    ("merge", "merge curve hook -o HERE/f.h5 --store LIBRARY --fit FILES", 0),
    ("merge", "merge curve plain -o HERE/r.h5 --store LIBRARY", 0),
    ("combine", "combine curve hook -o HERE/c.h5 --store LIBRARY --calibrate", 0),
    ("combine", "combine curve hook -o HERE/c.h5 --store LIBRARY --calibrate", 0),  # up to date
    ("combine", "combine curve hook -o HERE/i.h5 --store LIBRARY --gate instantaneous", 0),
    ("chain", "chain curve hook -o HERE/n.h5 --store LIBRARY --event 1:close --within 2:1mm", 0),
    ("combine", "combine curve hook -o HERE/n.h5 --store LIBRARY --gate sequence", 0),
    ("verify-stability", "verify-stability HERE/n.h5", 0),
    ("adapt", "adapt HERE/task.toml curve hook -o HERE/t.h5 --store LIBRARY", 0),
    ("adapt", "adapt HERE/task.toml curve hook -o HERE/t.h5 --store LIBRARY", 0),  # up to date
    ("adapt", "adapt HERE/far.toml curve hook -o HERE/u.h5 --store LIBRARY", 1),
    ("inspect", "inspect HERE/m.h5", 0),
    ("inspect", "inspect HERE/c.h5 --at 0.1,0", 0),
    ("inspect", "inspect HERE/m.h5 --lineage --store LIBRARY", 0),
    ("verify-stability", "verify-stability HERE/m.h5 HERE/c.h5 --period 0.001", 0),
    ("verify-stability", "verify-stability HERE/m.h5 --start-box demos --stay-in :,-1:", 0),
    ("verify-stability", "verify-stability HERE/unstable.h5", 1),
    ("verify-stability", "verify-stability HERE/i.h5", 3),
    ("verify-stability", "verify-stability HERE/nowhere.h5", 4),
    ("simulate", "simulate reach --store LIBRARY --demo 0 --log HERE/l.csv", 0),
    ("simulate", "simulate reach --store LIBRARY --demo 0 --check", 0),
    ("simulate", "simulate reach --store LIBRARY --target 2,0,0.5 --check", 1),
    ("run", "run reach --store LIBRARY --log HERE/run.h5", 0),
    ("run", "run reach --store LIBRARY --dry-run HERE/run.h5", 0),
    ("run", "run reach --store LIBRARY --timeout 0.1", 1),
    ("quickstart", "quickstart HERE/tour", 0),
    ("ls", "ls --store LIBRARY --check", 0),
    ("ls", "ls --store HERE", 0),
    ("diff", "diff curve plain --store LIBRARY", 0),
    ("diff", "diff curve reach --store LIBRARY", 0),
    ("tag", "tag a release --store HERE/shop", 0),
    ("log", "log a --store HERE/shop", 0),
    ("lock", "lock a@release --store HERE/shop --file HERE/skillctl.lock", 0),
    ("sign", "sign curve --key HERE/key.pem --store HERE/signed", 0),
    ("verify-signature", "verify-signature curve --key HERE/public.pem --store HERE/signed", 0),
    ("verify-signature", "verify-signature HERE/unstable.h5 --key HERE/public.pem", 1),
    ("verify-stability", "verify-stability HERE/unstable.h5 --require-signature HERE/public.pem", 1),
    ("untag", "untag a release --store HERE/shop", 0),
    ("gc", "gc --keep-last 1 --store HERE/shop --dry-run", 0),
    ("rm", "rm a@1 --store HERE/shop", 0),
    ("export", "export curve -o HERE/a.json --store LIBRARY", 0),
    ("export", "export curve -o HERE/a.mat --store LIBRARY", 0),
    ("export", "export curve -o HERE/a.h --check --store LIBRARY", 0),
    ("schema", "schema", 0),
    ("schema", "schema error", 0),
    ("completion", "completion bash", 0),
    ("error", "inspect curv --store LIBRARY", 4),
    ("error", "merge curve --nonsense", 2),
    ("error", "nonsense", 2),
    ("error", "learn HERE/nowhere.csv -o HERE/z.h5", 4),
]


def strict(schema):
    """Return a schema that also refuses keys it does not know: those would be undocumented."""
    if isinstance(schema, list):
        return [strict(entry) for entry in schema]
    if not isinstance(schema, dict):
        return schema
    opened = {key: strict(value) for key, value in schema.items()}
    if "required" in schema and "$defs" not in schema:
        opened.setdefault("additionalProperties", False)
    return opened


@lru_cache
def validator(name):
    """Return what checks a document of this name; the outermost object has one key of its own."""
    schema = strict(schema_of_output(name))
    Draft202012Validator.check_schema(schema)
    for place in OUTPUTS[name]:
        schema["$defs"][place.split(":")[1]]["properties"]["schema_version"] = True
    return Draft202012Validator(schema)


@pytest.fixture(scope="module")
def documents(library, curve_files, tmp_path_factory, save_with_matrix):
    """What every run of the table printed: (name, command line, exit code, document)."""
    from typer.testing import CliRunner

    from skillctl.cli.app import app

    here = tmp_path_factory.mktemp("documents")
    skill = load("curve", store=library)
    for name in ("1.h5", "2.h5"):
        (here / "shop" / "a").mkdir(parents=True, exist_ok=True)
        save(skill, here / "shop" / "a" / name)
    save_with_matrix("curve", 0, np.eye(2), here / "unstable.h5")
    shutil.copytree(library, here / "signed")
    (here / "batch").mkdir()
    task = "[target]\nposition = [0, 0.0]\n[start]\nlow = [0.2, 0.1]\nhigh = [0.21, 0.1]\n"
    (here / "task.toml").write_text(task)
    (here / "far.toml").write_text(f"{task}[[via]]\npoint = [5, 5.0]\nwithin = 0.1\n")
    (here / "many.toml").write_text(
        "[options]\npreset = 'fast'\ncomponents = 2\n"
        f"[[skills]]\nname = 'a'\ndata = {[str(file) for file in curve_files]}\n"
        "[[skills]]\nname = 'b'\ndata = 'many.toml'\n"
    )
    key = Ed25519PrivateKey.generate()
    (here / "key.pem").write_bytes(
        key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, serialization.NoEncryption())
    )
    (here / "public.pem").write_bytes(
        key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
    )
    printed = []
    for name, line, code in RUNS:
        if name in ("simulate", "quickstart") and not HAS_PYBULLET:
            continue
        files = f" {'--fit ' if '--fit' in line else ''}".join(map(str, curve_files))
        line = line.replace("FILES", files).replace("LIBRARY", str(library)).replace("HERE", str(here))
        result = CliRunner().invoke(app, [*line.split(), "--json"], catch_exceptions=False)
        assert result.exit_code == code, result.stderr
        printed.append((name, line, json.loads(result.stderr if name == "error" else result.stdout)))
    return printed


def test_every_command_has_a_schema_and_a_run():
    assert set(OUTPUTS) == {*COMMANDS, "error"}
    assert {name for name, _, _ in RUNS} == set(OUTPUTS)


def test_real_documents_are_what_their_schemas_say(documents):
    for name, line, document in documents:
        problems = [
            f"{error.json_path}: {error.message[:200]}" for error in validator(name).iter_errors(document)
        ]
        assert not problems, f"skillctl {line}: {problems[:5]}"


def test_a_document_without_one_of_its_keys_is_refused(documents):
    for name, line, document in documents:
        for key in document:
            changed = {other: value for other, value in document.items() if other != key}
            assert not validator(name).is_valid(changed), f"skillctl {line}: without {key}"


def test_a_document_with_a_value_of_another_type_is_refused(documents):
    for name, line, document in documents:
        for key, value in document.items():
            if name == "diff" and key in ("a", "b"):
                continue  # also the name of values of any type, deeper down
            other = [[0]] if value is None else ("five" if isinstance(value, int | float) else 5)
            assert not validator(name).is_valid({**document, key: other}), f"skillctl {line}: {key}"


def test_undocumented_keys_are_found_deep_down(documents):
    seen = 0
    for name, _, document in documents:
        if name == "verify-stability":
            changed = copy.deepcopy(document)
            changed["skills"][0]["novelty"] = 1
            with pytest.raises(ValidationError, match="novelty"):
                validator(name).validate(changed)
            seen += 1
    assert seen


def test_published_schemas_allow_keys_to_be_added(documents):
    for name, _, document in documents:
        assert Draft202012Validator(schema_of_output(name)).is_valid({**document, "added_later": 1})


def test_not_a_number_is_null(documents):
    for name, _, document in documents:
        assert "NaN" not in json.dumps(document), name


@pytest.mark.parametrize("name", OUTPUTS)
def test_whoever_describes_one_key_describes_all(name):
    """What a key means is said once, in the docstring of the report."""
    for kind, schema in schema_of_output(name)["$defs"].items():
        described = {key: "description" in value for key, value in schema.get("properties", {}).items()}
        assert len(set(described.values())) <= 1, (kind, described)


def test_attributes_of_docstrings_are_read():
    text = """A thing.

    Attributes:
        one, two: The first and
            the second.
        three: ``3``: a number.

    Other: nothing.
    """
    assert described_attributes(text) == {
        "one": "The first and the second.",
        "two": "The first and the second.",
        "three": "`3`: a number.",
    }


def test_a_type_without_json_is_not_guessed_at():
    class Unknown:
        pass

    with pytest.raises(TypeError, match="Unknown"):
        schemas_of([Unknown])


def test_an_unknown_output_is_refused_with_the_nearest(run):
    result = run("schema", "lern")
    assert result.exit_code == 4
    assert "Did you mean learn?" in result.stderr
