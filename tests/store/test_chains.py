"""Chains in a file: what a writer puts there, read back by the page, and what a reader refuses."""

import json
from dataclasses import replace
from io import BytesIO

import h5py
import numpy as np
import pytest

from skillctl import store
from skillctl.errors import InvalidModelError
from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.mixture import GaussianMixture

HALVES = np.array([0.5, 0.5])


@pytest.fixture(scope="module")
def region():
    """Return a region of some components around a place."""
    return lambda place, k=1: GaussianMixture(
        np.full(k, 1 / k), np.full((k, 2), place), np.stack([np.eye(2)] * k)
    )


@pytest.fixture(scope="module")
def chain(make_seds, region):
    """Stages: combined with regions, learned, combined without, combined with regions."""
    a, b, c = make_seds(1), make_seds(2, attractor=(1, 2)), make_seds(3, speed=0.5)
    taught = [CombinedSkill((a, b), HALVES, regions=(region(i, 1), region(i + 1, 2))) for i in (0.0, 10.0)]
    stages = (taught[0], c, CombinedSkill((b, c), HALVES), taught[1])
    events = (("close", "wait 0.5"), (), ("open",), ())
    return ChainedSkill(stages, np.array([0.1, 0.2, 0.3, 0.4]), events, "back", 0.0625)


@pytest.fixture(scope="module")
def data(wrap, chain):
    return store.encode(wrap(chain))


@pytest.fixture(scope="module")
def changed(data, reseal, page_digest):
    """Change the metadata, or the body, of that file, and seal it again."""

    def edit_and_seal(edit_meta=lambda meta: None, edit_body=lambda body: None):
        with h5py.File(file := BytesIO(data), "r+") as body:
            meta = json.loads(body["meta.json"][()].tobytes())
            edit_meta(meta)
            del body["meta.json"]
            text = np.frombuffer(json.dumps(meta).encode(), np.uint8)
            body.create_dataset("meta.json", data=text, track_times=False)
            edit_body(body)
        body = file.getvalue()[512:]
        return reseal(body, "chain", page_digest(body))

    return edit_and_seal


def test_a_file_states_the_stages_in_their_order(data, page_digest):
    with h5py.File(BytesIO(data)) as body:
        meta = json.loads(body["meta.json"][()].tobytes())
        owners = body["regions/part"][()].tolist()
        means = body["regions/means"][()][:, 0].tolist()
    node = meta["skill"]
    assert data[10:512].split(b"\n")[1].startswith(b"chain ")
    assert [part["kind"] for part in node.pop("parts")] == ["combined", "seds", "combined", "combined"]
    assert node == {
        "kind": "chain", "levels": [0.1, 0.2, 0.3, 0.4], "on_jump": "back", "disturbance_distance": 0.0625,
        "events": [["close", "wait 0.5"], [], ["open"], []],
    }  # fmt: skip
    # The acting parts are 0, 1 | 2 | 3, 4 | 5, 6; those of the third stage have no regions.
    assert owners == [0, 1, 1, 5, 6, 6]
    assert means == [0, 1, 1, 10, 11, 11]
    assert [parent["role"] for parent in meta["provenance"]["parents"]] == [
        f"stage {i}" for i in (1, 2, 3, 4)
    ]
    assert store.decode(data).digest == page_digest(data[512:])


def test_the_state_is_handed_over_where_the_page_says(data, chain):
    """V of the leaf that acts, from the arrays of the file alone, against the level of its stage."""
    with h5py.File(BytesIO(data)) as body:
        node = json.loads(body["meta.json"][()].tobytes())["skill"]
        attractors, lyapunov = body["model/attractors"][()], body["model/lyapunov"][()]
    leaves = [[leaf["leaf"] for leaf in part.get("parts", [part])] for part in node["parts"]]
    assert leaves == [[0, 1], [2], [3, 4], [5, 6]]  # here every acting part is a leaf
    read = store.decode(data).skill
    x = attractors[2] + np.random.default_rng(0).normal(0, 0.4, (200, 2))
    offsets = x - attractors[2]
    over = np.einsum("ni,ij,nj->n", offsets, lyapunov[2], offsets) <= node["levels"][1]
    assert over.any()
    assert not over.all()
    moved_on = read.onward(x, np.full(len(x), 2)) != 2
    assert (moved_on == over).all()


def test_regions_of_stages_decide_as_before(data, chain):
    read = store.decode(data).skill
    x = np.random.default_rng(1).normal(0.5, 3, (100, 2))
    for there, wanted in zip(read.parts, chain.parts, strict=True):
        assert (there.part_at(x) == wanted.part_at(x)).all()
        assert [len(one.priors) for one in getattr(there, "regions", ())] == [
            len(one.priors) for one in getattr(wanted, "regions", ())
        ]


def skill_with(**instead):
    return lambda meta: meta["skill"].update(instead)


@pytest.mark.parametrize(
    ("instead", "cause"),
    [
        ({"levels": []}, "skill.chain.levels"),
        ({"levels": [0.1, 0.1]}, "expected one a part"),
        ({"levels": [0.1, 0, 0.1, 0.1]}, "levels.1"),
        ({"levels": [0.1, "1", 0.1, 0.1]}, "levels.1"),
        ({"events": []}, "expected one a part"),
        ({"events": [["Close"], [], [], []]}, "events.0.0"),
        ({"events": [["wait -1"], [], [], []]}, "events.0.0"),
        ({"events": [[], ["wait 0.5\n"], [], []]}, "events.1.0"),
        ({"events": [[], ["wait  1"], [], []]}, "events.1.0"),
        ({"events": [[], ["wait \u0663"], [], []]}, "events.1.0"),  # an Arabic digit
        ({"on_jump": "away"}, "on_jump"),
        ({"on_jump": None}, "on_jump"),
        ({"disturbance_distance": 0}, "disturbance_distance"),
        ({"disturbance_distance": "1"}, "disturbance_distance"),
        ({"speed": 1.0}, "Extra inputs are not permitted"),
        ({"parts": []}, "parts"),
    ],
)
def test_the_layout_of_a_chain(refuse, changed, instead, cause):
    refuse(changed(skill_with(**instead)), cause)


@pytest.mark.parametrize("key", ["levels", "events", "on_jump", "disturbance_distance"])
def test_nothing_of_it_is_optional(refuse, changed, key):
    refuse(changed(lambda meta: meta["skill"].pop(key)), f"skill.chain.{key}: Field required")


def test_a_chain_is_no_stage_and_no_part(refuse, changed):
    def nested(meta):
        stages = meta["skill"]["parts"]
        stages[0] = {**meta["skill"], "parts": [stages[0]], "levels": [0.1], "events": [[]]}

    refuse(changed(nested), "skill.chain.parts.0")


def test_a_stage_is_latched(refuse, changed):
    def instantaneous(meta):
        meta["skill"]["parts"][2]["gate"] = "instantaneous"

    refuse(changed(instantaneous), "instantaneous")


@pytest.mark.parametrize(
    "part",
    [[0, 1, 1, 5, 5, 5], [0, 1, 1, 2, 2, 2], [0, 1, 1, 3, 5, 6], [5, 6, 6, 0, 1, 1], [0, 1, 1, 7, 7, 8]],
)
def test_regions_belong_to_all_parts_of_combined_stages(refuse, changed, part):
    def edit(body):
        body["regions/part"][...] = part

    refuse(changed(edit_body=edit), "/regions/part: must number all parts of a combined skill, in order")


def test_regions_of_some_stages_may_be_left_out(changed):
    def edit(body):
        for name in ("priors", "means", "covariances", "part"):
            kept = body[f"regions/{name}"][3:]
            del body[f"regions/{name}"]
            body.create_dataset(f"regions/{name}", data=kept, track_times=False)

    stages = store.decode(changed(edit_body=edit)).skill.parts
    assert [len(getattr(stage, "regions", ())) for stage in stages] == [0, 0, 0, 2]


@pytest.mark.parametrize("count", [0, 3, 5])
def test_the_command_has_one_parent_a_stage(refuse, changed, count):
    def edit(meta):
        meta["provenance"]["parents"] = (meta["provenance"]["parents"] * 2)[:count]

    refuse(changed(edit), f"provenance.parents: {count} skills do not chain into 4 parts")


def test_parents_are_in_the_order_of_the_stages(refuse, changed):
    def edit(meta):
        parents = meta["provenance"]["parents"]
        parents[0], parents[1] = parents[1], parents[0]

    refuse(changed(edit), "provenance.parents: the roles must be stage 1 to stage 4, in order")


@pytest.mark.parametrize("command", ["learn", "merge", "combine"])
def test_other_commands_make_no_chain(wrap, chain, command):
    operation = store.Operation(command=command, results={"kept": (1.0,), "lyapunov": "found"})
    with pytest.raises(InvalidModelError, match=f"{command} makes no chain skill"):
        store.encode(replace(wrap(chain), operation=operation))


def test_a_chain_made_in_python_names_any_parents(wrap, chain):
    made = replace(wrap(chain), operation=store.Operation(command="python"))
    one = made.provenance.model_copy(update={"parents": made.provenance.parents[:1]})
    assert len(store.decode(store.encode(replace(made, provenance=one))).provenance.parents) == 1
