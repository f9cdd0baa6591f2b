"""Regions of a combined skill in a file: only whole, of all parts, and of numbers that form mixtures."""

from io import BytesIO

import h5py
import numpy as np
import pytest

from skillctl import store
from skillctl.model.combined import CombinedSkill

REFUSED = "/regions/part: must number all parts of a combined skill, in order"


def regions(**instead):
    """An edit that gives each of the good skill's two parts a region of one Gaussian and of two."""
    arrays = {
        "priors": np.array([1.0, 0.25, 0.75]),
        "means": np.arange(6.0).reshape(3, 2),
        "covariances": np.stack([np.eye(2)] * 3),
        "part": np.array([0, 1, 1]),
    }

    def edit(body):
        for name, array in {**arrays, **instead}.items():
            if array is not None:
                body.create_dataset(f"regions/{name}", data=array, track_times=False)

    return edit


def test_they_decide_which_part_acts(hostile):
    skill = store.decode(hostile(regions(), honest=True)).skill
    assert isinstance(skill, CombinedSkill)
    assert [region.means.tolist() for region in skill.regions] == [[[0, 1]], [[2, 3], [4, 5]]]
    assert skill.part_at([[0.0, 1.0], [3.0, 4.0]]).tolist() == [0, 1]


@pytest.mark.parametrize(
    ("instead", "cause"),
    [
        ({"part": np.array([0, 0, 0])}, REFUSED),
        ({"part": np.array([1, 0, 1])}, REFUSED),
        ({"part": np.array([0, 1, 2])}, REFUSED),
        ({"part": np.array([-1, 0, 1])}, REFUSED),
        ({"priors": np.array([1.0, 0.25, 0.5])}, "regions: priors: must be positive and sum to one"),
        ({"covariances": np.zeros((3, 2, 2))}, "regions: covariances: must be positive definite"),
        ({"means": None}, "/regions/means: missing"),
        ({"means": np.zeros((3, 3))}, "d is . here and . elsewhere"),
        ({"priors": np.ones(4)}, "R is . here and . elsewhere"),
        ({"means": np.full((3, 2), np.nan)}, "/regions/means: must be finite"),
    ],
)
def test_others_are_refused(refuse, hostile, instead, cause):
    refuse(hostile(regions(**instead)), cause)


def test_a_skill_without_a_combined_one_has_none(refuse, reseal, wrap, make_seds):
    file = BytesIO(store.encode(wrap(make_seds(1))))
    with h5py.File(file, "r+") as body:
        regions()(body)
    refuse(
        reseal(file.getvalue()[512:], "seds"),
        "/regions: there is no combined skill that they could belong to",
    )
