"""Skills of poses in a file: what a writer puts there, and what a reader refuses."""

import json
from dataclasses import replace
from io import BytesIO

import h5py
import numpy as np
import pytest

from skillctl import store
from skillctl.errors import InvalidModelError
from skillctl.model.coordinates.chain import Chain, OnPosition
from skillctl.model.seds import SedsSkill

PI = np.pi


@pytest.fixture(scope="module")
def pose(wrap, make_bent_pose):
    """The artifact of a learned skill of poses, with shears and demonstrations."""
    return wrap(make_bent_pose(1))


@pytest.fixture(scope="module")
def changed(pose, reseal):
    """Edit the body of that artifact with h5py, or its metadata, and seal it again."""
    data = store.encode(pose)

    def edit_and_seal(edit=lambda body: None, **state):
        file = BytesIO(data)
        with h5py.File(file, "r+") as body:
            meta = json.loads(body["meta.json"][()].tobytes())
            meta["state"].update(state)
            del body["meta.json"]
            text = np.frombuffer(json.dumps(meta).encode(), np.uint8)
            body.create_dataset("meta.json", data=text, track_times=False)
            edit(body)
        return reseal(file.getvalue()[512:], "seds")

    return edit_and_seal


def setting(path, index, value):
    def edit(body):
        body[path][index] = value

    return edit


def replacing(path, array):
    def edit(body):
        del body[path]
        body.create_dataset(path, data=array, track_times=False)

    return edit


def test_a_file_states_what_its_numbers_mean(pose):
    with h5py.File(BytesIO(store.encode(pose))) as body:
        state = json.loads(body["meta.json"][()].tobytes())["state"]
        shapes = {
            name: body[f"coordinates/{name}"].shape for name in ("linear", "directions", "coefficients")
        }
        attractors = body["model/attractors"][()]
    names = ["x", "y", "z", "rx", "ry", "rz"]
    assert state == {
        "names": names, "unit": "m", "frame": "base", "kind": "pose", "characteristic_length": 0.25,
    }  # fmt: skip
    assert shapes == {"linear": (1, 3, 3), "directions": (3, 3), "coefficients": (3, 5, 3)}
    assert attractors.tolist() == [pose.skill.attractor.tolist()]


def test_what_is_read_moves_as_what_was_written(pose):
    read = store.decode(store.encode(pose)).skill
    assert isinstance(read, SedsSkill)
    states = np.random.default_rng(0).normal(0, 1, (50, 6))
    assert (read.velocity(states) == pose.skill.velocity(states)).all()
    assert read.coordinates == pose.skill.coordinates
    assert read.coordinates.links  # positions are bent, and nothing else
    assert (read.lifted(states)[:, 3:] == replace(read, coordinates=Chain()).lifted(states)[:, 3:]).all()


def test_rotation_vectors_of_demonstrations_do_not_jump(wrap, make_pose):
    """Through half a turn and on: 2 to 5 rad about one axis, which are not 2 to π and then −π to −1.3."""
    motions = wrap(make_pose(1)).demonstrations[0]
    (first, *_) = motions
    times = np.linspace(0, 1, 31)
    states = np.zeros((31, 6))
    states[:, 0], states[:, 5] = times, np.linspace(2, 5, 31)
    turning = replace(first, times=times, positions=states, velocities=np.zeros_like(states))
    artifact = replace(wrap(make_pose(1)), demonstrations=(replace(motions, demonstrations=(turning,)),))
    (read,) = store.decode(store.encode(replace(artifact, reports=()))).demonstrations[0]
    assert (read.positions == states).all()
    assert np.allclose(read.velocities[:, 5], 3.0, rtol=1e-12)  # [rad/s]: differences of rounded angles


@pytest.mark.parametrize("length", [0, -1, "1", None])
def test_a_pose_has_a_characteristic_length(refuse, changed, with_meta, meta, length):
    refuse(changed(characteristic_length=length), "state.pose.characteristic_length")
    euclidean = {**meta, "state": {**meta["state"], "characteristic_length": 1.0}}
    refuse(with_meta(json.dumps(euclidean).encode()), "Extra inputs are not permitted")


@pytest.mark.parametrize(
    ("state", "cause"),
    [
        ({"unit": "rad"}, "state.pose.unit"),
        ({"names": ["x", "y", "z"]}, "state.pose.names"),
        ({"names": ["x", "y", "z", "rx", "ry", "ry"]}, "expected 6 different names"),
        ({"names": list("abcdefg")}, "state.pose.names"),
        ({"kind": "euclidean"}, "Extra inputs are not permitted"),
    ],
)
def test_metadata_of_poses(refuse, changed, state, cause):
    refuse(changed(**state), cause)


def test_poses_have_six_numbers(refuse, with_meta, meta):
    names = ["x", "y", "z", "rx", "ry", "rz"]
    state = {**meta["state"], "names": names, "kind": "pose", "characteristic_length": 1.0}
    refuse(with_meta(json.dumps({**meta, "state": state}).encode()), "/model/means: d is 2, but a pose has 6")


@pytest.mark.parametrize(
    ("edit", "cause"),
    [
        (setting("model/attractors", (0, 3), np.nan), "/model/attractors: must be finite"),
        (
            setting("model/attractors", (0, slice(3, 6)), [0, 0, np.nextafter(PI, 4) * (1 + 2.0**-50)]),
            "half a",
        ),
        (setting("model/attractors", (0, slice(3, 6)), [1e200, 1e200, 0]), "longer than half a turn"),
        (setting("demonstrations/positions", (0, 5), np.inf), "/demonstrations/positions: must be finite"),
        (setting("demonstrations/positions", (0, 5), 1e300), "must be finite"),
        (
            replacing("coordinates/linear", np.eye(6)[None]),
            "/coordinates/linear: c is 6 here and 3 elsewhere",
        ),
    ],
)
def test_what_holds_no_poses_is_refused(refuse, changed, edit, cause):
    refuse(changed(edit), cause)


def test_shears_of_all_six_numbers_are_refused(refuse, changed):
    def edit(body):
        for name in ("linear", "directions", "coefficients"):
            old = body[f"coordinates/{name}"][()]
            padding = [(0, 0)] * (old.ndim - 1) + [(0, 3)]
            wide = np.eye(6)[None] if name == "linear" else np.pad(old, padding)
            replacing(f"coordinates/{name}", wide)(body)

    refuse(changed(edit), "/coordinates/linear: c is 6, but a position has 3 coordinates")


@pytest.mark.parametrize("turn", [[PI, 0, 0], [0, -PI, 0], [PI / np.sqrt(2), 0, PI / np.sqrt(2)]])
def test_a_target_turned_by_half_a_turn_is_stored(wrap, make_pose, turn):
    skill = make_pose(1, target=(0, 0, 0, *turn))
    assert store.decode(store.encode(wrap(skill))).skill.attractors.tolist() == [[0, 0, 0, *turn]]


def test_what_could_not_be_read_is_not_written(wrap, make_pose):
    with pytest.raises(InvalidModelError, match=r"stored: /model/attractors: a rotation vector is longer"):
        store.encode(wrap(make_pose(1, target=(0, 0, 0, 4, 0, 0))))


def test_shears_that_bend_the_orientation_cannot_be_stored(wrap, make_pose, make_bent, make_seds):
    six = make_bent(make_seds(1, d=6)).coordinates
    three = make_bent(make_seds(1, d=3)).coordinates.links[0]
    wrapped = make_bent(make_seds(1, d=2)).coordinates.links[0]
    for skill, coordinates in [
        (make_pose(1), six),
        (make_seds(1, d=3), Chain((OnPosition(three),))),
        (make_pose(1), Chain((OnPosition(wrapped, 2),))),
    ]:
        with pytest.raises(InvalidModelError, match="only those of learned shears"):
            store.encode(wrap(replace(skill, coordinates=coordinates)))
