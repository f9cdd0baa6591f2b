"""Chains on disk: stages of every kind, what is kept of them, and orders that do not lead on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from skillctl.compose.options import ChainOptions, CombineOptions, MergeOptions
from skillctl.errors import FitError, UsageError
from skillctl.evaluate.coverage import demonstrated_starts
from skillctl.model.chained import ChainedSkill
from skillctl.model.controller import Controller
from skillctl.model.pose import Pose
from skillctl.model.rollout import rollout
from skillctl.model.seds import SedsSkill
from skillctl.options import Length
from skillctl.stability.requirements import Requirements
from skillctl.store.source import open_skill
from skillctl.usecases.adapt import adapt
from skillctl.usecases.chain import chain
from skillctl.usecases.combine import combine
from skillctl.usecases.files import load, save
from skillctl.usecases.merge import merge
from skillctl.usecases.verify_stability import verify, verify_stability


def test_stages_of_every_kind_act_one_after_the_other(library, tmp_path):
    """Learned, merged, latched combined and adapted ones, each at its own target."""
    (tmp_path / "task.toml").write_text(
        "[target]\nposition = [0.05, 0.02]\n[start]\nlow = [0.2, 0.1]\nhigh = [0.21, 0.1]\n"
    )
    merge(["curve", "hook"], store=library, output=tmp_path / "m.h5", options=MergeOptions(target=(0.0, 0.1)))
    combine(["curve", "hook"], store=library, output=tmp_path / "c.h5")
    adapt(tmp_path / "task.toml", ["curve", "hook"], store=library, output=tmp_path / "a.h5")
    skills = ["curve", tmp_path / "m.h5", tmp_path / "c.h5", tmp_path / "a.h5", "curve"]
    options = ChainOptions(target=((5, (0.1, 0.1)),), event=((1, "close"), (2, "wait 0.1"), (1, "wait 0.2")))
    report = chain(skills, store=library, output=tmp_path / "n.h5", options=options)
    made = load(tmp_path / "n.h5")
    assert isinstance(made, ChainedSkill)
    assert [stage.kind for stage in made.parts] == ["seds", "merged", "combined", made.parts[3].kind, "seds"]
    assert made.events == (("close", "wait 0.2"), ("wait 0.1",), (), (), ())
    assert made.attractors.tolist() == [[0.1, 0.1]]
    named = [Path(part.skill).name for part in report.parts]
    assert named == ["curve@1", "m.h5", "c.h5", "a.h5", "curve@1"]
    certificate = verify(tmp_path / "n.h5")
    assert (certificate.verdict, certificate.course) == ("stable", report.certificate.course)
    course = certificate.course
    starts = np.random.default_rng(0).uniform(course.low, course.high, (20, 2))
    motions = rollout(
        made, starts, duration=course.steps * course.period, period=course.period,
        arrival_distance=course.stages[-1].within,
    )  # fmt: skip
    assert motions.arrived.all()
    (last,) = made.stages[-1]
    assert (motions.parts == last).all()


def test_what_the_stages_were_taught_moves_with_their_targets(library, tmp_path):
    options = ChainOptions(target=((2, (0.3, 0.1)),))
    chain(["curve", "curve"], store=library, output=tmp_path / "n.h5", options=options)
    first, second = open_skill(tmp_path / "n.h5").artifact.demonstrations
    original = open_skill("curve", library).artifact.demonstrations[0]
    for one, other, old in zip(first, second, original, strict=True):
        assert np.array_equal(one.positions, old.positions)
        assert np.allclose(
            other.positions - other.positions[-1], old.positions - old.positions[-1], atol=1e-12
        )
        assert other.positions[-1] == pytest.approx([0.3, 0.1], abs=1e-12)
    artifact = open_skill(tmp_path / "n.h5").artifact
    assert [parent.role for parent in artifact.provenance.parents] == ["stage 1", "stage 2"]
    assert artifact.operation.command == "chain"


def test_the_distances_are_those_asked_for_stage_by_stage(library, tmp_path):
    options = ChainOptions(
        within=(
            (2, Length(0.002, "m")),
            (None, Length(0.01, "")),
        )
    )
    report = chain(["curve", "hook", "curve"], store=library, output=tmp_path / "n.h5", options=options)
    within = [stage.within for stage in report.certificate.course.stages]
    assert within == pytest.approx([0.01, 0.002, 0.01], rel=0.5)  # in bent coordinates less than asked for
    assert max(within) <= 0.01
    assert within[1] <= 0.002


def test_poses_are_counted_in_one_characteristic_length(make_grasp, tmp_path):
    there, back = make_grasp(length=0.2), make_grasp((0.4, 0.0, 0.4, 2.9, 0.6, 0.3), length=0.3)
    save(there, tmp_path / "1.h5")
    save(back, tmp_path / "2.h5")
    combine([tmp_path / "1.h5", tmp_path / "2.h5"], output=tmp_path / "both.h5")
    report = chain([tmp_path / f for f in ("1.h5", "2.h5", "both.h5")], output=tmp_path / "n.h5")
    made = load(tmp_path / "n.h5")
    assert isinstance(made.space, Pose)
    assert made.space.length == pytest.approx((0.2 * 0.3 * 0.06**0.5) ** (1 / 3))
    assert len(report.parts[2].targets) == 2
    assert len(report.parts[0].targets[0]) == 7
    states = there.space.placed(0.1 * np.random.default_rng(0).normal(size=(20, 6)), there.attractor)
    assert np.allclose(made.acting_parts[0].velocity(states), there.velocity(states), atol=1e-12)
    both = load(tmp_path / "both.h5")
    assert (made.parts[2].part_at(states) == both.part_at(states)).all()
    controller, state = Controller(made, 0.01), states[0]
    for _ in range(3000):
        state = made.space.displace(state, 0.01 * controller.step(state))
    assert controller.done


def test_a_stage_turned_half_a_turn_from_the_one_before_is_refused(make_grasp, tmp_path):
    save(make_grasp((0.5, 0, 0.3, 0, 0, 0)), tmp_path / "1.h5")
    save(make_grasp((0.5, 0, 0.3, 0, 0, np.pi)), tmp_path / "2.h5")
    with pytest.raises(
        FitError, match=r"nothing was written: stage 2: its target is turned by 180° from"
    ) as caught:
        chain([tmp_path / "1.h5", tmp_path / "2.h5"], output=tmp_path / "n.h5")
    assert "--target" in caught.value.hint
    assert not (tmp_path / "n.h5").exists()
    options = ChainOptions(target=((2, (0.5, 0, 0.3, 0, 0, 1, 1)),))
    with pytest.raises(UsageError, match=r"stage 2: target: the quaternion has length 1\.41"):
        chain([tmp_path / "1.h5", tmp_path / "2.h5"], output=tmp_path / "n.h5", options=options)
    turned = ChainOptions(target=((2, (0.5, 0, 0.3, 0, 0, 0.5**0.5, 0.5**0.5)),), turn=True)
    report = chain([tmp_path / "1.h5", tmp_path / "2.h5"], output=tmp_path / "n.h5", options=turned)
    assert report.certificate.verdict == "stable"


def test_what_cannot_be_a_stage_is_refused_by_its_number(library, make_grasp, tmp_path):
    save(make_grasp(), tmp_path / "pose.h5")
    combine(
        ["curve", "hook"],
        store=library,
        output=tmp_path / "i.h5",
        options=CombineOptions(gate="instantaneous"),
    )
    chain(["curve", "hook"], store=library, output=tmp_path / "n.h5")

    def refused(*skills: str | Path) -> UsageError:
        with pytest.raises(UsageError) as caught:
            chain(skills, store=library, output=tmp_path / "x.h5")
        assert not (tmp_path / "x.h5").exists()
        assert caught.value.hint
        return caught.value

    assert "skill 2 is combined with the instantaneous gate" in str(refused("curve", tmp_path / "i.h5"))
    assert "skill 2 is a chain" in str(refused("curve", tmp_path / "n.h5"))
    assert "skill 2 moves poses, skill 1 positions" in str(refused("reach", tmp_path / "pose.h5"))
    assert "skill 1 positions" not in str(refused("curve", "reach"))


def test_combining_in_sequence_is_chaining(run, library, tmp_path):
    made = ["curve", "hook", "--store", library, "--within", "2mm", "--event", "1:close", "--on-jump", "back"]
    assert run("chain", *made, "-o", tmp_path / "1.h5").exit_code == 0
    assert run("combine", *made, "--gate", "sequence", "-o", tmp_path / "2.h5").exit_code == 0
    assert (tmp_path / "1.h5").read_bytes() == (tmp_path / "2.h5").read_bytes()
    again = run("chain", *made, "-o", tmp_path / "2.h5")
    assert "is up to date" in again.stdout


def test_an_unproved_stage_is_refused(library, tmp_path):
    curve = load("curve", store=library)
    assert isinstance(curve, SedsSkill)
    save(replace(curve, system_matrices=-curve.system_matrices), tmp_path / "unstable.h5")
    with pytest.raises(FitError, match="part 2: leaf 1, component 1"):
        chain(["curve", tmp_path / "unstable.h5"], store=library, output=tmp_path / "n.h5")
    assert not (tmp_path / "n.h5").exists()


def test_a_chain_starts_where_its_first_stage_was_taught(library, tmp_path):
    chain(["curve", "hook"], store=library, output=tmp_path / "n.h5")
    taught = open_skill("curve", library).artifact
    starts = demonstrated_starts(taught.skill, taught.demonstrations)
    (verdict,) = verify_stability([tmp_path / "n.h5"], required=Requirements(start_box="demos")).skills
    assert verdict.reach is not None
    assert (verdict.reach.start_low, verdict.reach.start_high) == (
        tuple(starts.min(axis=0).tolist()),
        tuple(starts.max(axis=0).tolist()),
    )
    assert verdict.reach.measured.arrived == verdict.reach.measured.starts
