"""Weights fitted to a task: recovered where they are known, optimal where they are not, always positive."""

from dataclasses import replace

import numpy as np
import pytest

from skillctl.compose import NoCommonLyapunovError, adapt, merge
from skillctl.errors import FitError, UsageError
from skillctl.model import Demonstration, DemonstrationSet, MergedSkill, StateSpace, rollout
from skillctl.model.contraction import decay_rates

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
    return DemonstrationSet(tuple(motions), StateSpace.cartesian(2))


STARTS = [[0.4, 0.1], [-0.2, 0.3], [0.1, -0.4]]
END = np.array([0.05, 0.02])


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
    assert fitted.used == (0, 1, 2)
    assert fitted.skill.speed == pytest.approx(1.4, rel=1e6 * EPS)
    assert np.abs(fitted.skill.attractor - END).max() <= 4 * EPS
    x = np.random.default_rng(2).normal(0, 0.2, (50, 2))
    expected = sum(w * moved(p).velocity(x) for w, p in zip(truth, parts, strict=True))
    assert np.abs(fitted.skill.velocity(x) - expected).max() <= 1e7 * EPS * np.abs(expected).max()


def test_a_part_that_does_not_help_is_left_out(parts):
    task = shown(lambda x: moved(parts[0]).velocity(x) - 0.3 * moved(parts[1]).velocity(x), STARTS, END)
    fitted = adapt(parts[:2], task)
    assert fitted.used == (0,)
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
    elsewhere = adapt(parts, task.translated(np.array([5.0, -3.0])), target=[1.0, 1.0])
    assert np.abs(elsewhere.weights - adapt(parts, task).weights).max() <= 1e7 * EPS
    assert elsewhere.skill.attractor.tolist() == [1.0, 1.0]


def test_factors_of_components_come_nearer_and_stay_positive(parts):
    rng = np.random.default_rng(4)
    factors = [rng.uniform(0.2, 3.0, part.n_components) for part in parts]
    truth = [
        replace(moved(p), system_matrices=p.system_matrices * f[:, None, None])
        for p, f in zip(parts, factors, strict=True)
    ]
    task = shown(lambda x: sum(0.5 * part.velocity(x) for part in truth), STARTS, END)

    def error(fitted):
        return np.sqrt(
            np.mean([np.square(fitted.skill.velocity(m.positions) - m.velocities).sum() for m in task])
        )

    per_part, per_component = adapt(parts, task), adapt(parts, task, level="component")
    # Factors of one are among the choices; without a pull the truth is.
    assert error(per_component) < error(per_part)
    assert error(adapt(parts, task, level="component", pull=0.0)) < 1e-9 * error(per_part)
    assert (per_component.weights == per_part.weights).all()
    assert decay_rates(per_component.skill.lyapunov, per_component.skill.component_matrices).min() > 0


def test_without_pull_the_factors_of_the_truth_are_found_and_with_much_none_moves(parts):
    part, other = parts[1], parts[2]
    factors = np.array([0.5, 2.0, 1.2])
    scaled = replace(moved(part), system_matrices=part.system_matrices * factors[:, None, None])
    task = shown(lambda x: scaled.velocity(x) + moved(other).velocity(x), STARTS, END)
    weights = adapt([part, other], task).weights
    for pull, expected in ((1e-14, factors), (1e12, weights[0] * np.ones(3))):
        fitted = adapt([part, other], task, level="component", pull=pull)
        matrices = weights[0] * fitted.skill.leaves[0].system_matrices
        found = matrices[:, 0, 0] / part.system_matrices[:, 0, 0]
        assert np.abs(found - expected).max() < 1e-3


def test_a_component_never_loses_all_its_weight(parts):
    part, other = parts[1], parts[2]
    signs = np.array([1.0, -1.0, 1.0])  # the task wants the second component backwards
    turned = replace(moved(part), system_matrices=part.system_matrices * signs[:, None, None])
    task = shown(lambda x: turned.velocity(x) + moved(other).velocity(x), STARTS, END)
    fitted = adapt([part, other], task, level="component", pull=0.0)
    factors = fitted.skill.leaves[0].system_matrices[:, 0, 0] / part.system_matrices[:, 0, 0]
    assert factors.min() == pytest.approx(0.05, rel=8 * EPS)
    assert decay_rates(np.eye(2), fitted.skill.component_matrices).min() > 0


def test_factors_reach_the_leaves_of_merged_parts(parts):
    nested = merge([merge(parts[:2], gate="experts", sharpness=2.0, speed=1.5), parts[2]])
    task = shown(lambda x: 0.8 * moved(nested).velocity(x) + 0.01, STARTS, END)
    fitted = adapt(nested.parts, task, level="component")
    assert isinstance(fitted.skill.parts[0], MergedSkill)
    before = np.concatenate([leaf.system_matrices for leaf in nested.leaves])
    after = np.concatenate([leaf.system_matrices for leaf in fitted.skill.leaves])
    ratios = after / before
    assert np.abs(ratios - ratios[:, :1, :1]).max() <= 16 * EPS * np.abs(ratios).max()  # one factor each
    assert (ratios > 0).all()
    residuals = [leaf.residual_covariances for leaf in fitted.skill.leaves]
    given = [leaf.residual_covariances for leaf in nested.leaves]
    spread = np.concatenate(residuals) / np.concatenate(given)  # of a velocity: with the factor squared
    assert np.abs(spread - ratios[:, :1, :1] ** 2).max() <= 64 * EPS * np.square(ratios).max()
    starts = np.array(STARTS)
    assert rollout(fitted.skill, starts, duration=200.0, period=0.002).arrived.all()


def test_what_cannot_be_fitted_is_refused_in_a_sentence(parts, make_skill):
    task = shown(lambda x: -moved(parts[0]).velocity(x), STARTS, END)  # away from the target
    with pytest.raises(FitError, match="no mixture of these skills moves along"):
        adapt(parts[:1] * 2, task)
    with pytest.raises(UsageError, match="fit level: one of part, component, not 'joint'"):
        adapt(parts, task, level="joint")
    with pytest.raises(UsageError, match="pull: must not be negative, got -1"):
        adapt(parts, task, pull=-1.0)
    solid = [make_skill(np.random.default_rng(0), dimension=3) for _ in range(2)]
    with pytest.raises(UsageError, match="the demonstrations have 2 dimensions, the skills 3"):
        adapt(solid, task)
    with pytest.raises(UsageError, match="needs at least two skills"):
        adapt(parts[:1], task)
    with pytest.raises(UsageError, match="target: expected 2 finite numbers"):
        adapt(parts, task, target=[1.0])
    with pytest.raises(NoCommonLyapunovError):
        adapt([parts[0], replace(parts[1], lyapunov=2 * np.eye(2))], task)
