"""Golden motions in a file: kept as they are, no part of the identity, and checked like everything else."""

from dataclasses import replace

import numpy as np
import pytest

from skillctl import store


def test_they_are_read_as_they_were_written_and_written_again(nested):
    data = store.encode(nested)
    there = store.decode(data)
    assert (there.golden.times == nested.golden.times).all()
    assert (there.golden.states == nested.golden.states).all()
    assert store.encode(there) == data


def test_they_are_no_part_of_the_identity(nested):
    without = replace(nested, golden=None)
    data, bare = store.encode(nested), store.encode(without)
    assert data != bare
    assert store.decode(data).digest == store.decode(bare).digest == nested.digest == without.digest
    assert store.digest_of(data) == store.digest_of(bare)
    assert store.decode(bare).golden is None


@pytest.mark.parametrize(
    ("path", "values", "said"),
    [
        ("golden/times", [0.0, 1.0, 3.0, 4.0, 5.0], "golden times: must rise from zero in equal steps"),
        ("golden/times", [0.0, 1.0], "T is"),
        ("golden/states", np.zeros((2, 5, 3)), "d is"),
        ("golden/states", np.zeros((65, 5, 2)), "G = 65 is not within 1 to 64"),
        ("golden/states", None, "golden"),
    ],
)
def test_what_is_no_motion_is_refused(hostile, refuse, path, values, said):
    def edit(body):
        del body[path]
        if values is not None:
            body.create_dataset(path, data=np.asarray(values, dtype="<f8"), track_times=False)

    refuse(hostile(edit), said)
