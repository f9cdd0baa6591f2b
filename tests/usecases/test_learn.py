"""Learning as a user meets it: the same bytes every time, nothing unproved, real data from end to end."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
import scipy.io

from skillctl.demonstrations.options import Reading
from skillctl.errors import FitError, StoreError, UsageError
from skillctl.learning.fit import fit
from skillctl.learning.options import LearnOptions
from skillctl.stability.certificate import certify
from skillctl.store import layout, metadata_of, read_skill, require_room_for_records
from skillctl.store.canonical import dump_canonical
from skillctl.store.source import open_skill
from skillctl.usecases import learn as module
from skillctl.usecases.files import load
from skillctl.usecases.learn import learn
from skillctl.usecases.verify_stability import verify

FAST = LearnOptions(preset="fast", n_components=3)


@pytest.mark.parametrize("name", ["Sshape", "GShape", "Angle"])
def test_handwriting_is_learned_proved_and_repeated(lasa, tmp_path, name):
    report = learn([lasa(name)], output=tmp_path / "a.h5")
    assert verify(tmp_path / "a.h5").verdict == "stable"
    assert len(report.demonstrations) == 7
    assert all(demonstration.arrived for demonstration in report.demonstrations)
    # Two people's demonstrations of one of these motions differ by about 2 mm; 5 mm would be another motion.
    assert np.mean([demonstration.dtw for demonstration in report.demonstrations]) < 5e-3
    skill = load(tmp_path / "a.h5")
    extent = open_skill(tmp_path / "a.h5").artifact.demonstrations[0].extent
    assert 0.03 < extent < 0.15  # metres, though the files hold millimetres
    assert np.allclose(skill.attractors, 0)


def test_the_lpv_ds_layout_is_learned_too(reach_files, tmp_path):
    cells = np.empty((1, len(reach_files)), dtype=object)
    for index, path in enumerate(reach_files):
        t, *columns = np.loadtxt(path, delimiter=",", skiprows=1, unpack=True)
        positions = np.stack(columns)
        cells[0, index] = np.vstack([positions, np.gradient(positions, t, axis=1)])
    scipy.io.savemat(tmp_path / "reach.mat", {"data": cells, "dt": 0.02})
    report = learn([tmp_path / "reach.mat"], output=tmp_path / "a.h5", options=FAST)
    assert report.dimension == 3
    assert verify(tmp_path / "a.h5").verdict == "stable"
    assert all(demonstration.arrived for demonstration in report.demonstrations)
    assert report.attractor == pytest.approx((0.6, 0.1, 0.5), abs=2e-3)  # rests are trimmed: about 1 mm


def many(curve_files, folder, count):
    """Copies of a demonstration under other names."""
    data = curve_files[0].read_bytes()
    for number in range(count):
        (folder / f"curve-{number:03}.csv").write_bytes(data)
    return sorted(folder.glob("curve-*.csv"))


def test_more_files_than_can_be_recorded_are_refused_before_anything_is_learned(
    curve_files, tmp_path, monkeypatch
):
    monkeypatch.setattr(module, "fit", lambda *_, **__: pytest.fail("learned in vain"))
    with pytest.raises(
        StoreError, match=r"records about it, of 300 demonstrations .* and 65536 fit"
    ) as caught:
        learn(many(curve_files, tmp_path, 300), output=tmp_path / "a.h5")
    assert "--demos 0-99" in caught.value.hint
    assert not (tmp_path / "a.h5").exists()


def test_what_fits_is_never_refused_beforehand_and_little_else_is_let_through(
    curve_files, tmp_path, monkeypatch
):
    files = many(curve_files, tmp_path, 30)
    learn(files, output=tmp_path / "a.h5", options=LearnOptions(preset="fast", n_components=1))
    artifact = read_skill(tmp_path / "a.h5")
    bare = artifact.operation.model_copy(update={"results": {}})  # as it is before
    size = len(dump_canonical(metadata_of(artifact)))
    monkeypatch.setitem(layout.MAX_LENGTHS, "B", size)
    require_room_for_records(artifact.demonstrations[0], bare, artifact.provenance)
    # Not known beforehand: 700 bytes about the skill itself, and 4 digits of each of 3 errors of 10 kB.
    monkeypatch.setitem(layout.MAX_LENGTHS, "B", int(0.9 * size))
    with pytest.raises(StoreError, match="of 30 demonstrations"):
        require_room_for_records(artifact.demonstrations[0], bare, artifact.provenance)


def test_the_same_inputs_give_the_same_bytes_in_any_surroundings(curve_files, tmp_path):
    surroundings = [
        {"PYTHONHASHSEED": "1", "TZ": "UTC", "LC_ALL": "C", "OMP_NUM_THREADS": "1"},
        {"PYTHONHASHSEED": "2", "TZ": "Asia/Tokyo", "LC_ALL": "C.UTF-8", "OMP_NUM_THREADS": "2"},
    ]
    written = []
    for number, variables in enumerate(surroundings):
        folder = tmp_path / str(number)
        folder.mkdir()
        for path in curve_files:
            shutil.copy(path, folder)
        os.umask(old := os.umask(0o077))
        command = [sys.executable, "-m", "skillctl", "learn", *(path.name for path in curve_files)]
        subprocess.run(
            [*command, "-o", "a.h5", "--preset", "fast"],
            cwd=folder,
            env={**os.environ, **variables},
            check=True,
            capture_output=True,
            umask=old if number else 0o077,
        )
        written.append((folder / "a.h5").read_bytes())
    assert written[0] == written[1]


def test_only_what_decides_the_result_makes_it_out_of_date(curve_files, tmp_path):
    def status(files, options=FAST, **more):
        return learn(files, output=tmp_path / "a.h5", options=options, **more).status

    copies = [shutil.copy(path, tmp_path / path.name) for path in curve_files]
    assert status(copies) == "learned"
    os.utime(copies[0], (0, 0))
    assert status(copies) == "up to date"
    assert status(curve_files) == "up to date"  # the same bytes elsewhere
    assert status(copies[:3]) == "learned"
    assert status(copies, LearnOptions(preset="fast", n_components=2)) == "learned"
    assert status(copies, reading=Reading(frame="table")) == "learned"
    assert status(copies) == "learned"
    copies[1].write_text(copies[1].read_text() + "2.020000,0.0,0.0\n")
    assert status(copies) == "learned"
    (tmp_path / "a.h5").write_bytes((tmp_path / "a.h5").read_bytes()[:-1])  # damaged: not up to date
    assert status(copies) == "learned"


def test_up_to_date_does_not_fit(curve_files, tmp_path, monkeypatch):
    learn(curve_files, output=tmp_path / "a.h5", options=FAST)

    def fail(*_, **__):
        raise AssertionError("fitted although nothing changed")

    monkeypatch.setattr(module, "fit", fail)
    assert learn(curve_files, output=tmp_path / "a.h5", options=FAST).status == "up to date"


def test_nothing_unproved_is_written(curve_files, tmp_path, monkeypatch):
    from dataclasses import replace

    def unstable(demonstrations, options, **more):
        fitted = fit(demonstrations, options, **more)
        return replace(fitted, skill=replace(fitted.skill, system_matrices=-fitted.skill.system_matrices))

    monkeypatch.setattr(module, "fit", unstable)
    with pytest.raises(FitError, match="could not be proved stable, so nothing was written: part 1"):
        learn(curve_files, output=tmp_path / "a.h5", options=FAST)
    assert list(tmp_path.iterdir()) == []


def test_the_artifact_says_where_it_comes_from(curve_files, tmp_path):
    learn(curve_files, output=tmp_path / "a.h5", options=FAST, reading=Reading(units="m", demos=(0, 2)))
    artifact = read_skill(tmp_path / "a.h5")
    assert [record.path for record in artifact.provenance.inputs] == [path.name for path in curve_files]
    assert artifact.operation.options["demos"] == (0, 2)
    assert artifact.operation.options["preset"] == "fast"
    assert artifact.operation.seed == 0
    (taught,) = artifact.demonstrations
    assert len(taught) == 2
    for motion in taught:
        assert np.array_equal(motion.positions[-1], artifact.skill.attractors[0])


def test_a_reversed_approach_is_a_retreat(reach_files, tmp_path):
    report = learn(reach_files, output=tmp_path / "a.h5", options=FAST, reading=Reading(reverse=True))
    artifact = read_skill(tmp_path / "a.h5")
    assert artifact.operation.options["reverse"] is True
    assert report.attractor == pytest.approx((0.4, 0.02, 0.5), abs=2e-3)  # the median of where they began
    for motion, shown in zip(artifact.demonstrations[0], report.demonstrations, strict=True):
        assert np.linalg.norm(motion.positions[0] - (0.6, 0.1, 0.5)) < 0.03  # moved, for the ends are not one
        assert shown.arrived
        assert shown.dtw < 5e-3
    assert learn(reach_files, output=tmp_path / "a.h5", options=FAST).status == "learned"


def test_the_proof_holds_for_what_is_stored_not_for_what_was_in_memory(curve_files, tmp_path):
    report = learn(curve_files, output=tmp_path / "a.h5", options=FAST)
    again = certify(read_skill(tmp_path / "a.h5").skill)
    assert (again.verdict, again.rate, again.period) == (
        "stable",
        report.certificate.rate,
        report.certificate.period,
    )


def test_progress_is_told(curve_files, tmp_path):
    steps = []
    learn(curve_files, output=tmp_path / "a.h5", options=FAST, progress=lambda *step: steps.append(step))
    assert steps
    assert all(0 <= done <= total for _, done, total in steps)


def test_a_destination_is_one_place(tmp_path, curve_files):
    with pytest.raises(UsageError, match="no place"):
        learn(curve_files)
    with pytest.raises(UsageError, match="exclude"):
        learn(curve_files, output=tmp_path / "a.h5", name="a")
