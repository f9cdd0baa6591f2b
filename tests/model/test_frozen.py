"""Copies and pickles of skills: what travels to a worker is as immutable, and as consistent, as what left."""

import copy
import pickle

import numpy as np
import pytest

from skillctl.model.combined import CombinedSkill
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.merged import MergedSkill
from skillctl.model.space import Euclidean
from skillctl.stability.certificate import certify

WAYS = [lambda value: pickle.loads(pickle.dumps(value)), copy.deepcopy, copy.copy]


@pytest.fixture
def tree(make_skill):
    rng = np.random.default_rng(6)
    parts = tuple(make_skill(rng, attractor=[0.0, 0.0]) for _ in range(3))
    merged = MergedSkill(parts[:2], [0.4, 0.6], "experts", parameters={"sharpness": 3.0})
    return CombinedSkill((merged, parts[2]), [0.5, 0.5])


@pytest.mark.parametrize("way", WAYS, ids=["pickle", "deepcopy", "copy"])
def test_a_copy_of_a_skill_moves_alike_and_cannot_be_changed(tree, way):
    copied = way(tree)
    x = np.random.default_rng(7).normal(size=(20, 2))
    assert (copied.velocity(x) == tree.velocity(x)).all()
    assert certify(copied) == certify(tree)
    assert dict(copied.parts[0].parameters) == {"sharpness": 3.0}
    for leaf in copied.leaves:
        for array in (leaf.system_matrices, leaf.means, leaf.attractor, leaf.lyapunov, leaf.form.matrix):
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0
        with pytest.raises(ValueError, match="read-only"):
            leaf.density.means[...] = 0
    with pytest.raises(ValueError, match="read-only"):
        copied.part_priors[...] = 0


@pytest.mark.parametrize("way", WAYS, ids=["pickle", "deepcopy", "copy"])
def test_a_copy_of_demonstrations_cannot_be_changed(way):
    motion = Demonstration.from_positions([0.0, 1.0, 2.0], [[0.0], [1.0], [3.0]], "a.csv")
    (copied,) = way(DemonstrationSet((motion,), Euclidean(("x",))))
    assert copied.source == "a.csv"
    for name in ("times", "positions", "velocities"):
        assert (getattr(copied, name) == getattr(motion, name)).all()
        with pytest.raises(ValueError, match="read-only"):
            getattr(copied, name)[...] = 0
