"""Files that are sealed again with other links, objects, names and attributes than the format has."""

import h5py
import numpy as np
import pytest
from h5py import h5a, h5d, h5g, h5s, h5t

MEANS = "model/means"


def external_link(body):
    del body[MEANS]
    body[MEANS] = h5py.ExternalLink("/etc/passwd", "/")


def soft_link(body):
    del body[MEANS]
    body[MEANS] = h5py.SoftLink("/model/priors")


def dangling_soft_group(body):
    del body["model"]
    body["model"] = h5py.SoftLink("/nowhere")


def same_object_twice(body):
    del body["model/covariances"]
    body["model/covariances"] = body["model/system_matrices"]


def cycle_to_the_root(body):
    del body["demonstrations"]
    body["demonstrations"] = body["/"]


def group_in_place_of_dataset(body):
    del body[MEANS]
    body.create_group(MEANS)


def dataset_in_place_of_group(body):
    del body["model"]
    body["model"] = np.zeros(3)


def named_type(body):
    del body[MEANS]
    body[MEANS] = np.dtype("<f8")


def committed_type(body):
    values = body[MEANS][()]
    del body[MEANS]
    kind = h5t.IEEE_F64LE.copy()
    kind.commit(body.id, b"hidden")
    made = h5d.create(body.id, MEANS.encode(), kind, h5s.create_simple(values.shape))
    made.write(h5s.ALL, h5s.ALL, values)
    del body["hidden"]


@pytest.mark.parametrize(
    ("edit", "cause"),
    [
        (external_link, "/model/means: a soft, external or user-defined link"),
        (soft_link, "/model/means: a soft, external or user-defined link"),
        (dangling_soft_group, "/model: a soft, external or user-defined link"),
        (same_object_twice, "/model/system_matrices: the same object as another member"),
        (cycle_to_the_root, "/demonstrations: the same object as another member"),
        (group_in_place_of_dataset, "/model/means: must be a dataset"),
        (dataset_in_place_of_group, "/model: must be a group"),
        (named_type, "/model/means: must be a dataset"),
        (committed_type, "/model/means: elements must be <f8"),
    ],
)
def test_links_and_objects(refuse, hostile, edit, cause):
    refuse(hostile(edit), cause)


def test_a_user_defined_link(refuse, hostile, reseal):
    def edit(body):
        del body["demonstrations/times"]
        body["demonstrations/times"] = h5py.ExternalLink("elsewhere.h5", "/")

    external, user_defined = b"\x40\x05times", b"\x41\x05times"  # type of the link, length of its name, name
    body = hostile(edit)[512:]
    assert body.count(external) == 1
    refuse(reseal(body.replace(external, user_defined)), "/demonstrations/times: .* user-defined link")


def test_a_thousand_datasets_are_refused_unread(refuse, hostile):
    def edit(body):
        for index in range(1000):
            h5d.create(body.id, b"d%d" % index, h5t.IEEE_F64LE, h5s.create_simple((2**21,)))

    refuse(hostile(edit), "/: 1004 members; the format has 6")


def many_groups(body):
    group = body.id
    for _ in range(10_000):
        group = h5g.create(group, b"g")


def many_members(body):
    crowd = h5g.create(body["demonstrations"].id, b"crowd")
    for index in range(50_000):
        crowd.links.create_hard(b"%05d" % index, body.id, b"meta.json")
    body.id.links.move(b"model", crowd, b"model")
    body.id.links.move(b"demonstrations/crowd", body.id, b"model")


def many_attributes(body):
    body.id.unlink(b"model")
    group = h5g.create(body.id, b"model")
    space = h5s.create(h5s.SCALAR)
    for index in range(20_000):
        h5a.create(group, b"%05d" % index, h5t.STD_U8LE, space)


@pytest.mark.parametrize(
    ("edit", "options", "cause"),
    [
        (many_groups, {}, "/g: not part of the format"),
        (many_members, {}, "/model/: 50001 members; the format has 10"),
        (many_attributes, {"libver": "latest"}, "/model: must not have attributes"),
    ],
)
def test_amounts(refuse, hostile, edit, options, cause):
    refuse(hostile(edit, **options), cause)


@pytest.mark.parametrize("name", [
    b"..", b".hidden", b"\x1b[2J", b"line\nbreak", "\u202egnp.h5".encode(), b"x" * 60_000, b"\xff\xfe",
    b"MEANS", b"Means", "m\u00e9ans".encode(), b"means ",
], ids=repr)  # fmt: skip
@pytest.mark.parametrize("place", ["", "model/", "demonstrations/"])
def test_names(refuse, hostile, place, name):
    def edit(body):  # in place of a member, so that numbers agree
        group = body[place or "/"]
        old = {"": "meta.json", "model/": "means", "demonstrations/": "times"}[place]
        group.id.links.move(old.encode(), group.id, name)

    refuse(hostile(edit, libver="latest"), "not part of the format|HDF5 cannot read it")


@pytest.mark.parametrize("path", ["meta.json", "model", "model/density_priors", "demonstrations/times"])
def test_missing_members(refuse, hostile, path):
    def edit(body):
        del body[path]

    refuse(hostile(edit), "missing|of the format|the format has")


def test_missing_demonstrations_are_noticed_in_the_metadata(refuse, hostile):
    def edit(body):
        del body["demonstrations"]

    refuse(hostile(edit), "demonstrations: the file holds none")


@pytest.mark.parametrize("path", ["/", "model", MEANS, "meta.json"])
def test_attributes(refuse, hostile, path):
    def edit(body):
        body[path].attrs["note"] = 1

    refuse(hostile(edit), "attribute")
