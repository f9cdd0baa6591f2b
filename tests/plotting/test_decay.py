"""The decay rate of figures against V itself, differentiated along motions, and against what is proved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skillctl.model.lyapunov import QuadraticForm
from skillctl.plotting.proof import Bounds, decay, draw_proofs


def test_one_linear_component_decays_at_its_own_rate_everywhere(make_skill):
    skill = make_skill(np.random.default_rng(0), n_components=1)
    linear = replace(skill, system_matrices=np.array([-2.0 * np.eye(2)]), lyapunov=np.diag([1.0, 5.0]))
    places = np.random.default_rng(1).normal(size=(20, 2))
    # eᵀP(−2e) / eᵀPe: a quotient of equal sums, each rounded a few times.
    assert decay(linear, places) == pytest.approx(2.0, rel=20 * np.finfo(float).eps)


@pytest.mark.parametrize("kind", ["learned", "merged", "combined"])
def test_it_is_the_logarithmic_derivative_of_the_distance(portrait, kind):
    skill = portrait(3, kind=kind).skill
    places = np.random.default_rng(2).normal(0, 0.3, (50, 3))
    parts = skill.part_at(places) if kind == "combined" else np.zeros(50, dtype=int)
    members = skill.parts if kind == "combined" else (skill,)
    step = 1e-6  # [s]: the error of the central difference is of order step², 1e-12, above rounding / step
    velocities = skill.velocity(places)

    def logarithm(x):
        return np.array(
            [
                0.5 * np.log((e - members[i].attractor) @ members[i].lyapunov @ (e - members[i].attractor))
                for e, i in zip(x, parts, strict=True)
            ]
        )

    slope = (logarithm(places + step * velocities) - logarithm(places - step * velocities)) / (2 * step)
    scale = np.abs(slope).max()
    assert decay(skill, places) == pytest.approx(-slope, abs=1e-6 * scale)


def test_no_place_decays_slower_than_the_components(portrait):
    skill = portrait(2).skill
    places = np.random.default_rng(3).uniform(-1, 1, (2000, 2))
    slowest = QuadraticForm(skill.lyapunov).rates(skill.component_matrices).min()
    assert decay(skill, places).min() >= slowest * (1 - 1e-9)


def test_it_is_negative_where_the_distance_grows_and_unknown_at_the_attractor(portrait):
    skill = portrait(2).skill
    growing = replace(skill, system_matrices=-skill.system_matrices)
    rates = decay(growing, np.array([[0.1, 0.2], skill.attractor]))
    assert rates[0] < 0
    assert np.isnan(rates[1])


def test_distances_are_in_the_norm_of_the_part_that_acted(portrait):
    shown = portrait(2, kind="combined")
    figure = draw_proofs([(shown, Bounds("stable", (None,), (None, None), None))])
    courses = next(axes for axes in figure.axes if axes.get_yscale() == "log" and axes.get_lines())
    for motion, line in zip(shown.motions, courses.get_lines(), strict=True):
        part = shown.skill.parts[motion.part]
        offsets = motion.positions - part.attractor
        values = np.einsum("ti,ij,tj->t", offsets, part.lyapunov, offsets)
        shares = np.asarray(line.get_ydata(), dtype=np.float64)
        # V is a sum of four products, none much larger than it; then come a root, a quotient and a square.
        assert shares**2 == pytest.approx(values / values[0], rel=64 * np.finfo(np.float64).eps)
        assert shares[-1] < 1e-2  # it arrived at the attractor of that part
