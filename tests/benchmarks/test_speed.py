"""What a control loop and a batch cost: run with ``pytest tests/benchmarks --benchmark-enable``.

A thousand states a second is the fastest arm controller in use, so one state has to fit well inside a
millisecond. The reference is what any Python program pays: one product of small NumPy arrays.
"""

from __future__ import annotations

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from skillctl.compose.combine import combine
from skillctl.compose.merge import merge
from skillctl.demonstrations.reaching import reaching_demonstrations
from skillctl.drivers.driver import Setup
from skillctl.drivers.fake import FakeArm
from skillctl.drivers.loop import Loop
from skillctl.drivers.options import RunOptions
from skillctl.learning.fit import fit
from skillctl.learning.options import LearnOptions
from skillctl.model.controller import Controller
from skillctl.model.gates import COMBINE_GATES, MERGE_GATES
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import Skill
from skillctl.stability.certificate import certify

REACHES = ("top-centre", "bottom-left", "bottom-right")


@pytest.fixture(scope="module")
def parts() -> list[SedsSkill]:
    options = LearnOptions(preset="fast", n_components=7, metric="euclidean")  # one P: they merge as they are
    return [fit(reaching_demonstrations(task), options).skill for task in REACHES]


@pytest.fixture(scope="module")
def reach(parts: list[SedsSkill]) -> SedsSkill:
    return parts[0]


@pytest.fixture(scope="module")
def kinds(parts: list[SedsSkill]) -> dict[str, Skill]:
    """A skill of every kind and gate, seven components a part, three dimensions."""
    merged = {gate.name: merge(parts[:2], gate=gate.name) for gate in MERGE_GATES}
    combined = {gate.name: combine(parts, gate=gate.name) for gate in COMBINE_GATES}
    return {"learned": parts[0], **merged, **combined}


KINDS = ["learned", *(gate.name for gate in (*MERGE_GATES, *COMBINE_GATES))]


@pytest.mark.benchmark(group="one state")
def test_reference_one_small_product(benchmark: BenchmarkFixture, reach: SedsSkill) -> None:
    matrix, state = reach.lyapunov, reach.attractor
    assert np.isfinite(benchmark(lambda: matrix @ state)).all()


@pytest.mark.benchmark(group="one state")
@pytest.mark.parametrize("distance", [0.0, 0.3, 1e6], ids=["at-attractor", "near", "far"])
def test_one_state(benchmark: BenchmarkFixture, reach: SedsSkill, distance: float) -> None:
    state = reach.attractor + distance
    velocity = benchmark(reach.velocity, state)
    assert np.isfinite(velocity).all()
    assert (velocity @ reach.lyapunov @ (state - reach.attractor) <= 0).all()  # V does not grow


@pytest.mark.benchmark(group="one state of each kind")
@pytest.mark.parametrize("kind", KINDS)
def test_one_state_of_each_kind(benchmark: BenchmarkFixture, kinds: dict[str, Skill], kind: str) -> None:
    skill, state = kinds[kind], np.array([0.42, 0.05, 0.55])
    velocity = benchmark(skill.velocity, state)
    # One product of all states is summed in another order than one for each.
    np.testing.assert_allclose(velocity, skill.velocity(state[None])[0], rtol=1e-9, atol=1e-12)


@pytest.mark.benchmark(group="one control step")
@pytest.mark.parametrize("kind", KINDS)
def test_one_control_step(benchmark: BenchmarkFixture, kinds: dict[str, Skill], kind: str) -> None:
    controller, state = Controller(kinds[kind], 1e-3), np.array([0.42, 0.05, 0.55])
    controller.step(state)
    command = benchmark(controller.step, state)  # the part that acts is known, as it is in a loop
    assert np.isfinite(command).all()


@pytest.mark.benchmark(group="about a hundred steps of run")
def test_steps_of_a_run(benchmark: BenchmarkFixture, reach: SedsSkill) -> None:
    loop = Loop(FakeArm(Setup("", reach, start=reach.attractor + 0.3)), reach, RunOptions(timeout=0.985))
    ending = benchmark(loop.drive, [])  # 99 steps, and those that bring the hand to rest
    assert ending.outcome == "timeout"


@pytest.mark.benchmark(group="batch")
def test_a_batch_of_states(benchmark: BenchmarkFixture, reach: SedsSkill) -> None:
    states = reach.attractor + np.random.default_rng(0).uniform(-0.3, 0.3, (100_000, 3))
    velocities = benchmark(reach.velocity, states)
    one = np.stack([reach.velocity(state) for state in states[:20]])
    # The two paths sum a few dozen terms in another order.
    np.testing.assert_allclose(velocities[:20], one, rtol=1e-9, atol=1e-12)


@pytest.mark.benchmark(group="prove")
def test_a_proof(benchmark: BenchmarkFixture, reach: SedsSkill) -> None:
    assert benchmark(certify, reach).verdict == "stable"


@pytest.mark.benchmark(group="learn")
def test_learning(benchmark: BenchmarkFixture) -> None:
    motion = reaching_demonstrations("bottom-left")
    result = benchmark.pedantic(fit, (motion, LearnOptions(preset="fast")), rounds=3)
    assert certify(result.skill).verdict == "stable"
