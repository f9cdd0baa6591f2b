"""Learned coordinates in a file: what a writer puts there, and what a reader refuses."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from skillctl import store
from skillctl.errors import InvalidModelError
from skillctl.model.combined import CombinedSkill
from skillctl.model.coordinates.chain import IDENTITY, Chain, Link


def coordinates(**instead):
    """An edit that adds two learned shears of three bumps each; the good skill has four leaves in 2-D."""
    arrays = {
        "linear": np.stack([np.eye(2)] * 4),
        "directions": np.eye(2),
        "firsts": np.zeros(2),
        "spacings": np.ones(2),
        "coefficients": np.zeros((2, 3, 2)),
        "leaf": np.zeros(2, dtype=np.int64),
    }

    def edit(body):
        for name, array in {**arrays, **instead}.items():
            if array is not None:
                body.create_dataset(f"coordinates/{name}", data=array, track_times=False)

    return edit


def test_leaves_with_fewer_bumps_get_empty_ones_more(wrap, make_seds, make_bent):
    few, many = make_bent(make_seds(1), bumps=3), make_bent(make_seds(2), bumps=7)
    plain = make_seds(3)
    combined = CombinedSkill((few, plain, many), np.array([0.3, 0.3, 0.4]))
    read = store.decode(store.encode(wrap(combined))).skill
    assert [leaf.coordinates for leaf in read.leaves[1:]] == [IDENTITY, many.coordinates]
    states = np.random.default_rng(0).normal(0, 2, (50, 2))
    for part, number in [(few, 0), (plain, 1), (many, 2)]:
        assert (read.parts[number].velocity(states) == part.velocity(states)).all()


def test_only_shears_can_be_stored(wrap, make_seds):
    @dataclass(frozen=True)
    class Doubled(Link):
        def forward(self, offsets):
            return 2 * offsets

        def back(self, coordinates):
            return coordinates / 2

        def tangent(self, offsets):
            return 2 * offsets, lambda velocities: velocities / 2

        def in_unit(self, unit):
            return self

        def check(self):
            return ()

    skill = replace(make_seds(1), coordinates=Chain((Doubled(),)))
    with pytest.raises(InvalidModelError, match="only those of learned shears"):
        store.encode(wrap(skill))


def test_a_digest_speaks_of_the_coordinates_too(hostile):
    plain, other = (
        store.digest_of(hostile(edit, honest=True)) for edit in (lambda body: None, coordinates())
    )
    assert plain != other


@pytest.mark.parametrize(
    ("instead", "cause"),
    [
        ({"linear": np.stack([np.eye(2)] * 3)}, "/model/.*: L is 4 here and 3 elsewhere"),
        ({"directions": np.eye(3)}, "(c|S) is . here and . elsewhere"),
        ({"spacings": np.ones(3)}, "S is . here and . elsewhere"),
        ({"coefficients": np.zeros((2, 65, 2))}, "J = 65 is not within 1 to 64"),
        ({"leaf": np.zeros(2)}, "elements must be <i8"),
        ({"spacings": None}, "/coordinates/spacings: missing"),
        ({"bias": np.ones(2)}, "/coordinates/bias: not part of the format"),
        ({"spacings": np.array([1, np.nan])}, "must be finite"),
        ({"leaf": np.array([0, 4])}, "/coordinates/leaf: must be leaf numbers below 4, in order"),
        ({"leaf": np.array([1, 0])}, "in order"),
        ({"linear": np.stack([np.eye(2), 2 * np.eye(2), *[np.eye(2)] * 2])}, "leaf 1 has no shears"),
        ({"linear": np.stack([np.diag([1.0, 0]), *[np.eye(2)] * 3])}, "upper triangular with a positive"),
        ({"linear": np.stack([np.array([[1.0, 0], [1, 1]]), *[np.eye(2)] * 3])}, "upper triangular with a"),
        ({"directions": np.array([[1.0, 0], [0, 0]])}, "no direction may be zero"),
        ({"spacings": np.array([1.0, 0])}, "spacings must be positive"),
        ({"spacings": np.array([1.0, -1])}, "spacings must be positive"),
        ({"coefficients": np.full((2, 3, 2), 1e60)}, "stretches by more than 1e\\+100"),
        ({"coefficients": np.full((2, 3, 2), 1e300)}, "stretches by more than 1e\\+100"),
        ({"spacings": np.array([1.0, 1e-200])}, "stretches by more than 1e\\+100"),
        ({"firsts": np.array([0, 1e200])}, "stretches by more than 1e\\+100"),
    ],
)
def test_what_is_no_invertible_map_is_refused(refuse, hostile, instead, cause):
    refuse(hostile(coordinates(**instead)), cause)
