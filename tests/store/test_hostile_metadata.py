"""Files that are sealed again with metadata that the format does not allow."""

import json

import pytest

from skillctl import store


def spelled(meta, old, new):
    text = json.dumps(meta)
    assert text.count(old) == 1, text.count(old)
    return text.replace(old, new).encode()


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        (b'{"a": "\xff"}', "not UTF-8"),
        (b'{"a": "\xed\xa0\x80"}', "not UTF-8"),
        (b'{"a": "\x00"}', "not JSON"),
        (b"{} {}", "not JSON"),
        (b"{}\0", "not JSON"),
        (b"\xef\xbb\xbf{}", "not JSON"),
        (b"[1]", "not an object"),
        (b"null", "not an object"),
        (b"[" * 65_000, "nested more than 64 deep"),
        (b'{"a":' * 13_000, "nested more than 64 deep"),
        (b'{"a": 1, "b": {"x": 1, "x": 2}}', "key 'x' occurs twice"),
        (b'{"a": NaN}', "NaN is not JSON"),
        (b'{"a": -Infinity}', "-Infinity is not JSON"),
        (b'{"a": 1e999}', "does not fit float64"),
        (b'{"a": ' + b"9" * 10_000 + b"}", "does not fit int64"),
        (b'{"a": 9223372036854775808}', "does not fit int64"),
        (b"{" + b" " * 65_536, "B = 65537 is not within 1 to 65536"),
        (b'{"format": 2}', r"/meta\.json: skill: Field required"),
    ],
)
def test_metadata_is_strict_json(refuse, with_meta, text, cause):
    refuse(with_meta(text), cause)


@pytest.mark.parametrize(("old", "new", "cause"), [
    ('"frame": "base", ', "", "state.euclidean.frame: Field required"),
    ('"frame": "base"', '"frame": "base", "extra": 1', "euclidean.extra: Extra inputs are not"),
    ('"frame": "base"', '"frame": "base", "\\u001b[2J": 1', "Extra inputs are not permitted"),
    ('"frame": "base"', '"frame": "\\u001b[2J"', "euclidean.frame: must not contain control"),
    ('"frame": "base"', '"frame": "\\ud800"', "state.euclidean.frame: "),
    ('"frame": "base"', '"frame": ""', "state.euclidean.frame: "),
    ('"frame": "base"', f'"frame": "{"x" * 201}"', "state.euclidean.frame: "),
    ('"names": ["x", "y"]', '"names": ["x", "x"]', "expected 2 different names"),
    ('"names": ["x", "y"]', '"names": ["x"]', "expected 2 different names"),
    ('"names": ["x", "y"]', '"names": "xy"', "state.euclidean.names: "),
    ('"seed": 7', '"seed": 7.0', "operation.seed: "),
    ('"seed": 7', '"seed": true', "operation.seed: "),
    ('"seed": 7', '"seed": "7"', "operation.seed: "),
    ('"seed": 7', '"seed": -1', "operation.seed: "),
    ('"kind": "combined"', '"kind": "seds"', "skill"),
    ('"kind": "combined"', '"kind": "average"', "skill"),
    ('"gate": "instantaneous"', '"gate": "Sometimes"', "gate"),
    ('"sharpness": 2.5', '"sharpness": 0.5', "sharpness: must be at least 1, got 0.5"),
    ('"sharpness": 2.5', '"sharpness": true', "parameters.sharpness"),
    ('"sharpness": 2.5', '"sharpness": [2.5]', "parameters.sharpness"),
    ('{"sharpness": 2.5}', '{"sharpness": 2.5, "softness": 1}', "softness: the experts gate does"),
    ('{"sharpness": 2.5}', '{"Sharpness": 2.5}', "parameters"),
    ('{"sharpness": 2.5}', '{}', "parameters: expected sharpness"),
    ('{"sharpness": 2.5}', '2.5', "parameters"),
    ('{}, "part_weights": [0.3', '{"sharpness": 1}, "part_weights": [0.3', "the density gate does not"),
    ('"parameters": {}, ', '"sharpness": 1.0, ', "sharpness: Extra inputs|parameters: Field required"),
    ('"speed": 0.9', '"speed": 0', "speed"),
    ('"speed": 0.9', '"speed": -0.9', "speed"),
    ('"part_priors": [0.5, 0.5]', '"part_priors": [0.5, 0.4]', "part_priors: must be positive and sum"),
    ('"part_priors": [0.5, 0.5]', '"part_priors": [1.0]', "part_priors: expected shape"),
    ('"part_priors": [0.5, 0.5]', '"part_priors": []', "part_priors"),
    ('"components": [0, 3]', '"components": [0, 2]', "does not continue"),
    ('"components": [0, 3]', '"components": [3, 0]', "does not continue"),
    ('"components": [0, 3]', '"components": [0, 3, 3]', "components"),
    ('"components": [0, 3]', '"components": [0, 0]', "does not continue|means: expected shape"),
    ('"components": [0, 3]', '"components": [0, 1000000000]', "does not continue|components"),
    ('"leaf": 0, "speed"', '"leaf": 1, "speed"', "leaf 1 does not continue"),
    ('"path": "data/motion.csv"', '"path": "/etc/passwd"', "relative path"),
    ('"path": "data/motion.csv"', '"path": "../secret"', "relative path"),
    ('"path": "data/motion.csv"', '"path": "C:\\\\secret"', "relative path"),
    (f'"sha256": "{"0" * 64}"', '"sha256": "0"', "sha256"),
    (f'"sha256": "{"0" * 64}"', f'"sha256": "{"0" * 64}\\n"', "sha256"),
    ('"command": "combine"', '"command": "rm -rf"', "operation.command"),
    ('"date": null', '"date": "yesterday"', "provenance.date"),
    ('"date": null', '"date": "2020-02-29T12:00:00"', "provenance.date"),
    ('["x", "y"], "unit": "m"', '["x", "y"], "unit": "mm"', "state.euclidean.unit"),
    ('"kind": "euclidean"', '"kind": "quaternion"', "state: "),
    ('"unit": "m"}, "results"', '"Unit": "m"}, "results"', "operation.options"),
    ('"unit": "m"}, "results"', f'"{"u" * 65}": "m"}}, "results"', "operation.options"),
    ('"unit": "m"}, "results"', '"unit": {"m": 1}}, "results"', "operation.options"),
    ('"unit": "m"}, "results"', '"unit": [["m"]]}, "results"', "operation.options"),
    ('"unit": "m"}, "results"', f'"unit": "{"m" * 1001}"}}, "results"', "operation.options"),
    ('"disturbance_distance": 0.1', '"disturbance_distance": 0', "disturbance_distance"),
    ('"part_weights": [0.3, 0.7]', '"part_weights": [0.3, 0.6]', "part_weights: must be positive and sum"),
    ('"part_weights": [0.3, 0.7]', '"part_weights": [-0.3, 1.3]', "part_weights"),
    ('"importer": "csv"', '"importer": ""', "importer"),
    ('"version": 3', '"version": 0', "version"),
    ('"version": 3', '"version": 1000000', "version"),
    ('"role": "part 1"', '"role": ""', "role"),
    (f'"digest": "sha256:{"1" * 64}"', f'"digest": "{"1" * 64}"', "digest"),
    ('"numpy": "2.0.0"', '"numpy": 2', "libraries"),
    ('"tool": "0.1.0"', '"tool": ""', "provenance.tool"),
])  # fmt: skip
def test_metadata_has_exactly_the_fields_of_the_format(refuse, with_meta, meta, old, new, cause):
    refuse(with_meta(spelled(meta, old, new)), f"/meta.json: .*{cause}|{cause}")


@pytest.mark.parametrize("change", [
    {"n_points": 1}, {"duration": 0}, {"dtw": -1e-9}, {"end_error": -1}, {"velocity_rmse": -1},
    {"arrived": 1}, {"leaf": -1}, {"source": "x" * 201}, {"extra": 1},
], ids=repr)  # fmt: skip
def test_reports_have_exactly_the_fields_of_the_format(refuse, with_meta, meta, change):
    reports = [{**meta["reports"][0], **change}]
    refuse(with_meta(json.dumps({**meta, "reports": reports}).encode()), f"reports.0.{next(iter(change))}")


@pytest.mark.parametrize("note", ["", "x" * 1001, "a\nb", 1])
def test_notes_are_short_texts(refuse, with_meta, meta, note):
    operation = {**meta["operation"], "note": note}
    refuse(with_meta(json.dumps({**meta, "operation": operation}).encode()), "operation.note")


def test_what_may_be_left_out_may_and_a_whole_number_is_a_float(with_meta, meta):
    operation = {"command": "python"}
    less = {
        **meta,
        "operation": operation,
        "provenance": {"tool": "x"},
        "skill": {**meta["skill"], "speed": 1},
    }
    del less["reports"]
    read = store.decode(with_meta(json.dumps(less, indent=3).encode(), honest=True))
    assert (read.reports, read.operation.options, read.operation.seed, read.skill.speed) == (
        (),
        {},
        None,
        1.0,
    )
    assert (read.provenance.inputs, read.provenance.parents, read.provenance.libraries) == ((), (), {})


@pytest.mark.parametrize("key", ["skill", "state", "operation", "provenance"])
def test_nothing_else_may_be_left_out(refuse, with_meta, meta, key):
    refuse(
        with_meta(json.dumps({k: v for k, v in meta.items() if k != key}).encode()), f"{key}: Field required"
    )


def test_a_report_on_a_leaf_that_is_not_there(refuse, with_meta, meta):
    reports = [{**meta["reports"][0], "leaf": 4}]
    refuse(with_meta(json.dumps({**meta, "reports": reports}).encode()), "there is no leaf 4")


def test_sources_and_demonstrations_must_agree(refuse, with_meta, meta):
    refuse(with_meta(json.dumps({**meta, "demonstrations": []}).encode()), "expected 6 sources")


def test_a_combined_skill_is_no_part(refuse, with_meta, meta):
    skill = {**meta["skill"], "parts": [meta["skill"]], "part_priors": [1.0]}
    refuse(with_meta(json.dumps({**meta, "skill": skill}).encode()), "skill")


def test_a_tree_may_be_16_deep_and_no_deeper(refuse, with_meta, meta):
    def deep(extra):
        skill = meta["skill"]  # combined, merged, merged, seds: four deep
        first = skill["parts"][0]
        for _ in range(extra):
            first = {"kind": "merged", "parts": [first], "part_weights": [1.0], "gate": "density",
                     "parameters": {}, "speed": 1.0}  # fmt: skip
        return json.dumps({**meta, "skill": {**skill, "parts": [first, skill["parts"][1]]}}).encode()

    store.decode(with_meta(deep(12), honest=True))
    refuse(with_meta(deep(13)), "nested more than 16 deep")
