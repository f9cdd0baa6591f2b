"""Weights fitted to a task: recovered where they are known, optimal where they are not, always positive."""

from dataclasses import replace

import numpy as np
import pytest

from skillctl.adapt.follow import scaled_components
from skillctl.adapt.weights import fit_velocities, most_helpful
from skillctl.compose.merge import merge
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.merged import MergedSkill
from skillctl.model.retarget import retargeted
from skillctl.model.space import Euclidean

EPS = np.finfo(float).eps


@pytest.fixture
def parts(make_skill):
    rng = np.random.default_rng(1)
    return [make_skill(rng, n_components=k, attractor=rng.normal(0, 0.3, 2)) for k in (2, 3, 4)]


def shown(field, starts, end):
    """Return demonstrations along straight lines to ``end``, with the velocities of a field given there."""
    times = np.linspace(0, 1, 30)
    share = np.linspace(1, 0, 30)[:, None]
    motions = []
    for start in starts:
        positions = end + share * (np.asarray(start) - end)
        motions.append(Demonstration(times, positions, field(positions)))
    return DemonstrationSet(tuple(motions), Euclidean.cartesian(2))


STARTS = [[0.4, 0.1], [-0.2, 0.3], [0.1, -0.4]]
END = np.array([0.05, 0.02])


def adapt(parts, task, end=END):
    """Fit parts that were moved to one end, as the search for a task does."""
    return fit_velocities([retargeted(part, end) for part in parts], task)


def moved(part):
    return part.translated(END - part.attractor)


def test_known_weights_are_recovered_and_their_sum_is_the_speed(parts):
    truth = np.array([0.3, 0.9, 0.2])
    task = shown(
        lambda x: sum(w * moved(p).velocity(x) for w, p in zip(truth, parts, strict=True)), STARTS, END
    )
    fitted = adapt(parts, task)
    # An exact least-squares problem, right up to its condition times rounding
    assert np.abs(fitted.weights - truth).max() <= 1e6 * EPS
    assert len(fitted.skill.parts) == 3
    assert fitted.skill.speed == pytest.approx(1.4, rel=1e6 * EPS)
    assert np.abs(fitted.skill.attractor - END).max() <= 4 * EPS
    x = np.random.default_rng(2).normal(0, 0.2, (50, 2))
    expected = sum(w * moved(p).velocity(x) for w, p in zip(truth, parts, strict=True))
    assert np.abs(fitted.skill.velocity(x) - expected).max() <= 1e7 * EPS * np.abs(expected).max()


def test_a_part_that_does_not_help_is_left_out(parts):
    task = shown(lambda x: moved(parts[0]).velocity(x) - 0.3 * moved(parts[1]).velocity(x), STARTS, END)
    fitted = adapt(parts[:2], task)
    assert fitted.weights[0] > 0
    assert fitted.weights[1] == 0
    assert len(fitted.skill.parts) == 1


def test_the_weights_are_optimal_among_all_that_are_not_negative(parts):
    rng = np.random.default_rng(3)
    for _ in range(20):
        noise = rng.normal(0, 0.2, (30, 2))
        task = shown(lambda x, noise=noise: moved(parts[0]).velocity(x) + noise, STARTS[:1], END)
        (motion,) = task
        weights = adapt(parts, task).weights
        fields = np.stack([moved(p).velocity(motion.positions) for p in parts])
        residual = np.tensordot(weights, fields, axes=1) - motion.velocities
        slopes = np.einsum("mnd,nd->m", fields, residual)
        # Karush–Kuhn–Tucker: no slope where a weight is positive, none downhill where it is zero
        tolerance = 1e-9 * np.einsum("mnd,mnd->m", fields, fields).max()
        assert (np.abs(slopes[weights > 0]) <= tolerance).all()
        assert (slopes[weights == 0] >= -tolerance).all()


def test_demonstrations_count_alike_whatever_their_length(parts):
    def sampled(motion, count):
        index = np.linspace(0, 29, count).round().astype(int)
        return Demonstration(np.arange(float(count)), motion.positions[index], motion.velocities[index])

    task = shown(lambda x: moved(parts[0]).velocity(x) + 0.1, STARTS[:2], END)
    first, second = task
    doubled = Demonstration(
        np.arange(60.0), np.repeat(second.positions, 2, axis=0), np.repeat(second.velocities, 2, axis=0)
    )
    even = adapt(parts, task).weights
    uneven = adapt(parts, DemonstrationSet((first, doubled), task.space)).weights
    assert np.abs(even - uneven).max() <= 1e6 * EPS


def test_where_the_task_was_shown_does_not_matter(parts):
    task = shown(lambda x: moved(parts[0]).velocity(x) + 0.5 * moved(parts[2]).velocity(x), STARTS, END)
    elsewhere = adapt(parts, task.translated(np.array([5.0, -3.0])), end=[1.0, 1.0])
    assert np.abs(elsewhere.weights - adapt(parts, task).weights).max() <= 1e7 * EPS
    assert elsewhere.skill.attractor.tolist() == [1.0, 1.0]


def test_factors_reach_the_leaves_of_merged_parts(parts):
    nested = merge([merge(parts[:2], gate="experts", parameters={"sharpness": 2.0}, speed=1.5), parts[2]])
    factors = np.arange(1.0, 6.0)  # of the two and three components of the parts merged first
    scaled = scaled_components(nested.parts[0], factors)
    assert isinstance(scaled, MergedSkill)
    before = np.concatenate([leaf.system_matrices for leaf in nested.parts[0].leaves])
    after = np.concatenate([leaf.system_matrices for leaf in scaled.leaves])
    assert (after == factors[:, None, None] * before).all()
    given = np.concatenate([leaf.residual_covariances for leaf in nested.parts[0].leaves])
    spread = np.concatenate([leaf.residual_covariances for leaf in scaled.leaves])
    assert (spread == factors[:, None, None] ** 2 * given).all()  # of a velocity: with the factor squared


def test_the_parts_that_move_most_along_with_a_task_are_kept(parts, make_skill):
    several = [*parts, make_skill(np.random.default_rng(9), n_components=2, speed=50.0)]
    weights = np.array([0.5, 0.1, 0.8, 0.0005])  # the last is the fastest, and moves least
    task = shown(
        lambda x: sum(w * moved(p).velocity(x) for w, p in zip(weights, several, strict=True)), STARTS, END
    )
    states = np.vstack([m.positions for m in task])
    share = [w * np.linalg.norm(moved(p).velocity(states)) for w, p in zip(weights, several, strict=True)]
    by_share = np.argsort(share)[::-1]
    assert by_share[-1] == 3
    assert np.argmax(np.divide(share, weights)) == 3
    assert most_helpful(several, task, 4) == (0, 1, 2, 3)
    assert most_helpful(several, task, 3) == (0, 1, 2)
    assert most_helpful(several, task, 1) == (int(by_share[0]),)
    assert most_helpful(several[:1], shown(lambda x: x - END, STARTS, END), 1) == ()


def test_parts_that_all_move_away_give_no_merger(parts):
    task = shown(lambda x: -moved(parts[0]).velocity(x), STARTS, END)  # away from the target
    assert adapt(parts[:1] * 2, task) is None


@pytest.mark.parametrize("most", [1, 2])
def test_of_parts_that_help_alike_only_one_is_dropped_at_a_time(make_skill, most):
    # Each part moves along its own axis, and the task along the diagonal: all three help alike, to the bit.
    seed = make_skill(np.random.default_rng(0), dimension=3, n_components=1, attractor=[0.0, 0.0, 0.0])
    parts = [replace(seed, system_matrices=-np.diag(axis)[None]) for axis in np.eye(3)]
    positions = np.linspace([1.0, 1.0, 1.0], [0.0, 0.0, 0.0], 20)
    motion = Demonstration(np.linspace(0, 1, 20), positions, -np.ones((20, 3)))
    helpful = most_helpful(parts, DemonstrationSet((motion,), seed.space), most)
    assert len(helpful) == most
