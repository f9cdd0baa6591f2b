"""Keep-out bodies: what is in them, the map to their outside, and motions that never enter them."""

from dataclasses import replace
from pickle import dumps, loads
from typing import Any

import numpy as np
import pytest

from skillctl.errors import InvalidModelError, UsageError
from skillctl.model.combined import CombinedSkill
from skillctl.model.coordinates.bodies import Ball, Box, Cylinder, Ellipsoid, around
from skillctl.model.coordinates.chain import Chain
from skillctl.model.coordinates.keep_out import NUDGE, KeepOut
from skillctl.model.kept_out import kept_out
from skillctl.model.merged import MergedSkill
from skillctl.model.rollout import rollout
from skillctl.stability.certificate import certify

EPS = np.finfo(float).eps
MARGIN = 0.02

FLAT = [
    Ball("ball", (0.3, -0.1), 0.05),
    Ellipsoid("egg", (-0.3, 0.2), (0.1, 0.04), turn=(0.7,)),
    Box("crate", (0.0, 0.4), (0.2, 0.1), turn=(0.3,)),
    Box("board", (0.0, -0.4), (0.6, 0.01), pole=(0.2, -0.4)),
]
SOLID = [
    Ball("ball", (0.3, -0.1, 0.0), 0.05),
    Ellipsoid("egg", (-0.3, 0.2, 0.1), (0.1, 0.04, 0.06), turn=(0.7, 0.2, -0.3)),
    Box("crate", (0.0, 0.4, 0.0), (0.2, 0.1, 0.05), turn=(0.3, 0.5, 1.0)),
    Box("board", (0.0, 0.0, -0.4), (0.6, 0.3, 0.01), pole=(0.2, 0.1, -0.4)),
    Cylinder("bottle", (0.0, 0.0, 0.4), 0.03, 0.2, turn=(0.4, 0.0, 0.0)),
]


def bodies(dimension):
    return FLAT if dimension == 2 else SOLID


def points_of(body, rng, n=4000):
    """Random points of a body, by its definition."""
    d = len(body.centre)
    unit = rng.normal(size=(n, d))
    unit *= rng.uniform(0, 1, (n, 1)) ** (1 / d) / np.linalg.norm(unit, axis=1, keepdims=True)
    if isinstance(body, Ball):
        return body.centre + body.radius * unit
    if isinstance(body, Ellipsoid):
        local = unit * body.radii
    elif isinstance(body, Box):
        local = rng.uniform(-0.5, 0.5, (n, d)) * body.size
        local[: 2**d] = np.stack(np.meshgrid(*[[-0.5, 0.5]] * d), -1).reshape(-1, d) * body.size
    else:
        angle, across = rng.uniform(0, 2 * np.pi, n), body.radius * np.sqrt(rng.uniform(0, 1, n))
        height = rng.uniform(-0.5, 0.5, n) * body.height
        local = np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)
    return body.centre + local @ body.axes


@pytest.fixture(params=[2, 3])
def skill(request, make_skill):
    d = request.param
    return make_skill(np.random.default_rng(d), n_components=3, dimension=d, attractor=np.zeros(d))


@pytest.mark.parametrize("body", [*FLAT, *SOLID], ids=lambda body: f"{body.name}-{len(body.centre)}")
def test_an_inflated_body_holds_all_points_within_the_margin(body):
    rng = np.random.default_rng(1)
    inside = points_of(body, rng)
    steps = rng.normal(size=inside.shape)
    steps *= MARGIN / np.linalg.norm(steps, axis=1, keepdims=True)
    gauge = body.inflated(MARGIN)
    values = gauge.values(inside + steps)
    assert values.max() <= 1 + 64 * EPS
    if not isinstance(body, Ellipsoid):  # exactly these: a support function's value is reached
        for direction in rng.normal(size=(20, len(body.centre))):
            n = direction / np.linalg.norm(direction)
            exact = gauge.support(n.tolist(), 1.0)
            assert (inside @ n).max() + MARGIN <= exact + 64 * EPS
            assert (points_of(body, rng, 40_000) @ n).max() + MARGIN >= exact - 0.05
            low, high = body.bounds
            assert (inside >= low).all()
            assert (inside <= high).all()


@pytest.mark.parametrize("body", [*FLAT, *SOLID], ids=lambda body: f"{body.name}-{len(body.centre)}")
def test_a_gauge_grows_evenly_and_its_slope_is_the_derivative(body):
    rng = np.random.default_rng(2)
    gauge = body.inflated(MARGIN)
    x = gauge.pole + rng.normal(0, 0.2, (500, len(body.centre)))
    t, slopes = gauge.slopes(x)
    np.testing.assert_allclose(gauge.values(gauge.pole + 3 * (x - gauge.pole)), 3 * t, rtol=64 * EPS)
    h = 1e-6  # of a function whose second derivative is below 1/(rounding · size) = 5e3
    steps = h * np.eye(len(body.centre))
    numeric = [(gauge.values(x + s) - gauge.values(x - s)) / (2 * h) for s in steps]
    np.testing.assert_allclose(slopes, np.stack(numeric, axis=1), atol=5e3 * h)
    single = [gauge.slope_at((each - gauge.pole).tolist()) for each in x]
    np.testing.assert_allclose([each[0] for each in single], t, rtol=64 * EPS)
    np.testing.assert_allclose([each[1] for each in single], slopes, rtol=1e-9, atol=1e-9)


def test_of_a_ball_the_map_is_the_formula_of_the_theory_page():
    """β(r) = ρ + (R − ρ)² r / (R² − ρ r), in metres."""
    rho, r = 0.05 + MARGIN, 0.06
    gauge = Ball("ball", (0.3, 0.0), 0.05).inflated(MARGIN)
    link = KeepOut(("ball",), (gauge,), np.array([2.0]), 0.01)
    x = link.back(np.array([[0.3, r]]))
    expected = rho + (2 * rho - rho) ** 2 * r / ((2 * rho) ** 2 - rho * r)
    np.testing.assert_allclose(x, [[0.3, expected]], rtol=8 * EPS)


def link_of(dimension, stride=0.01):
    gauges = tuple(body.inflated(MARGIN) for body in bodies(dimension))
    return KeepOut(tuple(b.name for b in bodies(dimension)), gauges, np.full(len(gauges), 1.15), stride)


@pytest.fixture(params=[2, 3])
def link(request):
    return link_of(request.param)


def outside(link, n=5000, seed=3):
    x = np.random.default_rng(seed).normal(0, 0.3, (n, len(link.gauges[0].pole)))
    return x[~link.inside(x)]


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_it_leads_there_and_back(link, unit):
    x = outside(link)
    there = link.in_unit(unit)
    y = there.forward(unit * x)
    # β⁻¹ is steepest at the surface: there it multiplies rounding by R²/(R − 1)² = 59, and β divides again.
    np.testing.assert_allclose(there.back(y), unit * x, atol=1e3 * EPS * unit)
    np.testing.assert_allclose(y, unit * link.forward(x), atol=1e5 * EPS * unit)
    assert (y != unit * x).any(axis=1).sum() > 20  # some were near a body
    assert (there.forward(np.zeros_like(x[:1])) == 0).all()


def test_one_state_goes_as_many_do(link):
    x = outside(link, 1000)
    y, pull = link.tangent(x)
    v = np.random.default_rng(4).normal(size=x.shape)
    pulled = pull(v)
    for i in range(len(x)):
        y_i, pull_i = link.tangent_at(x[i])
        np.testing.assert_allclose(y_i, y[i], atol=1e5 * EPS)
        np.testing.assert_allclose(link.forward_at(x[i]), y[i], atol=1e5 * EPS)
        np.testing.assert_allclose(link.back_at(y[i]), link.back(y[i][None])[0], atol=1e5 * EPS)
        np.testing.assert_allclose(pull_i(v[i]), pulled[i], rtol=1e-6, atol=1e-9)


def test_velocities_are_led_back_by_the_derivative(link):
    x = outside(link)
    y, pull = link.tangent(x)
    clear = np.min([gauge.values(y) for gauge in link.gauges], axis=0) > 0.05  # of poles, where x turns fast
    v = np.random.default_rng(5).normal(size=x.shape)
    h = 1e-7
    numeric = (link.back(y + h * v) - link.back(y - h * v)) / (2 * h)
    np.testing.assert_allclose(pull(v)[clear], numeric[clear], rtol=1e-3, atol=1e-3)


def test_the_map_has_one_slope_on_both_sides_of_an_influence(link):
    rng = np.random.default_rng(6)
    h = 1e-7
    for gauge, reach in zip(link.gauges, link.reaches, strict=True):
        rays = rng.normal(size=(200, len(gauge.pole)))
        edge = gauge.pole + reach * rays / gauge.values(gauge.pole + rays)[:, None]
        steps = h * rng.normal(size=edge.shape)
        ahead, behind = (link.back(edge + s) - edge for s in (steps, -steps))
        # The second derivative of β at R is 2/(R (R − 1)) = 12 in sizes of the body, of at least 2 cm.
        np.testing.assert_allclose(ahead, -behind, atol=12 / MARGIN * (4 * h) ** 2)
        np.testing.assert_allclose(ahead, steps, atol=12 / MARGIN * (4 * h) ** 2)


def test_motions_apart_stay_apart(link):
    """Along each ray from a pole, farther goes to farther: strictly increasing."""
    for gauge in link.gauges:
        rays = np.random.default_rng(7).normal(size=(50, len(gauge.pole)))
        rays /= gauge.values(gauge.pole + rays)[:, None]
        shares = np.linspace(2 * NUDGE, 1.149, 300)
        x = np.stack([gauge.values(link.back(gauge.pole + share * rays)) for share in shares])
        assert (np.diff(x, axis=0) > 0).all()
        assert x.min() > 1


def test_a_state_inside_counts_as_the_one_on_the_surface_before_it(link):
    gauge = link.gauges[0]
    ray = np.eye(len(gauge.pole))[:1]
    deep = link.back(link.forward(gauge.pole + 0.01 * ray))
    np.testing.assert_allclose(deep, gauge.pole + ray * (0.05 + MARGIN), atol=1e-6)
    poles = np.stack([each.pole for each in link.gauges])
    y = link.forward(poles)
    assert link.nudged(y).all()
    led_out = link.back(y)
    assert not link.inside(led_out).any()
    single = np.stack([link.back_at(link.forward_at(pole)) for pole in poles])
    np.testing.assert_allclose(single, led_out, atol=1e-9)


def test_boxes_hold_the_images_of_what_is_in_them(link):
    rng = np.random.default_rng(8)
    low = rng.uniform(-0.6, 0.5, (60, len(link.gauges[0].pole)))
    high = low + rng.uniform(0, 0.2, low.shape)
    for bounds, image in ((link.bounds_forward, link.forward), (link.bounds_back, link.back)):
        least, most = bounds(low, high)
        for _ in range(200):
            y = image(rng.uniform(low, high))
            assert ((y >= least) & (y <= most)).all()


def test_equal_bodies_are_equal_also_as_a_copy(link):
    assert loads(dumps(link)) == link
    assert hash(loads(dumps(link))) == hash(link)
    assert replace(link, stride=0.02) != link
    assert replace(link, reaches=link.reaches - 0.01) != link


def test_a_target_in_an_influence_is_found_exactly():
    gauge = Ball("ball", (0.25, 0.0), 0.1).inflated(0.025)
    KeepOut(("ball",), (gauge,), np.array([2.0]), 0.01)  # the target lies on its edge, to the last bit
    with pytest.raises(InvalidModelError, match="the target is in the influence of ball"):
        KeepOut(("ball",), (gauge,), np.array([np.nextafter(2.0, 3.0)]), 0.01)


def test_influences_that_meet_are_found():
    gauges = tuple(Ball(n, c, 0.05).inflated(0.05) for n, c in (("a", (0.5, 0.0)), ("b", (0.5, 0.3))))
    KeepOut(("a", "b"), gauges, np.array([1.49, 1.49]), 0.01)  # they end 2 mm before each other
    with pytest.raises(InvalidModelError, match="a and b are not proved to be apart"):
        KeepOut(("a", "b"), gauges, np.array([1.5, 1.51]), 0.01)
    with pytest.raises(InvalidModelError, match="a is no rounded body"):
        KeepOut(("a", "b"), gauges, np.array([1.0, 1.2]), 0.01)


def test_no_motion_enters_and_every_start_arrives(skill):
    d = skill.dimension
    kept = kept_out(skill, bodies(d), margin=MARGIN, stride=0.01)
    (link,) = kept.coordinates.links
    starts = outside(link, 400, seed=9)
    motions = rollout(kept, starts, duration=60.0, period=0.01)
    assert motions.arrived.all()
    entered = [link.inside(states).any() for states in motions.positions]
    assert not any(entered)
    plain = rollout(skill, starts, duration=60.0, period=0.01)
    assert sum(link.inside(states).any() for states in plain.positions) > 20  # they would have
    v = np.stack([kept.v_distance(states) for states in motions.positions])
    moving = v[:, :-1] > 1e-9
    assert (np.diff(v, axis=1)[moving] < 0).all()
    assert certify(kept, digest="").verdict == certify(skill, digest="").verdict


def test_between_two_steps_the_margin_stays_free(skill):
    """The chords of a motion, sampled, against the bodies by their definition."""
    d = skill.dimension
    kept = kept_out(skill, bodies(d), margin=MARGIN, stride=0.01)
    starts = outside(kept.coordinates.links[0], 100, seed=11)
    motions = rollout(kept, starts, duration=20.0, period=0.05)
    shares = np.linspace(0, 1, 11)[:, None, None, None]
    chords = motions.positions[None, :, :-1] * (1 - shares) + motions.positions[None, :, 1:] * shares
    for body in bodies(d):
        if isinstance(body, Ellipsoid):  # the only one whose inflation is larger than exact
            continue
        assert body.inflated(MARGIN).values(chords.reshape(-1, d)).min() >= 1 - 1e-9


def test_learned_merged_and_combined_skills_keep_out(skill):
    d = skill.dimension
    other = replace(skill, system_matrices=0.5 * skill.system_matrices)
    merged = MergedSkill((skill, other), np.array([0.4, 0.6]))
    combined = CombinedSkill((merged, skill.translated(np.full(d, 0.05))), np.array([0.5, 0.5]), "latched")
    for whole in (skill, merged, combined):
        kept = kept_out(whole, bodies(d), margin=MARGIN)
        targets = {leaf.attractor.tobytes(): leaf for leaf in kept.leaves}
        for leaf in targets.values():  # the bodies stay where they are, whatever the target
            link: Any = leaf.coordinates.links[0]
            poles = [gauge.pole + leaf.attractor for gauge in link.gauges]
            np.testing.assert_allclose(poles, [b.inflated(1.0).pole for b in bodies(d)], atol=8 * EPS)


def test_bodies_come_before_shears(skill, make_shears):
    shears = make_shears(np.random.default_rng(12), skill.dimension)
    bent = replace(skill, coordinates=Chain((shears,)))
    kept = kept_out(bent, bodies(skill.dimension), margin=MARGIN)
    x = outside(kept.coordinates.links[0], 500)
    np.testing.assert_array_equal(
        kept.coordinates.forward(x), shears.forward(kept.coordinates.links[0].forward(x))
    )


def test_influences_are_as_large_as_they_may_be(skill):
    d = skill.dimension
    one = kept_out(skill, [Ball("far", (0.5,) * d, 0.05)], margin=MARGIN).coordinates.links[0]
    assert one.reaches.tolist() == [2.0]
    radius = 0.05 + np.hypot(MARGIN, MARGIN / 2)
    board = Box("board", (1.0,) * d, (0.6,) + (0.02,) * (d - 1))  # wide and thin: it ends near the board
    wide = kept_out(skill, [board], margin=MARGIN).coordinates.links[0]
    assert 0.05 < 0.3 * (wide.reaches[0] - 1) < 0.1
    near = kept_out(skill, [Ball("near", (0.1,) + (0.0,) * (d - 1), 0.05)], margin=MARGIN)
    np.testing.assert_allclose(near.coordinates.links[0].reaches, 0.1 / radius, rtol=1e-8)
    pair = [Ball("a", (0.5,) * d, 0.05), Ball("b", (0.5,) * (d - 1) + (0.7,), 0.05)]
    both = kept_out(skill, pair, margin=MARGIN).coordinates.links[0]
    np.testing.assert_allclose(both.reaches.sum() * radius, 0.2, rtol=1e-2)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (Ball("cup", (0.05, 0.0), 0.04), "cup: the target is in it, or hardly farther from it than"),
        (Ball("cup", (0.3, 0.3), 0.1), "cup: the start is in it, or nearer than 22.4 mm"),
        (Ball("cup", (0.3, 0.3, 0.0), 0.1), "cup: a body with 3 coordinates, .* over x, y "),
    ],
)
def test_what_cannot_be_kept_out_of_is_refused_by_name(make_skill, body, message):
    skill = make_skill(np.random.default_rng(0), dimension=2, attractor=np.zeros(2))
    with pytest.raises(UsageError, match=message):
        kept_out(skill, [body], margin=MARGIN, start=[0.3, 0.3])


def test_bodies_too_near_to_each_other_want_one_around_both(make_skill):
    skill = make_skill(np.random.default_rng(0), dimension=3, attractor=np.zeros(3))
    bottles = [Cylinder(f"bottle {i}", (0.4, 0.08 * i, 0.0), 0.03, 0.2) for i in (1, 2)]
    with pytest.raises(UsageError, match="bottle 1 and bottle 2 are closer") as refusal:
        kept_out(skill, bottles, margin=MARGIN)
    assert "one body around both" in refusal.value.hint
    both = around("bottles", bottles)
    np.testing.assert_allclose(both.size, (0.06, 0.14, 0.2), atol=1e-6)
    link = kept_out(skill, [both], margin=MARGIN).coordinates.links[0]
    assert link.names == ("bottles",)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Ball("x", (0.0, np.nan), 0.1),
        lambda: Ball("x", (0.0, 0.0), 0.0),
        lambda: Box("x", (0.0, 0.0), (1.0,)),
        lambda: Box("x", (0.0, 0.0), (1.0, 1.0), pole=(0.6, 0.0)),
        lambda: Box("x", (0.0, 0.0), (1.0, 1.0), turn=(0.1, 0.2)),
        lambda: Box("x", (0.0,) * 4, (1.0,) * 4, turn=(0.1,)),
        lambda: Cylinder("x", (0.0, 0.0), 0.1, 0.1),
        lambda: Ellipsoid("x", (0.0, 0.0), (0.1, -0.1)),
        lambda: Box("x", (0.0, 0.0), (1.0, 1.0)).inflated(0.0),
    ],
)
def test_a_body_that_is_none_is_refused_by_name(make):
    with pytest.raises(UsageError, match="x: "):
        make()


def test_bodies_move_and_turn():
    for body, shift in ((SOLID[3], (0.1, 0.2, 0.3)), (FLAT[1], (0.1, 0.2))):
        x = np.random.default_rng(13).normal(size=(100, len(shift)))
        moved = body.translated(shift).inflated(MARGIN).values(x + shift)
        np.testing.assert_allclose(moved, body.inflated(MARGIN).values(x), rtol=1e-12)
    quarter = Box("x", (0.0, 0.0, 0.0), (0.4, 0.2, 0.1), turn=(0.0, 0.0, np.pi / 2))
    np.testing.assert_allclose(quarter.bounds[1], (0.1, 0.2, 0.05), atol=1e-8)


def test_of_a_pose_the_position_keeps_out_and_the_turn_is_as_before(make_pose_skill):
    skill = make_pose_skill(np.random.default_rng(14))
    target = skill.attractor[:3]
    body = Ball("ball", tuple(np.add(target, [0.15, 0.1, 0.0])), 0.04)
    kept = kept_out(skill, [body], margin=MARGIN)
    starts = np.tile(skill.attractor, (40, 1))
    starts[:, :3] += np.random.default_rng(15).normal([0.3, 0.2, 0.0], 0.03, (40, 3))
    starts[:, 3:] += np.random.default_rng(16).normal(0, 0.2, (40, 3))
    motions = rollout(kept, starts, duration=60.0, period=0.01)
    assert motions.arrived.all()
    assert body.inflated(MARGIN).values(motions.positions[..., :3].reshape(-1, 3)).min() >= 1
    plain = rollout(skill, starts, duration=60.0, period=0.01)
    assert body.inflated(MARGIN).values(plain.positions[..., :3].reshape(-1, 3)).min() < 1
