"""Mergers fitted to a task: judged by whole motions, honest about demonstrations left out, still proved."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skillctl.adapt.options import TaskOptions
from skillctl.adapt.task import fit_to_task, task_distances
from skillctl.compose.lyapunov import common_lyapunov_of
from skillctl.compose.options import MergeOptions
from skillctl.demonstrations.options import Reading
from skillctl.demonstrations.reader import read_demonstrations
from skillctl.errors import FitError, UsageError
from skillctl.model.demonstration import DemonstrationSet
from skillctl.store import read_skill
from skillctl.usecases.combine import combine
from skillctl.usecases.files import load
from skillctl.usecases.merge import merge
from skillctl.usecases.verify_stability import verify


def written(path: Path, start, bend, end=(0.0, 0.0)) -> Path:
    s = np.linspace(0, 1, 101)[:, None]
    eased = s**3 * (10 - 15 * s + 6 * s**2)
    positions = (
        np.asarray(start) * (1 - eased) + np.asarray(end) * eased + np.asarray(bend) * np.sin(np.pi * eased)
    )
    names = ",".join("xyz"[: positions.shape[1]])
    np.savetxt(
        path, np.hstack([2 * s, positions]), delimiter=",", header=f"t,{names}", comments="", fmt="%.6f"
    )
    return path


@pytest.fixture
def task_files(tmp_path):
    """Between what curve and hook do: three demonstrations."""
    return tuple(
        written(tmp_path / f"task-{i}.csv", (0.02 + 0.05 * i, -0.1), (0.03, 0.02), (0.05, 0.02))
        for i in range(3)
    )


def fitted(files, output, library, level="part", skills=("curve", "hook"), **options):
    return merge(
        skills,
        output=output,
        store=library,
        task=TaskOptions(tuple(files), level),
        options=MergeOptions(**options),
    )


@pytest.mark.parametrize("level", ["part", "component"])
def test_fitted_weights_are_never_worse_than_one_part_or_equal_weights(task_files, tmp_path, library, level):
    report = fitted(task_files[:1], tmp_path / "m.h5", library, level, ("curve", "hook", "plain"))
    errors = report.task.errors
    assert errors.fitted <= min(errors.best_single, errors.equal)
    assert report.task.held_out is None
    assert verify(tmp_path / "m.h5").verdict == "stable"
    if level == "component":
        per_part = fitted(task_files[:1], tmp_path / "p.h5", library, "part", ("curve", "hook", "plain"))
        assert errors.fitted <= per_part.task.errors.fitted
    made = load(tmp_path / "m.h5")
    task = read_demonstrations([task_files[0]]).demonstrations
    again = task_distances(made, task, made.attractors[0])
    assert report.task.errors.fitted == pytest.approx(
        again.mean(), rel=1e-6
    )  # P was rounded on its way to disk


def test_the_target_is_where_the_demonstrations_end_unless_another_is_given(task_files, tmp_path, library):
    assert fitted(task_files, tmp_path / "m.h5", library).attractor == pytest.approx((0.05, 0.02), abs=1e-9)
    assert fitted(task_files, tmp_path / "m.h5", library, target=(1.0, 2.0)).attractor == (1.0, 2.0)


def test_a_demonstration_left_out_has_no_influence_on_the_weights_it_judges(task_files, library):
    parts = [load(name, store=library) for name in ("curve", "hook")]
    lyapunov = common_lyapunov_of(parts)
    task = read_demonstrations(task_files).demonstrations
    target = (0.0, 0.0)
    expected = []
    for i in range(3):
        rest = DemonstrationSet(task.demonstrations[:i] + task.demonstrations[i + 1 :], task.space)
        skill = fit_to_task(parts, rest, lyapunov, level="component", target=target).skill
        expected.append(task_distances(skill, task, skill.attractor)[i])
    whole = fit_to_task(parts, task, lyapunov, level="component", target=target)
    # The others are followed together with the one left out: a few steps more or less at the end
    assert whole.held_out.fitted == pytest.approx(np.mean(expected), rel=0.02)
    assert whole.held_out.equal == whole.errors.equal  # nothing is fitted there


def test_what_fitting_found_and_what_it_read_are_recorded(task_files, tmp_path, library):
    report = fitted(task_files, tmp_path / "m.h5", library, "component")
    artifact = read_skill(tmp_path / "m.h5")
    assert [record.path for record in artifact.provenance.inputs] == [path.name for path in task_files]
    assert [parent.name for parent in artifact.provenance.parents] == [
        p.skill.split("@")[0] for p in report.parts
    ]
    errors: Any = artifact.operation.results["errors"]
    assert errors[2] == report.task.errors.fitted
    assert artifact.operation.options["fit_level"] == "component"
    for number, leaf in enumerate(artifact.skill.leaves):
        taught = artifact.demonstrations[number]
        for demo, told in zip(taught, [r for r in artifact.reports if r.leaf == number], strict=True):
            error = leaf.velocity(demo.positions) - demo.velocities
            # Velocities are derived anew from stored positions
            assert told.velocity_rmse == pytest.approx(np.sqrt((error**2).sum(axis=1).mean()), rel=1e-6)


def test_the_store_gives_the_skills_that_help_and_nothing_else(task_files, tmp_path, library):
    combine(["curve", "hook"], name="both", store=library)
    try:
        options = TaskOptions(task_files[:1], from_store=True)
        report = merge([], name="fitted", store=library, task=options)
        assert report.task.candidates == 3  # not reach, which is in space, nor both, which is combined
        assert {part.skill for part in report.parts} <= {"curve@1", "hook@1", "plain@1"}
        assert not merge(
            [], name="fitted", store=library, task=options
        ).written.created  # its own result is no part
        with pytest.raises(UsageError, match="exclude each other"):
            merge(["curve"], name="fitted", store=library, task=options)
    finally:
        for name in ("both", "fitted"):
            for file in (library / name).glob("*.h5"):
                file.unlink()


def test_a_store_without_suitable_skills_is_refused(tmp_path, library):
    in_space = written(tmp_path / "s.csv", (0.1, 0.2, 0.3), (0, 0, 0.1), (0, 0, 0))
    with pytest.raises(UsageError, match="has 1 skills with coordinates x, y, z"):
        merge([], name="new", store=library, task=TaskOptions((in_space,), from_store=True))


def test_contradictions_and_other_spaces_are_refused_before_anything_is_written(
    task_files, tmp_path, library
):
    out = tmp_path / "m.h5"
    in_space = written(tmp_path / "s.csv", (0.1, 0.2, 0.3), (0, 0, 0.1), (0, 0, 0))
    with pytest.raises(UsageError, match=r"3 dimensions \(x, y, z\), curve@1 has 2 \(x, y\)"):
        fitted([in_space], out, library)
    for options in ({"part_weights": (1, 2)}, {"gate": "density"}, {"speed": 2.0}):
        with pytest.raises(UsageError, match="and fit exclude each other"):
            fitted(task_files, out, library, **options)
    with pytest.raises(UsageError, match="unit of the demonstrations"):
        merge(
            ["curve", "hook"],
            output=out,
            store=library,
            task=TaskOptions(task_files, reading=Reading(units="rad")),
        )
    away = written(tmp_path / "away.csv", (0.0, 0.0), (0.0, 0.0), (0.3, 0.1))
    with pytest.raises(UsageError, match="at least two"):
        fitted([away], out, library, skills=["curve"])
    assert not out.exists()


def test_a_store_whose_skills_do_not_help_says_so(tmp_path, library, monkeypatch):
    monkeypatch.setattr("skillctl.adapt.candidates.most_helpful", lambda *_: ())
    task = written(tmp_path / "t.csv", (0.1, 0.2), (0, 0.1))
    with pytest.raises(FitError, match="no skill of the store moves along"):
        merge([], name="new", store=library, task=TaskOptions((task,), from_store=True))


def test_the_command_shows_the_errors_and_refuses_lonely_options(run, task_files, tmp_path, library):
    fits = [word for path in task_files for word in ("--fit", path)]
    result = run("merge", "curve", "hook", *fits, "--store", library, "-o", tmp_path / "m.h5")
    assert result.exit_code == 0
    for text in (
        "3 given",
        "each left out in turn",
        "best part alone",
        "equal weights",
        "chosen from 2 skills",
    ):
        assert text in result.stdout
    for words in (
        ["--fit-level", "component"],
        ["--from-store"],
        ["--units", "mm"],
        ["--scale", "2"],
        ["--demos", "0"],
        ["--frame", "world"],
        ["--input-format", "csv"],
    ):
        refused = run("merge", "curve", "hook", *words, "--store", library, "-o", tmp_path / "x.h5")
        assert (refused.exit_code, refused.stdout) == (2, "")
        assert f"{words[0]} is only used with --fit" in refused.stderr
    assert run("merge", "-o", tmp_path / "x.h5").exit_code == 2


def test_the_command_reads_a_task_as_learn_does(run, task_files, tmp_path, library):
    halves = []
    for path in task_files:
        table = np.loadtxt(path, delimiter=",", skiprows=1) * [1, 0.5, 0.5]
        halves.append(tmp_path / f"half-{path.name}")
        np.savetxt(halves[-1], table, delimiter=",", header="t,x,y", comments="", fmt="%.9f")

    def fitted_to(files, *words):
        fits = [word for path in files for word in ("--fit", path)]
        into = ("--store", library, "-o", tmp_path / f"{len(list(tmp_path.iterdir()))}.h5")
        result = run("merge", "curve", "hook", *fits, *words, *into)
        assert result.exit_code == 0, result.stderr
        return next(line for line in result.stdout.splitlines() if " given" in line).split()

    whole = fitted_to(task_files[1:2])
    assert fitted_to(halves, "--scale", "2", "--demos", "1", "--input-format", "csv") == whole
    refused = run(
        *("merge", "curve", "hook", "--fit", halves[0], "--frame", "camera", "--store", library),
        *("-o", tmp_path / "x.h5"),
    )
    assert refused.exit_code == 2
    assert "frame of the demonstrations: camera" in refused.stderr
