"""Chains: stages in their order, events between them, jumps, and a memory that can be written down."""

import copy
import json
import pickle

import numpy as np
import pytest

from skillctl.errors import InvalidModelError, UsageError
from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.controller import Controller
from skillctl.model.coordinates.bodies import Ball
from skillctl.model.rollout import rollout
from skillctl.model.skill import contraction_period

PERIOD = 0.01
ENDS = ([0.0, 0.0], [1.0, 0.5], [-0.5, 0.8])
LEVEL = 1e-4


@pytest.fixture
def make_chain(make_skill):
    """A chain of learned skills that end at ENDS."""

    def make(*, events=((), (), ()), seed=3, **options):
        rng = np.random.default_rng(seed)
        stages = tuple(make_skill(rng, attractor=end) for end in ENDS)
        return ChainedSkill(stages, [LEVEL] * 3, events, **options)

    return make


def v_of(stage, state):
    """V by its definition."""
    offset = state - stage.attractor
    return offset @ stage.lyapunov @ offset


def driven(controller, state, steps, busy=lambda event: False):
    """Follow a chain as a perfect robot; yield stage, event and state at each step."""
    for _ in range(steps):
        command = controller.step(state, busy=busy(controller.event))
        yield controller.stage, controller.event, state
        state = state + controller.period * command


def test_a_rollout_passes_all_stages_in_their_order_and_ends_at_the_last_target(make_chain):
    chain = make_chain()
    starts = np.random.default_rng(0).uniform(-2, 2, (20, 2))
    period = min(PERIOD, contraction_period(chain))
    result = rollout(chain, starts, duration=200.0, period=period)
    assert result.arrived.all()
    assert (result.parts == 2).all()
    np.testing.assert_allclose(result.positions[:, -1], np.tile(ENDS[2], (20, 1)), atol=1e-3)
    for path in result.positions:
        inside = np.array([[v_of(stage, x) <= LEVEL for x in path] for stage in chain.parts[:2]])
        assert inside[1, inside[0].argmax() :].any()
        assert inside[0].any()


def test_a_start_at_the_last_target_does_not_count_before_the_other_stages(make_chain):
    chain = make_chain()
    result = rollout(chain, [ENDS[2]], duration=200.0, period=min(PERIOD, contraction_period(chain)))
    assert result.arrival_times[0] > 0
    assert np.linalg.norm(result.positions[0] - ENDS[0], axis=1).min() < 0.1


def test_many_and_single_states_are_handed_over_alike(make_chain):
    chain = make_chain()
    rng = np.random.default_rng(1)
    near = np.array([stage.attractor for stage in chain.parts])[:, None] + 0.02 * rng.standard_normal(
        (3, 40, 2)
    )
    for part, states in enumerate(near):
        many = chain.onward(states, np.full(40, part))
        one = [chain.onward_at(state, part) for state in states]
        by_hand = [min(part + (v_of(chain.parts[part], x) <= LEVEL), 2) for x in states]
        assert many.tolist() == one == by_hand
        assert len(set(one)) == (1 if part == 2 else 2)


def test_events_come_in_their_order_and_the_stage_waits_for_them(make_chain):
    chain = make_chain(events=[("close", "wait 0.3"), (), ("open",)])
    controller = Controller(chain, 0.1, allow_unproved=True)
    closing = iter([True] * 4 + [False])
    seen = list(driven(controller, np.array(ENDS[0]), 400, lambda event: event == "close" and next(closing)))
    assert [event for _, event, _ in seen[:5]] == ["close"] * 5  # due once, and four times busy
    assert [event for _, event, _ in seen[5:9]] == ["wait 0.3"] * 3 + [None]
    assert [stage for stage, _, _ in seen[:8]] == [0] * 8
    assert seen[8][0] == 1
    assert [event for _, event, _ in seen].count("open") == 1
    assert controller.done


def test_events_go_on_only_where_the_stage_is_over(make_chain):
    chain = make_chain(events=[("close",), (), ()], disturbance_distance=100.0)
    controller = Controller(chain, PERIOD, allow_unproved=True)
    controller.step(ENDS[0])
    assert controller.event == "close"
    for _ in range(3):  # dragged away, less than what counts as a jump
        controller.step([0.3, 0.3])
        assert (controller.stage, controller.event) == (0, "close")
    controller.step(ENDS[0])
    assert (controller.stage, controller.event) == (1, None)


def test_a_step_that_is_refused_leaves_events_as_they_were(make_chain):
    chain = make_chain(events=[("close",), (), ()])
    controller = Controller(chain, PERIOD, allow_unproved=True)
    controller.step(ENDS[0])
    before = controller.state()
    with pytest.raises(UsageError, match="needs a margin"):
        controller.step(ENDS[0], seen=[Ball("ball", (0.5, 0.5), 0.1)])
    assert controller.state() == before


@pytest.mark.parametrize(("on_jump", "stage"), [("stay", 2), ("back", 0)])
def test_a_jump_keeps_the_stage_or_leads_back_to_the_one_that_knows_the_place(make_chain, on_jump, stage):
    chain = make_chain(on_jump=on_jump)
    controller = Controller(chain, PERIOD, allow_unproved=True)
    controller.go(2)
    controller.step([0.4, 0.4])
    assert controller.stage == 2
    taught = chain.parts[0].density.means[0]
    scores = [float(part.density.log_density(taught[None])[0]) for part in chain.parts]
    assert np.argmax(scores) == 0
    controller.step(taught)
    assert controller.stage == stage


def test_a_jump_never_leads_to_a_stage_that_has_not_begun(make_chain):
    chain = make_chain(on_jump="back")
    controller = Controller(chain, PERIOD, allow_unproved=True)
    controller.step([0.4, 0.4])
    controller.step(chain.parts[2].density.means[0])
    assert controller.stage == 0


def test_the_memory_can_be_written_down_and_gone_on_with(make_chain):
    chain = make_chain(events=[("close", "wait 0.05"), (), ("wait 0.1",)])
    ours = Controller(chain, PERIOD, allow_unproved=True)
    state = np.array([0.3, -0.2])
    for step in range(1500):
        theirs = Controller(chain, PERIOD, allow_unproved=True)
        theirs.restore(json.loads(json.dumps(ours.state())))
        command = ours.step(state, busy=step % 2 == 0)
        if step % 10 == 0 or ours.event:
            assert theirs.stage is None or theirs.part is not None
            assert (theirs.step(state, busy=step % 2 == 0) == command).all()
            assert (theirs.stage, theirs.event, theirs.done) == (ours.stage, ours.event, ours.done)
        state = state + PERIOD * command
    assert ours.stage > 0


@pytest.mark.parametrize(
    "change",
    [
        lambda memory: memory.pop("last"),
        lambda memory: memory.update(begin=7),
        lambda memory: memory["last"].update(parts=3),
        lambda memory: memory["last"].update(states=[0.0]),
        lambda memory: memory["course"].update(until=3),
    ],
)
def test_a_memory_of_another_skill_is_refused(make_chain, change):
    controller = Controller(make_chain(), PERIOD, allow_unproved=True)
    controller.step([0.3, 0.1])
    memory = controller.state()
    change(memory)
    with pytest.raises(UsageError, match="not that of a controller of this skill"):
        controller.restore(memory)
    assert controller.part == 0


def test_a_stage_that_is_not_there_is_refused(make_chain):
    controller = Controller(make_chain(), PERIOD, allow_unproved=True)
    with pytest.raises(UsageError, match="no stage 3"):
        controller.go(3)
    with pytest.raises(UsageError, match="no stage 0"):
        Controller(make_chain().parts[0], PERIOD, allow_unproved=True).go(0)


def test_a_combined_stage_moves_at_its_own_speed_and_chooses_its_part(make_skill):
    rng = np.random.default_rng(4)
    parts = tuple(make_skill(rng, attractor=[0.0, 0.0]) for _ in range(2))
    combined = CombinedSkill(parts, [0.5, 0.5], speed=2.0)
    chain = ChainedSkill((parts[0], combined), [LEVEL] * 2, [(), ()])
    assert [list(stage) for stage in chain.stages] == [[0], [1, 2]]
    for state in rng.uniform(-1, 1, (20, 2)):
        part = chain.begun_at(1, state)
        assert part == 1 + combined.selected(state)
        np.testing.assert_allclose(chain.velocity(state, part), combined.velocity(state), rtol=1e-12)


def test_chains_are_copied_pickled_and_moved_whole(make_chain):
    chain = make_chain(events=[("close",), (), ("open",)], on_jump="back")
    states = np.random.default_rng(2).uniform(-1, 1, (5, 2))
    for twin in (copy.deepcopy(chain), pickle.loads(pickle.dumps(chain))):
        assert (twin.velocity(states, 1) == chain.velocity(states, 1)).all()
        assert (twin.events, twin.on_jump) == (chain.events, chain.on_jump)
    offset = np.array([0.25, 0.5])
    moved = chain.carried(np.zeros(2), offset)
    np.testing.assert_allclose(
        moved.velocity(states + offset, 2), chain.velocity(states, 2), rtol=1e-9, atol=1e-12
    )
    np.testing.assert_allclose(moved.attractors, chain.attractors + offset)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"levels": [1.0, 0.0, 1.0]}, "levels"),
        ({"levels": [1.0, 1.0]}, "levels"),
        ({"events": [(), ()]}, "one tuple for each part"),
        ({"events": [("Close",), (), ()]}, "'Close' is no word"),
        ({"events": [("wait",), (), ()]}, "'wait' is no word"),
        ({"on_jump": "forward"}, "one of stay, back"),
        ({"disturbance_distance": 0.0}, "disturbance_distance"),
    ],
)
def test_a_chain_that_makes_no_sense_is_refused(make_chain, change, said):
    fields = {"levels": [1.0] * 3, "events": [()] * 3, **change}
    with pytest.raises(InvalidModelError, match=said):
        ChainedSkill(make_chain().parts, **fields)


def test_instantaneous_skills_and_chains_are_no_stages(make_chain):
    chain = make_chain()
    instantaneous = CombinedSkill(chain.parts, [1 / 3] * 3, gate="instantaneous")
    with pytest.raises(InvalidModelError, match="an instantaneous combined skill cannot be a stage"):
        ChainedSkill((instantaneous,), [1.0], [()])
    with pytest.raises(InvalidModelError, match="a chain cannot be a stage of a chain"):
        ChainedSkill((chain,), [1.0], [()])
    with pytest.raises(InvalidModelError, match="a chain cannot be a part of another skill"):
        CombinedSkill((chain,), [1.0])


def test_a_rollout_says_which_part_acts_at_each_state(make_chain, monkeypatch):
    chain = make_chain()
    period = min(PERIOD, contraction_period(chain))
    whole = rollout(chain, [[1.5, -1.0], ENDS[0]], duration=200.0, period=period)
    for path, acting in zip(whole.positions, whole.acting, strict=True):
        expected, stage = [], 0
        for x in path:
            while stage < 2 and v_of(chain.parts[stage], x) <= LEVEL:
                stage += 1
            expected.append(stage)
        assert acting.tolist() == expected
    assert whole.acting[1, 0] == 1  # it starts at the end of the first stage
    monkeypatch.setattr("skillctl.model.rollout.MOST_STATES", 50)
    thinned = rollout(chain, [[1.5, -1.0], ENDS[0]], duration=200.0, period=period)
    at = np.searchsorted(whole.times, thinned.times - period / 2)
    assert len(thinned.times) < 60
    assert (thinned.acting == whole.acting[:, at]).all()
