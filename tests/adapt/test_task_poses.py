"""Tasks for skills of poses: places concern positions, and a target may have an orientation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skillctl.adapt.search import search
from skillctl.adapt.task_file import Task
from skillctl.adapt.verdict import judge_task
from skillctl.errors import UsageError
from skillctl.model.mixture import GaussianMixture
from skillctl.model.pose import Pose
from skillctl.model.seds import SedsSkill
from skillctl.stability.certificate import certify

TURNED = Rotation.from_euler("xyz", [20, -10, 40], degrees=True)
TARGET = (0.5, -0.1, 0.4, *TURNED.as_quat().tolist())
START = {"low": (0.2, -0.2, 0.3), "high": (0.25, -0.1, 0.35)}


def straight(rates, turning: float = 2.0, length: float = 0.25) -> SedsSkill:
    """Each position coordinate decays at its own rate, the orientation at another."""
    matrix = np.diag([*(-np.array(rates)), *(3 * [-turning])])
    one = np.ones(1)
    density = GaussianMixture(one, np.zeros((1, 6)), np.eye(6)[None])
    return SedsSkill(
        priors=one,
        means=np.zeros((1, 6)),
        covariances=np.eye(6)[None],
        system_matrices=matrix[None],
        residual_covariances=np.eye(6)[None],
        attractor=np.zeros(6),
        lyapunov=np.eye(6),
        density=density,
        space=Pose(length=length),
    )


def test_places_concern_positions_and_the_orientation_is_reached():
    middle = tuple(0.5 * (np.array([0.225, -0.15, 0.325]) + np.array(TARGET[:3])))
    wanted = Task(
        target={"position": TARGET, "tolerance": 0.01, "tolerance-deg": 2.0},
        start=START,
        via=[{"name": "middle", "point": middle, "within": 0.06}],
        **{"keep-out": [{"name": "ball", "kind": "ball", "centre": (0.4, 0.2, 0.4), "radius": 0.1}]},
    )
    skill = straight((2.0, 2.0, 2.0))
    found = search(wanted, [skill])
    assert found.best.holds
    moved = found.best.build()
    assert Rotation.from_rotvec(moved.attractors[0, 3:].copy()).as_quat() == pytest.approx(
        TURNED.as_quat(), abs=1e-12
    )
    verdict = judge_task(wanted, moved, certify(moved))
    assert verdict.holds
    margins = {each.clause: each.margin for each in verdict.clauses}
    # Straight lines from the box to the target: the worst corner passes the middle at half of its distance
    # from the middle of the box, or nearer.
    corner = 0.5 * np.linalg.norm([0.025, 0.05, 0.025])
    assert 0.06 - corner - 1e-3 <= margins["middle"] <= 0.06
    assert margins["target.orientation"] == pytest.approx(2.0, abs=1e-5)  # motions start turned as they end


def test_a_position_alone_keeps_the_orientation_of_the_skill():
    wanted = Task(target={"position": TARGET[:3], "tolerance": 0.01}, start=START)
    found = search(wanted, [straight((2.0, 2.0, 2.0))])
    assert "target.orientation" not in found.best.worst
    assert found.best.build().attractors[0].tolist() == [*TARGET[:3], 0.0, 0.0, 0.0]


def test_mergers_of_poses_are_followed():
    flat, steep = straight((1.0, 4.0, 4.0)), straight((4.0, 1.0, 1.0), length=0.4)
    middle = tuple(0.5 * (np.array([0.225, -0.15, 0.325]) + np.array(TARGET[:3])))
    wanted = Task(
        target={"position": TARGET, "tolerance": 0.01},
        start=START,
        via=[{"name": "middle", "point": middle, "within": 0.04}],
    )
    found = search(wanted, [flat, steep])
    assert found.best.kind == "merged"
    skill = found.best.build()
    again = found.judge.trial(skill)
    assert again["middle"] == pytest.approx(found.best.margins["middle"], abs=2e-3)  # other steps of time


def test_orientations_are_asked_of_poses_only(make_skill):
    plain = make_skill(np.random.default_rng(0), dimension=3)
    wanted = Task(target={"position": (0.0, 0.0, 0.0), "tolerance-deg": 2.0}, start=START)
    with pytest.raises(UsageError, match="no orientation"):
        search(wanted, [plain])
