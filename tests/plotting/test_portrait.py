"""What figures show: motions that start where they should, within a box that holds what matters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skillctl.model.space import Euclidean
from skillctl.plotting.portrait import POINTS, Scale, box_around, motions_from, portrait_of


@pytest.mark.parametrize("dimension", [1, 2, 3, 7])
def test_every_demonstration_has_a_motion_from_its_start(portrait, dimension):
    shown = portrait(dimension)
    assert len(shown.motions) == len(shown.demonstrations) == 3
    for motion, demonstration in zip(shown.motions, shown.demonstrations, strict=True):
        assert (motion.positions[0] == demonstration.positions[0]).all()
        assert len(motion.times) == len(motion.positions) <= POINTS


def test_without_demonstrations_motions_start_in_the_middle_of_what_was_taught(portrait):
    shown = portrait(2, demonstrations=False)
    assert shown.demonstrations == ()
    assert (np.array([m.positions[0] for m in shown.motions]) == shown.skill.density.means).all()


@pytest.mark.parametrize("kind", ["learned", "merged", "combined"])
def test_the_box_holds_demonstrations_and_attractors(portrait, kind):
    shown = portrait(3, kind=kind)
    inside = np.vstack([shown.goals, *(d.positions for d in shown.demonstrations)])
    assert (shown.low < inside).all()
    assert (inside < shown.high).all()


def test_a_box_is_never_a_line():
    low, high = box_around(np.array([[0.0, 1.0], [1.0, 1.0]]))
    assert high[1] - low[1] > 0.5
    assert 0.5 * (low + high)[1] == 1.0


def test_a_skill_that_diverges_stays_within_bounds(portrait):
    stable = portrait(2)
    wild = replace(stable.skill, system_matrices=-1e3 * stable.skill.system_matrices)
    shown = portrait_of("wild", wild, [None])
    assert all(np.isfinite(motion.positions).all() for motion in shown.motions)
    span = stable.high - stable.low
    assert (shown.high - shown.low < 10 * span).all()


def test_a_motion_that_is_stiff_and_slow_costs_a_bounded_number_of_steps(portrait, monkeypatch):
    monkeypatch.setattr("skillctl.plotting.portrait.MOST_STEPS", 300)
    stiff = replace(
        portrait(2).skill, system_matrices=np.stack([np.diag([-1e5, -1e-3])] * 3), lyapunov=np.eye(2)
    )
    (motion,) = motions_from(stiff, np.array([[0.1, 0.1]]), longest=10.0)
    assert motion.times[-1] == pytest.approx(300 * 0.25 / 1e5)


def test_a_motion_knows_its_speed(portrait):
    motion = portrait(2).motions[0]
    middle = len(motion.times) // 4
    expected = np.linalg.norm(portrait(2).skill.velocity(motion.positions[middle]))
    # Differences over twice the spacing of the drawn points: good to a few per cent where nothing bends.
    assert motion.speeds[middle] == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(
    ("unit", "extent", "told"),
    [("m", 0.1, (1e3, "mm")), ("m", 1.0, (1.0, "m")), ("rad", 0.1, (1.0, "rad"))],
)
def test_small_lengths_are_told_in_millimetres_and_angles_never(unit, extent, told):
    scale = Scale.of(Euclidean(("x", "y"), unit=unit), extent)
    assert (scale.factor, scale.unit) == told
