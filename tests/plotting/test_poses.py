"""Figures of skills of poses: positions as of any skill in space, the hand's axes, its angle over time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skillctl.model.combined import CombinedSkill
from skillctl.plotting import style
from skillctl.plotting.fit import draw_fit
from skillctl.plotting.panels import HAND, HANDS
from skillctl.plotting.portrait import portrait_of
from skillctl.plotting.proof import Bounds, draw_proofs
from skillctl.plotting.skill import draw_family, draw_skill

COLOURS = [line["color"] for line in style.AXES.values()]


@pytest.fixture(scope="module")
def grasp(make_grasp, make_grasp_motions):
    skill = make_grasp()
    return portrait_of("grasp", skill, [make_grasp_motions(skill)])


def turned(states, target):
    """Return the angles from a target in degrees, by SciPy."""
    return np.degrees(
        (
            Rotation.from_rotvec(target[3:].copy()).inv() * Rotation.from_rotvec(states[:, 3:].copy())
        ).magnitude()
    )


def test_the_box_holds_positions_and_speeds_are_those_of_positions(grasp):
    assert grasp.low.shape == grasp.high.shape == (3,)
    for motion in grasp.motions:
        moved = np.linalg.norm(np.gradient(motion.positions[:, :3], axis=0), axis=1)
        middle = len(moved) // 2
        step = np.gradient(motion.times)[middle]
        # Only one of the two estimates weighs steps that differ by the rounding of indices.
        assert motion.speeds[middle] == pytest.approx(moved[middle] / step, rel=0.01)


def test_the_axes_of_the_hand_are_drawn_where_it_is(grasp, lines):
    above = draw_skill(grasp, "learned").axes[0]
    reach = HAND * float((grasp.high - grasp.low).max())
    for number, colour in enumerate(COLOURS):
        (drawn,) = lines(above, colour)
        x, y = drawn.get_data()
        assert len(x) == 3 * HANDS * len(grasp.motions)  # from, to, and a gap
        start = grasp.motions[0].positions[0]
        axis = Rotation.from_rotvec(start[3:]).as_matrix()[:2, number]
        assert [x[0], y[0]] == pytest.approx(start[:2])
        assert [x[1] - x[0], y[1] - y[0]] == pytest.approx(reach * axis)
        assert np.isnan(x[2])


def test_the_angle_from_the_target_is_drawn_over_time(grasp, lines, texts):
    figure = draw_skill(grasp, "learned")
    angles = figure.axes[3]
    motion, demonstration = grasp.motions[0], grasp.demonstrations[0]
    assert angles.get_ylabel() == "angle from target [°]"
    assert lines(angles, style.MOTION)[0].get_ydata() == pytest.approx(
        turned(motion.positions, grasp.goals[0]), abs=1e-6
    )
    assert lines(angles, style.DEMONSTRATION)[0].get_ydata() == pytest.approx(
        turned(demonstration.positions, grasp.goals[0]), abs=1e-6
    )
    assert "hand's z axis" in texts(figure)


def test_parts_with_other_orientations_have_their_own_angles(make_grasp, make_grasp_motions, lines):
    parts = make_grasp(), make_grasp((0.5, -0.1, 0.3, 0.0, 1.0, 0.0))
    both = CombinedSkill(parts, np.array([0.5, 0.5]))
    shown = portrait_of("both", both, [make_grasp_motions(part) for part in parts])
    angles = draw_skill(shown, "combined").axes[3]
    ends = [np.asarray(line.get_ydata())[-1] for line in angles.get_lines()]
    assert max(ends) < 1  # [°]: every motion ends where its own part ends


def test_a_fit_shows_angles_and_a_skill_left_out(grasp, lines):
    figure = draw_fit(grasp, [(0.001, 0.02)] * 3, grasp.motions)
    assert figure.axes[4].get_title().endswith("DTW 1.00 mm, 1.15°")
    assert [len(lines(axes, style.LEFT_OUT)) for axes in figure.axes[:4]] == [3] * 4
    assert figure.axes[3].get_ylabel() == "angle from target [°]"


def test_a_family_has_a_row_of_angles(grasp):
    figure = draw_family([(grasp, "weight 0.5")], (grasp, "merged"))
    assert [axes.get_ylabel() for axes in figure.axes].count("angle from target [°]") == 2


def test_a_proof_has_a_course_for_each_block_with_its_rate(grasp, lines):
    rates = 0.8, 0.6
    figure = draw_proofs([(grasp, Bounds("stable", rates, (None,), None))])
    courses = [axes for axes in figure.axes if axes.get_xlabel() == "time [s]"]
    assert len(courses) == 2
    for axes, rate in zip(courses, rates, strict=True):
        (proved,) = lines(axes, style.INK)
        times, shares = proved.get_data()
        assert shares == pytest.approx(np.exp(-rate * times))
    angles = turned(grasp.motions[0].positions, grasp.goals[0])
    drawn = lines(courses[1], style.MOTION)[0].get_ydata()
    assert drawn == pytest.approx(angles / angles[0], abs=1e-6)


def test_without_demonstrations_motions_start_at_the_densitys_means(make_grasp):
    skill = make_grasp()
    starts = np.array([motion.positions[0] for motion in portrait_of("bare", skill, [None]).motions])
    assert np.abs(skill.charted(starts) - skill.density.means).max() < 1e-12
