"""What is in the figures: the right lines, ellipses, regions, labels and limits, whoever draws them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.contour import QuadContourSet
from matplotlib.patches import Circle, Ellipse

from skillctl.model.space import Euclidean
from skillctl.plotting.fit import MOST_PROFILES, draw_fit
from skillctl.plotting.flow import widest_speed
from skillctl.plotting.panels import DEVIATIONS, _leads
from skillctl.plotting.portrait import motions_from, portrait_of
from skillctl.plotting.proof import Bounds, draw_proofs
from skillctl.plotting.skill import draw_family, draw_skill
from skillctl.plotting.style import DEMONSTRATION, INK, LEFT_OUT, MOTION, PARTS, WITNESS, moved_by

ROUNDING = 1e-9  # of coordinates after a change of unit and back; far below a pixel


def test_a_plane_shows_demonstrations_motions_and_attractor_to_scale(portrait, lines, texts):
    shown = portrait(2, reach=0.05, demonstrations=True)
    figure = draw_skill(shown, "learned")
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [mm]", "y [mm]")
    assert axes.get_aspect() == 1
    assert axes.get_xlim() == pytest.approx((1e3 * shown.low[0], 1e3 * shown.high[0]))
    for colour, drawn in ((DEMONSTRATION, shown.demonstrations), (MOTION, shown.motions)):
        found = lines(axes, colour)
        assert len(found) == len(drawn) == 3
        for line, each in zip(found, drawn, strict=True):
            assert line.get_xydata() == pytest.approx(1e3 * each.positions, abs=ROUNDING)
    (star,) = [line for line in axes.get_lines() if line.get_marker() == "*"]
    assert star.get_xydata() == pytest.approx(1e3 * shown.goals)
    assert "skill  (learned)" in texts(figure)


def test_large_skills_are_told_in_metres_and_joints_in_radians(portrait):
    (axes,) = draw_skill(portrait(2, reach=2.0), "learned").axes
    assert axes.get_xlabel() == "x [m]"
    (axes,) = draw_skill(portrait(2, unit="rad"), "learned").axes
    assert axes.get_xlabel() == "x [rad]"


def test_ellipses_are_two_standard_deviations_of_the_density_seen_from_a_side(portrait):
    shown = portrait(3, reach=2.0)  # in metres
    above, side, front, _ = draw_skill(shown, "learned").axes
    for axes, pair in ((above, (0, 1)), (side, (0, 2)), (front, (1, 2))):
        patches = [patch for patch in axes.patches if isinstance(patch, Ellipse)]
        assert len(patches) == shown.skill.density.n_components
        for patch, mean, covariance in zip(
            patches, shown.skill.density.means, shown.skill.density.covariances, strict=True
        ):
            corners = patch.get_patch_transform().transform([[1, 0], [0, 1], [0.6, 0.8]])
            offsets = corners - mean[list(pair)]
            precision = np.linalg.inv(covariance[np.ix_(pair, pair)])
            deviations = np.sqrt(np.einsum("ni,ij,nj->n", offsets, precision, offsets))
            assert deviations == pytest.approx(DEVIATIONS, rel=1e-6)


def test_streamlines_follow_the_field_and_the_widest_are_the_fastest(portrait, texts, monkeypatch):
    monkeypatch.setattr("skillctl.plotting.flow.DENSITY", 1.15)  # as users get it: near the attractor, too
    shown = portrait(2, reach=2.0)
    figure = draw_skill(shown, "learned")
    (axes,) = figure.axes
    flows = [c for c in axes.collections if len(c.get_paths()) == 1 and c.get_zorder() == 1.0]
    speeds = []
    for flow in flows:
        path = flow.get_paths()[0]
        vertices, codes = np.asarray(path.vertices), np.asarray(path.codes)
        steps, middles = np.diff(vertices, axis=0), 0.5 * (vertices[1:] + vertices[:-1])
        drawn = (codes[1:] == path.LINETO) & steps.any(axis=1)
        field = shown.skill.velocity(middles)[drawn]
        along = (steps[drawn] * field).sum(axis=1)
        cosines = along / np.linalg.norm(steps[drawn], axis=1) / np.linalg.norm(field, axis=1)
        assert np.median(cosines) > 0.99  # on a grid of 90 points the sharpest bends are cut
        speeds.append(np.linalg.norm(field, axis=1).mean())
    widths = [np.atleast_1d(flow.get_linewidth())[0] for flow in flows]
    assert len(flows) > 2
    assert np.argsort(widths).tolist() == np.argsort(speeds).tolist()
    fastest = f"{widest_speed(shown):.2g}"
    assert f"field; widest: {float(fastest):g} m/s" in texts(figure)


def test_levels_of_v_are_at_equal_steps_of_the_distance(portrait):
    shown = portrait(2, reach=2.0)
    shown = replace(shown, skill=replace(shown.skill, lyapunov=np.array([[2.0, 0.5], [0.5, 1.0]])))
    (axes,) = draw_skill(shown, "learned").axes
    (levels,) = [c for c in axes.collections if isinstance(c, QuadContourSet)]
    heights = np.asarray(levels.levels)
    assert np.diff(heights) == pytest.approx(heights[0])
    for level, path in zip(levels.levels, levels.get_paths(), strict=True):
        offsets = path.vertices - shown.skill.attractor
        distances = np.sqrt(np.einsum("ni,ij,nj->n", offsets, shown.skill.lyapunov, offsets))
        # Linear interpolation between grid points: good to the curvature over one cell.
        assert distances == pytest.approx(level, abs=0.01 * heights[0])


@pytest.mark.parametrize(
    ("gate", "words"), [("latched", "starts that select part"), ("instantaneous", "acts: part")]
)
def test_regions_are_where_the_parts_act(portrait, texts, gate, words):
    shown = portrait(2, kind="combined", gate=gate)
    places, leads = None, []
    for x, y, lead in _leads(shown):
        places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) / shown.scale.factor
        leads.append(lead.ravel())
    assert (np.argmax(leads, axis=0) == shown.skill.part_at(places)).all()
    figure = draw_skill(shown, "combined")
    (axes,) = figure.axes
    tints = [c for c in axes.collections if isinstance(c, QuadContourSet) and c.get_zorder() == 0.2]
    assert len(tints) == 2
    assert {f"{words} 1", f"{words} 2"} <= set(texts(figure))
    starts = [line for line in axes.get_lines() if line.get_marker() == "o"]
    assert [line.get_markerfacecolor() for line in starts] == list(PARTS[:2])


def test_space_is_seen_from_three_sides_and_in_perspective(portrait, lines, texts):
    shown = portrait(3)
    figure = draw_skill(shown, "learned")
    *sides, perspective = figure.axes
    assert [(a.get_xlabel()[0], a.get_ylabel()[0]) for a in sides] == [("x", "y"), ("x", "z"), ("y", "z")]
    assert all(len(lines(axes, MOTION)) == 3 for axes in figure.axes)
    assert perspective.name == "3d"
    assert {"seen from above", "seen from the side", "seen from the front"} <= set(texts(figure))
    assert not {"seen from above"} & set(texts(draw_skill(portrait(3, unit="rad"), "learned")))


@pytest.mark.parametrize(("dimension", "panels"), [(1, 2), (4, 4), (7, 7)])
def test_other_dimensions_are_shown_over_time(portrait, lines, dimension, panels):
    shown = portrait(dimension, unit="rad")
    figure = draw_skill(shown, "learned")
    assert len(figure.axes) == panels
    last = figure.axes[-1]
    assert last.get_xlabel() == "time [s]"
    assert last.get_ylabel() == f"{shown.skill.space.names[-1]} [rad]"
    for line, motion in zip(lines(last, MOTION), shown.motions, strict=True):
        assert line.get_xydata() == pytest.approx(np.column_stack([motion.times, motion.positions[:, -1]]))


def test_a_legend_explains_what_is_there_and_nothing_else(portrait, texts):
    assert "demonstration" in texts(draw_skill(portrait(2), "learned"))
    assert "demonstration" not in texts(draw_skill(portrait(2, demonstrations=False), "learned"))
    assert "attractor" not in texts(draw_skill(portrait(7), "learned"))


@pytest.mark.parametrize(("dimension", "panels"), [(1, 3), (2, 3), (3, 9), (4, 12)])
def test_a_family_is_shown_on_the_same_axes(portrait, texts, dimension, panels):
    parents = [(portrait(dimension, name=name), "weight 0.5") for name in ("left", "right")]
    figure = draw_family(parents, (portrait(dimension, kind="merged", name="both"), "merged"))
    assert len(figure.axes) == panels
    rows = [figure.axes[i : i + 3] for i in range(0, panels, 3)]
    if dimension in (2, 3):
        for row in rows:
            assert len({axes.get_xlim() for axes in row}) == len({axes.get_ylim() for axes in row}) == 1
    assert [a.get_title() for a in rows[0]] == ["left\nweight 0.5", "right\nweight 0.5", "both\nmerged"]


def test_many_parents_go_on_in_the_next_row(portrait, monkeypatch):
    monkeypatch.setattr("skillctl.plotting.skill.MOST_IN_A_ROW", 2)
    figure = draw_family([(portrait(2), f"weight {i}") for i in range(2)], (portrait(2), "merged"))
    assert [axes.get_subplotspec().rowspan.start for axes in figure.axes] == [0, 0, 1]


def test_a_fit_shows_paths_and_speeds_of_every_demonstration(portrait, lines, texts):
    shown = portrait(2)
    figure = draw_fit(shown, apart(0.001, 0.002, None))
    paths, *profiles = figure.axes
    assert len(lines(paths, DEMONSTRATION)) == len(lines(paths, MOTION)) == 3
    assert len(profiles) == 3
    assert [axes.get_title().split("\n")[1] for axes in profiles] == ["DTW 1.00 mm", "DTW 2.00 mm", "DTW –"]
    assert profiles[0].get_ylabel() == "speed [m/s]"
    assert "learned without that demonstration" not in texts(figure)


def test_a_fit_says_how_far_demonstrations_were_moved(portrait):
    _, *profiles = draw_fit(portrait(2), apart(0.001, 0.002, 0.003), moved=apart(0.0, 0.02, None)).axes
    titles = [axes.get_title().split("\n")[1] for axes in profiles]
    assert titles == ["DTW 1.00 mm", "DTW 2.00 mm, moved 20.00 mm", "DTW 3.00 mm"]


@pytest.mark.parametrize("dimension", [2, 3, 7])
def test_motions_learned_without_a_demonstration_are_marked(portrait, lines, texts, dimension):
    shown = portrait(dimension)
    starts = np.array([d.positions[0] for d in shown.demonstrations])
    held = motions_from(shown.skill, starts, 2.0)
    figure = draw_fit(shown, apart(*[0.001] * 3), held)
    assert "learned without that demonstration" in texts(figure)
    counts = [len(lines(axes, LEFT_OUT)) for axes in figure.axes]
    assert counts == [3] * (len(counts) - 3) + [1] * 3


def test_a_speed_beyond_all_demonstrations_is_told_in_numbers(portrait, texts):
    shown = portrait(2)
    quick = motions_from(replace(shown.skill, speed=50.0), shown.motions[0].positions[:1], 2.0)[0]
    figure = draw_fit(replace(shown, motions=(quick, *shown.motions[1:])), apart(*[0.001] * 3))
    fastest = max(np.linalg.norm(d.velocities, axis=1).max() for d in shown.demonstrations)
    assert figure.axes[1].get_ylim()[1] <= 2.5 * fastest
    assert any(text.startswith("peak ") for text in texts(figure))


def test_of_very_many_demonstrations_some_speeds_are_shown_and_that_is_said(portrait, texts):
    shown = portrait(2)
    many = replace(shown, demonstrations=shown.demonstrations * 10, motions=shown.motions * 10)
    figure = draw_fit(many, apart(*[0.001] * 30))
    assert len(figure.axes) == 1 + MOST_PROFILES
    assert any(f"first {MOST_PROFILES} of 30" in text for text in texts(figure))


def apart(*distances):
    """Return distances without angles."""
    return [(each, None) for each in distances]


def bounds(**given):
    return Bounds(**{"verdict": "stable", "rates": (0.1,), "radii": (None,), "witness": None, **given})


def test_a_proof_shows_the_decay_rate_its_lowest_and_the_proved_line(portrait, lines, texts):
    shown = portrait(2, reach=2.0)
    figure = draw_proofs([(shown, bounds())])
    rates, courses = figure.axes[:2]
    (image,) = rates.get_images()
    assert image.get_array().min() > 0
    assert rates.get_title() == f"lowest here: {image.get_array().min():.3g} 1/s"
    assert len(lines(courses, MOTION)) == 3
    (line,) = lines(courses, INK)
    times, shares = line.get_xydata().T
    assert shares == pytest.approx(np.exp(-0.1 * times))
    assert courses.get_yscale() == "log"
    assert {"proved: no motion is slower", "lowest decay rate"} <= set(texts(figure))
    assert not any("mathdefault" in text for text in texts(figure))


def test_where_v_grows_is_in_another_colour_with_a_line_around_it(portrait):
    shown = portrait(2)
    turned = np.array([[0.0, -1.0], [1.0, 0.0]])  # V grows on some sides and shrinks on others
    part = replace(shown.skill, lyapunov=np.diag([1.0, 4.0]), system_matrices=np.stack([turned] * 3))
    figure = draw_proofs([(replace(shown, skill=part), bounds(rates=(None,), verdict="not proved"))])
    rates = figure.axes[0]
    (zero,) = [c for c in rates.collections if isinstance(c, QuadContourSet)]
    assert list(zero.levels) == [0.0]
    image = rates.get_images()[0]
    assert (image.get_array() < image.norm.vmin).any()


def test_radii_and_witness_are_drawn_to_scale(portrait, lines, texts):
    shown = portrait(2, kind="combined", gate="instantaneous", reach=2.0)
    lost = (0.3, -0.4)
    given = bounds(verdict="not proved", rates=(None,), radii=(0.02, None), witness=lost)
    figure = draw_proofs([(shown, given)])
    rates = figure.axes[0]
    (circle,) = [patch for patch in rates.patches if type(patch) is Circle]
    assert circle.get_radius() == pytest.approx(0.02)
    assert circle.center == pytest.approx(shown.skill.parts[0].attractor)
    assert lines(rates, WITNESS)[0].get_xydata()[0] == pytest.approx(lost)
    assert {"witness: reaches no attractor", "proved radius"} <= set(texts(figure))
    assert "proved: no motion is slower" not in texts(figure)


def test_three_dimensions_are_cut_through_the_attractor(portrait):
    shown = portrait(3)
    figure = draw_proofs([(shown, bounds())])
    assert [axes.get_title()[0] for axes in figure.axes[:3]] == ["z", "y", "x"]
    assert all(len(axes.get_images()) == 1 for axes in figure.axes[:3])


@pytest.mark.parametrize("dimension", [1, 4])
def test_other_dimensions_show_how_the_distance_shrinks(portrait, lines, dimension):
    figure = draw_proofs([(portrait(dimension), bounds()), (portrait(2), bounds())])
    assert len(lines(figure.axes[0], MOTION)) == 3


def test_names_are_written_as_they_are(portrait, texts):
    name = "$\\frac{$\n</svg>"
    shown = portrait(2, name=name)
    names = Euclidean(("$a$", "关"))
    named = replace(shown, skill=replace(shown.skill, space=names))
    figure = draw_skill(named, "learned")
    assert any(text.startswith("$\\frac{$") and "\n" not in text for text in texts(figure))
    assert figure.axes[0].get_xlabel() == "$a$ [m]"


def test_a_portrait_without_any_demonstration_can_be_drawn_whatever_its_kind(portrait):
    for dimension in (1, 2, 3, 5):
        shown = portrait(dimension, kind="combined", demonstrations=False)
        assert draw_skill(shown, "combined").axes
    assert portrait_of("again", shown.skill, [None, None]).demonstrations == ()


@pytest.mark.parametrize("dimension", [2, 3, 4])
def test_motions_of_a_combined_skill_have_the_colour_of_their_part(portrait, lines, texts, dimension):
    shown = portrait(dimension, kind="combined", demonstrations=True)
    figure = draw_skill(shown, "combined")
    assert {motion.part for motion in shown.motions} == {0, 1}
    assert not lines(figure.axes[0], MOTION)
    for part in (0, 1):
        drawn = [line for line in figure.axes[0].get_lines() if line.get_color() == moved_by(part)["color"]]
        assert len(drawn) == sum(motion.part == part for motion in shown.motions)
        assert any(text.endswith(f"part {part + 1}") for text in texts(figure))


@pytest.mark.parametrize("kind", ["learned", "combined"])
@pytest.mark.parametrize("name", ["z", "a name that is rather long"])
def test_no_label_is_cut_off_at_the_edge_of_the_figure(portrait, kind, name):
    shown = portrait(3, kind=kind, demonstrations=True)
    space = replace(shown.skill.space, names=(*shown.skill.space.names[:2], name))
    skill = shown.skill.with_leaves(lambda leaf: replace(leaf, space=space))
    figure = draw_skill(replace(shown, skill=skill), kind)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())
    for edge in (pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]):
        assert (edge == 255).all()


def test_no_part_is_lost_on_white_and_white_lines_are_outlined(portrait):
    for colour in PARTS:
        red, green, blue = to_rgb(colour)
        assert 0.2126 * red + 0.7152 * green + 0.0722 * blue < 0.75, colour  # Rec. 709: of white it is 1
    shown = portrait(2, demonstrations=True)
    (axes, *_) = draw_proofs([(shown, bounds())]).axes
    white = [line for line in axes.get_lines() if line.get_color() == "white"]
    assert len(white) == len(shown.motions)
    assert all(line.get_path_effects() for line in white)
