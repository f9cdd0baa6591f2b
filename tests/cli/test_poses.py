"""What is seen of skills of poses: quaternions, roll, pitch and yaw, errors in millimetres and degrees."""

from __future__ import annotations

import json
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skillctl import store
from skillctl.cli.exit_codes import ExitCode
from skillctl.compose.parts import in_one_space
from skillctl.store import Artifact, Operation, current_provenance

TARGET = (0.5, -0.1, 0.3, *Rotation.from_euler("xyz", [170, 5, 40], degrees=True).as_rotvec())


@pytest.fixture(scope="module")
def written(make_grasp, make_grasp_motions, tmp_path_factory):
    """Return a function that writes a skill of poses with its demonstrations, and returns the path."""
    folder = tmp_path_factory.mktemp("poses")

    def write(name, skill):
        path = folder / f"{name}.h5"
        taught = (make_grasp_motions(skill),)
        made = Artifact(skill, taught, Operation(command="python"), current_provenance())
        store.write_file(path, store.encode(made))
        return path

    return write


@pytest.fixture(scope="module")
def grasp(written, make_grasp):
    return written("grasp", make_grasp(TARGET))


def test_an_attractor_is_shown_as_a_target_is_given_and_as_roll_pitch_yaw(run, grasp):
    shown = run("inspect", grasp)
    assert shown.exit_code == 0
    quaternion = Rotation.from_rotvec(TARGET[3:]).as_quat()
    assert f"0.5,-0.1,0.3,{','.join(f'{value:.4g}' for value in quaternion)}" in shown.stdout
    assert "170°, 5°, 40°" in shown.stdout
    assert "x, y, z in m; rx, ry, rz in rad, frame base" in shown.stdout
    assert "counts as 200.00 mm" in shown.stdout


def test_the_document_has_states_and_what_they_mean(run, grasp):
    document = json.loads(run("inspect", grasp, "--json").stdout)
    (leaf,) = document["leaves"]
    assert leaf["attractor"] == pytest.approx(TARGET)
    assert leaf["target"] == pytest.approx([*TARGET[:3], *Rotation.from_rotvec(TARGET[3:]).as_quat()])
    assert np.degrees(leaf["roll_pitch_yaw"]) == pytest.approx([170, 5, 40])
    assert document["space"]["length"] == 0.2
    assert document["space"]["units"] == ["m", "m", "m", "rad", "rad", "rad"]
    # The joint mixture regresses the charted velocity: zero at the anchor, for whatever weights.
    mixture = leaf["joint_mixture"]
    anchor = np.array([*TARGET[:3], 0, 0, 0])
    for mean, covariance in zip(mixture["means"], np.array(mixture["covariances"]), strict=True):
        gain = covariance[6:, :6] @ np.linalg.inv(covariance[:6, :6])
        assert mean[6:] + gain @ (anchor - mean[:6]) == pytest.approx(np.zeros(6), abs=1e-12)


def test_at_takes_a_quaternion_and_gives_a_twist(run, grasp):
    shown = run("inspect", grasp, "--at", "0.3,0.1,0.5,0,0.6,0,0.8")
    assert "at        0.3,0.1,0.5,0,0.6,0,0.8\n" in shown.stdout
    (line,) = [line for line in shown.stdout.splitlines() if line.startswith("velocity")]
    assert " m/s; " in line
    assert line.endswith(" rad/s")


def test_differences_are_in_millimetres_and_degrees(run, grasp, written, make_grasp):
    turned = Rotation.from_rotvec(TARGET[3:]) * Rotation.from_rotvec([0, 0, np.radians(5)])
    other = written("other", make_grasp((0.51, *TARGET[1:3], *turned.as_rotvec())))
    shown = run("diff", grasp, other, "--exit-code")
    assert shown.exit_code == ExitCode.NEGATIVE
    assert "10.00 mm, 5.00°" in shown.stdout
    assert "°/s apart at most" in shown.stdout
    document = json.loads(run("diff", grasp, other, "--json").stdout)["behaviour"]
    assert document["attractors"] == pytest.approx(0.01)
    assert document["attractors_angle"] == pytest.approx(np.radians(5))


def test_the_length_in_which_angles_count_is_no_difference_in_behaviour(run, grasp, written, make_grasp):
    skill = make_grasp(TARGET)
    (other, _) = in_one_space([skill, replace(make_grasp(TARGET, length=0.8))])
    assert other.space.length == pytest.approx(0.4)
    shown = run("diff", grasp, written("longer", other), "--exit-code")
    assert shown.exit_code == 0
    assert "state.characteristic_length" in shown.stdout


def test_a_page_and_pictures_show_the_orientation(run, grasp, tmp_path):
    page, picture, proof = (tmp_path / name for name in ("page.html", "skill.svg", "proof.png"))
    assert run("inspect", grasp, "--html", page, "--plot", picture).exit_code == 0
    assert run("verify-stability", grasp, "--plot", proof).exit_code == 0
    text = page.read_text(encoding="utf-8")
    HTMLParser().feed(text)
    assert "170°, 5°, 40°" in text
    assert text.count("data:image/svg+xml") == 3
    assert picture.stat().st_size > 0 < proof.stat().st_size


def test_exports_hold_the_length_and_a_mat_file_is_refused(run, grasp, tmp_path):
    assert run("export", grasp, "-o", tmp_path / "grasp.json").exit_code == 0
    document = json.loads((tmp_path / "grasp.json").read_text(encoding="utf-8"))
    assert document["meta"]["state"]["characteristic_length"] == 0.2
    assert document["arrays"]["model/attractors"] == [pytest.approx(TARGET)]
    refused = run("export", grasp, "-o", tmp_path / "grasp.mat")
    assert refused.exit_code == ExitCode.USAGE
    assert "moves poses" in refused.stderr
    assert "--position-only" in refused.stderr
    assert not (tmp_path / "grasp.mat").exists()
