"""Figures of chains: stages in their colours, where each is over to scale, speeds over time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.patches import Ellipse, Polygon, Rectangle

from skillctl.model.chained import ChainedSkill
from skillctl.model.coordinates.chain import Chain
from skillctl.plotting.chain import outline, pieces, stage_begins
from skillctl.plotting.portrait import portrait_of
from skillctl.plotting.skill import draw_family, draw_skill
from skillctl.plotting.style import DEMONSTRATION, part_colour

ENDS = (0.1, -0.2, 0.3)  # of each coordinate, stage by stage
LEVEL = 4e-4


@pytest.fixture(scope="session")
def chained(make_skill, show_to):
    """Return a maker of portraits of a chain of three stages, the first with two demonstrations."""

    def make(dimension=2, *, events=((), ("close", "wait 0.5"), ())):
        rng = np.random.default_rng(11)
        p = np.diag(np.arange(1.0, dimension + 1))
        stages = tuple(
            make_skill(rng, dimension=dimension, lyapunov=p, attractor=np.full(dimension, end))
            for end in ENDS
        )
        chain = ChainedSkill(stages, np.full(3, LEVEL), events)
        taught = [show_to(stage, count) for stage, count in zip(stages, (2, 3, 1), strict=True)]
        return portrait_of("shelf", chain, taught)

    return make


def coloured(axes, stage):
    """The lines of a stage: in its colour, darker."""
    wanted = 0.7 * np.array(to_rgb(part_colour(stage)))
    return [line for line in axes.get_lines() if np.allclose(to_rgb(line.get_color()), wanted)]


def test_motions_begin_where_the_first_stage_was_taught_and_pass_all_stages(chained):
    shown = chained()
    assert len(shown.demonstrations) == 6
    assert len(shown.motions) == 2
    for motion, demonstration in zip(shown.motions, shown.demonstrations, strict=False):
        assert (motion.positions[0] == demonstration.positions[0]).all()
        assert np.unique(motion.acting).tolist() == [0, 1, 2]
        assert (np.diff(motion.acting) >= 0).all()
        assert np.linalg.norm(motion.positions[-1] - ENDS[2]) < 1e-3 * 1.01
    inside = [(shown.low < end).all() and (end < shown.high).all() for end in ENDS]
    assert all(inside)


def test_a_motion_is_drawn_in_the_colours_of_its_stages_without_gaps(chained):
    shown = chained()
    axes, _ = draw_skill(shown, "chain").axes
    for motion in shown.motions:
        drawn = [piece for piece, _ in pieces(shown, motion)]
        assert [piece.start for piece in drawn[1:]] == [piece.stop - 1 for piece in drawn[:-1]]
        apart = [piece for piece, _ in pieces(shown, motion, apart=True)]
        assert [piece.start for piece in apart[1:]] == [piece.stop for piece in apart[:-1]]
    factor = shown.scale.factor
    for stage in range(3):
        lines = coloured(axes, stage)
        assert len(lines) == 2
        for line, motion in zip(lines, shown.motions, strict=True):
            own = np.flatnonzero(motion.acting == stage)
            assert line.get_xydata()[: len(own)] == pytest.approx(factor * motion.positions[own])


@pytest.mark.parametrize("dimension", [2, 3, 6])
def test_a_stage_is_over_within_the_outline(make_skill, dimension):
    """Every corner is on the border of the projection, whose matrix is a Schur complement of P."""
    rng = np.random.default_rng(1)
    square = rng.normal(size=(dimension, dimension))
    p = square @ square.T + np.eye(dimension)
    skill = make_skill(rng, dimension=dimension, lyapunov=p, attractor=np.full(dimension, 0.4))
    corners = outline(skill, LEVEL, (0, 1)) - 0.4
    a, b, c = p[:2, :2], p[:2, 2:], p[2:, 2:]
    shadow = a - b @ np.linalg.solve(c, b.T) if dimension > 2 else a
    values = np.einsum("ni,ij,nj->n", corners, shadow, corners) / LEVEL
    assert values == pytest.approx(1, rel=1e-9)  # P is well conditioned


def test_the_outline_is_bent_as_the_coordinates_are(make_skill, make_shears):
    rng = np.random.default_rng(2)
    skill = make_skill(rng, attractor=[0.2, 0.1])
    bent = replace(skill, coordinates=Chain((make_shears(rng, 2, size=0.3),)))
    corners = outline(bent, 0.04, (0, 1))
    assert bent.v_distance(corners) == pytest.approx(0.2)
    assert np.ptp(np.linalg.norm(corners - bent.attractor, axis=1)) > 0.01  # no circle, which it is without


@pytest.mark.parametrize(("dimension", "views"), [(2, 1), (3, 3)])
def test_outlines_are_drawn_in_every_view_with_the_number_of_the_stage(chained, texts, dimension, views):
    shown = chained(dimension)
    figure = draw_skill(shown, "chain of 3 stages")
    pairs = ((0, 1), (0, 2), (1, 2))
    for axes, (i, j) in zip(figure.axes[:views], pairs, strict=False):
        borders = [patch for patch in axes.patches if isinstance(patch, Polygon)]
        assert len(borders) == 3
        assert not any(isinstance(patch, Ellipse) for patch in axes.patches)
        for border, end in zip(borders, ENDS, strict=True):
            reach = shown.scale.factor * np.sqrt(LEVEL / np.array([i + 1, j + 1]))
            sides = 0.5 * np.ptp(border.get_xy(), axis=0)
            assert sides == pytest.approx(reach, rel=0.02)
            middle = 0.5 * (border.get_xy().max(axis=0) + border.get_xy().min(axis=0))
            assert middle == pytest.approx(shown.scale.factor * np.full(2, end), abs=0.02 * reach.max())
    written = texts(figure)
    assert [written.count(number) for number in "123"] == [views + 1] * 3  # and once beside the speeds
    assert "where a stage is over" in written
    assert "stage 3" in written
    assert not any(text.startswith(("field", "level", "position density")) for text in written)


def test_stages_that_end_in_one_place_share_a_label(chained, texts):
    shown = chained()
    chain = shown.skill
    again = replace(
        chain,
        parts=(*chain.parts, chain.parts[0]),
        levels=np.full(4, LEVEL),
        events=(*chain.events, ()),
    )
    written = texts(draw_skill(portrait_of("again", again, [None] * 4), "chain"))
    assert "1, 4" in written
    assert [written.count(number) for number in "1234"] == [1, 2, 2, 1]  # beside the speeds each has its own


@pytest.mark.parametrize(("dimension", "panel"), [(1, 1), (2, 1), (3, 3), (4, 4)])
def test_speeds_have_bands_of_the_stages_and_their_events(chained, texts, dimension, panel):
    shown = chained(dimension)
    figure = draw_skill(shown, "chain")
    axes = [each for each in figure.axes if each.get_ylabel().startswith("speed")]
    assert axes == [figure.axes[panel]]
    begins = stage_begins(shown)
    firsts = [[m.times[np.argmax(m.acting >= stage)] for m in shown.motions] for stage in range(3)]
    assert begins == pytest.approx(np.median(firsts, axis=1))
    bands = [patch for patch in axes[0].patches if isinstance(patch, Rectangle)]
    latest = max(motion.times[-1] for motion in shown.motions)
    assert [band.get_x() for band in bands] == pytest.approx(begins)
    assert bands[-1].get_x() + bands[-1].get_width() == pytest.approx(latest)
    for stage in range(3):
        for line, motion in zip(coloured(axes[0], stage), shown.motions, strict=True):
            own = motion.acting == stage
            assert line.get_ydata()[: own.sum()] == pytest.approx(shown.scale.factor * motion.speeds[own])
    (noted,) = [text for text in axes[0].texts if "close, wait 0.5" in text.get_text()]
    assert noted.get_position()[0] == pytest.approx(begins[2])
    assert axes[0].get_xlabel() == "time [s], without events"
    # Demonstrations of later stages do not begin when the motion does.
    for each in figure.axes:
        if each.get_xlabel().startswith("time"):
            assert not [line for line in each.get_lines() if line.get_color() == DEMONSTRATION]


def test_a_chain_that_stops_on_the_way_has_bands_as_far_as_it_comes(chained):
    shown = chained()
    still = replace(shown.skill.parts[1], system_matrices=np.full((3, 2, 2), 1e-9))
    stuck = portrait_of("stuck", shown.skill.with_stage(1, still), [None] * 3)
    assert len(stage_begins(stuck)) == 2
    draw_skill(stuck, "chain")


def test_angles_are_from_the_target_of_the_stage(make_grasp):
    first = make_grasp()
    second = make_grasp((0.4, 0.2, 0.3, 0.5, 1.0, 0.3))
    chain = ChainedSkill((first, second), np.full(2, 1e-4), ((), ()))
    shown = portrait_of("turning", chain, [None, None])
    *_, angles, speeds, _ = draw_skill(shown, "chain").axes
    assert angles.get_ylabel() == "angle from target [°]"
    assert speeds.get_ylabel() == "speed [m/s]"
    for stage, skill in enumerate((first, second)):
        for line, motion in zip(coloured(angles, stage), shown.motions, strict=True):
            own = motion.positions[motion.acting == stage]
            between = np.degrees(chain.space.apart(own, np.tile(skill.attractor, (len(own), 1)))[1])
            assert line.get_ydata() == pytest.approx(between)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_chain_is_shown_beside_what_it_was_made_from(chained, texts, dimension):
    shown = chained(dimension)
    parents = [
        (portrait_of(f"p{i}", part, [None]), f"stage {i}")
        for i, part in enumerate(shown.skill.parts, start=1)
    ]
    figure = draw_family(parents, (shown, "chain of 3 stages"))
    written = texts(figure)
    assert {"p1\nstage 1", "p3\nstage 3", "shelf\nchain of 3 stages"} <= set(written)
    assert {"stage 1", "position density, 2σ", "where a stage is over"} <= set(written)
