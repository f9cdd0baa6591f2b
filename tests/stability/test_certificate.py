"""Certificates: what they say is true, and what is not true they do not say."""

import dataclasses
import json
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

from skillctl.errors import InvalidModelError
from skillctl.model.combined import CombinedSkill
from skillctl.model.gates import MERGE_GATES
from skillctl.model.merged import MergedSkill
from skillctl.model.mixture import GaussianMixture
from skillctl.model.stepper import Stepper
from skillctl.stability.certificate import certify
from skillctl.stability.report import at_least, at_most, least_frequency

EPS = np.finfo(float).eps


def random_p(rng, d):
    root = rng.normal(size=(d, d))
    p = root @ root.T + 0.3 * np.eye(d)
    return 0.5 * (p + p.T)


def p_norm(p, offsets):
    return np.sqrt(np.einsum("...i,ij,...j->...", offsets, p, offsets))


def with_matrix(skill, index, matrix):
    matrices = skill.system_matrices.copy()
    matrices[index] = matrix
    return replace(skill, system_matrices=matrices)


@pytest.mark.parametrize("dimension", [1, 2, 3, 7, 10])
def test_rate_and_period_are_the_smallest_of_all_components_rounded_down(make_skill, dimension):
    rng = np.random.default_rng(dimension)
    p = random_p(rng, dimension)
    skill = make_skill(rng, dimension=dimension, n_components=4, lyapunov=p, rate=0.4, speed=1.5)
    certificate = certify(skill)
    assert (certificate.verdict, certificate.scope) == ("stable", "global")
    matrices = 1.5 * skill.system_matrices
    losses = [-(p @ a + a.T @ p) for a in matrices]
    rate = min(eigh(0.5 * loss, p, eigvals_only=True)[0] for loss in losses)
    period = min(
        eigh(loss, a.T @ p @ a, eigvals_only=True)[0] for loss, a in zip(losses, matrices, strict=True)
    )
    # The first rounding towards safety is 2^-40, far above the rounding of either eigenvalue solver.
    assert rate * (1 - 2.0**-38) <= certificate.rate < rate
    assert period * (1 - 2.0**-38) <= certificate.period < period
    assert certificate.rate > 0.4 * 1.5  # by construction of the skill
    assert (certificate.failures, certificate.evidence, certificate.sampling) == ((), (), None)


def test_rate_and_period_hold_as_fractions(make_skill):
    """The reported floats fulfil the conditions exactly, every speed on the way included."""
    rng = np.random.default_rng(0)
    p = random_p(rng, 2)
    leaves = [make_skill(rng, lyapunov=p, n_components=2, speed=s) for s in (0.1, 0.7)]
    inner = MergedSkill(tuple(leaves), [0.5, 0.5], speed=1.3)
    outer = CombinedSkill((inner, make_skill(rng, lyapunov=p, attractor=[1.0, 1.0])), [0.5, 0.5], speed=0.9)
    certificate = certify(outer)

    def definite(m):
        return m[0][0] > 0 and m[0][0] * m[1][1] - m[0][1] * m[1][0] > 0

    def exact(array):
        return np.array([Fraction(v) for v in array.ravel().tolist()], dtype=object).reshape(array.shape)

    speed = Fraction(0.9) * Fraction(1.3) * Fraction(0.7)
    fp = exact(p)
    part = certificate.parts[0]
    for matrix in leaves[1].system_matrices:
        a = speed * exact(matrix)
        assert definite(-(fp @ a + a.T @ fp) - 2 * Fraction(part.rate) * fp)
        assert definite(-(fp @ a + a.T @ fp) - Fraction(part.period) * (a.T @ fp @ a))
    assert certificate.rate == min(c.rate for c in certificate.parts)
    assert certificate.period == min(c.period for c in certificate.parts)


def test_speed_scales_rates_and_shortens_periods(make_skill):
    skill = make_skill(np.random.default_rng(1), dimension=3)
    slow, fast = certify(skill), certify(replace(skill, speed=4.0))
    assert fast.rate == pytest.approx(4 * slow.rate, rel=8 * EPS)
    assert fast.period == pytest.approx(slow.period / 4, rel=8 * EPS)


def test_an_indefinite_component_is_named(make_skill):
    skill = make_skill(np.random.default_rng(2), n_components=4)
    certificate = certify(with_matrix(skill, 2, [[-1.0, 3.0], [0.0, -1.0]]), seed=5)
    assert (certificate.verdict, certificate.scope) == ("not proved", "none")
    assert [c.proved for c in certificate.parts[0].components] == [True, True, False, True]
    assert certificate.parts[0].components[2].component == 3
    assert certificate.parts[0].components[2].rate == pytest.approx(-0.5, rel=8 * EPS)
    assert certificate.failures == (
        "part 1: leaf 1, component 3: P A + Aᵀ P is not negative definite (decay rate -0.5 1/s).",
    )
    assert (certificate.rate, certificate.period) == (None, None)
    assert certificate.sampling.seed == 5


def test_the_leaf_of_a_merged_skill_is_named(make_skill):
    rng = np.random.default_rng(3)
    good, bad = make_skill(rng), with_matrix(make_skill(rng), 0, np.eye(2))
    certificate = certify(MergedSkill((good, MergedSkill((good, bad), [0.5, 0.5])), [0.5, 0.5]))
    failed = [(c.leaf, c.component) for c in certificate.parts[0].components if not c.proved]
    assert failed == [(3, 1)]
    assert "part 1: leaf 3, component 1" in certificate.failures[0]


@pytest.mark.parametrize(
    "matrix",
    [
        [[-1.0, 2.0], [0.0, -1.0]],  # −(A + Aᵀ) = [2 −2; −2 2]: exactly singular
        [[0.0, 1.0], [-1.0, 0.0]],
        [[-1.0, 0.0], [0.0, 0.0]],
        [[-1e-14, 5.0], [-5.0, -1.0]],  # decays, but by less than the margin: execution would round it away
    ],
)
def test_a_component_that_is_only_nearly_stable_is_not_proved(make_skill, matrix):
    certificate = certify(with_matrix(make_skill(np.random.default_rng(4)), 1, matrix))
    assert certificate.verdict == "not proved"
    assert [c.proved for c in certificate.parts[0].components] == [True, False, True]


def test_a_component_just_above_the_margin_is_proved(make_skill):
    certificate = certify(with_matrix(make_skill(np.random.default_rng(4)), 1, [[-1e-11, 5.0], [-5.0, -1.0]]))
    assert certificate.verdict == "stable"
    assert 0.99e-11 < certificate.rate <= 1e-11


def test_a_matrix_that_is_definite_only_after_rounding_is_not_proved(make_skill):
    # By eigenvalues in floating point −(A + Aᵀ) is definite; its determinant as a fraction is negative.
    rng = np.random.default_rng(5)
    found = 0
    for _ in range(2000):
        v = rng.normal(size=2)
        s = np.outer(v, v)
        exact = Fraction(s[0, 0]) * Fraction(s[1, 1]) - Fraction(s[0, 1]) ** 2
        if exact < 0 and np.linalg.eigvalsh(s)[0] > 0:
            found += 1
            skill = with_matrix(make_skill(rng), 0, -s)
            assert not certify(skill).parts[0].components[0].proved
        if found == 3:
            return
    raise AssertionError("no such matrix among the samples")


def test_a_p_that_is_not_clearly_definite_is_found_out(make_skill):
    """Exact arithmetic decides where the smallest eigenvalue is rounding."""
    rng = np.random.default_rng(6)
    refused = 0
    for share in np.linspace(0.5, 1.5, 200):
        v = rng.normal(size=2)
        p = np.outer(v, v)
        p[1, 1] += share * 2.0**-45 * p[1, 1]
        lowered = [Fraction(p[i, i]) * (1 - Fraction(1, 2**46)) for i in range(2)]
        if lowered[0] * lowered[1] > Fraction(p[0, 1]) ** 2:
            certify(replace(make_skill(rng), lyapunov=p))
        else:
            refused += 1
            with pytest.raises(InvalidModelError, match="must be positive definite, and not nearly singular"):
                replace(make_skill(rng), lyapunov=p)
    assert 20 < refused < 180


@pytest.mark.parametrize(
    ("matrix", "p", "verdict"),
    [
        (-1e100 * np.eye(2), np.eye(2), "stable"),
        (-1e-100 * np.eye(2), np.eye(2), "stable"),
        (np.diag([-1e-100, -1e100]), np.eye(2), "not proved"),  # below the margin
        (-np.eye(2), np.diag([1e-100, 1e100]), "stable"),
        (-np.eye(2), np.array([[1.0, 1.0], [1.0, 1.0 + 2.0**-44]]), "stable"),  # nearly singular
        (1e99 * np.array([[1.0, -1.0], [1.0, 1.0]]), np.eye(2), "not proved"),
        (np.zeros((2, 2)), np.eye(2), "not proved"),
    ],
)
def test_extreme_numbers_get_an_answer(make_skill, matrix, p, verdict):
    skill = make_skill(np.random.default_rng(0), n_components=1)
    certificate = certify(replace(skill, system_matrices=matrix[None], lyapunov=p))
    assert certificate.verdict == verdict
    if verdict == "stable":
        assert certificate.rate == pytest.approx(np.abs(matrix).max(), rel=1e-9)
        # What is proved is what is executed: a step of the proved period brings the state nearer.
        skill = replace(skill, system_matrices=matrix[None], lyapunov=p)
        start = skill.attractor + np.array([[0.3, -0.2]])
        ahead = Stepper(skill, certificate.period).step_many(start).states
        assert skill.v_distance(ahead)[0] < skill.v_distance(start)[0]
    json.dumps(dataclasses.asdict(certificate), allow_nan=False)


@settings(deadline=None, max_examples=15)
@given(
    seed=st.integers(0, 2**32 - 1),
    dimension=st.integers(1, 4),
    gate=st.sampled_from([gate.name for gate in MERGE_GATES]),
)
def test_the_rate_bounds_the_decay_of_every_motion(make_skill, seed, dimension, gate):
    rng = np.random.default_rng(seed)
    p = random_p(rng, dimension)
    parts = tuple(make_skill(rng, dimension=dimension, lyapunov=p, rate=0.2) for _ in range(2))
    parameters = {"sharpness": 2.0} if gate == "experts" else {}
    skill = MergedSkill(parts, [0.3, 0.7], gate, speed=1.2, parameters=parameters)
    rate = certify(skill).rate
    start = rng.normal(0, 0.3, dimension)
    times = np.linspace(0, 3, 31)
    tolerance = 1e-9
    motion = solve_ivp(
        lambda _, x: skill.velocity(x),
        (0, 3),
        start,
        t_eval=times,
        rtol=tolerance,
        atol=1e-12,
        method="DOP853",
    )
    norms = p_norm(p, motion.y.T)
    # Local errors of rtol each step add up to a relative error far below 1e-6 over these few hundred steps;
    # the absolute part is the integrator's atol seen through √‖P‖.
    slack = 1e3 * tolerance * norms[0] + 1e-10 * np.sqrt(np.linalg.norm(p, 2))
    assert (norms <= np.exp(-rate * times) * norms[0] + slack).all()


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), dimension=st.integers(1, 7), share=st.floats(1e-3, 1.0))
def test_no_step_up_to_the_period_increases_the_distance(make_skill, seed, dimension, share):
    rng = np.random.default_rng(seed)
    p = random_p(rng, dimension)
    skill = make_skill(rng, dimension=dimension, lyapunov=p, rate=0.1)
    period = share * certify(skill).period
    x = rng.normal(0, 0.3, (200, dimension))
    before, after = p_norm(p, x), p_norm(p, x + period * skill.velocity(x))
    # One step rounds each coordinate by a few ulps of its largest term, which P's condition may stretch.
    steps = 1 + period * np.linalg.norm(skill.component_matrices, 2, axis=(1, 2)).max()
    slack = 64 * EPS * steps * np.sqrt(np.linalg.cond(p))
    assert (after <= before * (1 + slack)).all()


@pytest.mark.parametrize("dimension", [1, 2, 5])
def test_a_step_five_per_cent_longer_can_increase_it(make_skill, dimension):
    rng = np.random.default_rng(dimension)
    p = random_p(rng, dimension)
    skill = make_skill(rng, dimension=dimension, n_components=1, lyapunov=p)
    a = skill.component_matrices[0]
    # The direction that loses least: the eigenvector of the condition at its border.
    _, vectors = eigh(-(p @ a + a.T @ p), a.T @ p @ a)
    x = vectors[:, 0]
    period = 1.05 * certify(skill).period
    assert p_norm(p, x + period * skill.velocity(x)) > p_norm(p, x)


def combined(make_skill, rng, places, gate, shared_p=True, **options):
    ps = [np.eye(2)] * len(places) if shared_p else [random_p(rng, 2) for _ in places]
    parts = []
    for place, p in zip(places, ps, strict=True):
        part = make_skill(rng, attractor=place, lyapunov=p, rate=1.0)
        density = GaussianMixture([1.0], [place], [0.01 * np.eye(2)])
        parts.append(replace(part, density=density))
    return CombinedSkill(tuple(parts), np.full(len(places), 1 / len(places)), gate, **options)


def test_a_latched_combination_is_as_stable_as_its_parts(make_skill):
    skill = combined(make_skill, np.random.default_rng(7), ([0, 0], [1, 0]), "latched", False, speed=2.0)
    certificate = certify(skill)
    assert (certificate.verdict, certificate.scope) == ("stable", "global")
    alone = [certify(replace(part, speed=2.0)) for part in skill.parts]
    assert [part.rate for part in certificate.parts] == [c.rate for c in alone]
    assert certificate.rate == min(c.rate for c in alone)
    assert "basin" in certificate.proof[0]


def test_one_bad_part_spoils_a_latched_combination(make_skill):
    skill = combined(make_skill, np.random.default_rng(8), ([0, 0], [1, 0]), "latched")
    spoilt = replace(skill, parts=(skill.parts[0], with_matrix(skill.parts[1], 1, np.eye(2))))
    certificate = certify(spoilt)
    assert (certificate.verdict, certificate.scope) == ("not proved", "none")
    assert [part.proved for part in certificate.parts] == [True, False]
    assert "part 2: leaf 1, component 2" in certificate.failures[0]


def test_instantaneous_switching_around_one_attractor_under_one_p_is_stable(make_skill):
    skill = combined(make_skill, np.random.default_rng(9), ([0, 0], [0, 0]), "instantaneous")
    assert (certify(skill).verdict, certify(skill).scope) == ("stable", "global")


def test_instantaneous_switching_under_different_p_is_not_proved_and_says_why(make_skill):
    skill = combined(make_skill, np.random.default_rng(10), ([0, 0], [0, 0]), "instantaneous", False)
    certificate = certify(skill)
    assert certificate.verdict == "inconclusive"
    assert "different P" in certificate.failures[0]
    assert certificate.rate is None
    assert certificate.sampling.arrived == certificate.sampling.starts
    assert "evidence, not proof" in certificate.evidence[0]


def test_switching_between_attractors_is_never_called_stable(make_skill):
    skill = combined(make_skill, np.random.default_rng(11), ([0, 0], [1, 0]), "instantaneous")
    certificate = certify(skill)
    assert certificate.verdict == "inconclusive"  # no proof, and no witness
    assert certificate.scope == "local"
    assert certificate.rate == min(part.rate for part in certificate.parts)


def test_regions_that_push_at_each_other_are_refuted_by_a_witness(make_skill):
    # Left of x = ½ the part whose goal lies right acts, and the other way round: nothing ever arrives.
    rng = np.random.default_rng(12)
    left, right = combined(make_skill, rng, ([0, 0], [1, 0]), "instantaneous").parts
    crossed = CombinedSkill(
        (replace(left, density=right.density), replace(right, density=left.density)),
        [0.5, 0.5],
        "instantaneous",
    )
    certificate = certify(crossed, seed=3)
    assert (certificate.verdict, certificate.scope) == ("not proved", "none")
    assert [part.radius for part in certificate.parts] == [None, None]
    x = np.array(certificate.sampling.witness)
    nearest = np.inf
    for _ in range(20000):  # followed here by hand, ten times finer and as long
        part = crossed.parts[int(x[0] < 0.5)]
        x = x + 0.1 * certificate.sampling.period * part.velocity(x)
        nearest = min(nearest, np.linalg.norm(x - crossed.attractors, axis=1).min())
    assert nearest > 0.1
    assert "reached no attractor" in certificate.evidence[0]
    assert certify(crossed, seed=3).sampling == certificate.sampling
    assert certify(crossed, seed=4).sampling.witness != certificate.sampling.witness


def test_what_came_near_and_then_got_stuck_is_a_witness_before_time_is_up(make_skill, monkeypatch):
    # As above, but one direction is so slow that following it to the guaranteed arrival would take hours.
    left, right = combined(make_skill, np.random.default_rng(18), ([0, 0], [1, 0]), "instantaneous").parts
    matrices = np.tile(np.diag([-1.0, -1e-3]), (3, 1, 1))
    crossed = CombinedSkill(
        tuple(
            replace(a, density=b.density, system_matrices=matrices) for a, b in ((left, right), (right, left))
        ),
        [0.5, 0.5],
        "instantaneous",
    )
    monkeypatch.setattr("skillctl.stability.sampling.STARTS", 1)
    for seed in range(3):
        sampling = certify(crossed, seed=seed).sampling
        assert sampling.duration < np.log(10) / 1e-3 / 0.5  # not even a tenth of the way, twice over
        assert sampling.witness is not None
        assert abs(sampling.witness_end[0] - 0.5) < 0.1  # on the border


def test_one_attractor_without_a_radius_leaves_no_local_proof(make_skill):
    # The second part knows a place of its own, but not its attractor: the first part acts there.
    near, far = combined(make_skill, np.random.default_rng(17), ([0, 0], [1, 0]), "instantaneous").parts
    away = replace(far, density=far.density.translated(np.array([5.0, 0.0])))
    certificate = certify(CombinedSkill((near, away), [0.5, 0.5], "instantaneous"))
    assert certificate.parts[0].radius is not None
    assert certificate.parts[1].radius is None
    assert (certificate.scope, certificate.rate, certificate.period) == ("none", None, None)


def test_an_unstable_skill_gets_a_witness_too(make_skill):
    skill = make_skill(np.random.default_rng(13), n_components=1)
    certificate = certify(with_matrix(skill, 0, np.diag([50.0, -1.0])))
    assert certificate.verdict == "not proved"
    assert certificate.sampling.witness is not None
    assert certificate.sampling.arrived < certificate.sampling.starts


def test_a_skill_that_is_stable_without_proof_gets_no_witness(make_skill):
    # A Jordan block: −(A + Aᵀ) is indefinite for P = I, and yet everything converges.
    skill = make_skill(np.random.default_rng(14), n_components=1)
    certificate = certify(with_matrix(skill, 0, [[-1.0, 4.0], [0.0, -1.0]]))
    assert certificate.verdict == "not proved"
    assert certificate.sampling.witness is None
    assert certificate.sampling.arrived == certificate.sampling.starts


def test_a_motion_that_is_only_slow_is_no_witness(make_skill):
    # Stable with a time constant of 1000 s, which this P does not show; the search ends before it arrives.
    skill = make_skill(np.random.default_rng(16), n_components=1)
    slow = replace(with_matrix(skill, 0, np.diag([-1e-3, -4.0])), lyapunov=np.array([[1.0, 0.9], [0.9, 1.0]]))
    certificate = certify(slow)
    assert certificate.verdict == "not proved"
    assert certificate.sampling.arrived < certificate.sampling.starts
    assert certificate.sampling.witness is None


def test_a_certificate_is_json_and_names_its_digest(make_skill):
    rng = np.random.default_rng(15)
    for gate in ("latched", "instantaneous"):
        skill = combined(make_skill, rng, ([0, 0], [1, 0]), gate)
        document = json.dumps(dataclasses.asdict(certify(skill, digest="sha256:abc")), allow_nan=False)
        assert json.loads(document)["digest"] == "sha256:abc"
        assert all(part["proved"] for part in json.loads(document)["parts"])


@given(st.floats(1e-300, 1e300), st.integers(1, 6))
def test_spoken_numbers_are_rounded_to_the_safe_side(number, digits):
    low, high = Fraction(at_least(number, digits)), Fraction(at_most(number, digits))
    assert low <= Fraction(number) <= high
    assert high - low <= Fraction(number) * Fraction(10) ** (1 - digits)


def test_a_printed_frequency_is_never_too_low():
    for period in (8 / 3, math.nextafter(8 / 3, 0), 0.1, 1 / 3, 2.0**-7, 0.0499999999):
        assert Fraction(least_frequency(period)) * Fraction(period) >= 1
