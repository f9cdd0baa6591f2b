"""What a simulated second costs: run with ``pytest tests/benchmarks/test_simulating.py --benchmark-enable``.

A batch of a thousand episodes of five seconds should be over while one drinks a coffee: at least ten
simulated seconds per second of CPU and core, everything included that an episode does. The reference is what
nobody can undercut: the bare steps of Bullet, of the same arm, as many of them.
"""

from __future__ import annotations

import time

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from skillctl.demonstrations.reaching import reaching_demonstrations
from skillctl.learning.fit import fit
from skillctl.learning.options import LearnOptions
from skillctl.model.seds import SedsSkill
from skillctl.simulation.arm import CONTROL_PERIOD, ArmBody
from skillctl.simulation.arms import ARMS
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import Scenario, Shelf

START, TARGET = (0.42, -0.1, 0.55), (0.5, 0.1, 0.6)


@pytest.fixture(scope="module")
def reach() -> SedsSkill:
    return fit(reaching_demonstrations("top-centre"), LearnOptions(preset="fast", n_components=7)).skill


def steps(arm: str, count: int) -> float:
    """Let Bullet alone step an arm; return the CPU time, [s]."""
    with ArmBody(ARMS[arm], 0.0, shapes="collision") as body:
        body.bullet.setTimeStep(CONTROL_PERIOD)
        began = time.process_time()
        for _ in range(count):
            body.bullet.stepSimulation()
        return time.process_time() - began


@pytest.mark.benchmark(group="simulate")
@pytest.mark.parametrize("scene", [None, Shelf()], ids=["free", "shelf"])
@pytest.mark.parametrize("arm", ARMS)
def test_an_episode(benchmark: BenchmarkFixture, reach: SedsSkill, arm: str, scene: Shelf | None) -> None:
    scenario = Scenario(arm=arm, start=START, target=TARGET if scene is None else None, scene=scene)
    if scene is not None and arm == "xarm6":
        pytest.skip("the shelf's upper board is out of this arm's reach")
    spent = []

    def episode() -> object:
        began = time.process_time()
        result = simulate(reach, scenario)
        spent.append(time.process_time() - began)
        return result

    result = benchmark.pedantic(episode, rounds=5, warmup_rounds=1)
    assert result.success
    simulated = result.metrics.simulated_time
    benchmark.extra_info["simulated seconds per CPU second"] = simulated / min(spent)
    benchmark.extra_info["CPU time over bare steps"] = min(spent) / steps(
        arm, round(simulated / CONTROL_PERIOD)
    )
