"""Two chains, stage by stage: cases whose answer is known."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from skillctl.evaluate.comparison import compare_behaviour
from skillctl.evaluate.stage_comparison import StageDifference, same_course, stage_differences
from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.retarget import retargeted

ENDS = ([0.0, 0.0], [1.0, 0.5], [-0.5, 0.8])


@pytest.fixture(scope="module")
def chain(make_skill):
    rng = np.random.default_rng(3)
    stages = tuple(make_skill(rng, attractor=end) for end in ENDS)
    return ChainedSkill(stages, [0.1, 0.2, 0.3], (("close",), (), ("open",)))


def reordered(chain, *order):
    return replace(
        chain,
        parts=tuple(chain.parts[i] for i in order),
        levels=chain.levels[list(order)],
        events=tuple(chain.events[i] for i in order),
    )


def pairs(found):
    return [(stage.a, stage.b, stage.same_motion) for stage in found]


def test_a_chain_is_itself(chain):
    found = stage_differences(chain, chain)
    assert pairs(found) == [(1, 1, True), (2, 2, True), (3, 3, True)]
    assert {stage.target for stage in found} == {0.0}
    assert [stage.levels for stage in found] == [(0.1, 0.1), (0.2, 0.2), (0.3, 0.3)]
    assert found[0].events == (("close",), ("close",))


def test_stages_are_found_where_they_are_now(chain):
    assert pairs(stage_differences(chain, reordered(chain, 1, 0, 2))) == [
        (1, 2, True), (2, 1, True), (3, 3, True),
    ]  # fmt: skip
    assert pairs(stage_differences(chain, reordered(chain, 1, 2))) == [
        (1, None, False), (2, 1, True), (3, 2, True),
    ]  # fmt: skip
    longer = stage_differences(reordered(chain, 0, 2), chain)
    assert pairs(longer) == [(1, 1, True), (2, 3, True), (None, 2, False)]
    assert longer[-1] == StageDifference(None, 2, levels=(None, 0.2), events=(None, ()))


def test_a_stage_used_twice_is_two_stages(chain):
    twice = reordered(chain, 0, 1, 0)
    assert pairs(stage_differences(twice, twice)) == [(1, 1, True), (2, 2, True), (3, 3, True)]
    assert pairs(stage_differences(twice, reordered(chain, 0, 0, 1))) == [
        (1, 1, True), (2, 3, True), (3, 2, True),
    ]  # fmt: skip


def test_what_was_learned_again_is_another_motion_in_its_place(chain, make_skill):
    other = make_skill(np.random.default_rng(9), attractor=[1.0, 0.9])
    (_, changed, _) = stage_differences(chain, chain.with_stage(1, other))
    assert (changed.a, changed.b, changed.same_motion) == (2, 2, False)
    assert changed.target == pytest.approx(0.4)
    moved = chain.with_stage(1, retargeted(chain.parts[1], [1.0, 0.9]))
    (_, changed, _) = stage_differences(chain, moved)
    assert changed.same_motion
    assert changed.target == pytest.approx(0.4)


def test_priors_and_gates_make_another_motion(chain):
    even = CombinedSkill(chain.parts[:2], np.array([0.5, 0.5]))
    odd = replace(even, part_priors=np.array([0.25, 0.75]))
    one, other = (chain.with_stage(0, stage) for stage in (even, odd))
    assert not stage_differences(one, other)[0].same_motion
    assert stage_differences(one, one)[0].same_motion


def test_only_chains_have_stages(chain):
    assert stage_differences(chain, chain.parts[0]) == ()
    assert not same_course(chain, chain.parts[0], 1, 1)
    assert same_course(chain.parts[0], chain.parts[1], 0, 0)


@pytest.mark.parametrize(
    "change",
    [
        {"levels": np.array([0.1, 0.2, 0.30001])},
        {"events": (("close",), ("open",), ())},
        {"on_jump": "back"},
        {"disturbance_distance": 0.021},
    ],
)
def test_a_chain_with_the_same_motions_may_go_on_in_another_way(chain, change):
    other = replace(chain, **change)
    assert same_course(chain, chain, 0, 0)
    assert not same_course(chain, other, 1e-6, 1e-6)


def test_levels_and_distances_within_the_tolerance_are_the_same(chain):
    other = replace(chain, levels=chain.levels * (1 + 1e-9), disturbance_distance=0.02 + 1e-9)
    assert same_course(chain, other, 1e-8, 1e-8)
    assert not same_course(chain, other, 1e-10, 1e-10)


def test_the_velocities_of_all_stages_are_compared(chain):
    """Only the last stage is faster: the field at a start is the same, and yet they differ."""
    faster = chain.with_stage(2, chain.parts[2].accelerated(2))
    found = compare_behaviour(chain, faster, [], 1e-9, 1e-9)
    assert not found.same
    assert found.grid.greatest > 0
    places = np.array([[0.3, 0.1], [-0.2, 0.7]])
    first = chain.velocity(places), faster.velocity(places)
    assert (first[0] == first[1]).all()
    assert compare_behaviour(chain, chain, [], 0, 0).same


@pytest.mark.parametrize("other", [lambda chain: reordered(chain, 0, 1), lambda chain: chain.parts[2]])
def test_chains_of_other_stages_are_compared_by_their_motions_alone(chain, other):
    found = compare_behaviour(chain, other(chain), [], 1e-9, 1e-9)
    assert (found.incomparable, found.grid, found.same) == ("other stages", None, False)


def test_the_command_shows_what_became_of_each_stage(run, chain_file):
    one = chain_file("curve", "hook", events=(("close", "wait 0.5"), ()))
    other = chain_file("hook", "curve", to="other.h5", level=4e-4, on_jump="back")
    same = run("diff", one, one, "--exit-code")
    assert (same.exit_code, same.stdout.splitlines()[-1]) == (0, "result  identical")
    text = run("diff", one, other, "--exit-code")
    assert text.exit_code == 1
    rows = [line.split(maxsplit=4) for line in text.stdout.splitlines() if "→" in line]
    assert [row[:2] for row in rows] == [["1", "2"], ["2", "1"]]
    assert "0.0001 → 0.0004  close, wait 0.5 → –" in text.stdout
    assert "skill.on_jump" in text.stdout
    shown = json.loads(run("diff", one, other, "--json").stdout)["stages"]
    assert [(stage["a"], stage["b"], stage["same_motion"]) for stage in shown] == [(1, 2, True), (2, 1, True)]
    shorter = chain_file("curve", to="shorter.h5")
    assert "velocity          not comparable: they have other stages\n" in run("diff", one, shorter).stdout
    events = chain_file("curve", "hook", to="events.h5", events=(("close", "wait 0.6"), ()))
    assert "result                      they behave differently\n" in run("diff", one, events).stdout
