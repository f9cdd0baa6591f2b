"""What format 2 reserves for later builds: its layout is read, its use is refused in one sentence."""

import json

import numpy as np
import pytest

from skillctl import store
from skillctl.store import errors, layout


def coordinates(**instead):
    """An edit that adds two learned shears of three bumps each; the good skill has four leaves in 2-D."""
    arrays = {
        "linear": np.stack([np.eye(2)] * 4),
        "directions": np.eye(2),
        "centres": np.zeros((2, 3)),
        "widths": np.ones(2),
        "coefficients": np.zeros((2, 3, 2)),
        "leaf": np.zeros(2, dtype=np.int64),
    }

    def edit(body):
        for name, array in {**arrays, **instead}.items():
            if array is not None:
                body.create_dataset(f"coordinates/{name}", data=array, track_times=False)

    return edit


def pose(meta):
    return {**meta, "state": {**meta["state"], "kind": "pose", "characteristic_length": 0.25}}


def chain(meta, **instead):
    skill = {"kind": "chain", "parts": [meta["skill"]], "levels": [0.01], "events": [["close", "wait 0.5"]]}
    operation = {**meta["operation"], "command": "chain"}
    return {**meta, "skill": {**skill, **instead}, "operation": operation}


def adapted(meta):
    return {**meta, "operation": {**meta["operation"], "command": "adapt"}}


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
        (pose, "poses"),
        (chain, "a chain of skills and the command chain"),
        (adapted, "the command adapt"),
        (gated, "the gate avoiding"),
        (lambda meta: gated(meta, "experts"), "the gate experts"),
        (gated_below, "the gate latched"),
        (lambda meta: adapted(pose(meta)), "poses and the command adapt"),
    ],
)
def test_reserved_metadata_is_refused_by_name(refuse, with_meta, meta, change, used):
    said = f"uses {used}, which a later skillctl writes; this build cannot use it"
    refuse(with_meta(stored(change(meta))), said, errors.LaterFeatureError)


def test_learned_coordinates_are_refused_by_name(refuse, hostile):
    refuse(hostile(coordinates()), "uses learned coordinates, which", errors.LaterFeatureError)


def test_the_hint_is_to_upgrade(with_meta, meta):
    with pytest.raises(errors.LaterFeatureError) as caught:
        store.decode(with_meta(stored(pose(meta))))
    assert caught.value.hint == "Upgrade skillctl."


def test_their_layout_is_read_so_that_a_store_keeps_them(hostile, tmp_path):
    data = hostile(coordinates(), honest=True)
    stored = store.Registry(tmp_path).publish("reach", data)
    assert stored.digest == store.digest_of(data) == store.read_header(stored.path).digest


@pytest.mark.parametrize(
    ("instead", "cause"),
    [
        ({"linear": np.stack([np.eye(2)] * 3)}, "/model/.*: L is 4 here and 3 elsewhere"),
        ({"directions": np.eye(3)}, "(d|S) is . here and . elsewhere"),
        ({"widths": np.ones(3)}, "S is . here and . elsewhere"),
        ({"centres": np.zeros((2, 4))}, "J is . here and . elsewhere"),
        (
            {"centres": np.zeros((2, 65)), "coefficients": np.zeros((2, 65, 2))},
            "J = 65 is not within 1 to 64",
        ),
        ({"leaf": np.zeros(2)}, "elements must be <i8"),
        ({"widths": None}, "/coordinates/widths: missing"),
        ({"bias": np.ones(2)}, "/coordinates/bias: not part of the format"),
        ({"widths": np.array([1, np.nan])}, "must be finite"),
    ],
)
def test_the_layout_of_learned_coordinates(refuse, hostile, instead, cause):
    refuse(hostile(coordinates(**instead)), cause)


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


@pytest.mark.parametrize("length", [0, -1, "1", None])
def test_a_pose_has_a_characteristic_length(refuse, with_meta, meta, length):
    changed = pose(meta)
    changed["state"]["characteristic_length"] = length
    refuse(with_meta(stored(changed)), "state.pose.characteristic_length")
    euclidean = {**meta, "state": {**meta["state"], "characteristic_length": 1.0}}
    refuse(with_meta(stored(euclidean)), "Extra inputs are not permitted")


@pytest.mark.parametrize("path", [path for path, spec in layout.ARRAYS.items() if spec.since > 1])
def test_no_array_of_format_2_is_in_a_file_of_format_1(path):
    group, name = path.split("/")
    assert group not in layout.members("", 1)
    assert name not in layout.members(group, 1)
    assert name in layout.members(group, 2)
