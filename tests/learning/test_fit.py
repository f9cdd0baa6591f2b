from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from skillctl.errors import UsageError
from skillctl.learning.fit import LATE_GAIN, Distance, _unfinished, fit, learned_distance
from skillctl.learning.options import LearnOptions, Preset
from skillctl.learning.outcome import Result, StageResult
from skillctl.learning.select import component_limit
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.rollout import rollout
from skillctl.model.seds import SedsSkill
from skillctl.model.space import Euclidean

Curved = Callable[..., DemonstrationSet]
FAST = LearnOptions(preset="fast", n_components=4)


def mean_distance(skill: SedsSkill, demonstrations: DemonstrationSet) -> float:
    """Mean distance of demonstration points to the rollout from their start, in the space's unit."""
    starts = np.stack([d.positions[0] for d in demonstrations])
    duration = 5 * max(d.duration for d in demonstrations)
    rollouts = rollout(skill, starts, duration=duration, period=0.005, arrival_distance=1e-3)
    assert rollouts.arrived.all()
    distances = []
    for index, demonstration in enumerate(demonstrations):
        path = rollouts.trajectory(index)[1]
        gaps = np.linalg.norm(demonstration.positions[:, None] - path[None], axis=2)
        distances.append(gaps.min(axis=1).mean())
    return float(np.mean(distances))


def worst_slack(skill: SedsSkill) -> float:
    product = skill.lyapunov @ skill.system_matrices
    return float(np.linalg.eigvalsh(-0.5 * (product + product.swapaxes(1, 2))).min())


@pytest.mark.parametrize("name", ["Sshape", "GShape", "Angle"])
def test_handwriting_is_reproduced_within_millimetres_and_stable(
    lasa: Callable[[str], DemonstrationSet], name: str
) -> None:
    demonstrations = lasa(name)
    result = fit(demonstrations)
    assert worst_slack(result.skill) > 0
    # Two demonstrations of one motion differ by 2.1 mm on average; the motion's own bound is added.
    assert mean_distance(result.skill, result.demonstrations) < 2.1e-3 + result.deviation_bound


@pytest.mark.parametrize("period", [0.002, 0.01, 0.05])
def test_the_skill_is_stable_under_a_controller_of_the_period_asked_for(
    curved: Curved, period: float
) -> None:
    skill = fit(curved(), LearnOptions(preset="fast", period=period)).skill
    step = np.eye(2) + period * skill.system_matrices
    change = step.swapaxes(1, 2) @ skill.lyapunov @ step - skill.lyapunov  # V after one step minus V
    assert np.linalg.eigvalsh(change).max() < 0


def test_the_euclidean_metric_is_the_papers_condition(curved: Curved) -> None:
    result = fit(curved(), LearnOptions(metric="euclidean", preset="fast"))
    np.testing.assert_array_equal(result.skill.lyapunov, np.eye(2))
    symmetric = result.skill.system_matrices + result.skill.system_matrices.swapaxes(1, 2)
    assert np.linalg.eigvalsh(symmetric).max() < 0  # Eq. 5


@pytest.mark.parametrize("objective", ["likelihood", "mse", "reproduction"])
def test_every_objective_gives_a_stable_skill_that_arrives(curved: Curved, objective: str) -> None:
    result = fit(curved(), LearnOptions(objective=objective, preset="fast"))
    assert worst_slack(result.skill) > 0
    assert mean_distance(result.skill, result.demonstrations) < 0.05 * curved().extent


def test_reproduction_follows_the_motion_closer_than_velocities_alone(
    lasa: Callable[[str], DemonstrationSet],
) -> None:
    demonstrations = lasa("Sshape")
    results = {name: fit(demonstrations, LearnOptions(objective=name)) for name in ("mse", "reproduction")}
    distances = {name: mean_distance(r.skill, r.demonstrations) for name, r in results.items()}
    assert distances["reproduction"] < distances["mse"]


@pytest.mark.parametrize("motion", ["Sshape", "GShape", "Zshape"])
def test_a_field_is_slow_where_there_are_no_data(
    lasa: Callable[[str], DemonstrationSet], motion: str
) -> None:
    shown = lasa(motion)
    skill = fit(shown).skill
    points = np.vstack([d.positions for d in shown])
    low, high = points.min(axis=0), points.max(axis=0)
    grid = np.stack(np.meshgrid(*np.linspace(2 * low - high, 2 * high - low, 40).T), axis=-1).reshape(-1, 2)
    fastest = max(np.linalg.norm(d.velocities, axis=1).max() for d in shown)
    # Up to one extent beside the data a motion may be some times as fast as any shown, as it may have as many
    # times as far to go. Without the ridge it was hundreds of times as fast.
    assert np.linalg.norm(skill.velocity(grid), axis=1).max() < 10 * fastest
    assert np.abs(np.linalg.eigvals(skill.component_matrices)).max() * shown.demonstrations[0].duration < 50


@pytest.mark.parametrize("dimension", [1, 2, 3, 7])
def test_any_dimension_can_be_learned(curved: Curved, dimension: int) -> None:
    demonstrations = curved(dimension=dimension)
    result = fit(demonstrations, LearnOptions(preset="fast"))
    assert result.skill.dimension == dimension
    assert mean_distance(result.skill, result.demonstrations) < 0.05 * demonstrations.extent


def test_one_demonstration_is_enough(curved: Curved) -> None:
    result = fit(curved(count=1), LearnOptions(preset="fast"))
    assert mean_distance(result.skill, result.demonstrations) < 0.03 * curved(count=1).extent


def test_the_unit_of_the_data_changes_nothing_but_the_unit(curved: Curved) -> None:
    metres, millimetres = fit(curved(), FAST).skill, fit(curved(scale=1e3), FAST).skill
    states = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 2))
    # Rounding differs; a few dozen optimiser steps amplify it.
    np.testing.assert_allclose(millimetres.velocity(1e3 * states), 1e3 * metres.velocity(states), rtol=1e-4)


def test_moving_the_data_moves_the_skill(curved: Curved) -> None:
    offset = np.array([0.3, -1.2])
    here, there = fit(curved(), FAST).skill, fit(curved().translated(offset), FAST).skill
    states = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 2))
    np.testing.assert_allclose(there.attractor, here.attractor + offset, atol=1e-12)
    np.testing.assert_allclose(there.velocity(states + offset), here.velocity(states), rtol=1e-4, atol=1e-6)


def test_embedded_demonstrations_end_exactly_at_the_attractor(curved: Curved) -> None:
    result = fit(curved(), FAST)
    for demonstration in result.demonstrations:
        np.testing.assert_allclose(demonstration.positions[-1], result.skill.attractor, atol=1e-15)


def test_a_given_lyapunov_matrix_is_kept(curved: Curved) -> None:
    given = np.array([[2.0, 0.3], [0.3, 0.5]])
    result = fit(curved(), FAST, distance=Distance(given))
    np.testing.assert_array_equal(result.skill.lyapunov, given)
    assert worst_slack(result.skill) > 0
    with pytest.raises(UsageError, match="lyapunov"):
        fit(curved(), FAST, distance=Distance(np.eye(3)))


def test_one_metric_can_serve_several_motions(curved: Curved) -> None:
    distance = learned_distance([curved(seed=0), curved(seed=1)])
    assert distance.lyapunov.shape == (2, 2)
    assert np.linalg.eigvalsh(distance.lyapunov).min() > 0


def test_more_components_than_the_data_carry_are_refused(curved: Curved) -> None:
    short = curved(count=1, samples=20)
    limit = component_limit(short)
    assert limit == 2
    with pytest.raises(UsageError, match=r"9 is more than .* \(\d\)") as caught:
        fit(short, LearnOptions(n_components=9))
    assert "--components" in caught.value.hint
    assert fit(short, LearnOptions(preset="fast")).skill.n_components <= limit


def test_one_long_demonstration_carries_the_usual_number_of_components(curved: Curved) -> None:
    result = fit(curved(dimension=3, count=1, samples=500), LearnOptions(preset="fast"))
    assert result.skill.n_components == 7


@pytest.mark.parametrize("count", [1, 4])
def test_components_can_be_selected(curved: Curved, count: int) -> None:
    straight = [Demonstration.from_positions(d.times, d.positions[:, :1]) for d in curved(count=count)]
    line = DemonstrationSet(tuple(straight), Euclidean.cartesian(1))
    result = fit(line, LearnOptions(n_components="auto", preset="fast"))
    assert 1 <= result.skill.n_components <= 10


@pytest.mark.parametrize(("name", "metrics"), [("Angle", 1), ("GShape", 2)])
def test_only_a_motion_that_contradicts_its_metric_is_learned_with_a_stretched_one_too(
    lasa: Callable[[str], DemonstrationSet], name: str, metrics: int
) -> None:
    seen: list[tuple[str, int, int]] = []
    plain = replace(FAST, coordinates="identity")
    fit(lasa(name), plain, progress=lambda *step: seen.append(step))
    assert [step[:2] for step in seen].count(("mixtures", 1)) == metrics


def test_progress_is_told_and_ends(curved: Curved) -> None:
    seen: list[tuple[str, int, int]] = []
    fit(curved(), FAST, progress=lambda *step: seen.append(step))
    assert [stage.split(",")[0] for stage, done, _ in seen if done == 1] == [
        "mixtures",
        "start 1 of 1",
        "polish",
    ]
    assert seen[-1][1] == seen[-1][2]


def test_a_motion_that_contradicts_the_metric_is_warned_about(
    lasa: Callable[[str], DemonstrationSet],
) -> None:
    result = fit(lasa("Leaf_1"), LearnOptions(metric="euclidean", coordinates="identity", preset="fast"))
    (warning,) = result.warnings
    assert "V would have to grow" in warning
    assert "--metric learned" in warning
    assert fit(lasa("Line")).warnings == ()


@pytest.mark.parametrize(
    ("options", "stages"),
    [
        ({"objective": "likelihood"}, ["metric", "mixture"]),
        ({"objective": "mse"}, ["metric", "polish"]),
        ({"metric": "euclidean"}, ["polish"]),
    ],
)
def test_a_fit_says_how_its_stages_ended(curved: Curved, options: dict[str, str], stages: list[str]) -> None:
    result = fit(curved(), replace(FAST, **options))
    assert [stage.stage for stage in result.results] == stages
    assert result.converged is (result.results[-1].result is Result.CONVERGED)
    if result.results[-1].result is Result.OUT_OF_STEPS:
        assert result.results[-1].steps == FAST.effort.polish_steps


def test_a_fit_that_runs_out_of_steps_while_it_still_gains_is_warned_about(
    lasa: Callable[[str], DemonstrationSet],
) -> None:
    result = fit(lasa("Multi_Models_2"), LearnOptions(preset="fast"))
    (warning,) = result.warnings
    last = result.results[-1]
    assert not result.converged
    assert last.late_gain is not None
    assert warning == (
        f"the optimiser used all of its 12 steps, and the last three still lowered the objective by "
        f"{last.late_gain:.1%}; --preset default takes more."
    )


@pytest.mark.parametrize(
    ("last", "preset", "words"),
    [
        (StageResult("polish", Result.OUT_OF_STEPS, 60, 0.5), "quality", "lowered the objective by 50.0%."),
        (StageResult("polish", Result.OUT_OF_STEPS, 30, 0.5), "default", "; --preset quality takes more."),
        (
            StageResult("mixture", Result.OUT_OF_STEPS, 200),
            "fast",
            "not converged after its 200 steps.",
        ),
        (StageResult("polish", Result.OUT_OF_STEPS, 30, LATE_GAIN), "default", None),
        (StageResult("polish", Result.NO_BETTER_STEP, 4, 0.5), "default", None),
        (StageResult("polish", Result.CONVERGED, 4, 0.5), "default", None),
    ],
)
def test_only_a_fit_that_more_steps_would_improve_is_warned_about(
    last: StageResult, preset: Preset, words: str | None
) -> None:
    warnings = _unfinished(last, preset)
    assert len(warnings) == (words is not None)
    assert words is None or warnings[0].endswith(words)


@pytest.mark.parametrize(
    "options",
    [
        {"objective": "speed"},
        {"metric": "l2"},
        {"preset": "slow"},
        {"n_components": 0},
        {"seed": -1},
        {"period": -0.1},
    ],
)
def test_bad_options_are_named(options: dict[str, object]) -> None:
    with pytest.raises(UsageError):
        LearnOptions(**options)


SCRIPT = """
import hashlib, numpy as np
from skillctl.learning.fit import fit
from skillctl.learning.options import LearnOptions
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.space import Euclidean
t = np.linspace(0, 1, 80)[:, None]
g = np.random.default_rng(0)
demos = [Demonstration.from_positions(t[:, 0], (1 - t**2) * g.normal(1, 0.1, 3) + 0.1 * np.sin(3 * t))
         for _ in range(3)]
s = fit(DemonstrationSet(tuple(demos), Euclidean.cartesian(3)), LearnOptions(preset="fast")).skill
print(hashlib.sha256(s.system_matrices.tobytes() + s.means.tobytes() + s.priors.tobytes()).hexdigest())
"""


def test_the_same_input_gives_the_same_bytes_in_any_process_and_with_any_thread_count() -> None:
    digests = set()
    for threads, hash_seed in (("1", "0"), ("2", "1")):
        environment = os.environ | {"OPENBLAS_NUM_THREADS": threads, "PYTHONHASHSEED": hash_seed}
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, check=True
        )
        digests.add(done.stdout)
    assert len(digests) == 1
