"""What a control loop and a batch cost: run with ``pytest tests/benchmarks --benchmark-enable``.

A thousand states a second is the fastest arm controller in use, so one state has to fit well inside a
millisecond. The reference is what any Python program pays: one product of small NumPy arrays.
"""

from __future__ import annotations

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from skillctl.demonstrations.reaching import reaching_demonstrations
from skillctl.learning.fit import fit
from skillctl.learning.options import LearnOptions
from skillctl.model.seds import SedsSkill
from skillctl.stability.certificate import certify


@pytest.fixture(scope="module")
def reach() -> SedsSkill:
    return fit(reaching_demonstrations("top-centre"), LearnOptions(preset="fast", n_components=7)).skill


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
