"""What format 2 reserves for later builds: its layout is read, its use is refused in one sentence."""

import json

import pytest

from skillctl import store
from skillctl.store import errors, layout


def gated(meta, gate="avoiding"):
    return {**meta, "skill": {**meta["skill"], "gate": gate}}


def gated_below(meta):
    first, *others = meta["skill"]["parts"]
    first = {**first, "gate": "latched", "parameters": {"anything": -1}}  # no gate of merged skills
    return {**meta, "skill": {**meta["skill"], "parts": [first, *others]}}


def chained(meta):
    skill = {"kind": "chain", "parts": [gated(meta)["skill"]], "levels": [0.1], "events": [[]]}
    operation = {**meta["operation"], "command": "python"}
    return {
        **meta,
        "skill": {**skill, "on_jump": "stay", "disturbance_distance": 0.02},
        "operation": operation,
    }


def stored(meta) -> bytes:
    return json.dumps(meta).encode()


@pytest.mark.parametrize(
    ("change", "used"),
    [
        (gated, "the gate avoiding"),
        (lambda meta: gated(meta, "experts"), "the gate experts"),
        (gated_below, "the gate latched"),
        (lambda meta: gated(gated_below(meta)), "the gate avoiding and the gate latched"),
        (chained, "the gate avoiding"),
    ],
)
def test_reserved_metadata_is_refused_by_name(refuse, with_meta, meta, change, used):
    said = f"uses {used}, which a later skillctl writes; this build cannot use it"
    refuse(with_meta(stored(change(meta))), said, errors.LaterFeatureError)


def test_the_hint_is_to_upgrade(with_meta, meta):
    with pytest.raises(errors.LaterFeatureError) as caught:
        store.decode(with_meta(stored(gated(meta))))
    assert caught.value.hint == "Upgrade skillctl."


@pytest.mark.parametrize("path", [path for path, spec in layout.ARRAYS.items() if spec.since > 1])
def test_no_array_of_format_2_is_in_a_file_of_format_1(path):
    group, name = path.split("/")
    assert group not in layout.members("", 1)
    assert name not in layout.members(group, 1)
    assert name in layout.members(group, 2)
