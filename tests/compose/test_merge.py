"""Merging: the three gates against their formulas written out, what is refused, and that it is stable."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from skillctl.compose.lyapunov import common_lyapunov_of, with_lyapunov
from skillctl.compose.merge import NoCommonLyapunovError, merge
from skillctl.compose.parts import notes_on
from skillctl.errors import UsageError
from skillctl.model.combined import CombinedSkill
from skillctl.model.gates import MERGE_GATES as RECORDS
from skillctl.model.lyapunov import QuadraticForm
from skillctl.model.merged import MergedSkill
from skillctl.model.retarget import retargeted
from skillctl.model.space import Euclidean

EPS = np.finfo(float).eps
RELATIVE = 1e5 * EPS  # logits of a few thousand, right to a few ulps, decide weights

MERGE_GATES = [gate.name for gate in RECORDS]


def random_p(rng, d):
    root = rng.normal(size=(d, d))
    p = root @ root.T + 0.5 * np.eye(d)
    return 0.5 * (p + p.T)


def gates_of(part, x):
    """h_k^i of Eq. 4 at one state, by SciPy."""
    densities = np.array(
        [
            prior * multivariate_normal(mean, covariance).pdf(x)
            for prior, mean, covariance in zip(part.priors, part.means, part.covariances, strict=True)
        ]
    )
    return densities / densities.sum()


def density_of(part, x):
    columns = zip(part.density.priors, part.density.means, part.density.covariances, strict=True)
    return sum(prior * multivariate_normal(mean, covariance).pdf(x) for prior, mean, covariance in columns)


def written_out(parts, alphas, gate, gamma, x):
    """The velocity at one state, as the theory writes each gate."""
    h = [gates_of(part, x) for part in parts]
    if gate == "superposition":
        tilde = [a * hi for a, hi in zip(alphas, h, strict=True)]
    elif gate == "density":
        p = [a * density_of(part, x) for a, part in zip(alphas, parts, strict=True)]
        tilde = [pi / sum(p) * hi for pi, hi in zip(p, h, strict=True)]
    else:
        total = sum(a * (hl**gamma).sum() for a, hl in zip(alphas, h, strict=True))
        tilde = [a * hi**gamma / total for a, hi in zip(alphas, h, strict=True)]
    assert abs(sum(t.sum() for t in tilde) - 1) < 1e-12
    velocity = np.zeros_like(x)
    for part, weights in zip(parts, tilde, strict=True):
        for weight, matrix in zip(weights, part.system_matrices, strict=True):
            velocity += weight * part.speed * (matrix @ (x - part.attractor))
    return velocity


@pytest.mark.parametrize("gate", MERGE_GATES)
@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_each_gate_is_its_formula(make_skill, gate, dimension):
    rng = np.random.default_rng(dimension)
    parts = [
        make_skill(rng, dimension=dimension, n_components=k, speed=s)
        for k, s in ((2, 1.0), (3, 0.5), (4, 2.0))
    ]
    gamma = 2.5 if gate == "experts" else 1.0
    merged = merge(
        parts,
        part_weights=[1, 2, 5],
        gate=gate,
        parameters={"sharpness": gamma} if gate == "experts" else {},
        speed=0.8,
    )
    alphas = np.array([1, 2, 5]) / 8
    means = np.concatenate([part.means for part in parts])
    x = means[rng.integers(0, 9, 30)] + rng.normal(0, 0.03, (30, dimension))
    expected = 0.8 * np.stack([written_out(parts, alphas, gate, gamma, row) for row in x])
    size = np.linalg.norm(merged.component_matrices, 2, axis=(1, 2)).max() * np.abs(x).max()
    assert np.abs(merged.velocity(x) - expected).max() <= RELATIVE * size


def test_a_merged_skill_inside_a_merger_counts_as_one_part(make_skill):
    rng = np.random.default_rng(4)
    a, b, c = (make_skill(rng) for _ in range(3))
    nested = merge([merge([a, b], part_weights=[1, 3]), c], part_weights=[2, 2])
    x = rng.normal(0, 0.2, (50, 2))
    expected = 0.125 * a.velocity(x) + 0.375 * b.velocity(x) + 0.5 * c.velocity(x)
    assert np.abs(nested.velocity(x) - expected).max() <= RELATIVE * np.abs(expected).max()
    assert [len(part.leaves) for part in nested.parts] == [2, 1]


def test_unless_told_the_experts_gate_prefers_the_strongest_component(make_skill):
    rng = np.random.default_rng(4)
    parts = [make_skill(rng, n_components=3) for _ in range(2)]
    x = rng.normal(0, 0.3, (50, 2))
    own = [part.responsibilities(x) for part in parts]
    merged = merge(parts, gate="experts")
    powers = np.hstack(own) ** 4
    assert np.abs(merged.responsibilities(x) - powers / powers.sum(axis=1, keepdims=True)).max() <= 64 * EPS


def test_a_large_sharpness_lets_the_strongest_component_act_alone(make_skill):
    rng = np.random.default_rng(5)
    parts = [make_skill(rng, n_components=3) for _ in range(2)]
    merged = merge(parts, gate="experts", parameters={"sharpness": 2000.0})
    x = np.concatenate([part.means for part in parts])
    weights = merged.responsibilities(x)
    strongest = np.hstack([part.responsibilities(x) for part in parts])
    two = np.sort(strongest, axis=1)[:, -2:]
    clear = two[:, 0] < 0.98 * two[:, 1]  # 0.98^2000 < 1e-17
    assert clear.any()
    assert (np.argmax(weights, axis=1) == np.argmax(strongest, axis=1))[clear].all()
    assert (weights.max(axis=1) > 1 - 16 * EPS)[clear].all()


def test_weights_only_matter_relative_to_each_other(make_skill):
    rng = np.random.default_rng(6)
    parts = [make_skill(rng) for _ in range(3)]
    assert (merge(parts, part_weights=[1, 2, 5]).part_weights == np.array([1, 2, 5]) / 8).all()
    assert np.abs(merge(parts, part_weights=[1e308, 1e308, 1e308]).part_weights - 1 / 3).max() <= EPS
    assert (merge(parts).part_weights == 1 / 3).all()


def test_without_a_target_the_attractors_meet_at_their_weighted_mean(make_skill):
    rng = np.random.default_rng(7)
    parts = [make_skill(rng, attractor=place) for place in ([0.0, 0.0], [4.0, 8.0])]
    assert merge(parts, part_weights=[3, 1]).attractor.tolist() == [1.0, 2.0]


def test_with_a_target_every_part_goes_there(make_skill):
    rng = np.random.default_rng(8)
    parts = [make_skill(rng, attractor=rng.normal(size=2)) for _ in range(2)]
    target = [1 / 3, -2 / 7]
    merged = merge(parts, target=target)
    x = rng.normal(0, 0.2, (40, 2))
    expected = 0.5 * sum(retargeted(part, target).velocity(x) for part in parts)
    assert all((leaf.attractor == target).all() for leaf in merged.leaves)
    assert np.abs(merged.velocity(x) - expected).max() <= RELATIVE * np.abs(expected).max()


def test_parts_that_meet_already_do_not_move(make_skill):
    rng = np.random.default_rng(9)
    place = rng.normal(size=2)
    parts = [make_skill(rng, attractor=place) for _ in range(3)]
    merged = merge(parts, part_weights=[0.3, 0.3, 0.4])
    assert (merged.attractor == place).all()
    assert all((new.means == old.means).all() for new, old in zip(merged.leaves, parts, strict=True))


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    dimension=st.integers(1, 5),
    count=st.integers(2, 5),
    gate=st.sampled_from(MERGE_GATES),
    gamma=st.floats(1, 50),
)
def test_with_a_common_p_every_merger_shrinks_the_distance_everywhere(
    make_skill, seed, dimension, count, gate, gamma
):
    rng = np.random.default_rng(seed)
    p = random_p(rng, dimension)
    parts = [
        make_skill(
            rng, dimension=dimension, n_components=int(k), lyapunov=p, attractor=rng.normal(size=dimension)
        )
        for k in rng.integers(1, 5, count)
    ]
    merged = merge(
        parts,
        part_weights=rng.uniform(1e-3, 1, count),
        gate=gate,
        parameters={"sharpness": gamma} if gate == "experts" else {},
        speed=2.0,
    )
    x = merged.attractor + rng.normal(0, 1, (100, dimension)) * 10 ** rng.uniform(-3, 3, (100, 1))
    offsets, velocity = x - merged.attractor, merged.velocity(x)
    growth = np.einsum("ni,ij,nj->n", offsets, p, velocity)
    # Parts decay at 0.5 1/s or faster by construction, twice that at speed 2: V̇ ≤ −2 · 1 · V.
    assert (growth <= -1.0 * np.einsum("ni,ij,nj->n", offsets, p, offsets)).all()


def test_different_p_are_refused_with_the_parts_in_conflict(make_skill):
    # Dayawansa and Martin's pair has no common P for a > 3 + √8
    rng = np.random.default_rng(10)
    matrices = np.array([[[-1.0, -1.0], [1.0, -1.0]], [[-1.0, -9.0], [1 / 9.0, -1.0]]])
    ps = [np.eye(2), np.diag([1.0, 81.0])]
    first, third = (
        replace(make_skill(rng, n_components=1), system_matrices=m[None], lyapunov=p)
        for m, p in zip(matrices, ps, strict=True)
    )
    second = replace(first, system_matrices=-np.eye(2)[None], lyapunov=np.diag([1.0, 2.0]))
    with pytest.raises(NoCommonLyapunovError, match="skills 1 and 3 admit no common Lyapunov") as caught:
        merge([first, second, third])
    assert caught.value.parts == (0, 2)
    assert common_lyapunov_of([first, second, third]) is None
    with pytest.raises(NoCommonLyapunovError, match="different Lyapunov matrices") as caught:
        merge([first, second])
    assert caught.value.parts == ()


def test_a_common_p_that_is_found_makes_the_merger_possible(make_skill):
    rng = np.random.default_rng(11)
    base = random_p(rng, 3)
    parts = [make_skill(rng, dimension=3, lyapunov=base, rate=1.0) for _ in range(3)]
    # The same motions, each with a P of its own that also proves it
    parts = [with_lyapunov(part, base + 0.01 * i * np.diag([1.0, 2.0, 3.0])) for i, part in enumerate(parts)]
    found = common_lyapunov_of(parts)
    merged = merge(parts, lyapunov=found)
    assert (merged.lyapunov == found).all()
    assert QuadraticForm(found).rates(merged.component_matrices).min() > 0


def test_a_new_p_changes_no_velocity_and_reaches_every_leaf(make_skill):
    rng = np.random.default_rng(12)
    skill = MergedSkill((make_skill(rng), MergedSkill((make_skill(rng),), [1.0], speed=2.0)), [0.5, 0.5])
    p = random_p(rng, 2)
    changed = with_lyapunov(skill, p)
    x = rng.normal(size=(10, 2))
    assert (changed.velocity(x) == skill.velocity(x)).all()
    assert all((leaf.lyapunov == p).all() for leaf in changed.leaves)
    with pytest.raises(UsageError, match="lyapunov: expected 2 x 2"):
        with_lyapunov(skill, np.eye(3))


def test_a_part_that_already_shares_its_p_keeps_it(make_skill):
    rng = np.random.default_rng(13)
    p = random_p(rng, 2)
    parts = [make_skill(rng, lyapunov=p) for _ in range(2)]
    assert common_lyapunov_of(parts) is parts[0].lyapunov


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"part_weights": [1.0]}, "part weights: expected 2 numbers, one per skill, got 1"),
        ({"part_weights": [1.0, 2.0, 3.0]}, "part weights: expected 2 numbers, one per skill, got 3"),
        ({"part_weights": [1.0, 0.0]}, "part weights: must be positive, got 1, 0"),
        ({"part_weights": [1.0, -2.0]}, "part weights: must be positive"),
        ({"part_weights": [1.0, np.nan]}, "part weights: must be positive"),
        ({"gate": "average"}, "gate: one of superposition, density, experts, not 'average'"),
        ({"gate": "experts", "parameters": {"sharpness": 0.9}}, "sharpness: must be at least 1, got 0.9"),
        ({"gate": "experts", "parameters": {"sharpness": np.inf}}, "sharpness: must be at least 1"),
        (
            {"gate": "density", "parameters": {"sharpness": 2.0}},
            "sharpness: the density gate does not take it",
        ),
        ({"speed": 0.0}, "speed: must be a positive number, got 0"),
        ({"speed": np.nan}, "speed: must be a positive number"),
        ({"target": [1.0, 2.0, 3.0]}, "target: expected 2 finite numbers"),
        ({"lyapunov": np.eye(3)}, "lyapunov: expected 2 x 2"),
    ],
)
def test_options_that_make_no_sense_are_refused_in_a_sentence(make_skill, options, words):
    rng = np.random.default_rng(0)
    with pytest.raises(UsageError, match=words):
        merge([make_skill(rng), make_skill(rng)], **options)


def test_parts_that_do_not_fit_are_refused_in_a_sentence(make_skill):
    rng = np.random.default_rng(0)
    flat = make_skill(rng)

    def refused(words, *parts):
        with pytest.raises(UsageError, match=words):
            merge(parts)

    refused("needs at least two skills, got 1", flat)
    refused("needs at least two skills, got 0")
    refused("skill 2 has 3 dimensions, skill 1 2", flat, make_skill(rng, dimension=3))
    refused("unit of skill 2: rad; of skill 1: m", flat, replace(flat, space=Euclidean(("x", "y"), "rad")))
    refused(
        "frame of skill 2: cup; of skill 1: base",
        flat,
        replace(flat, space=Euclidean(("x", "y"), frame="cup")),
    )
    refused(
        "names of skill 3: u, v; of skill 1: x, y", flat, flat, replace(flat, space=Euclidean(("u", "v")))
    )
    refused("skill 2 is a combined skill", flat, CombinedSkill((flat, flat), [0.5, 0.5]))


def test_the_same_part_twice_is_allowed_and_noted(make_skill):
    rng = np.random.default_rng(14)
    one, other = make_skill(rng), make_skill(rng)
    assert notes_on([one, other, one]) == ("skills 1 and 3 are the same motion.",)
    assert notes_on([one, retargeted(one, [1.0, 1.0])]) == ("skills 1 and 2 are the same motion.",)
    assert notes_on([one, replace(one, speed=2.0), other]) == ()
    x = rng.normal(0, 0.2, (20, 2))
    twice = merge([one, one]).velocity(x)
    assert np.abs(twice - one.velocity(x)).max() <= RELATIVE * np.abs(twice).max()
