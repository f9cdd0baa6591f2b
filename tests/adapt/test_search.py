"""The search for a skill that does a task, against motions that are computed one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skillctl.adapt.blends import Blends
from skillctl.adapt.judge import Judge
from skillctl.adapt.search import search, shortlist
from skillctl.adapt.task_file import Task
from skillctl.adapt.verdict import judge_task
from skillctl.errors import UsageError
from skillctl.model.gates import MERGE_GATES
from skillctl.model.mixture import GaussianMixture
from skillctl.model.rollout import rollout
from skillctl.model.seds import SedsSkill
from skillctl.model.space import Euclidean
from skillctl.stability.certificate import certify


def linear(matrix, *, attractor=(0.0, 0.0)):
    """One component: ẋ = A (x − x*)."""
    matrix, goal = np.array(matrix, dtype=float), np.array(attractor, dtype=float)
    d = len(goal)
    density = GaussianMixture(np.ones(1), goal[None], np.eye(d)[None])
    return SedsSkill(
        priors=np.ones(1),
        means=goal[None],
        covariances=np.eye(d)[None],
        system_matrices=matrix[None],
        residual_covariances=1e-4 * np.eye(d)[None],
        attractor=goal,
        lyapunov=np.eye(d),
        density=density,
        space=Euclidean.cartesian(d),
    )


# From (1, 1) the first comes to y = 0 long before x = 0, the second to x = 0 long before y = 0; both together
# go straight.
FLAT = linear([[-1.0, 0.0], [0.0, -4.0]])
STEEP = linear([[-4.0, 0.0], [0.0, -1.0]])


def task(**clauses):
    start = {"low": (0.95, 0.95), "high": (1.0, 1.0)}
    return Task(**{"target": {"position": (0.0, 0.0), "tolerance": 0.02}, "start": start, **clauses})


@pytest.mark.parametrize("gate", [gate.name for gate in MERGE_GATES])
def test_many_mergers_at_once_move_as_each_alone(make_skill, gate):
    rng = np.random.default_rng(1)
    parts = [make_skill(rng, rate=1.0, spread=0.2) for _ in range(3)]
    blends = Blends(parts)
    weights = [np.array(w) for w in ((0.2, 0.3, 0.5), (0.6, 0.0, 0.4), (1 / 3, 1 / 3, 1 / 3))]
    factors = [np.ones(9), np.ones(9), rng.uniform(0.5, 2, 9)]
    tried = [blends.plain(w)._replace(factors=f) for w, f in zip(weights, factors, strict=True)]
    starts = rng.normal(size=(4, 2))
    together = blends.follow(tried, gate, starts, 0.01, 60, 0.0)
    for motions, blend in zip(together, tried, strict=True):
        alone = rollout(
            blends.skill(blend, gate, 1.0), starts, duration=0.6, period=0.01, arrival_distance=1e-12
        )
        assert motions == pytest.approx(alone.positions, abs=60 * 2**-52 * 100)  # sums in another order


def test_bent_coordinates_are_followed_as_each_alone(make_skill, make_shears):
    from skillctl.model.coordinates.chain import Chain

    rng = np.random.default_rng(2)
    chain = Chain((make_shears(rng, 2, size=0.05),))
    parts = [replace(make_skill(rng, rate=1.0, spread=0.2), coordinates=chain) for _ in range(2)]
    blends = Blends(parts)
    blend = blends.plain(np.array([0.4, 0.6]))
    starts = rng.normal(size=(3, 2))
    (together,) = blends.follow([blend], "density", starts, 0.005, 50, 0.0)
    alone = rollout(
        blends.skill(blend, "density", 1.0), starts, duration=0.25, period=0.005, arrival_distance=1e-12
    )
    assert together == pytest.approx(alone.positions, abs=1e-11)  # inverse shears are exact to rounding only


def test_a_task_that_only_a_merger_does():
    # The straight line from (1, 1) passes (0.5, 0.5); e^(−4t) curves of the parts are 0.28 away from it.
    wanted = task(via=[{"name": "middle", "point": (0.5, 0.5), "within": 0.08}])
    found = search(wanted, [FLAT, STEEP])
    assert found.single.worst["middle"] < -0.1
    assert found.best.kind == "merged"
    assert found.best.holds
    assert found.equal is not None
    assert found.equal.worst["middle"] == pytest.approx(0.08, abs=0.03)
    assert found.best.score > max(c.score for c in found.candidates) - 0.05


def test_each_skill_alone_is_judged_by_its_closed_form():
    found = search(task(limits={"time": 9.0}), [FLAT])
    # |x(t)| = e^(−t) from 1 falls to 0.02 at ln 50; the controller's steps of 0.01 s: (1 − 0.01)^n.
    expected = 0.01 * np.ceil(np.log(0.02) / np.log(0.99))
    assert found.best.worst["limits.time"] == pytest.approx(9.0 - expected, abs=0.011)


def test_starts_select_a_part_of_a_combination():
    left = linear([[-1.0, 0.0], [0.0, -4.0]], attractor=(0.0, 0.0))
    upper = replace(left, density=GaussianMixture(np.ones(1), np.array([[1.0, 1.0]]), 0.01 * np.eye(2)[None]))
    lower = replace(
        STEEP, density=GaussianMixture(np.ones(1), np.array([[1.0, -1.0]]), 0.01 * np.eye(2)[None])
    )
    points = {"points": ((1.0, 1.0), (1.0, -1.0))}
    # The first passes (0.5, 0.0625), the second (0.0625, −0.5): only a choice by the start does both.
    vias = [
        {"name": "flat", "point": (0.5, 0.0625), "within": 1.0},
        {"name": "steep", "point": (0.0625, -0.5), "within": 1.0},
    ]
    wanted = Task(target={"position": (0.0, 0.0), "tolerance": 0.02}, start=points, via=vias)
    found = search(wanted, [upper, lower])
    (both,) = [c for c in found.candidates if c.kind == "combined"]
    assert both.margins["flat"][0] == pytest.approx(1.0, abs=0.01)
    assert both.margins["steep"][1] == pytest.approx(1.0, abs=0.01)


def test_speed_is_chosen_for_the_limits():
    # |ẋ| is 1·√(1 + 16) at first; the parts take ln 50 s. Faster than 3 m/s is forbidden.
    found = search(task(limits={"speed": 3.0, "time": 8.0}), [FLAT])
    assert found.best.speed == pytest.approx(0.9 * 3.0 / np.sqrt(17), rel=0.01)
    assert found.best.holds
    skill = found.best.build()
    assert float(np.linalg.norm(skill.velocity([1.0, 1.0]))) == pytest.approx(2.7, rel=0.01)


def test_equal_calls_give_equal_results():
    wanted = task(via=[{"point": (0.5, 0.5), "within": 0.08}])
    first, second = (search(wanted, [FLAT, STEEP]) for _ in range(2))
    assert [c.score for c in first.candidates] == [c.score for c in second.candidates]
    assert (first.best.weights == second.best.weights).all()


def test_margins_of_a_candidate_are_those_of_its_skill():
    wanted = task(via=[{"name": "middle", "point": (0.5, 0.5), "within": 0.08}])
    found = search(wanted, [FLAT, STEEP])
    again = Judge.of(wanted, FLAT, found.judge.starts).trial(found.best.build())
    assert again["middle"] == pytest.approx(found.best.margins["middle"], abs=0.01)  # other steps of time


def test_an_impossible_task_is_named_by_its_clause():
    wanted = task(**{"keep-out": [{"name": "bottle", "kind": "ball", "centre": (0.0, 0.0), "radius": 0.1}]})
    found = search(wanted, [FLAT, STEEP])
    assert not found.best.holds
    assert found.best.worst["bottle"] < -0.09


def test_another_dimension_is_refused():
    with pytest.raises(UsageError, match="3 numbers, the skills have 2"):
        search(
            Task(
                target={"position": (0.0, 0.0, 0.0)}, start={"low": (1.0, 1.0, 1.0), "high": (1.0, 1.0, 1.0)}
            ),
            [FLAT],
        )


def test_what_is_proved_of_each_clause():
    """P = I and V = x² + y²: from the box up to (1, 1) no motion of ẋ = −x leaves the circle of radius √2."""
    slow = linear([[-1.0, 0.0], [0.0, -1.0]])
    wanted = task(
        limits={"time": 20.0, "period": 0.5},
        **{
            "stay-in": [
                {"name": "wide", "low": (-2.0, -2.0), "high": (2.0, 2.0)},
                {"name": "tight", "low": (-0.1, -0.1), "high": (1.1, 1.1)},
            ],
            "keep-out": [
                {"name": "far", "kind": "ball", "centre": (3.0, 0.0), "radius": 0.5, "clearance": 0.1},
                {"name": "near", "kind": "ball", "centre": (1.0, -0.5), "radius": 0.1},
            ],
        },
    )
    verdict = judge_task(wanted, slow, certify(slow))
    bounds = {each.clause: each.bound for each in verdict.clauses}
    assert verdict.holds
    assert bounds["target"] == 0.02
    assert bounds["wide"] == pytest.approx(2 - np.sqrt(2), abs=1e-9)
    assert bounds["tight"] == pytest.approx(0.1 - np.sqrt(2), abs=1e-9)  # not proved
    assert bounds["far"] == pytest.approx(3.0 - 0.5 - 0.1 - np.sqrt(2), abs=1e-6)
    assert bounds["near"] is None
    assert bounds["limits.period"] == pytest.approx(2.0 - 0.5, abs=1e-6)  # |1 − Δt| < 1 for Δt < 2
    # From √2 to 0.02 at rate 1 it takes ln(√2 / 0.02) at least; the bound is about 1 mm, and for long steps.
    assert 0 < bounds["limits.time"] < 20 - np.log(np.sqrt(2) / 0.02)
    assert {each.clause for each in verdict.clauses if each.proved} >= {"target", "wide", "far"}


def test_of_many_skills_those_that_move_differently_are_taken():
    crowd = [linear([[-1.0, 0.0], [0.0, -4.0 - 0.01 * i]]) for i in range(5)]  # all but the same motion
    wanted = task(via=[{"name": "middle", "point": (0.5, 0.5), "within": 0.08}])
    skills = [*crowd, STEEP, *crowd]
    chosen = shortlist(wanted, skills)
    assert len(chosen) == 3
    assert 5 in chosen
    assert search(wanted, [skills[i] for i in chosen]).best.holds
