"""Combining: regions, priors, alignment, what is taken apart, and how much of what was taught is kept."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from skillctl.compose.combine import combine
from skillctl.compose.merge import merge
from skillctl.errors import UsageError
from skillctl.evaluate.coverage import (
    calibrated_priors,
    coverage,
    same_targets,
    selected_shares,
    with_regions,
)
from skillctl.learning.em import POSITION_FLOOR
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.mixture import GaussianMixture
from skillctl.model.retarget import retargeted
from skillctl.model.rollout import ARRIVAL_DISTANCE, rollout
from skillctl.model.space import Euclidean

EPS = np.finfo(float).eps


@pytest.fixture
def three(make_skill):
    rng = np.random.default_rng(1)
    return [make_skill(rng, attractor=place) for place in ([0.0, 0.0], [1.0, 0.0], [0.0, 1.0])]


def test_parts_keep_their_attractors_unless_aligned(three):
    assert combine(three).part_attractors.tolist() == [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
    assert combine(three, part_priors=[2, 1, 1], align=True).attractors.tolist() == [[0.25, 0.25]]
    assert combine(three, align=True, target=[1 / 3, 5.0]).part_attractors.tolist() == [[1 / 3, 5.0]] * 3


def test_priors_are_uniform_or_given(three):
    assert (combine(three).part_priors == 1 / 3).all()
    assert combine(three, part_priors=[1, 1, 2]).part_priors.tolist() == [0.25, 0.25, 0.5]


def test_a_larger_prior_takes_ground(three):
    x = np.random.default_rng(2).uniform(-0.5, 1.5, (500, 2))
    even, favoured = combine(three), combine(three, part_priors=[1, 1e6, 1])
    gained = (favoured.part_at(x) == 1) & (even.part_at(x) != 1)
    assert gained.any()
    assert not ((favoured.part_at(x) != 1) & (even.part_at(x) == 1)).any()


def test_combined_skills_are_taken_apart(three):
    inner = replace(combine(three[:2], part_priors=[1, 3], gate="instantaneous"), speed=2.0)
    outer = combine([inner, three[2]], part_priors=[3, 1])
    assert len(outer.parts) == 3
    assert np.abs(outer.part_priors - [3 / 16, 9 / 16, 4 / 16]).max() <= 2 * EPS
    assert [part.speed for part in outer.parts] == [2.0, 2.0, 1.0]
    assert (outer.gate, outer.speed) == ("latched", 1.0)
    x = np.random.default_rng(3).uniform(-0.5, 1.5, (200, 2))
    chosen = outer.part_at(x)
    both = chosen < 2
    assert both.any()
    assert (inner.part_at(x) == chosen)[both].all()
    difference = outer.velocity(x)[both] - inner.velocity(x)[both]
    # Another batch may be summed in another order; logits of a few thousand, right to a few ulps.
    assert np.abs(difference).max() <= 1e5 * EPS * np.abs(inner.velocity(x)).max()


def test_a_merged_skill_is_one_part(three):
    merged = merge(three[:2])
    assert combine([merged, three[2]]).parts == (merged, three[2])


def test_a_disturbance_is_a_share_of_the_smallest_motion(make_skill):
    rng = np.random.default_rng(4)

    def of_size(size):
        density = GaussianMixture([1.0], [[0.0, 0.0]], [np.diag([9.0, 16.0]) * size**2])
        return replace(make_skill(rng), density=density)

    # Two standard deviations each way: a box of 12 by 16 sizes, diagonal 20, five per cent of it 1
    assert combine([of_size(0.01), of_size(0.5)]).disturbance_distance == pytest.approx(0.01, rel=8 * EPS)
    assert combine([of_size(0.01), of_size(0.5)], disturbance_distance=0.3).disturbance_distance == 0.3


def test_a_common_p_reaches_every_part(three):
    p = np.diag([1.0, 2.0])
    skill = combine(three, align=True, gate="instantaneous", lyapunov=p)
    assert all((part.lyapunov == p).all() for part in skill.parts)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"part_priors": [1.0, 2.0]}, "part priors: expected 3 numbers, one per skill, got 2"),
        ({"part_priors": [1.0, 2.0, 0.0]}, "part priors: must be positive, got 1, 2, 0"),
        ({"gate": "random"}, "gate: one of latched, instantaneous, not 'random'"),
        ({"target": [0.0, 0.0]}, "target: the skills keep their own attractors"),
        ({"target": [0.0], "align": True}, "target: expected 2 finite numbers"),
        ({"disturbance_distance": 0.0}, "disturbance distance: must be positive"),
        ({"disturbance_distance": np.nan}, "disturbance distance: must be positive"),
    ],
)
def test_options_that_make_no_sense_are_refused_in_a_sentence(three, options, words):
    with pytest.raises(UsageError, match=words):
        combine(three, **options)


def test_parts_that_do_not_fit_are_refused_in_a_sentence(make_skill, three):
    with pytest.raises(UsageError, match="combine: needs at least two skills, got 1"):
        combine(three[:1])
    with pytest.raises(UsageError, match="combine: skill 2 has 3 dimensions"):
        combine([three[0], make_skill(np.random.default_rng(0), dimension=3)])


def straight(*starts, end=(0.0, 0.0), duration=2.0):
    times = np.linspace(0, duration, 21)
    share = np.linspace(1, 0, 21)[:, None]
    motions = [
        Demonstration.from_positions(times, np.asarray(end) + share * np.asarray(start)) for start in starts
    ]
    return DemonstrationSet(tuple(motions), Euclidean.cartesian(2))


def near(start):
    """Return four demonstrations that start around a place."""
    return straight(*(np.add(start, aside) for aside in ([0.1, 0.0], [-0.1, 0.0], [0.0, 0.1], [0.0, -0.1])))


@pytest.fixture
def crossing(make_skill):
    """Two skills with Gaussians right of and above their attractors, both a unit wide circle away."""
    rng = np.random.default_rng(5)
    parts = []
    for place, centre in (([0.0, 0.0], [0.5, 0.0]), ([3.0, 0.0], [3.0, 0.5])):
        density = GaussianMixture([1.0], [centre], [0.25 * np.eye(2)])
        parts.append(replace(make_skill(rng, attractor=place, rate=2.0), density=density))
    return parts


def share_left_out(motions, other):
    """Return which motions of a part, each left out of its one Gaussian, start where that beats another's."""
    found = []
    for left in range(len(motions)):
        rest = np.vstack([m.positions - m.positions[-1] for i, m in enumerate(motions) if i != left])
        floor = POSITION_FLOOR * (rest**2).sum(axis=1).mean() * np.eye(2)
        own = multivariate_normal(rest.mean(axis=0), np.cov(rest.T, bias=True) + floor)
        start = motions[left].positions[0] - motions[left].positions[-1]
        found.append(own.logpdf(start) > other.logpdf(start))
    return np.mean(found)


def test_coverage_counts_starts_that_select_when_they_are_left_out(crossing):
    skill = combine(crossing, disturbance_distance=0.1)
    # Relative to the attractor, wherever the recording ended.
    first = straight([0.5, 0.1], [0.6, -0.2], [1.9, 0.6], [0.4, 0.3], end=(-7.0, 4.0))
    expected = share_left_out(first.demonstrations, multivariate_normal([3.0, 0.5], 0.25 * np.eye(2)))
    report, alone = coverage(skill, [first, straight([0.0, 0.5])])
    assert (report.part, report.demonstrations, report.instead) == (1, 4, 2)
    assert report.selected == report.kept == expected == 0.5
    # Without its only demonstration nothing is known of a part.
    assert (alone.part, alone.demonstrations) == (2, 1)
    assert (alone.selected, alone.kept, alone.instead) == (None, None, None)


def test_parts_taught_from_the_same_places_name_each_other(crossing):
    # Each place was shown to both. Of a part from which one is left out only the other is known.
    left, right = (replace(part, density=crossing[0].density) for part in crossing)
    first, second = straight([1.0, 0.0], [-1.0, 0.0]), straight([1.0, 0.02], [-1.0, 0.02])
    skill = with_regions(combine([left, right], align=True), [first, second])
    report = coverage(skill, [first, second])
    assert [(part.selected, part.kept, part.instead) for part in report] == [(0.0, 0.0, 2), (0.0, 0.0, 1)]
    assert selected_shares(skill, [first, second]) == ((2, 0.0), (2, 0.0))


def test_a_part_without_demonstrations_is_left_out(crossing):
    report = coverage(combine(crossing), [None, straight([0.0, 0.5])])
    assert [part.part for part in report] == [2]


def test_demonstrations_of_merged_leaves_count_for_their_part(crossing):
    skill = combine([merge([crossing[0], crossing[0]]), crossing[1]])
    sets = [straight([0.5, 0.0]), straight([0.6, 0.0], [2.5, 0.0]), None]
    (report,) = coverage(skill, sets)
    assert (report.part, report.demonstrations) == (1, 3)


def test_a_motion_that_selects_its_part_but_is_led_elsewhere_is_not_kept(crossing):
    # Instantaneous: the goals of the two parts lie in each other's region, so no motion arrives.
    swapped = [replace(a, density=b.density) for a, b in zip(crossing, crossing[::-1], strict=True)]
    report = coverage(combine(swapped, gate="instantaneous"), [near([3.0, 0.0]), near([-3.0, 0.0])])
    assert [part.selected for part in report] == [1.0, 1.0]
    assert [part.kept for part in report] == [0.0, 0.0]


def test_a_motion_that_ends_right_by_chance_is_not_kept(make_skill):
    # The second part owns a disc around its attractor. A motion from beyond belongs to the first part, whose
    # straight way leads through that disc, where the second takes over. Without the demonstration from there
    # nothing is known of that way.
    def straight_to(place, variance):
        skill = make_skill(np.random.default_rng(6), n_components=1, attractor=place)
        density = GaussianMixture([1.0], [place], [variance * np.eye(2)])
        return replace(skill, system_matrices=-np.eye(2)[None], density=density)

    parts = [straight_to([0.0, 0.0], 25.0), straight_to([3.0, 0.0], 0.1)]
    _, second = coverage(
        combine(parts, gate="instantaneous"), [straight([1.0, 0.0]), straight([3.0, 0.0], [0.0, 3.0])]
    )
    assert (second.selected, second.kept) == (0.0, 0.0)
    ends = rollout(combine(parts, gate="instantaneous"), [[6.0, 0.0]], duration=20.0, period=0.01)
    assert np.linalg.norm(ends.positions[0, -1] - [3.0, 0.0]) < ARRIVAL_DISTANCE


def test_a_motion_that_does_not_arrive_in_time_is_not_kept(crossing):
    slow = [replace(part, speed=1e-3) for part in crossing]
    (first, _) = coverage(combine(slow), [near([0.5, 0.0]), near([0.0, 0.5])])
    assert (first.selected, first.kept) == (1.0, 0.0)


def test_coverage_needs_one_set_per_leaf(crossing):
    with pytest.raises(UsageError, match="demonstrations: expected 2 sets, got 1"):
        coverage(combine(crossing), [None])


def starts_along(axis, values):
    """Return demonstrations that start at the given coordinates of one axis and end at the origin."""
    times, share = np.linspace(0, 1, 20), np.linspace(1, 0, 20)[:, None]
    motions = tuple(Demonstration.from_positions(times, share * value * np.eye(2)[axis]) for value in values)
    return DemonstrationSet(motions, Euclidean.cartesian(2))


def selected(skill, sets):
    """Return the sum over parts of the share of starts that select them; no motion is followed."""
    return sum(
        np.mean(
            [skill.part_at(part.attractor[None] + m.positions[0] - m.positions[-1])[0] == i for m in taught]
        )
        for i, (part, taught) in enumerate(zip(skill.parts, sets, strict=True))
    )


def test_calibration_leaves_alone_what_is_right_and_wins_what_can_be_won(crossing):
    skill = combine(crossing, part_priors=[3, 1])
    right = [starts_along(0, [0.5]), starts_along(1, [0.5])]
    assert selected(skill, right) == 2
    assert np.abs(calibrated_priors(skill, right) - [0.75, 0.25]).max() <= 4 * np.finfo(float).eps
    biased = combine(crossing, part_priors=[1e-9, 1])
    assert selected(biased, right) == 1
    assert selected(replace(biased, part_priors=calibrated_priors(biased, right)), right) == 2


def test_calibration_needs_demonstrations(crossing):
    with pytest.raises(UsageError, match="carry no demonstrations"):
        calibrated_priors(combine(crossing), [None, None])


def test_targets_that_one_cannot_tell_apart_are_named(crossing):
    # Both densities are circles of a standard deviation of 0.5: their boxes have a diagonal of 2 √2.
    tolerance = 0.02 * 2 * np.sqrt(2)
    left, right = (replace(part, attractor=np.zeros(2)) for part in crossing)
    near, far = (retargeted(right, [gap * tolerance, 0.0]) for gap in (0.99, 1.01))
    ((first, second, gap),) = same_targets(combine([left, near]))
    assert (first, second) == (1, 2)
    assert gap == pytest.approx(0.99 * tolerance)
    assert same_targets(combine([left, far])) == same_targets(combine([left, right])) == ()
