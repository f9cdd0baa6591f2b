"""Make the artifacts of this directory: python tests/archives/v2/make.py DIRECTORY

Artifacts of each kind, gate and shape, of numbers that are exact in binary and need no random generator, so
that every build that writes format 2 makes files with the same content digests. What is there is left alone.
Prints a line for each new one: content digest, SHA-256 of the file (it depends on the version of HDF5), name.
"""

from __future__ import annotations

import hashlib
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from skillctl import store
from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.coordinates.chain import Chain, OnPosition
from skillctl.model.coordinates.shears import Shears
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.merged import MergedSkill
from skillctl.model.mixture import GaussianMixture
from skillctl.model.pose import Pose
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import Skill
from skillctl.model.space import Euclidean

SPACE = Euclidean(("x", "y"), unit="m", frame="base")


def seds(offset: float, attractor: tuple[float, float] = (0.5, -0.25)) -> SedsSkill:
    """Return a skill of two components; ``offset`` tells one skill from another."""
    covariance = np.array([[0.5, 0.125], [0.125, 0.25]])
    return SedsSkill(
        priors=np.array([0.25, 0.75]),
        means=np.array([[0.0, 1.0], [2.0, -1.0]]) + offset,
        covariances=np.stack([covariance, 2 * covariance]),
        system_matrices=np.array([[[-1.0, 0.5], [-0.5, -1.0]], [[-2.0, 0.0], [0.25, -0.5]]]),
        residual_covariances=np.stack([covariance, covariance]) / 16,
        attractor=np.array(attractor),
        lyapunov=np.array([[1.0, 0.25], [0.25, 2.0]]),
        density=GaussianMixture(np.array([1.0]), np.array([[offset, 0.5]]), covariance[None]),
        space=SPACE,
        speed=1.5,
    )


def joints() -> SedsSkill:
    """Return a skill of one component in three joint angles, with two components of position density."""
    return SedsSkill(
        priors=np.array([1.0]),
        means=np.array([[0.0, 0.5, -0.5]]),
        covariances=np.diag([0.5, 0.25, 0.125])[None],
        system_matrices=np.array([[[-1.0, 0.5, 0.0], [-0.5, -1.0, 0.25], [0.0, -0.25, -2.0]]]),
        residual_covariances=np.diag([0.0625, 0.0625, 0.125])[None],
        attractor=np.array([1.0, 0.0, -1.0]),
        lyapunov=np.eye(3),
        density=GaussianMixture(
            np.array([0.5, 0.5]), np.array([[1.0, 0.0, -1.0], [0.0, 0.5, -0.5]]), np.stack([np.eye(3)] * 2)
        ),
        space=Euclidean(("shoulder", "elbow", "wrist"), unit="rad", frame="arm"),
    )


def bent(offset: float) -> SedsSkill:
    """Return the skill ``seds`` in learned coordinates: two shears of three bumps."""
    shears = Shears(
        linear=np.array([[0.5, 0.25], [0.0, 2.0]]),
        directions=np.array([[1.0, 0.0], [0.5, 0.5]]),
        firsts=np.array([-0.5, -1.0]),
        spacings=np.array([0.5, 0.75]),
        coefficients=np.array(
            [[[0.0, 0.25], [0.0, -0.5], [0.0, 1.0]], [[0.5, -0.5], [0.25, 0.0], [0.0, 0.0]]]
        ),
    )
    return replace(seds(offset), coordinates=Chain((shears,)))


POSES = Pose(frame="table", length=0.25)


def pose(offset: float, turn: tuple[float, float, float] = (0.0, 3.0, -0.5)) -> SedsSkill:
    """Return a skill of poses of two components; the first bends positions by a shear."""
    covariance = np.diag([0.5, 0.25, 0.5, 0.125, 0.125, 0.25])
    matrices = np.stack([np.diag([-1.0, -1.0, -2.0, -1.0, -0.5, -1.0]), np.diag([-0.5] * 3 + [-2.0] * 3)])
    matrices[0, 0, 1], matrices[0, 1, 0], matrices[1, 3, 5], matrices[1, 5, 3] = 0.5, -0.5, 0.25, -0.25
    shears = Shears(
        linear=np.array([[0.5, 0.25, 0.0], [0.0, 2.0, 0.5], [0.0, 0.0, 1.0]]),
        directions=np.array([[1.0, 0.0, 0.5]]),
        firsts=np.array([-0.5]),
        spacings=np.array([0.5]),
        coefficients=np.array([[[0.0, 0.25, 0.0], [0.0, -0.5, 0.0], [0.0, 1.0, 0.0]]]),
    )
    return SedsSkill(
        priors=np.array([0.25, 0.75]),
        means=np.array([[0.0, 1.0, 0.5, 0.0, 0.25, 0.0], [2.0, -1.0, 0.5, 0.125, 0.0, 0.0]]) + offset,
        covariances=np.stack([covariance, 2 * covariance]),
        system_matrices=matrices,
        residual_covariances=np.stack([covariance, covariance]) / 16,
        attractor=np.array([0.5, -0.25, offset, *turn]),
        lyapunov=np.diag([1.0, 2.0, 0.5, 1.0, 1.0, 1.0]),
        density=GaussianMixture(np.array([1.0]), np.full((1, 6), offset), covariance[None]),
        space=POSES,
        coordinates=Chain((OnPosition(shears),)) if offset == 0 else Chain(),
    )


def turning() -> DemonstrationSet:
    """Return a short motion that turns past half a turn."""
    states = np.array(
        [[-2.0, 1.0, 0.5, 0.0, 0.0, 2.5], [0.25, 0.5, 0.0, 0.0, 0.0, 3.0], [0.5, -0.25, 0.0, 0.0, 0.0, 3.75]]
    )
    motion = Demonstration.from_positions(np.arange(3) / 8, states, "turning.csv", POSES)
    return DemonstrationSet((motion,), POSES)


def demonstrations(offset: float) -> DemonstrationSet:
    """Return two short motions."""
    times = np.arange(4) / 8
    positions = np.array([[-2.0, 1.0], [-1.0, 1.5], [0.25, 0.5], [0.5, -0.25]])
    motions = [
        Demonstration.from_positions(times[:n], positions[:n] + offset, f"motion_{n}.csv") for n in (4, 3)
    ]
    return DemonstrationSet(tuple(motions), SPACE)


# What each command records besides other facts, and its tree is refused without.
RECORDED: dict[str, dict[str, object]] = {
    "learn": {"notes": ("two starts agree", "the last ran out of steps")},
    "merge": {"lyapunov": "found", "dtw_before": (0.25,), "dtw_after": (0.5,)},
    "combine": {"kept": (1.0, 0.5)},
    "chain": {},
    "python": {},
}


def artifact(skill: Skill, taught: tuple[DemonstrationSet | None, ...], command: str) -> store.Artifact:
    """Return a skill with some of everything that metadata can hold."""
    parents = tuple(
        store.ParentRecord(
            name="reach",
            version=3,
            digest=f"sha256:{'1' * 64}",
            role=f"stage {number}" if command == "chain" else "part",
        )
        for number in range(1, max(1, len(skill.parts)) + 1)
    )
    reports = tuple(
        store.DemonstrationReport(
            source=motion.source,
            leaf=leaf,
            n_points=motion.times.size,
            duration=motion.duration,
            velocity_rmse=0.0625,
            dtw=0.001953125,
            end_error=1e-9,
            arrived=True,
        )
        for leaf, motions in enumerate(taught)
        for motion in motions or ()
    )
    return store.Artifact(
        skill,
        taught,
        store.Operation.model_validate(
            {
                "command": command,
                "options": {"metric": "learned", "n_components": 2, "target": None, "weights": [0.5, 1]},
                "seed": 7,
                "results": {"converged": True, "objective": 0.1} | RECORDED[command],
                "note": "slower near the shelf",
            }
        ),
        store.Provenance(
            inputs=(store.InputRecord(path="data/motion.csv", sha256="0" * 64, importer="csv"),),
            parents=parents,
            tool="0.2.0",
            libraries={"numpy": "2.0.0"},
            date="2020-02-29T12:00:00Z",
        ),
        reports,
    )


def archive() -> dict[str, store.Artifact]:
    """Return the artifacts by file name."""
    left, right, other = seds(0.0), seds(1.0), seds(-1.0, (3.0, 4.0))
    merged = MergedSkill(
        (left, right), np.array([0.25, 0.75]), "experts", speed=0.5, parameters={"sharpness": 2.0}
    )
    combined = CombinedSkill((merged, other), np.array([0.5, 0.5]), "latched", 0.0625, 2.0)
    halves, taught = np.array([0.5, 0.5]), (demonstrations(0.0), demonstrations(1.0))
    added, dense = (
        MergedSkill((left, right), halves),
        MergedSkill((right, left), halves, "density", speed=0.25),
    )
    nested = MergedSkill((dense, left), np.array([0.125, 0.875]), "superposition")
    instantaneous = CombinedSkill((left, other), halves, "instantaneous", 0.125)
    regions = tuple(GaussianMixture(halves, part.means, part.covariances) for part in (left, other))
    taught_regions = CombinedSkill((left, other), halves, "latched", 0.125, regions=regions)
    chain = ChainedSkill(
        (other, taught_regions, bent(0.0)),
        np.array([0.0009765625, 0.25, 0.5]),
        (("close", "wait 0.5"), (), ("open",)),
        "back",
        0.0625,
    )
    poses = ChainedSkill(
        (pose(0.0), pose(1.0, (0.0, 0.0, 0.5))), np.array([0.125, 0.25]), ((), ("open",)), "stay", 0.125
    )
    aligned = CombinedSkill((left, dense), np.array([0.75, 0.25]), "instantaneous", 0.125, 0.5)
    return {
        "seds-bare.h5": artifact(right, (None,), "python"),
        "seds-bent.h5": artifact(bent(0.0), (demonstrations(0.0),), "learn"),
        "combined-bent.h5": artifact(CombinedSkill((bent(1.0), other), halves), (None, None), "python"),
        "seds-pose.h5": artifact(pose(0.0), (turning(),), "learn"),
        "combined-poses.h5": artifact(
            CombinedSkill(
                (pose(0.0), pose(1.0, (0.0, 0.0, 0.5))),
                halves,
                regions=(pose(0.0).density, pose(1.0).density),
            ),
            (None, turning()),
            "python",
        ),
        "seds-joints.h5": artifact(joints(), (None,), "learn"),
        "merged-superposition.h5": artifact(added, taught, "merge"),
        "merged-density.h5": artifact(dense, (None, None), "python"),
        "merged-nested.h5": artifact(nested, (*taught, None), "merge"),
        "combined-instantaneous.h5": artifact(instantaneous, taught, "combine"),
        "combined-regions.h5": artifact(taught_regions, taught, "combine"),
        "combined-aligned.h5": artifact(aligned, (demonstrations(-1.0), None, None), "combine"),
        "chain.h5": artifact(chain, (demonstrations(-1.0), None, None, demonstrations(0.0)), "chain"),
        "chain-poses.h5": artifact(poses, (turning(), None), "python"),
        "seds.h5": artifact(left, (demonstrations(0.0),), "learn"),
        "merged.h5": artifact(merged, (demonstrations(0.0), demonstrations(1.0)), "merge"),
        "combined.h5": artifact(combined, (None, demonstrations(1.0), demonstrations(-1.0)), "combine"),
    }


def main(directory: Path) -> None:
    """Write what is not there yet: what is there is never made again."""
    for name, content in archive().items():
        if (directory / name).exists():
            continue
        data = store.encode(content)
        store.write_file(directory / name, data)
        print(content.digest, hashlib.sha256(data).hexdigest(), name)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
