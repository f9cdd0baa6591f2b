"""A merger takes as long as was demonstrated, as far as the proof of its parts allows."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from skillctl.adapt import task as task_module
from skillctl.adapt.pace import PATIENCE, paced
from skillctl.adapt.task import fit_to_task
from skillctl.compose.merge import merge
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.space import Euclidean
from skillctl.stability.certificate import certify

READ = 0.02  # a time is read off to a step, of which there are 200 in a duration at least


@pytest.fixture
def parts(make_skill):
    """Return two linear skills, ξ̇ = −ξ and ξ̇ = −3 ξ; a mixture of equal weights decays with 2 1/s."""
    rng = np.random.default_rng(0)
    first = make_skill(rng, n_components=1)
    return [replace(first, attractor=np.zeros(2), system_matrices=-rate * np.eye(2)[None]) for rate in (1, 3)]


def decaying(rate: float, count: int = 3) -> DemonstrationSet:
    """Return demonstrations of ξ̇ = −rate ξ from starts in all directions, down to a thousandth of the way."""
    times = np.linspace(0, math.log(1e3) / rate, 2000)
    shown = [
        Demonstration.from_positions(
            times, np.exp(-rate * times)[:, None] * np.array([math.cos(angle), math.sin(angle)])
        )
        for angle in np.linspace(0, 2, count)
    ]
    return DemonstrationSet(tuple(shown), Euclidean.cartesian(2))


def test_a_merger_of_two_tempi_takes_the_mean_of_the_demonstrated_times(parts):
    # Exponentials are near after ln(1/NEAR)/rate: 1 and 1/3 of ln(1/NEAR), of which the mean is 2/3.
    found = paced(merge(parts), [decaying(1.0), decaying(3.0)])
    assert 2 * found.skill.speed == pytest.approx(1.5, rel=READ)
    assert found.late == 1


def test_sets_count_by_their_shares(parts):
    found = paced(merge(parts), [decaying(1.0), decaying(3.0)], [3, 1])
    assert 2 * found.skill.speed == pytest.approx(1 / (0.75 + 0.25 / 3), rel=READ)


@pytest.mark.parametrize("speed", [0.01, 100.0])
def test_a_motion_that_is_far_too_slow_or_too_fast_is_paced_as_well(parts, speed):
    found = paced(replace(merge(parts), speed=speed), [decaying(2.0)])
    assert 0.01 * PATIENCE**2 * 2 < 1  # so that one round would not do
    assert found.skill.speed == pytest.approx(1.0, rel=2 * READ)


def test_the_proved_period_limits_the_speed_which_is_told(parts):
    merged = merge(parts)
    longest = certify(parts[1]).period  # of the faster part
    found = paced(merged, [decaying(20.0)], period=longest / 2)
    assert found.skill.speed == pytest.approx(2.0, rel=1e-2)
    assert found.late == pytest.approx(10 / 2, rel=READ)
    assert certify(found.skill).period >= longest / 2 * (1 - 1e-3)  # certified in few digits, rounded down
    relaxed = paced(merged, [decaying(20.0)], period=longest / 50)
    assert relaxed.skill.speed == pytest.approx(10.0, rel=READ)
    assert relaxed.late == 1


def test_a_candidate_that_would_be_late_is_not_chosen(parts, monkeypatch):
    shown = decaying(2.0, count=1)

    def hindered(skill, *arguments, **options):
        found = paced(skill, *arguments, **options)
        return replace(found, late=1.0 if len(skill.parts) == 1 else 2.0)

    assert fit_to_task(parts, shown, parts[0].lyapunov).late == 1
    monkeypatch.setattr(task_module, "paced", hindered)
    chosen = fit_to_task(parts, shown, parts[0].lyapunov)
    assert (len(chosen.skill.parts), chosen.late) == (1, 1)
    monkeypatch.setattr(task_module, "paced", lambda *given: replace(paced(*given), late=2.0))
    assert fit_to_task(parts, shown, parts[0].lyapunov).late == 2  # all are late: then the nearest
