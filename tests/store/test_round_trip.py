"""What was written is what is read, bit for bit."""

import json
import shutil
import subprocess
from io import BytesIO

import h5py
import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skillctl import store
from skillctl.errors import InvalidModelError, StoreError
from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.merged import MergedSkill
from skillctl.model.seds import SedsSkill
from skillctl.model.space import Euclidean

LEAF_ARRAYS = (
    "priors",
    "means",
    "covariances",
    "system_matrices",
    "residual_covariances",
    "attractor",
    "lyapunov",
)


def exact(skill):
    """The whole of a skill as nested tuples of bytes and numbers: equal if and only if bit-identical."""
    if isinstance(skill, SedsSkill):
        density = skill.density
        arrays = [getattr(skill, name) for name in LEAF_ARRAYS]
        arrays += [density.priors, density.means, density.covariances]
        return ("seds", skill.speed.hex(), skill.space, *((a.shape, a.tobytes()) for a in arrays))
    parts = tuple(exact(part) for part in skill.parts)
    if isinstance(skill, MergedSkill):
        numbers = (
            skill.part_weights.tobytes(),
            skill.gate,
            sorted(skill.parameters.items()),
            skill.speed.hex(),
        )
        return ("merged", parts, *numbers)
    if isinstance(skill, ChainedSkill):
        jumps = skill.on_jump, skill.disturbance_distance.hex()
        return ("chain", parts, skill.levels.tobytes(), skill.events, *jumps)
    numbers = (skill.part_priors.tobytes(), skill.gate, skill.disturbance_distance.hex(), skill.speed.hex())
    regions = [a.tobytes() for r in skill.regions for a in (r.priors, r.means, r.covariances)]
    return ("combined", parts, *numbers, regions)


def exact_demonstrations(artifact):
    return [
        None
        if taught is None
        else [(d.times.tobytes(), d.positions.tobytes(), d.velocities.tobytes(), d.source) for d in taught]
        for taught in artifact.demonstrations
    ]


def test_reading_gives_back_what_was_written(artifact):
    read = store.decode(store.encode(artifact))

    assert exact(read.skill) == exact(artifact.skill)
    assert exact_demonstrations(read) == exact_demonstrations(artifact)
    assert read.operation == artifact.operation
    assert read.reports == artifact.reports
    assert read.provenance == artifact.provenance
    assert read.digest == artifact.digest


def test_writing_what_was_read_gives_the_same_bytes(artifact):
    data = store.encode(artifact)
    assert store.encode(store.decode(data)) == data


positive = st.floats(1e-3, 1e3)
happens = st.sampled_from(["close", "open", "wait 0.5", "wait 12", "a-b_c"])
shares = st.lists(positive, min_size=1, max_size=3).map(lambda w: np.array(w) / np.sum(w))


@st.composite
def skill_trees(draw, make_seds):
    """Any tree: every kind, gate and depth, matrices of any finite numbers, weights of any digits."""
    d = draw(st.integers(1, 4))

    def leaf():
        k, m = draw(st.integers(1, 3)), draw(st.integers(1, 3))
        made = make_seds(draw(st.integers(0, 99)), d, k, m, speed=draw(positive))
        # Four speeds of 1e-3 to 1e3 may multiply a matrix; beyond 1e-100 … 1e100 a skill is refused.
        sizes = st.floats(1e-88, 1e88) | st.floats(-1e88, -1e-88) | st.just(0.0)
        any_matrices = draw(hnp.arrays(float, (k, d, d), elements=sizes))
        fields = {name: getattr(made, name) for name in LEAF_ARRAYS} | {"system_matrices": any_matrices}
        return SedsSkill(**fields, density=made.density, space=made.space, speed=made.speed)

    def part(depth):
        if depth == 0 or draw(st.booleans()):
            return leaf()
        weights = draw(shares)
        parts = tuple(part(depth - 1) for _ in weights)
        gate = draw(st.sampled_from(["superposition", "density", "experts"]))
        parameters = {"sharpness": draw(st.floats(1, 9))} if gate == "experts" else {}
        return MergedSkill(parts, weights, gate, draw(positive), parameters)

    def combined(gate):
        priors = draw(shares)
        parts = tuple(part(2) for _ in priors)
        return CombinedSkill(parts, priors, gate, draw(positive), draw(positive))

    kind = draw(st.sampled_from(["part", "combined", "chain"]))
    if kind == "part":
        return part(2)
    if kind == "combined":
        return combined(draw(st.sampled_from(["latched", "instantaneous"])))
    levels = draw(st.lists(positive, min_size=1, max_size=3))
    stages = tuple(combined("latched") if draw(st.booleans()) else part(2) for _ in levels)
    events = tuple(tuple(draw(st.lists(happens, max_size=3))) for _ in levels)
    return ChainedSkill(
        stages, np.array(levels), events, draw(st.sampled_from(["stay", "back"])), draw(positive)
    )


@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_every_tree_survives(data, make_seds, wrap):
    artifact = wrap(data.draw(skill_trees(make_seds)))
    encoded = store.encode(artifact)
    read = store.decode(encoded)
    assert exact(read.skill) == exact(artifact.skill)
    assert store.encode(read) == encoded


def test_leaves_may_keep_no_demonstrations(make_seds, wrap):
    skill = MergedSkill((make_seds(1), make_seds(2), make_seds(3)), np.full(3, 1 / 3))

    none, middle = wrap(skill, without=(0, 1, 2)), wrap(skill, without=(0, 2))

    assert store.decode(store.encode(none)).demonstrations == (None, None, None)
    assert exact_demonstrations(store.decode(store.encode(middle))) == exact_demonstrations(middle)
    with h5py.File(BytesIO(store.encode(none))) as body:
        assert "demonstrations" not in body


def test_the_digest_is_over_path_type_shape_and_bytes_of_every_array(good, page_digest):
    assert store.decode(good).digest == page_digest(good[512:]) == store.digest_of(good)


def test_the_digest_does_not_depend_on_the_layout_in_the_file(nested, hostile):
    def rewrite(body):  # the same array, written elsewhere in the file
        values = body["model/means"][()]
        del body["model/means"]
        body.create_dataset("model/means", data=values, track_times=False)

    moved = hostile(rewrite, honest=True)
    assert moved != store.encode(nested)
    assert store.decode(moved).digest == nested.digest


def test_every_part_of_the_content_changes_the_digest(make_seds, wrap):
    def digest(**changes):
        base = wrap(make_seds(1))
        fields = {name: getattr(base, name) for name in ("skill", "demonstrations", "operation")}
        fields |= {"provenance": base.provenance, "reports": base.reports}
        return store.Artifact(**(fields | changes)).digest

    digests = {
        digest(),
        digest(demonstrations=(None,)),
        digest(reports=()),
        digest(operation=store.Operation(command="learn")),
        digest(provenance=store.Provenance(tool="0.1.0")),
        digest(skill=make_seds(1, speed=1.0000000000000002)),
    }
    assert len(digests) == 6


def test_the_file_is_a_seal_before_an_hdf5_body_with_one_attribute(good, reseal, nested):
    assert reseal(good[512:], "combined", nested.digest) == good
    with h5py.File(BytesIO(good)) as body:
        assert dict(body.attrs) == {"format": b"skill-v2"}
        every = [body]
        body.visititems(lambda _, item: every.append(item))
        assert all(not item.attrs for item in every[1:])
        text = body["meta.json"][()].tobytes()
    assert text == json.dumps(json.loads(text), sort_keys=True, separators=(",", ":")).encode()


def test_no_demonstration_says_more_than_printable_text(make_seds, wrap):
    from dataclasses import replace

    artifact = wrap(make_seds(1))
    odd = tuple(replace(d, source=f"\x1b[31m\u202e{'x' * 300}.csv#1") for d in artifact.demonstrations[0])
    sets = (replace(artifact.demonstrations[0], demonstrations=odd),)
    read = store.decode(store.encode(replace(artifact, demonstrations=sets, reports=())))
    sources = [d.source for d in read.demonstrations[0]]
    assert all(s.isprintable() and len(s) == 200 and s.endswith("x.csv#1") for s in sources)


def test_a_state_space_that_cannot_be_written_is_refused(make_seds, wrap):
    from dataclasses import replace

    skill = replace(make_seds(1), space=Euclidean(("x", "y\n")))
    with pytest.raises(InvalidModelError, match=r"state\.euclidean\.names\.1: .* control characters"):
        store.encode(wrap(skill))


def test_a_skill_that_no_reader_would_take_is_not_written(make_seds, wrap):
    with pytest.raises(StoreError, match=r"too large.*take [0-9]+ bytes, and 65536 fit"):
        store.encode(
            store.Artifact(
                make_seds(1),
                (None,),
                store.Operation(command="learn", results={f"fact_{i}": "x" * 200 for i in range(400)}),
                wrap(make_seds(1)).provenance,
            )
        )


@pytest.mark.parametrize(
    ("sets", "reports", "cause"),
    [
        (0, (), "0 sets for a skill of 1 leaves"),
        (2, (), "2 sets for a skill of 1 leaves"),
        (1, (store.DemonstrationReport(source="a", leaf=1, n_points=2, duration=1.0),), "no leaf 1"),
    ],
)
def test_an_artifact_is_consistent_from_the_start(make_seds, wrap, sets, reports, cause):
    base = wrap(make_seds(1))
    with pytest.raises(InvalidModelError, match=cause):
        store.Artifact(base.skill, base.demonstrations * sets, base.operation, base.provenance, reports)


def test_h5dump_reads_every_artifact(artifact, tmp_path):
    if shutil.which("h5dump") is None:
        pytest.skip("h5dump (package hdf5-tools) is not installed")
    (path := tmp_path / "skill.h5").write_bytes(store.encode(artifact))
    shown = subprocess.run(["h5dump", "-H", str(path)], capture_output=True, text=True, check=True).stdout
    assert shown.count("DATASET") == 15
