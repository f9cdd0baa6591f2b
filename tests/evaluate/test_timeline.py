"""The stages of a chain over time, against systems whose motion has a formula."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from skillctl import store
from skillctl.evaluate.place import at, regions_of
from skillctl.evaluate.timeline import stage_ends, timeline_of
from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.mixture import GaussianMixture
from skillctl.stability.certificate import certify

PERIOD = 1e-3  # [s]
RATES = (2.0, 0.5)
ENDS = ([0.0, 0.0], [3.0, 4.0])
LEVELS = np.array([0.01, 0.04])


@pytest.fixture
def linear(make_skill):
    """Two stages ξ̇ = −r (ξ − ξ*) under V = ‖ξ − ξ*‖², taught at (2, 0) and at (0, 0)."""

    def stage(rate, end, place):
        skill = make_skill(np.random.default_rng(0), n_components=1, attractor=end)
        density = GaussianMixture(np.ones(1), np.array([place]), 0.01 * np.eye(2)[None])
        return replace(skill, system_matrices=-rate * np.eye(2)[None], density=density)

    stages = tuple(map(stage, RATES, ENDS, ([2.0, 0.0], [0.0, 0.0])))
    return ChainedSkill(stages, LEVELS, (("close", "wait 0.25"), ("wait 1", "wait 0.5")), "back", 0.125)


def artifact_of(chain, parents=()):
    provenance = store.Provenance(tool="1", parents=parents)
    operation = store.Operation(command="python")
    return store.Artifact(chain, (None,) * len(chain.leaves), operation, provenance)


def steps(start, end, rate, level):
    """The first step at which V = ‖x − x*‖² (1 − r Δt)^2n is at the level."""
    return np.ceil(0.5 * np.log(level / np.sum((start - end) ** 2)) / np.log1p(-rate * PERIOD))


def test_a_stage_is_over_at_the_step_of_the_formula(linear):
    starts = np.array([[2.0, 0.0], [0.0, -1.5], [0.05, 0.0]])
    ends = stage_ends(linear, starts, PERIOD)
    for start, found in zip(starts, ends, strict=True):
        first = steps(start, np.array(ENDS[0]), RATES[0], LEVELS[0]) if start.any() else 0
        first = max(first, 0)
        handed = start * (1 - RATES[0] * PERIOD) ** first
        second = steps(handed, np.array(ENDS[1]), RATES[1], LEVELS[1])
        # A step more or less where V is at the level but for rounding.
        np.testing.assert_allclose(found / PERIOD, [first, first + second], atol=1.5)
    assert ends[2, 0] == 0  # it starts where the first stage is over


def test_a_stage_that_does_not_end_has_no_time(linear):
    still = linear.with_stage(1, replace(linear.parts[1], system_matrices=np.full((1, 2, 2), 1e-9)))
    ends = stage_ends(still, np.array([[2.0, 0.0]]), PERIOD)
    assert np.isfinite(ends[0, 0])
    assert np.isnan(ends[0, 1])
    line = timeline_of(artifact_of(still), certify(still))
    assert [stage.duration is None for stage in line.stages] == [False, True]
    assert line.stages[1].begins == pytest.approx(line.stages[0].duration + 0.25)
    assert line.duration is None


def test_waits_count_and_other_events_do_not(linear):
    line = timeline_of(artifact_of(linear), certify(linear))
    first, second = line.stages
    moves = [0.5 * np.log(4 / 0.01) / 2]
    moves.append(np.log((25**0.5 - 0.06) / 0.2) / 0.5)  # from (0.1, 0), 0.06 nearer to (3, 4)
    # The periods of the rollout are 10 ms, and so is the error of Euler's steps at rates of 2/s, in per cent.
    assert first.duration == pytest.approx(moves[0], rel=0.02)
    assert second.duration == pytest.approx(moves[1], rel=0.02)
    assert (first.begins, first.waits, second.waits) == (0, 0.25, 1.5)
    assert second.begins == pytest.approx(first.duration + 0.25)
    assert line.duration == pytest.approx(second.begins + second.duration + 1.5)
    assert (line.starts, line.on_jump, line.disturbance_distance) == (1, "back", 0.125)
    assert [stage.events for stage in line.stages] == list(linear.events)
    assert [stage.level for stage in line.stages] == LEVELS.tolist()
    assert [stage.targets for stage in line.stages] == [(tuple(end),) for end in ENDS]


def test_stages_have_the_names_of_the_skills_they_were(linear):
    parents = tuple(
        store.ParentRecord(name=name, version=3, digest=f"sha256:{'1' * 64}", role="x") for name in "ab"
    )
    named = timeline_of(artifact_of(linear, parents), certify(linear))
    assert [stage.skill for stage in named.stages] == ["a@3", "b@3"]
    unnamed = timeline_of(artifact_of(linear, parents[:1]), certify(linear))
    assert [stage.skill for stage in unnamed.stages] == [None, None]


def test_what_is_seen_is_within_what_is_proved(chained):
    artifact = chained("curve", "hook")
    line = timeline_of(artifact, certify(artifact.skill))
    assert line.starts == 4
    for stage, skill in zip(line.stages, artifact.skill.parts, strict=True):
        assert 0 < stage.duration < stage.bound
        # {V ≤ c} reaches √(c / λ) from the target, λ the least eigenvalue of P; the bound may round up.
        reach = np.sqrt(1e-4 / np.linalg.eigvalsh(skill.lyapunov)[0])
        assert reach <= stage.within < 1.001 * reach
    assert line.duration < certify(artifact.skill).course.arrival
    assert timeline_of(replace(artifact, skill=artifact.skill.parts[0], **bare(1)), None) is None


def bare(n):
    return {"demonstrations": (None,) * n, "reports": ()}


def test_a_place_says_which_stage_acts_there(linear):
    certificate = certify(linear)
    places = {(2.0, 0.1): (1, 1), (0.05, 0.0): (2, 2), (0.3, 0.1): (1, 2), (9.0, 0.0): (1, 1)}
    for position, stages in places.items():
        place = at(linear, position, certificate)
        assert (place.stages, place.part, place.arrives, place.attractor) == (stages, None, True, 1)
        rate, end = RATES[stages[0] - 1], np.array(ENDS[stages[0] - 1])
        assert place.velocity == pytest.approx(tuple(-rate * (np.array(position) - end)))
        np.testing.assert_allclose(place.end, ENDS[1], atol=1e-3)
    stays = replace(linear, on_jump="stay")
    assert at(stays, (2.0, 0.1), certificate).stages == (1, 2)
    assert at(linear.parts[0], (2.0, 0.1), certificate).stages is None


def test_the_second_stage_may_be_combined(linear):
    stage = CombinedSkill(linear.parts, np.array([0.5, 0.5]))
    chain = linear.with_stage(1, stage)
    line = timeline_of(artifact_of(chain), certify(chain))
    assert line.stages[1].targets == (tuple(ENDS[0]), tuple(ENDS[1]))
    assert at(chain, (0.05, 0.0), certify(chain)).stages == (2, 2)


def test_the_command_shows_the_stages_to_people_and_programs(run, chain_file):
    path = chain_file("curve", "hook", events=(("close", "wait 0.5"), ()), on_jump="back")
    text = run("inspect", path)
    assert (text.exit_code, text.stderr) == (0, "")
    for words in (
        "kind                chain of 2 stages\n",
        "after a jump        of more than 20.00 mm: that stage goes on, of those begun, which",
        "stage  skill    begins ",
        "curve@1  0.00 s",
        "close, wait 0.5\n",
        "stage  leaf  components",
        "stage 2  hook@1",
    ):
        assert words in text.stdout
    shown = json.loads(run("inspect", path, "--at", "0.1,0.1", "--json").stdout)
    assert (shown["kind"], shown["tree"]["disturbance_distance"]) == ("chain", 0.02)
    assert [stage["skill"] for stage in shown["timeline"]["stages"]] == ["curve@1", "hook@1"]
    assert shown["timeline"]["stages"][0]["events"] == ["close", "wait 0.5"]
    assert shown["at"]["stages"][0] == 1
    place = run("inspect", path, "--at", "0.1,0.1").stdout
    assert "acts      stage 1, of a motion that starts here\n" in place
    assert "after a jump here in the last stage\n" in place


def test_combined_stages_have_their_regions(chained, library, tmp_path):
    from skillctl.usecases.combine import combine

    both = combine(["curve", "hook"], output=tmp_path / "both.h5", store=library).written.path
    alone = regions_of(artifact := store.read_skill(both), certify(artifact.skill))
    chain = chained("hook", str(both), "curve")
    found = regions_of(chain, certify(chain.skill))
    assert [region.part for region in found] == [2, 3]  # the first is the only one of stage 1
    assert [replace(region, part=region.part - 1) for region in found] == list(alone)
    assert regions_of(chained("curve", "hook"), certify(chained("curve", "hook").skill)) == ()
