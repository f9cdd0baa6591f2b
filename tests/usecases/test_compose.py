"""Skills from skills on disk: proofs, refits, and what children take over from their parents."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skillctl.compose.options import CombineOptions, MergeOptions
from skillctl.errors import ArtifactError, FitError, UsageError
from skillctl.learning.options import LearnOptions
from skillctl.model.joint import joint_mixture
from skillctl.model.mixture import GaussianMixture
from skillctl.model.rollout import rollout
from skillctl.model.seds import SedsSkill
from skillctl.model.space import Euclidean
from skillctl.store import Artifact, Operation, current_provenance, encode, read_skill, write_file
from skillctl.store.source import open_skill
from skillctl.usecases.combine import combine
from skillctl.usecases.files import load, save
from skillctl.usecases.learn import learn
from skillctl.usecases.merge import merge
from skillctl.usecases.verify_stability import verify


def shear(strength: float, upper: bool) -> SedsSkill:
    """Return a one-component skill, stable by itself, whose matrix shears one way."""
    matrix = -np.eye(2)
    matrix[(0, 1) if upper else (1, 0)] = strength
    # P of the Lyapunov equation P A + Aᵀ P = −I, solved by hand for A = −I + strength · e_i e_jᵀ.
    a, b = strength / 4, strength**2 / 4
    lyapunov = np.array([[0.5, a], [a, 0.5 + b]]) if upper else np.array([[0.5 + b, a], [a, 0.5]])
    eye = np.eye(2)[None]
    return SedsSkill(
        priors=np.ones(1),
        means=np.array([[0.2, 0.1]]),
        covariances=0.01 * eye,
        system_matrices=matrix[None],
        residual_covariances=1e-4 * eye,
        attractor=np.zeros(2),
        lyapunov=lyapunov,
        density=GaussianMixture(np.ones(1), np.array([[0.2, 0.1]]), 0.01 * eye),
        space=Euclidean.cartesian(2),
    )


@pytest.fixture
def conflict(tmp_path, library):
    """Two skills without a common P (their mean matrix is unstable), carrying demonstrations."""
    skills = {"upper": replace(shear(10, upper=True), speed=0.5), "lower": shear(10, upper=False)}
    mean = np.mean([skill.system_matrices[0] for skill in skills.values()], axis=0)
    assert np.linalg.eigvals(mean).real.max() > 0
    for name, skill in skills.items():
        taught = open_skill("curve", library).artifact.demonstrations
        operation = Operation(command="learn", options={"preset": "fast", "objective": "mse"}, seed=3)
        artifact = Artifact(skill, taught, operation, current_provenance())
        write_file(tmp_path / f"{name}.h5", encode(artifact))
        assert verify(tmp_path / f"{name}.h5").verdict == "stable"
    return [tmp_path / "upper.h5", tmp_path / "lower.h5"]


def test_parts_without_a_common_proof_are_refitted_and_the_cost_is_told(conflict, tmp_path):
    report = merge(conflict, output=tmp_path / "m.h5")
    assert report.lyapunov == "refitted"
    assert [refit.leaf for refit in report.refits] == [1, 2]
    assert all(refit.dtw_after < refit.dtw_before for refit in report.refits)  # shear never was this motion
    assert verify(tmp_path / "m.h5").verdict == "stable"
    assert [leaf.speed for leaf in load(tmp_path / "m.h5").leaves] == [0.5, 1.0]
    results = read_skill(tmp_path / "m.h5").operation.results
    assert results["dtw_after"] == tuple(refit.dtw_after for refit in report.refits)


def test_a_matrix_that_proves_next_to_nothing_is_worth_a_refit(tmp_path, library):
    # −I + s e₁e₂ᵀ and −I + s e₂e₁ᵀ: any P proves at most 1 − s/2, the rate of their mean, of both together.
    paths = []
    for upper in (True, False):
        taught = open_skill("curve", library).artifact.demonstrations
        operation = Operation(command="learn", options={"preset": "fast"}, seed=0)
        artifact = Artifact(shear(1.96, upper), taught, operation, current_provenance())
        write_file(tmp_path / f"{upper}.h5", encode(artifact))
        paths.append(tmp_path / f"{upper}.h5")
    as_they_are = MergeOptions(speed=1.0)
    kept = merge(paths, output=tmp_path / "kept.h5", options=as_they_are, refit=False)
    assert kept.lyapunov == "found"
    assert 0 < kept.certificate.rate <= 0.02
    again = merge(paths, output=tmp_path / "again.h5", options=as_they_are)
    assert again.lyapunov == "refitted"
    assert again.certificate.rate > kept.certificate.rate
    assert "as they were would prove a decay of" in again.notes[-1]


def test_merging_keeps_the_controller_period_wherever_a_common_matrix_allows(library, tmp_path):
    report = merge(["curve", "hook"], output=tmp_path / "m.h5", store=library, refit=False)
    assert verify("curve", store=library).period >= 0.01
    assert verify("hook", store=library).period >= 0.01
    assert report.certificate.period >= 0.01
    fast = MergeOptions(speed=3.0)
    assert (
        merge(["curve", "hook"], output=tmp_path / "m.h5", store=library, options=fast).certificate.rate > 0
    )


def test_a_merger_is_as_fast_as_its_parts_were_demonstrated_unless_a_speed_is_given(library, tmp_path):
    def made(**options):
        report = merge(
            ["curve", "hook"], output=tmp_path / "m.h5", store=library, options=MergeOptions(**options)
        )
        return report, load(tmp_path / "m.h5")

    def arrival(times, x, goal):
        """Return when a fiftieth of the way to the goal is left."""
        away = np.linalg.norm(x - goal, axis=1)
        return float(np.interp(-away.max() / 50, -np.minimum.accumulate(away), times))

    shown, taken = [], []
    plain, skill = made()
    for motions in read_skill(tmp_path / "m.h5").demonstrations:
        run = rollout(skill, [m.positions[0] for m in motions], duration=30.0, period=1e-3)
        goal = skill.attractors[0]
        shown.append(np.median([arrival(m.times - m.times[0], m.positions, goal) for m in motions]))
        taken.append(np.median([arrival(*run.trajectory(i), goal) for i in range(len(motions))]))
    # Times are read off to one of 200 steps of a duration, and the artifact keeps 200 points of a motion.
    assert np.mean(taken) == pytest.approx(np.mean(shown), rel=0.03)
    given, same = made(speed=1.0)
    assert given.speed == 1.0 != plain.speed
    assert skill.velocity([0.1, 0.2]) == pytest.approx(plain.speed * same.velocity([0.1, 0.2]), rel=1e-12)


def test_a_merger_that_its_proof_makes_late_says_how_late(library, tmp_path):
    paths = [tmp_path / "a.h5", tmp_path / "b.h5"]
    for name, path in zip(["curve", "hook"], paths, strict=True):
        artifact = open_skill(name, library).artifact
        slow = replace(artifact.skill.leaves[0], speed=artifact.skill.speed / 4)
        promised = artifact.operation.model_copy(
            update={"options": {**artifact.operation.options, "period": 1e3}}
        )
        write_file(path, encode(replace(artifact, skill=slow, operation=promised)))
    report = merge(paths, output=tmp_path / "m.h5")
    # The parts are proved for less than they promise, and the merger keeps what they are proved for.
    assert report.speed == pytest.approx(1.0, rel=0.01)
    assert "its motions take 3." in report.notes[0] or "its motions take 4" in report.notes[0]
    prompt = merge(["curve", "hook"], output=tmp_path / "p.h5", store=library)
    assert not any("times as long" in note for note in prompt.notes)


def test_no_refit_refuses_and_names_the_parts(conflict, tmp_path):
    with pytest.raises(FitError, match=r"no one Lyapunov matrix proves .*upper\.h5 and .*lower\.h5"):
        merge(conflict, output=tmp_path / "m.h5", refit=False)
    assert not (tmp_path / "m.h5").exists()


def test_switching_at_every_instant_gets_its_common_proof_by_a_refit_too(conflict, tmp_path):
    options = CombineOptions(gate="instantaneous", align=True)
    report = combine(conflict, output=tmp_path / "c.h5", options=options)
    assert (report.certificate.verdict, report.certificate.scope, report.lyapunov) == (
        "stable",
        "global",
        "refitted",
    )
    assert [refit.leaf for refit in report.refits] == [1, 2]
    assert read_skill(tmp_path / "c.h5").operation.results["lyapunov"] == "refitted"
    assert verify(tmp_path / "c.h5").verdict == "stable"
    with pytest.raises(FitError, match="no one Lyapunov matrix proves"):
        combine(conflict, output=tmp_path / "d.h5", options=options, refit=False)
    assert not (tmp_path / "d.h5").exists()


def test_calibrated_priors_win_starts_back_and_the_report_has_both(library, tmp_path):
    # Taken apart, a combined skill leaves its priors behind: hook's share is as good as nothing.
    biased = CombineOptions(part_priors=(1.0, 1e-200))
    assert (
        combine(["curve", "hook"], output=tmp_path / "b.h5", store=library, options=biased)
        .coverage[1]
        .selected
        < 1
    )
    options = CombineOptions(calibrate=True)
    report = combine([tmp_path / "b.h5", "hook"], output=tmp_path / "c.h5", store=library, options=options)
    before, after = (sum(p.selected for p in kept) for kept in (report.coverage_before, report.coverage))
    assert after >= before
    assert read_skill(tmp_path / "c.h5").operation.options["calibrate"] is True
    contradictory = CombineOptions(calibrate=True, part_priors=(1, 2))
    with pytest.raises(UsageError, match="exclude each other"):
        combine(["curve", "hook"], output=tmp_path / "d.h5", store=library, options=contradictory)


def test_parts_without_demonstrations_cannot_be_refitted(tmp_path):
    paths = [save(shear(10, upper=upper), tmp_path / f"{upper}.h5") for upper in (True, False)]
    with pytest.raises(FitError, match=r"True\.h5 carries no demonstrations"):
        merge(paths, output=tmp_path / "m.h5")


def test_a_matrix_for_all_parts_is_found_where_there_is_one(tmp_path):
    paths = [save(shear(1, upper=upper), tmp_path / f"{upper}.h5") for upper in (True, False)]
    assert merge(paths, output=tmp_path / "m.h5").lyapunov == "found"
    assert merge([paths[0]] * 2, output=tmp_path / "m.h5").lyapunov == "shared"


def test_merging_gives_the_weighted_sum_of_the_velocities(library, tmp_path):
    merge(
        ["curve", "hook"],
        output=tmp_path / "m.h5",
        store=library,
        options=MergeOptions(part_weights=(3, 1), speed=2.0, target=(0.3, 0.1)),
        refit=False,
    )
    merged = load(tmp_path / "m.h5")
    states = np.random.default_rng(0).uniform(-0.5, 0.5, (50, 2))
    expected = np.zeros_like(states)
    for name, weight in {"curve": 0.75, "hook": 0.25}.items():
        part = load(name, store=library)
        expected += 2.0 * weight * part.velocity(states - [0.3, 0.1] + part.attractors[0])
    # Moving means and states and back costs some roundings of numbers around 1.
    assert np.allclose(merged.velocity(states), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("make", [merge, combine])
def test_demonstrations_move_with_their_leaf(library, tmp_path, make):
    options = MergeOptions(target=(1, 2)) if make is merge else CombineOptions(align=True, target=(1, 2))
    make(["curve", "hook"], output=tmp_path / "m.h5", store=library, options=options)
    artifact = read_skill(tmp_path / "m.h5")
    for name, moved in zip(("curve", "hook"), artifact.demonstrations, strict=True):
        (taught,) = open_skill(name, library).artifact.demonstrations
        for before, after in zip(taught, moved, strict=True):
            offset = after.positions - before.positions
            assert np.allclose(offset, [1, 2] - before.positions[-1], atol=1e-12)  # roundings of sums near 2


def test_children_remember_their_parents(library, tmp_path):
    combine(["curve@1", library / "hook" / "1.h5"], output=tmp_path / "c.h5", store=library)
    first, second = read_skill(tmp_path / "c.h5").provenance.parents
    assert (first.name, first.version, first.role) == ("curve", 1, "part 1")
    assert first.digest == open_skill("curve", library).artifact.digest
    assert (second.name, second.version) == ("1.h5", None)
    reports = read_skill(tmp_path / "c.h5").reports
    assert [report.leaf for report in reports] == [0] * 4 + [1] * 4


def test_trees_of_trees_are_proved_too(library, tmp_path):
    merge(["curve", "hook"], output=tmp_path / "m.h5", store=library)
    merge([tmp_path / "m.h5", "plain"], output=tmp_path / "mm.h5", store=library)
    report = combine([tmp_path / "mm.h5", "curve", "hook"], output=tmp_path / "c.h5", store=library)
    assert verify(tmp_path / "c.h5").verdict == "stable"
    assert len(load(tmp_path / "c.h5").leaves) == 5
    flattened = combine([tmp_path / "c.h5", "plain"], output=tmp_path / "cc.h5", store=library)
    assert [part.share for part in flattened.parts] == pytest.approx([0.5, 0.5])
    assert sum(part.share for part in report.parts) == pytest.approx(1)


def test_the_same_composition_gives_the_same_bytes(library, tmp_path):
    for make in (merge, combine):
        first = make(["curve", "hook"], output=tmp_path / "a.h5", store=library)
        again = make(["curve", "hook"], output=tmp_path / "a.h5", store=library)
        other = make(["curve", "hook"], output=tmp_path / "b.h5", store=library)
        assert (first.written.created, again.written.created, other.written.created) == (True, False, True)
        assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()
        (tmp_path / "a.h5").unlink()
        (tmp_path / "b.h5").unlink()


def test_handwriting_merges_and_combines_into_proved_skills(lasa, tmp_path):
    fast = LearnOptions(preset="fast")
    names = ["Sshape", "Angle"]
    parts = [tmp_path / f"{name}.h5" for name in names]
    for name, path in zip(names, parts, strict=True):
        learn([lasa(name)], output=path, options=fast)
    merge(parts, output=tmp_path / "m.h5")
    combine(parts, output=tmp_path / "c.h5")
    assert verify(tmp_path / "m.h5").verdict == verify(tmp_path / "c.h5").verdict == "stable"


def test_joint_mixture_regresses_to_the_skill(library):
    source = open_skill("hook", library)
    skill = replace(source.skill.leaves[0], speed=1.7)
    joint = joint_mixture(skill)
    states = source.artifact.demonstrations[0].demonstrations[1].positions  # elsewhere densities underflow
    # Gaussian mixture regression, written out from the conditional of a Gaussian (Eq. 3 and 4).
    weights = np.empty((len(states), len(joint.priors)))
    conditional = np.empty((len(states), len(joint.priors), 2))
    for k, (prior, mean, covariance) in enumerate(
        zip(joint.priors, joint.means, joint.covariances, strict=True)
    ):
        position, cross = covariance[:2, :2], covariance[2:, :2]
        offset = states - mean[:2]
        gain = cross @ np.linalg.inv(position)
        conditional[:, k] = mean[2:] + offset @ gain.T
        left = covariance[2:, 2:] - gain @ cross.T  # what remains of the velocity's spread: C, at this speed
        scale = np.abs(covariance[2:, 2:]).max()
        assert np.allclose(left, 1.7**2 * skill.residual_covariances[k], rtol=0, atol=1e-9 * scale)
        exponent = -0.5 * np.einsum("ni,ij,nj->n", offset, np.linalg.inv(position), offset)
        weights[:, k] = prior * np.exp(exponent) / np.sqrt(np.linalg.det(2 * np.pi * position))
    weights /= weights.sum(axis=1, keepdims=True)
    expected = np.einsum("nk,nkd->nd", weights, conditional)
    # The covariances' condition number, about 1e4, times rounding, with room for both inversions.
    assert np.allclose(skill.velocity(states), expected, rtol=1e-8, atol=1e-10)
    assert np.linalg.eigvalsh(joint.covariances).min() > 0


def test_what_was_saved_from_python_is_loaded_again(tmp_path):
    skill = shear(1, upper=True)
    save(skill, tmp_path / "a.h5")
    (again,) = load(tmp_path / "a.h5").leaves
    assert np.array_equal(again.system_matrices, skill.system_matrices)
    assert verify(skill) == verify(load(str(tmp_path / "a.h5"))) != verify(tmp_path / "a.h5")
    (tmp_path / "a.h5").write_bytes(b"")
    with pytest.raises(ArtifactError):
        load(tmp_path / "a.h5")


def test_the_public_names_are_these():
    import skillctl

    for name in ("learn", "merge", "combine", "verify", "load", "save"):
        assert callable(getattr(skillctl, name))
        assert name in dir(skillctl)
    with pytest.raises(AttributeError, match="no attribute 'lern'"):
        skillctl.lern  # type: ignore[attr-defined]  # noqa: B018 - the access is the test
