"""What files of format 1 state in its own way is read in the current form, and no more than that."""

import json
from io import BytesIO
from pathlib import Path

import h5py
import numpy as np
import pytest

from skillctl import store
from skillctl.store import errors

ARCHIVE = Path(__file__).parents[1] / "archives" / "v1"


@pytest.fixture
def resealed(reseal, page_digest):
    """Change the metadata of an archived artifact of format 1 by a function, and seal it again."""

    def change(name, edit):
        data = (ARCHIVE / name).read_bytes()
        with h5py.File(file := BytesIO(data), "r+") as body:
            meta = json.loads(body["meta.json"][()].tobytes())
            edit(meta)
            del body["meta.json"]
            text = np.frombuffer(json.dumps(meta).encode(), np.uint8)
            body.create_dataset("meta.json", data=text, track_times=False)
        body = file.getvalue()[512:]
        return reseal(body, store.read_header(ARCHIVE / name).kind, page_digest(body, 1), 1)

    return change


def test_a_file_of_format_1_is_resealed_faithfully(resealed):
    read = store.decode(resealed("merged.h5", lambda meta: None))
    assert read.skill.parameters == {"sharpness": 2.0}


def test_a_sharpness_is_read_where_the_gate_has_one(resealed):
    def state(meta):
        meta["skill"]["sharpness"] = 7

    assert store.decode(resealed("merged.h5", state)).skill.parameters == {"sharpness": 7.0}
    assert store.decode(resealed("merged-density.h5", state)).skill.parameters == {}  # it did nothing there


def test_what_was_saved_from_python_says_so(resealed):
    def save(meta):
        meta["operation"] = {"command": "merge", "options": {"from_python": True}, "results": {}}

    operation = store.decode(resealed("merged.h5", save)).operation
    assert (operation.command, operation.options) == ("python", {})


def test_results_that_python_left_out_may_be_missing_but_not_wrong(resealed, refuse):
    def without(meta):
        meta["operation"]["results"] = {}

    def wrong(meta):
        meta["operation"]["results"] = {"lyapunov": "guessed"}

    assert store.decode(resealed("merged.h5", without)).operation.results == {}
    refuse(resealed("merged.h5", wrong), "operation.results.lyapunov")


def test_held_out_errors_are_a_whole_in_format_1_too(resealed, refuse):
    def some(meta):
        meta["operation"]["results"] = {"held_out_dtw": 0.5}

    refuse(resealed("seds.h5", some), "operation.results.held_out_demonstrations")


def part_of(meta):
    return meta["skill"]["parts"][0]


@pytest.mark.parametrize(
    ("edit", "cause"),
    [
        (lambda meta: meta["skill"].pop("sharpness"), "sharpness: must be a number of at least 1"),
        (lambda meta: meta["skill"].update(sharpness=0.5), "sharpness: must be a number of at least 1"),
        (lambda meta: meta["skill"].update(sharpness="2"), "sharpness: must be a number of at least 1"),
        (lambda meta: meta["skill"].update(sharpness=True), "sharpness: must be a number of at least 1"),
        (lambda meta: meta["skill"].update(parameters={}), "parameters: not part of format 1"),
        (lambda meta: part_of(meta).update(sharpness=2.0), "sharpness: Extra inputs are not permitted"),
        (
            lambda meta: part_of(meta).update(kind="chain"),
            "kind: format 1 has seds, merged, combined here",
        ),
        (
            lambda meta: meta["skill"].update(kind="chain"),
            "kind: format 1 has seds, merged, combined here",
        ),
        (lambda meta: meta["skill"].update(gate="avoiding"), "gate: format 1 has superposition, density, "),
        (lambda meta: part_of(meta).update(gate="experts"), "skill.gate: format 1 has none here"),
        (lambda meta: meta["state"].update(kind="pose"), "state.kind: format 1 has euclidean"),
        (
            lambda meta: meta["state"].update(kind="pose", characteristic_length=1.0),
            "state.kind: format 1 has euclidean",
        ),
        (
            lambda meta: meta["operation"].update(command="python"),
            "operation.command: format 1 has learn, merge, combine",
        ),
        (lambda meta: meta["operation"].update(command="learn"), "operation.command: learn makes no merged"),
        (lambda meta: meta.update(skill=[]), "skill: "),
        (lambda meta: meta.update(skill={"kind": []}), "skill: "),
        (lambda meta: meta["skill"].update(parts={}), "parts"),
        (lambda meta: meta["skill"].update(parts=[None, 1]), "parts"),
        (lambda meta: meta["skill"].update(gate=1), "gate"),
        (lambda meta: meta.update(state=1), "state: "),
        (lambda meta: meta.update(operation=None), "operation: "),
        (lambda meta: meta.update(format=2), "format: must be 1, as its seal states"),
        (lambda meta: meta.update(format=3), "has skill format 3; this build reads formats 1, 2"),
    ],
)
def test_files_of_format_1_state_nothing_else(resealed, edit, cause):
    with pytest.raises((errors.InvalidArtifactError, errors.TooNewFormatError), match=cause):
        store.decode(resealed("merged.h5", edit))


def test_arrays_of_format_2_are_no_part_of_format_1(reseal, page_digest, refuse):
    with h5py.File(file := BytesIO((ARCHIVE / "merged.h5").read_bytes()), "r+") as body:
        body.create_dataset("coordinates/widths", data=np.ones(2), track_times=False)
    body = file.getvalue()[512:]
    refuse(reseal(body, "merged", page_digest(body, 1), 1), "/coordinates: not part of the format")
