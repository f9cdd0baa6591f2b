"""What is recorded about where a skill comes from."""

import json
from pathlib import Path

import numpy as np
import pytest
import scipy
from pydantic import ValidationError

import skillctl
from skillctl import store
from skillctl.errors import UsageError
from skillctl.store.canonical import dump_canonical, load_strict
from skillctl.store.errors import Refusal


@pytest.mark.parametrize(("given", "recorded"), [
    ("data/a.csv", "data/a.csv"),
    ("./data/../a.csv", "a.csv"),
    ("/home/someone/a.csv", "a.csv"),
    ("../elsewhere/a.csv", "a.csv"),
    ("a\x1b[2J.csv", r"a\x1b[2J.csv"),
    ("b\udcff.csv", r"b\udcff.csv"),
    ("a:0.csv", "a_0.csv"),
    ("c:run/0.csv", "c_run/0.csv"),
    (r"\0.csv", "_0.csv"),
    (r"a\..\0.csv", "a_.._0.csv"),
    ("\udcc3\udcbc0.csv", "_udcc3_udcbc0.csv"),  # ü in a locale that cannot read it
    ("y" * 100 + "/" + "x" * 199, "x" * 199),
    ("x" * 300 + ".csv", "x" * 196 + ".csv"),
])  # fmt: skip
def test_inputs_are_recorded_without_user_or_machine(given, recorded):
    record = store.input_record(Path(given), "0" * 64, "csv")
    assert record.path == recorded
    assert record.sha256 == "0" * 64


def test_the_versions_that_made_the_numbers_are_recorded(monkeypatch):
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    made = store.current_provenance()
    assert made.tool == skillctl.__version__
    assert made.libraries == {"numpy": np.__version__, "scipy": scipy.__version__}
    assert made.date is None


@pytest.mark.parametrize(
    ("epoch", "date"),
    [
        ("0", "1970-01-01T00:00:00Z"),
        ("1582977600", "2020-02-29T12:00:00Z"),
        ("", None),
    ],
)
def test_a_date_comes_from_source_date_epoch_alone(monkeypatch, epoch, date):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", epoch)
    monkeypatch.setenv("TZ", "Asia/Kathmandu")
    assert store.current_provenance().date == date


@pytest.mark.parametrize("epoch", ["yesterday", "1.5", "1e99", "9" * 30])
def test_a_bad_epoch_is_a_usage_error(monkeypatch, epoch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", epoch)
    with pytest.raises(UsageError, match="SOURCE_DATE_EPOCH"):
        store.current_provenance()


def operation(**changes):
    return store.Operation(**({"command": "learn", "options": {"metric": "learned"}, "seed": 7} | changes))


def provenance(**changes):
    record = store.InputRecord(path="a.csv", sha256="0" * 64, importer="csv")
    parent = store.ParentRecord(name="reach", version=1, digest=f"sha256:{'1' * 64}", role="part")
    return store.Provenance(**({"inputs": (record,), "parents": (parent,), "tool": "0.1.0"} | changes))


def test_the_fingerprint_changes_with_everything_that_decides_the_result():
    other_input = store.InputRecord(path="a.csv", sha256="1" * 64, importer="csv")
    other_reader = store.InputRecord(path="a.csv", sha256="0" * 64, importer="tsv")
    other_parent = store.ParentRecord(name="reach", version=1, digest=f"sha256:{'2' * 64}", role="part")
    fingerprints = [
        store.input_fingerprint(operation(), provenance()),
        store.input_fingerprint(operation(command="merge"), provenance()),
        store.input_fingerprint(operation(seed=8), provenance()),
        store.input_fingerprint(operation(options={"metric": "euclidean"}), provenance()),
        store.input_fingerprint(operation(), provenance(inputs=(other_input,))),
        store.input_fingerprint(operation(), provenance(inputs=(other_reader,))),
        store.input_fingerprint(operation(), provenance(inputs=())),
        store.input_fingerprint(operation(), provenance(parents=(other_parent,))),
        store.input_fingerprint(operation(), provenance(tool="0.2.0")),
    ]
    assert len(set(fingerprints)) == len(fingerprints)


def test_the_fingerprint_does_not_change_with_anything_else():
    moved = store.InputRecord(path="elsewhere/b.csv", sha256="0" * 64, importer="csv")
    assert store.input_fingerprint(
        operation(results={"dtw": 0.5}), provenance(inputs=(moved,), date="2020-02-29T12:00:00Z")
    ) == store.input_fingerprint(operation(), provenance())


def test_the_fingerprint_survives_the_file(wrap, make_seds):
    artifact = wrap(make_seds(1))
    read = store.decode(store.encode(artifact))
    assert store.input_fingerprint(read.operation, read.provenance) == store.input_fingerprint(
        artifact.operation, artifact.provenance
    )


def test_facts_are_made_plain():
    given = {
        "flag": np.bool_(True), "count": np.int64(3), "share": np.float64(0.5),
        "weights": np.array([0.25, 0.75]),
        "names": ["a", "b\n"], "none": None, "path": Path("/home/someone/a.csv"), "bad": float("nan"),
    }  # fmt: skip
    stored = store.Operation(command="learn", options=given)
    assert stored.options == {
        "flag": True, "count": 3, "share": 0.5, "weights": (0.25, 0.75), "names": ("a", r"b\n"), "none": None,
        "path": "a.csv", "bad": None,
    }  # fmt: skip
    assert type(stored.options["share"]) is float
    assert load_strict(dump_canonical(stored.model_dump(mode="json")))["options"]["weights"] == [0.25, 0.75]


def test_labels_are_made_printable_and_short():
    report = store.DemonstrationReport(source=f"\x1b[31m{'x' * 300}\n.csv", leaf=0, n_points=2, duration=1.0)
    assert report.source.isprintable()
    assert len(report.source) == 200
    assert report.source.endswith(r"x\n.csv")


@pytest.mark.parametrize("value", [{"a": 1}, [[1]], object(), 1j])
def test_facts_refuse_what_metadata_cannot_hold(value):
    with pytest.raises(TypeError, match="metadata cannot hold"):
        store.Operation(command="learn", options={"x": value})


@pytest.mark.parametrize("field", ["options", "results"])
@pytest.mark.parametrize("key", ["Upper", "1st", "", "a-b", "a" * 65, "a\n"])
def test_facts_have_plain_names(field, key):
    with pytest.raises(ValidationError):
        store.Operation(command="learn", **{field: {key: 1}})


@pytest.mark.parametrize("value", [0.1, 1e22, 1e-7, 5e-324, 1.7976931348623157e308, -0.0, 2**63 - 1, 1, True])
def test_canonical_json_reads_back_exactly(value):
    text = dump_canonical({"b": value, "a": [value]})
    assert text.startswith(b'{"a":[')
    read = load_strict(text)["b"]
    assert (type(read), repr(read)) == (type(value), repr(value))
    assert json.loads(text) == {"a": [value], "b": value}


def test_canonical_json_has_no_nan():
    with pytest.raises(ValueError, match="JSON"):
        dump_canonical({"a": float("nan")})


def test_brackets_inside_text_are_not_depth():
    assert load_strict(b'{"a": "' + b"[" * 100 + b'\\"[["}') == {"a": "[" * 100 + '"[['}
    with pytest.raises(Refusal, match="nested"):
        load_strict(b'["\\\\"' + b",[" * 64)
