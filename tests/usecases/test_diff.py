"""Two skills differ where they move or are proved differently, not where they are written differently."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from skillctl import store
from skillctl.evaluate.comparison import matched_components
from skillctl.usecases.diff import diff
from skillctl.usecases.files import load, save


@pytest.fixture
def changed(tmp_path, library):
    """Write a changed copy of the skill curve, with its demonstrations, and return its path."""
    original = store.read_skill(library / "curve" / "1.h5")

    def write(**fields):
        path = tmp_path / "changed.h5"
        made = replace(original, skill=replace(original.skill.leaves[0], **fields))
        store.write_file(path, store.encode(made))
        return path

    return write


def permuted(skill, order):
    names = ("priors", "means", "covariances", "system_matrices", "residual_covariances")
    return {name: getattr(skill, name)[order] for name in names}


def test_a_skill_does_not_differ_from_itself(library):
    report = diff("curve", "curve@1", atol=0, rtol=0, store=library)
    assert (report.identical, report.differs, report.metadata) == (True, False, ())
    assert report.behaviour.rollouts == report.behaviour.grid.greatest == 0


def test_the_order_of_components_is_no_difference(library, changed):
    skill = load("curve", store=library)
    report = diff("curve", changed(**permuted(skill, [2, 0, 1])), store=library)
    assert not report.identical
    assert not report.differs
    (leaf,) = report.leaves
    assert leaf.matched == (2, 3, 1)  # where each component of a went
    assert (leaf.unmatched, leaf.priors, leaf.means, leaf.covariances, leaf.system_matrices) == (
        0,
        0,
        0,
        0,
        0,
    )


def test_a_faster_skill_differs_by_what_it_is_faster(library, changed):
    skill = load("curve", store=library)
    report = diff("curve", changed(speed=1.25 * skill.speed), store=library)
    assert report.differs
    for field in (report.behaviour.demonstrations, report.behaviour.grid):
        assert field.greatest == pytest.approx(0.25 * field.speed, rel=1e-12)  # float64 rounding
    assert report.leaves[0].system_matrices == pytest.approx(0.25, rel=1e-12)
    assert report.behaviour.attractors == 0


def test_tolerances_decide_what_counts(library, changed):
    skill = load("curve", store=library)
    path = changed(speed=skill.speed * (1 + 1e-6))
    assert diff("curve", path, store=library).differs
    assert not diff("curve", path, rtol=2e-6, atol=1e-5, store=library).differs
    assert diff("curve", path, rtol=5e-7, atol=0, store=library).differs


def test_another_attractor_is_told_by_its_distance(library, changed):
    (skill,) = load("curve", store=library).leaves
    report = diff("curve", changed(attractor=skill.attractor + np.array([0.03, 0.04])), store=library)
    assert report.differs
    assert report.behaviour.attractors == pytest.approx(0.05, rel=1e-12)
    assert report.leaves[0].attractor == pytest.approx(0.05, rel=1e-12)


def test_a_lost_proof_is_a_difference_whatever_the_tolerances(library, changed):
    (skill,) = load("curve", store=library).leaves
    matrices = skill.system_matrices.copy()
    matrices[0] = np.eye(2) * 1e-9
    report = diff("curve", changed(system_matrices=matrices), atol=1e9, rtol=1, store=library)
    assert report.behaviour.same
    assert report.differs
    assert [certificate.verdict for certificate in report.certificates] == ["stable", "not proved"]


def test_components_without_a_partner_are_counted(library, changed):
    skill = load("curve", store=library)
    fewer = {name: values[:2] for name, values in permuted(skill, [0, 1, 2]).items()}
    fewer["priors"] = fewer["priors"] / fewer["priors"].sum()
    (leaf,) = diff("curve", changed(**fewer), store=library).leaves
    assert (leaf.matched, leaf.unmatched) == ((1, 2, None), 1)


def test_nearest_components_find_each_other_first(make_skill):
    rng = np.random.default_rng(0)
    a = make_skill(rng, n_components=6)
    order = rng.permutation(6)
    b = replace(a, **permuted(a, order))
    assert [j for _, j in matched_components(a, b)] == np.argsort(order).tolist()


def test_skills_of_different_spaces_and_trees_are_compared_as_far_as_they_go(library, tmp_path):
    report = diff("curve", "reach", store=library)
    assert report.differs
    assert report.leaves is None
    assert report.behaviour.grid is None
    assert {"state.names"} <= {change.field for change in report.metadata}


def test_metadata_names_what_differs_by_its_path(library):
    report = diff("curve", "plain", store=library)
    changes = {change.field: (change.a, change.b) for change in report.metadata}
    assert changes["operation.options.metric"] == ("learned", "euclidean")
    assert "operation.options.preset" not in changes


def test_skills_without_demonstrations_are_compared_on_the_grid(library, tmp_path):
    a = save(load("curve", store=library), tmp_path / "a.h5")
    b = save(replace(load("curve", store=library).leaves[0], speed=9.0), tmp_path / "b.h5")
    assert not diff(a, a).differs
    report = diff(a, b)
    assert report.behaviour.demonstrations is None
    assert report.differs


def test_the_exit_code_says_whether_they_differ_only_if_asked(run, library):
    arguments = ["diff", "curve", "plain", "--store", library]
    assert run(*arguments).exit_code == 0
    asked = run(*arguments, "--exit-code")
    assert (asked.exit_code, asked.stderr) == (1, "")
    assert "they behave differently" in asked.stdout
    assert "operation.options.metric" in asked.stdout
    same = run("diff", "curve", "curve@1", "--exit-code", "--store", library)
    assert (same.exit_code, same.stderr) == (0, "")
    assert "identical" in same.stdout
    document = json.loads(run(*arguments, "--json").stdout)
    assert document["differs"] is True
    assert document["behaviour"]["grid"]["points"] == 31 * 31
    assert run(*arguments, "--atol", "-1").exit_code == 2
