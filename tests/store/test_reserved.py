"""What format 2 reserves for later builds: its layout is read, its use is refused in one sentence."""

import json

import pytest

from skillctl import store
from skillctl.store import errors, layout


def chain(meta, **instead):
    skill = {"kind": "chain", "parts": [meta["skill"]], "levels": [0.01], "events": [["close", "wait 0.5"]]}
    operation = {**meta["operation"], "command": "chain"}
    return {**meta, "skill": {**skill, **instead}, "operation": operation}


def gated(meta, gate="avoiding"):
    return {**meta, "skill": {**meta["skill"], "gate": gate}}


def gated_below(meta):
    first, *others = meta["skill"]["parts"]
    first = {**first, "gate": "latched", "parameters": {"anything": -1}}  # no gate of merged skills
    return {**meta, "skill": {**meta["skill"], "parts": [first, *others]}}


def stored(meta) -> bytes:
    return json.dumps(meta).encode()


@pytest.mark.parametrize(
    ("change", "used"),
    [
        (chain, "a chain of skills and the command chain"),
        (gated, "the gate avoiding"),
        (lambda meta: gated(meta, "experts"), "the gate experts"),
        (gated_below, "the gate latched"),
    ],
)
def test_reserved_metadata_is_refused_by_name(refuse, with_meta, meta, change, used):
    said = f"uses {used}, which a later skillctl writes; this build cannot use it"
    refuse(with_meta(stored(change(meta))), said, errors.LaterFeatureError)


def test_the_hint_is_to_upgrade(with_meta, meta):
    with pytest.raises(errors.LaterFeatureError) as caught:
        store.decode(with_meta(stored(chain(meta))))
    assert caught.value.hint == "Upgrade skillctl."


@pytest.mark.parametrize(
    ("instead", "cause"),
    [
        ({"levels": []}, "levels"),
        ({"levels": [0.1, 0.1]}, "expected one a part"),
        ({"levels": [0]}, "levels.0"),
        ({"events": []}, "expected one a part"),
        ({"events": [["Close"]]}, "events.0.0"),
        ({"events": [["wait -1"]]}, "events.0.0"),
        ({"events": [["wait 0.5\n"]]}, "events.0.0"),
        ({"parts": []}, "parts"),
    ],
)
def test_the_layout_of_a_chain(refuse, with_meta, meta, instead, cause):
    refuse(with_meta(stored(chain(meta, **instead))), cause)


def test_a_chain_is_no_part(refuse, with_meta, meta):
    inner = chain(meta)["skill"]
    refuse(with_meta(stored(chain(meta, parts=[inner]))), "skill.chain.parts.0")


@pytest.mark.parametrize("path", [path for path, spec in layout.ARRAYS.items() if spec.since > 1])
def test_no_array_of_format_2_is_in_a_file_of_format_1(path):
    group, name = path.split("/")
    assert group not in layout.members("", 1)
    assert name not in layout.members(group, 1)
    assert name in layout.members(group, 2)
