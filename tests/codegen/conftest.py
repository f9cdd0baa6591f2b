"""Skills of every kind that a header can be of."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.coordinates.bodies import Ball, Box, Cylinder, Ellipsoid
from skillctl.model.coordinates.chain import Chain
from skillctl.model.kept_out import kept_out
from skillctl.model.merged import MergedSkill

BODIES = (
    Ball("ball", (0.3, -0.1, 0.0), 0.05),
    Ellipsoid("egg", (-0.3, 0.2, 0.1), (0.1, 0.04, 0.06), turn=(0.7, 0.2, -0.3)),
    Box("crate", (0.0, 0.4, 0.0), (0.2, 0.1, 0.05), turn=(0.3, 0.5, 1.0)),
    Box("board", (0.0, 0.0, -0.4), (0.6, 0.3, 0.01), pole=(0.2, 0.1, -0.4)),
    Cylinder("bottle", (0.0, 0.0, 0.4), 0.03, 0.2, turn=(0.4, 0.0, 0.0)),
)
KINDS = (
    *("learned", "in the plane", "in shears", "superposition", "densities", "experts", "nested"),
    *("merged in shears", "latched", "instantaneous", "pose", "pose in shears", "poses merged"),
    *("poses latched", "poses of one turn", "kept out", "kept out in shears", "pose kept out"),
    *("chain", "chain that goes back", "chain of poses"),
)


@pytest.fixture(autouse=True)
def _compiler() -> None:
    if shutil.which("cc") is None:
        pytest.skip("there is no C compiler")


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    """Each kind of skill, by name."""
    return str(request.param)


@pytest.fixture(scope="session")
def skill_of(
    make_skill: Any, make_shears: Any, make_pose_skill: Any, make_grasp: Any
) -> Callable[[str], Any]:
    """Return a maker of a skill of each kind."""
    thirds = np.array([0.2, 0.3, 0.5])

    def rng(seed: int) -> np.random.Generator:
        return np.random.default_rng(seed)

    def learned(seed: int, attractor: Any = (0.5, 0.1, 0.2), bent: bool = False, **options: Any) -> Any:
        skill = make_skill(rng(seed), dimension=3, attractor=attractor, **options)
        return replace(skill, coordinates=Chain((make_shears(rng(9), 3),))) if bent else skill

    def merged(gate: str, bent: bool = False, speed: float = 1.0) -> Any:
        parts = tuple(learned(seed, bent=bent, n_components=4) for seed in range(3))
        return MergedSkill(parts, thirds, gate, speed)

    def nested() -> Any:
        parts = merged("density", speed=1.3), learned(7), merged("superposition")
        return MergedSkill(parts, thirds, "experts")

    def combined(gate: str, bent: bool) -> Any:
        parts = learned(1), learned(2, attractor=(0.1, 0.1, 0.2), bent=bent), merged("density")
        return CombinedSkill(parts, thirds, gate, speed=1.5)

    def poses(gate: str, target: Any) -> Any:
        parts = make_pose_skill(rng(3)), make_pose_skill(rng(4), target=target)
        return CombinedSkill(parts, np.array([0.4, 0.6]), gate)

    def away(bent: bool) -> Any:
        return learned(1, attractor=(0.9, 0.9, 0.9), bent=bent, spread=0.2)

    def chained(on_jump: Any) -> Any:
        parts = learned(1), combined("latched", bent=True), merged("density")
        events = ("close", "wait 0.03"), (), ("open", "wait 0.055", "home")
        return ChainedSkill(parts, np.array([2e-3, 1e-3, 5e-4]), events, on_jump)

    def poses_chained() -> Any:
        last = make_pose_skill(rng(6), target=(0.2, 0.2, 0.1, 0.0, 1.0, 0.0), bent=True)
        parts = make_pose_skill(rng(3)), poses("latched", (0.1, 0.2, 0.3, 1.0, 0.0, 0.2)), last
        return ChainedSkill(parts, np.array([2e-3, 1e-3, 5e-4]), (("close",), ("wait 0.03",), ()), "back")

    makers: dict[str, Callable[[], Any]] = {
        "learned": lambda: learned(1, n_components=7),
        "in the plane": lambda: make_skill(rng(2), speed=1.7),
        "in shears": lambda: learned(1, n_components=7, bent=True),
        "superposition": lambda: merged("superposition"),
        "densities": lambda: merged("density"),
        "experts": lambda: merged("experts"),
        "nested": nested,
        "merged in shears": lambda: merged("density", bent=True, speed=1.2),
        "latched": lambda: combined("latched", bent=True),
        "instantaneous": lambda: combined("instantaneous", bent=False),
        "pose": lambda: make_pose_skill(rng(3)),
        "pose in shears": lambda: make_pose_skill(rng(3), bent=True),
        "poses merged": lambda: MergedSkill(
            (make_pose_skill(rng(3)), make_pose_skill(rng(4))), np.array([0.4, 0.6]), "density"
        ),
        "poses latched": lambda: poses("latched", (0.1, 0.2, 0.3, 1.0, 0.0, 0.2)),
        "poses of one turn": lambda: poses("instantaneous", (0.1, 0.2, 0.3, 0.0, 2.0, -1.0)),
        "kept out": lambda: kept_out(away(bent=False), BODIES, margin=0.02),
        "kept out in shears": lambda: kept_out(away(bent=True), BODIES[2:], margin=0.02),
        "chain": lambda: chained("stay"),
        "chain that goes back": lambda: chained("back"),
        "chain of poses": poses_chained,
        "pose kept out": lambda: kept_out(make_grasp(), BODIES[:1], margin=0.02),
    }
    assert set(makers) == set(KINDS)
    return lambda name: makers[name]()
