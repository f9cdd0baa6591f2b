"""Copies and pickles of skills: what travels to a worker is as immutable, and as consistent, as what left."""

import copy
import pickle
from collections.abc import Mapping
from dataclasses import replace
from types import FunctionType

import numpy as np
import pytest

from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.controller import Controller
from skillctl.model.coordinates.bodies import Ball
from skillctl.model.coordinates.chain import Chain
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.kept_out import kept_out
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


def kinds_of(make_skill, make_pose_skill, make_shears):
    """Return a skill of every kind, by name."""
    rng = np.random.default_rng(8)
    plain, other = (make_skill(rng, attractor=[0.0, 0.0]) for _ in range(2))
    space = make_skill(rng, dimension=3, spread=0.02)
    pose = make_pose_skill(rng)
    ball = Ball("ball", (-0.1, 0.3, 0.0), 0.05)
    near = Ball("near", (0.4, 0.3, 0.3), 0.05)
    return {
        "seds": plain,
        "sheared": replace(plain, coordinates=Chain((make_shears(rng, 2),))),
        "pose": pose,
        "sheared pose": make_pose_skill(rng, bent=True),
        "merged": MergedSkill((plain, other), [0.4, 0.6], "density"),
        "combined": CombinedSkill((plain, other), [0.5, 0.5]),
        "kept out": kept_out(space, [ball], margin=0.01),
        "pose kept out": kept_out(pose, [near], margin=0.01),
        "chain": ChainedSkill((plain, other), [1e-3, 1e-3], [("close", "wait 0.1"), ("open",)]),
    }


KINDS = [
    "seds",
    "sheared",
    "pose",
    "sheared pose",
    "merged",
    "combined",
    "kept out",
    "pose kept out",
    "chain",
]


@pytest.fixture
def skill(request, make_skill, make_pose_skill, make_shears):
    return kinds_of(make_skill, make_pose_skill, make_shears)[request.param]


def arrays_of(value, path="skill", seen=None):
    """Yield every array that can be reached from a value by public attributes, with the way to it."""
    seen = set() if seen is None else seen
    if id(value) in seen or isinstance(value, str | bytes | int | float | type | FunctionType):
        return
    seen.add(id(value))
    if isinstance(value, np.ndarray):
        yield path, value
    elif isinstance(value, Mapping):
        for key, each in value.items():
            yield from arrays_of(each, f"{path}[{key!r}]", seen)
    elif isinstance(value, tuple | list | set | frozenset):
        for number, each in enumerate(value):
            yield from arrays_of(each, f"{path}[{number}]", seen)
    elif type(value).__module__.startswith("skillctl"):
        slots = {name for kind in type(value).__mro__ for name in getattr(kind, "__slots__", ())}
        for name in slots | set(getattr(value, "__dict__", ())):
            if not name.startswith("_") and hasattr(value, name):
                yield from arrays_of(getattr(value, name), f"{path}.{name}", seen)


@pytest.mark.parametrize("way", WAYS, ids=["pickle", "deepcopy", "copy"])
@pytest.mark.parametrize("skill", KINDS, indirect=True)
def test_nothing_in_a_skill_of_any_kind_or_its_copy_can_be_changed(skill, way):
    x = np.asarray(skill.attractors[0]) + np.random.default_rng(9).normal(size=(20, skill.dimension))
    for part in range(len(skill.acting_parts)):
        before = skill.velocity(x, part)
        copied = way(skill)
        assert type(copied) is type(skill)
        assert copied.velocity(x, part).tobytes() == before.tobytes()
    assert certify(copied) == certify(skill)
    found = dict(arrays_of(skill))
    assert len(found) > 8  # priors, means, covariances, matrices, … of one leaf at least
    assert dict(arrays_of(copied)).keys() == found.keys()
    writeable = [where for where, array in (*found.items(), *arrays_of(copied)) if array.flags.writeable]
    assert writeable == [], writeable


@pytest.mark.parametrize("way", WAYS, ids=["pickle", "deepcopy", "copy"])
@pytest.mark.parametrize("skill", KINDS, indirect=True)
def test_a_copy_of_a_controller_goes_on_alike_and_by_itself(skill, way):
    """A copy is taken on the way; whatever either does after that, the other does not know."""
    start = np.asarray(skill.attractors[0]) + 0.2 / np.sqrt(skill.dimension)

    def driven(controller, state, steps, busy):
        for _ in range(steps):
            command = controller.step(state, busy=busy)
            yield command.tobytes(), controller.part, controller.stage, controller.event, controller.done
            state = skill.space.displace(state, controller.period * command)

    ours = Controller(skill, 0.01, allow_unproved=True)
    assert len(list(driven(ours, start, 5, False))) == 5
    here = ours.next
    memory = ours.state()
    theirs = way(ours)
    assert theirs.state() == memory
    forward = list(driven(theirs, here, 400, True))  # one waits for an event that goes on and on
    assert ours.state() == memory
    assert list(driven(way(ours), here, 400, True)) == forward
    theirs.reset()
    assert list(driven(ours, here, 400, True)) == forward
