"""Merged and combined skills: what the tree adds to its leaves."""

from dataclasses import replace

import numpy as np
import pytest

from skillctl.errors import InvalidModelError, UsageError
from skillctl.model.combined import CombinedSkill
from skillctl.model.gates import MERGE_GATES as RECORDS
from skillctl.model.merged import MergedSkill
from skillctl.model.mixture import GaussianMixture
from skillctl.model.retarget import retargeted
from skillctl.model.space import Euclidean

EPS = np.finfo(float).eps
MERGE_GATES = [gate.name for gate in RECORDS]
RELATIVE = 1e5 * EPS  # logits of a few thousand, right to a few ulps, decide weights


@pytest.fixture
def parts(make_skill):
    rng = np.random.default_rng(11)
    return tuple(make_skill(rng, n_components=k, attractor=[0.1, 0.2]) for k in (2, 3, 4))


@pytest.fixture
def states():
    return np.random.default_rng(12).normal(0, 0.3, (60, 2))


def sharp(gate, sharpness):
    """The parameters of a gate, as sharp as given if it has a sharpness."""
    return {"sharpness": sharpness} if gate == "experts" else {}


def close(one, other, states):
    size = np.linalg.norm(np.concatenate([one.component_matrices]), 2, axis=(1, 2)).max()
    reach = np.abs(states).max() + 1
    return np.abs(one.velocity(states) - other.velocity(states)).max() <= RELATIVE * size * reach


@pytest.mark.parametrize("gate", MERGE_GATES)
def test_a_merge_of_one_skill_is_that_skill(parts, states, gate):
    # γ = 1: with γ > 1 the experts gate sharpens within a part, too
    assert close(MergedSkill((parts[0],), [1.0], gate, parameters=sharp(gate, 1.0)), parts[0], states)


@pytest.mark.parametrize("gate", MERGE_GATES)
def test_merging_a_skill_with_itself_changes_nothing(parts, states, gate):
    twice = MergedSkill((parts[1], parts[1]), [0.25, 0.75], gate, parameters=sharp(gate, 1.0))
    assert close(twice, parts[1], states)


@pytest.mark.parametrize("gate", MERGE_GATES)
def test_the_order_of_the_parts_does_not_matter(parts, states, gate):
    weights = np.array([0.2, 0.3, 0.5])
    order = [2, 0, 1]
    merged = MergedSkill(parts, weights, gate, parameters=sharp(gate, 2.0))
    permuted = MergedSkill(tuple(parts[i] for i in order), weights[order], gate, parameters=sharp(gate, 2.0))
    assert close(merged, permuted, states)


@pytest.mark.parametrize("gate", MERGE_GATES)
@pytest.mark.parametrize("distance", [1.0, 1e6, 1e120, 1e200, 1e300])
def test_merged_weights_are_a_mixture_at_any_distance(parts, states, gate, distance):
    merged = MergedSkill(parts, [0.2, 0.3, 0.5], gate, parameters=sharp(gate, 3.0))
    weights = merged.responsibilities(distance * states)
    shares = merged.part_weights_at(distance * states)
    assert weights.shape == (60, 9)
    assert shares.shape == (60, 3)
    for mixture in (weights, shares):
        assert (mixture >= 0).all()
        assert np.abs(mixture.sum(axis=1) - 1).max() <= 32 * EPS
    assert np.abs(weights[:, 2:5].sum(axis=1) - shares[:, 1]).max() <= 32 * EPS
    assert np.isfinite(merged.velocity(distance * states)).all()


def test_speeds_on_the_way_multiply(parts, states):
    inner = MergedSkill(parts[:2], [0.5, 0.5], speed=2.0)
    outer = MergedSkill((inner, parts[2]), [0.5, 0.5], speed=4.0)
    plain = MergedSkill((replace(inner, speed=1.0), replace(parts[2], speed=0.5)), [0.5, 0.5], speed=8.0)
    assert (outer.component_matrices[:5] == 8 * np.concatenate([p.system_matrices for p in parts[:2]])).all()
    assert close(outer, plain, states)
    assert outer.leaves == parts
    assert outer.n_components == 9


@pytest.mark.parametrize("gate", MERGE_GATES)
def test_one_state_and_many_states_agree(parts, states, gate):
    merged = MergedSkill(parts, [0.2, 0.3, 0.5], gate, parameters=sharp(gate, 2.0))
    one = np.stack([merged.velocity(state) for state in states])
    assert np.abs(one - merged.velocity(states)).max() <= RELATIVE * np.abs(one).max()


def test_moving_a_tree_moves_every_leaf(parts, states):
    offset = np.array([0.5, -1.0])
    tree = MergedSkill(
        (MergedSkill(parts[:2], [0.5, 0.5], "density"), parts[2]),
        [0.3, 0.7],
        "experts",
        parameters=sharp("experts", 2.0),
    )
    moved = tree.translated(offset)
    difference = moved.velocity(states + offset) - tree.velocity(states)
    assert np.abs(difference).max() <= RELATIVE * np.abs(tree.velocity(states)).max()
    target = np.array([1 / 3, 1 / 7])
    assert all((leaf.attractor == target).all() for leaf in retargeted(tree, target).leaves)


def test_the_density_of_a_merger_is_the_weighted_sum(parts, states):
    merged = MergedSkill(parts, [0.2, 0.3, 0.5])
    expected = sum(
        w * np.exp(part.density.log_density(states))
        for w, part in zip(merged.part_weights, parts, strict=True)
    )
    assert np.abs(np.exp(merged.density.log_density(states)) / expected - 1).max() <= RELATIVE


def test_parts_of_a_merger_share_attractor_p_and_space(make_skill, parts):
    rng = np.random.default_rng(0)
    with pytest.raises(InvalidModelError, match="share one attractor"):
        MergedSkill((parts[0], make_skill(rng)), [0.5, 0.5])
    with pytest.raises(InvalidModelError, match="one Lyapunov matrix"):
        MergedSkill((parts[0], replace(parts[1], lyapunov=2 * np.eye(2))), [0.5, 0.5])
    with pytest.raises(InvalidModelError, match="state spaces differ"):
        MergedSkill((parts[0], replace(parts[1], space=Euclidean(("x", "y"), "rad"))), [0.5, 0.5])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"part_weights": [0.5, 0.5]}, "part_weights: expected shape"),
        ({"part_weights": [0.5, 0.5, 0.5]}, "part_weights: must be positive and sum to one"),
        ({"gate": "mean"}, "gate: one of superposition, density, experts"),
        ({"gate": "experts", "parameters": {"sharpness": 0.5}}, "sharpness: must be at least 1"),
        ({"gate": "experts", "parameters": {"sharpness": np.nan}}, "sharpness: must be at least 1"),
        ({"parameters": {"sharpness": 2.0}}, "the superposition gate does not take it"),
        ({"speed": -1.0}, "speed: must be a positive number"),
        ({"speed": 1e308}, "speed: must be zero or of a size from 1e-100"),
        ({"parts": ()}, "parts: at least one is needed"),
    ],
)
def test_a_merger_is_valid_or_does_not_exist(parts, options, words):
    with pytest.raises(InvalidModelError, match=words):
        MergedSkill(**{"parts": parts, "part_weights": [0.2, 0.3, 0.5], **options})


@pytest.fixture
def combined(make_skill):
    rng = np.random.default_rng(21)
    return CombinedSkill(
        tuple(make_skill(rng, attractor=place) for place in ([0.0, 0.0], [0.5, 0.1], [0.2, 0.6])),
        [0.2, 0.3, 0.5],
        speed=2.0,
    )


def test_exactly_the_part_with_the_largest_weighted_density_acts(combined, states):
    pairs = zip(combined.part_priors, combined.parts, strict=True)
    scores = np.stack([prior * np.exp(part.density.log_density(states)) for prior, part in pairs])
    expected = np.argmax(scores, axis=0)
    seen = scores.max(axis=0) > 0  # elsewhere the densities themselves underflow
    assert (combined.part_at(states)[seen] == expected[seen]).all()
    assert len(set(expected.tolist())) > 1
    for state, part in zip(states, combined.part_at(states), strict=True):
        difference = combined.velocity(state) - 2.0 * combined.parts[part].velocity(state)
        assert np.abs(difference).max() <= RELATIVE * np.abs(combined.velocity(state)).max()


def test_the_acting_part_can_be_named(combined, states):
    ones = np.ones(len(states), dtype=np.int64)
    assert (combined.velocity(states, ones) == 2.0 * combined.parts[1].velocity(states)).all()


@pytest.mark.parametrize("distance", [1e3, 1e100, 1e200])
def test_far_away_the_widest_part_acts(make_skill, distance):
    rng = np.random.default_rng(0)
    narrow, wide = make_skill(rng), make_skill(rng)
    wide = replace(wide, density=GaussianMixture([1.0], [[0.0, 0.0]], [100 * np.eye(2)]))
    skill = CombinedSkill((narrow, wide), [0.999, 0.001])
    directions = rng.normal(size=(30, 2))
    assert (skill.part_at(distance * directions) == 1).all()


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("factor", [1e-20, 1e-30, 1e-100])
def test_covariances_too_small_for_rounding_still_give_velocities_between_those_of_the_components(
    make_skill, factor, seed
):
    skill = make_skill(np.random.default_rng(seed), attractor=[0.1, 0.2])
    skill = replace(skill, covariances=factor * skill.covariances)
    single = np.array([skill.velocity(state) for state in skill.means])
    fastest = max(np.linalg.norm(matrix, 2) for matrix in skill.system_matrices)
    limits = (1 + RELATIVE) * fastest * np.linalg.norm(skill.means - skill.attractor, axis=1)
    for velocities in (single, skill.velocity(skill.means)):
        assert (np.linalg.norm(velocities, axis=1) <= limits).all()


def test_attractors_of_a_combined_skill(combined):
    assert combined.attractors.tolist() == [[0.0, 0.0], [0.5, 0.1], [0.2, 0.6]]
    assert not combined.aligned
    same = CombinedSkill(tuple(retargeted(p, [1.0, 1.0]) for p in combined.parts), combined.part_priors)
    assert same.aligned
    assert same.attractors.tolist() == [[1.0, 1.0]]
    assert retargeted(same, [1 / 3, 2.0]).attractors.tolist() == [[1 / 3, 2.0]]
    with pytest.raises(UsageError, match="3 attractors"):
        retargeted(combined, [0.0, 0.0])


def test_a_combined_skill_is_no_part(combined):
    for kind in (MergedSkill, CombinedSkill):
        with pytest.raises(InvalidModelError, match="cannot be a part"):
            kind((combined, combined), [0.5, 0.5])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"part_priors": [0.5, 0.5]}, "part_priors: expected shape"),
        ({"gate": "sometimes"}, "gate: one of latched, instantaneous"),
        ({"disturbance_distance": 0.0}, "disturbance_distance: must be a positive number"),
        ({"speed": np.nan}, "speed: must be a positive number"),
        ({"speed": 1e308}, "speed: must be zero or of a size from 1e-100"),
    ],
)
def test_a_combination_is_valid_or_does_not_exist(combined, options, words):
    with pytest.raises(InvalidModelError, match=words):
        replace(combined, **options)
