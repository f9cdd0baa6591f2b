"""Bounds of motions from a box: by hand, by fractions, and against ten thousand motions."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from skillctl.exact import Dyadic
from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.coordinates.chain import Chain, Link
from skillctl.model.lyapunov import QuadraticForm
from skillctl.model.merged import MergedSkill
from skillctl.model.mixture import GaussianMixture
from skillctl.model.rollout import rollout
from skillctl.stability.certificate import certify
from skillctl.stability.exact import inverse_diagonal, root_above, rounded_up
from skillctl.stability.parts import proved_rate
from skillctl.stability.reach import bound_reach
from skillctl.stability.sublevels import sublevels_of

P = np.array([[2.0, 1.0], [1.0, 2.0]])


def reach_of(skill, low, high, **options):
    return bound_reach(skill, certify(skill), np.array(low), np.array(high), **options)


def with_one_matrix(skill, matrix, lyapunov):
    return replace(skill, system_matrices=np.array([matrix]), lyapunov=np.array(lyapunov))


def test_the_box_around_a_sublevel_set_is_that_computed_by_hand(make_skill):
    """Offsets from (0, −1) to (1, 1): V is largest at (1, 1), c = 6; (P⁻¹)ᵢᵢ = 2/3, √(c (P⁻¹)ᵢᵢ) = 2."""
    skill = make_skill(np.random.default_rng(0), lyapunov=P, attractor=[3.0, -1.0])
    reach = reach_of(skill, [3.0, -2.0], [4.0, 0.0])
    (part,) = reach.parts
    assert (part.part, part.level) == (1, 6.0)
    # The exact bounds are float64 numbers; rounding outwards may add one unit in the last place of a root.
    assert reach.low == pytest.approx((1.0, -3.0), rel=2**-51)
    assert reach.high == pytest.approx((5.0, 1.0), rel=2**-51)
    assert reach.low[0] <= 1.0
    assert reach.high[0] >= 5.0
    assert reach.exact


def test_bounds_are_rounded_outwards_and_no_farther_than_float64_forces():
    rng = np.random.default_rng(1)
    for _ in range(200):
        root = rng.normal(size=(2, 2))
        p = root @ root.T + 0.01 * np.eye(2)
        p = 0.5 * (p + p.T)
        (a, b), (_, c) = [[Fraction(v) for v in row] for row in p.tolist()]
        assert inverse_diagonal(Dyadic.of(p)) == [c / (a * c - b * b), a / (a * c - b * b)]
        value = Fraction(float(rng.uniform(0, 1))) / 3
        assert Fraction(rounded_up(value)) >= value > Fraction(np.nextafter(rounded_up(value), 0))
        assert Fraction(root_above(value)) ** 2 >= value > Fraction(np.nextafter(root_above(value), 0)) ** 2
    assert rounded_up(Fraction(10) ** 400) == np.inf
    assert inverse_diagonal(Dyadic.of([[4.0]])) == [Fraction(1, 4)]


def test_the_time_of_arrival_is_that_computed_by_hand(make_skill):
    """ξ⁺ = (1 − 2Δt) ξ: with Δt = 0.1, A + ½Δt A² = −1.8, so every step shrinks |ξ| by e^(−0.18) at least."""
    skill = make_skill(np.random.default_rng(0), dimension=1, n_components=1)
    skill = with_one_matrix(skill, [[-2.0]], [[1.0]])
    reach = reach_of(skill, [0.5], [1.0], period=0.1)
    assert reach.arrival == pytest.approx(np.log(1 / reach.arrival_distance) / 1.8 + 0.1, rel=1e-9)
    assert reach.arrival > np.log(1 / reach.arrival_distance) / 1.8 + 0.1
    steps = np.ceil(np.log(1 / reach.arrival_distance) / -np.log(0.8))
    assert reach.measured.arrival == pytest.approx(0.1 * steps, rel=1e-12)  # the farthest start is a corner
    assert reach.measured.low == pytest.approx((0.5 * 0.8**steps,), rel=1e-9)
    assert reach.measured.high == (1.0,)


def test_a_rate_that_is_estimated_too_high_is_found_out(make_skill, monkeypatch):
    """1.98 is a rate of ξ̇ = −2 ξ, but not of its steps of 0.1 s, which have 1.8."""
    skill = with_one_matrix(
        make_skill(np.random.default_rng(0), dimension=1, n_components=1), [[-2.0]], [[1.0]]
    )
    monkeypatch.setattr(QuadraticForm, "rates", lambda self, matrices, period=0.0: np.array([1.98]))
    assert 0.9 <= proved_rate(skill, 1.0, 0.1) <= 1.8
    assert proved_rate(skill, 1.0, 1e-6) == pytest.approx(1.98, rel=1e-9)


def test_motions_that_start_at_the_attractor_have_arrived(make_skill):
    skill = make_skill(np.random.default_rng(0), attractor=[1.0, 2.0])
    reach = reach_of(skill, [1.0, 2.0], [1.0, 2.0])
    assert (reach.low, reach.high, reach.arrival) == ((1.0, 2.0), (1.0, 2.0), 0.0)


def skills(make_skill, make_shears):
    rng = np.random.default_rng(7)
    far, near = np.array([0.5, 0.0]), np.array([0.0, 0.0])
    parts = tuple(make_skill(rng, lyapunov=P, spread=0.1, speed=s) for s in (0.7, 1.2))
    bent = replace(
        make_skill(rng, lyapunov=P, spread=0.1), coordinates=Chain((make_shears(rng, 2, size=0.05),))
    )
    yield "learned", parts[0]
    yield "merged", MergedSkill(parts, [0.4, 0.6], speed=1.3)
    yield "aligned", CombinedSkill(parts, [0.5, 0.5], "instantaneous", speed=1.1)
    ends = tuple(
        make_skill(rng, lyapunov=p, attractor=a, spread=0.1) for p, a in ((P, near), (np.eye(2), far))
    )
    yield "latched", CombinedSkill(ends, [0.5, 0.5], "latched", speed=0.8)
    yield "bent", bent
    yield "bent, latched", CombinedSkill((bent, ends[1]), [0.5, 0.5], "latched")


@pytest.mark.parametrize("kind", ["learned", "merged", "aligned", "latched", "bent", "bent, latched"])
def test_ten_thousand_motions_stay_in_and_arrive_in_time(make_skill, make_shears, kind):
    skill = dict(skills(make_skill, make_shears))[kind]
    certificate = certify(skill)
    low, high = np.array([0.1, -0.3]), np.array([0.4, 0.1])
    for period in (certificate.period, 0.5 * certificate.period):
        reach = bound_reach(skill, certificate, low, high, period=period)
        starts = np.random.default_rng(0).uniform(low, high, (10_000, 2))
        motions = rollout(skill, starts, duration=min(reach.arrival, 400 * period), period=period)
        assert (motions.positions >= reach.low).all()
        assert (motions.positions <= reach.high).all()
        assert {part.part for part in reach.parts} >= set((np.unique(motions.parts) + 1).tolist())
    # At half the proved period all arrive while they are followed, and before the bound.
    assert motions.arrived.all()
    assert motions.arrival_times.max() <= reach.arrival
    assert reach.measured.arrived == reach.measured.starts
    assert reach.measured.arrival <= reach.arrival


def test_interval_bounds_hold_and_are_hardly_larger_than_sampled_ones(make_skill, make_shears):
    for seed in range(3):
        rng = np.random.default_rng(seed)
        d = 2 + seed % 2
        link = make_shears(rng, d, size=0.05)
        skill = replace(make_skill(rng, dimension=d, rate=1.0), coordinates=Chain((link,)))
        bounds = sublevels_of(skill)
        low, high = np.full(d, 0.3), np.full(d, 0.5)
        level = bounds.level(low, high)
        starts = rng.uniform(low, high, (20_000, d))
        faces = np.where(rng.uniform(size=starts.shape) < 0.5, low, high)
        starts = np.where(rng.uniform(size=starts.shape) < 0.7, faces, starts)  # extremes lie on the border
        sampled = (link.forward(starts) ** 2).sum(axis=1).max()  # P is the identity
        assert sampled <= level <= 1.03 * sampled
        directions = rng.normal(size=(200_000, d))
        border = np.sqrt(level) * directions / np.linalg.norm(directions, axis=1, keepdims=True)
        places = link.back(border)
        least, most = bounds.extent(level)
        assert (least <= places.min(axis=0)).all()
        assert (most >= places.max(axis=0)).all()
        assert (least >= 1.03 * places.min(axis=0)).all()
        assert (most <= 1.03 * places.max(axis=0)).all()
        radius = bounds.radius(1e-3)
        farthest = np.linalg.norm(link.back(border * (radius / np.sqrt(level))), axis=1).max()
        assert 0.6e-3 <= farthest <= 1e-3  # it ends where the first guess passes


def test_with_coordinates_that_know_no_bounds_nothing_is_claimed(make_skill):
    class Mirror(Link):
        """y = −s, without a word about boxes."""

        def forward(self, states):
            return -states

        def back(self, coordinates):
            return -coordinates

        def tangent(self, offsets):
            return -offsets, lambda velocities: -velocities

        def in_unit(self, unit):
            return self

        def check(self):
            return ()

    skill = replace(make_skill(np.random.default_rng(0)), coordinates=Chain((Mirror(),)))
    reach = reach_of(skill, [0.1, 0.1], [0.2, 0.2])
    assert (reach.low, reach.high, reach.arrival) == ((-np.inf,) * 2, (np.inf,) * 2, None)
    assert not reach.exact


def test_only_parts_that_the_start_box_can_select_count(make_skill):
    def part(seed, place):
        density = GaussianMixture([1.0], [place], [0.01 * np.eye(2)])
        return replace(make_skill(np.random.default_rng(seed), attractor=place), density=density)

    # The regions of equal spheres meet half-way between them, at x = 1.
    skill = CombinedSkill((part(1, [0.0, 0.0]), part(2, [2.0, 0.0])), [0.5, 0.5])
    for low, high, chosen in (
        ([0.0, -0.1], [0.5, 0.1], [1]),
        ([1.5, -0.1], [2.0, 0.1], [2]),
        ([0.9, -0.1], [1.1, 0.1], [1, 2]),
    ):
        reach = reach_of(skill, low, high)
        assert [part.part for part in reach.parts] == chosen
        assert reach.low[0] == min(part.low[0] for part in reach.parts)
        assert reach.high[0] == max(part.high[0] for part in reach.parts)


def test_without_a_proof_there_are_no_bounds(make_skill):
    skill = make_skill(np.random.default_rng(0))
    unstable = with_one_matrix(make_skill(np.random.default_rng(0), n_components=1), np.eye(2), np.eye(2))
    period = certify(skill).period
    assert reach_of(unstable, [0.0, 0.0], [0.1, 0.1]) is None
    assert reach_of(skill, [0.0, 0.0], [0.1, 0.1], period=np.nextafter(period, 1)) is None
    assert reach_of(skill, [0.0, 0.0], [0.1, 0.1], period=period) is not None


def test_of_a_chain_every_stage_begins_where_the_one_before_is_over(make_skill):
    """ξ̇ = −2 ξ, then −2 (ξ − 1), over within 0.1: from 2 … 3 no motion leaves −3 … 3, nor then −0.1 … 2.1."""
    rng = np.random.default_rng(0)
    first, second = (
        with_one_matrix(make_skill(rng, dimension=1, n_components=1, attractor=[end]), [[-2.0]], [[1.0]])
        for end in (0.0, 1.0)
    )
    chain = ChainedSkill((first, second), [0.01, 0.01], [("wait 0.5",), ()])
    reach = reach_of(chain, [2.0], [3.0], period=0.1)
    assert [(part.part, part.level) for part in reach.parts] == [(1, 9.0), (2, pytest.approx(1.21, rel=1e-9))]
    assert (reach.low, reach.high) == (pytest.approx((-3.0,), rel=1e-9), pytest.approx((3.0,), rel=1e-9))
    steps = (
        np.ceil(np.log(3 / 0.1) / 0.18) + 5
    )  # each of which shrinks |ξ| by e^(−0.18) at least, and the wait
    assert reach.arrival == pytest.approx(
        0.1 * steps + np.log(1.1 / reach.arrival_distance) / 1.8 + 0.1, rel=1e-9
    )
    assert reach.measured.arrived == reach.measured.starts
    assert reach.measured.arrival < reach.arrival
