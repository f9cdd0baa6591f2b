"""Print the table of the learner: accuracy, arrival, CPU time, per objective, metric and preset.

python tests/benchmarks/learning.py            # every row, about five minutes
python tests/benchmarks/learning.py --motions  # and the figures of each motion
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one core, before NumPy starts its threads
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import subprocess
import sys
from collections.abc import Iterator, Sequence
from typing import Any, get_args

import lasa
import numpy as np
from lasa import Score, microseconds, score

from skillctl.arrays import FloatArray
from skillctl.geometry import box
from skillctl.learning.fit import fit, learned_distance
from skillctl.learning.options import Coordinates, LearnOptions
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.rollout import rollout
from skillctl.model.space import Euclidean

PLAIN: dict[str, Any] = {"coordinates": "identity"}
ROWS = {
    "default": LearnOptions(),
    "fast": LearnOptions(preset="fast"),
    "quality": LearnOptions(preset="quality"),
    "no shears": LearnOptions(**PLAIN),
    "no shears, P = I (strict SEDS)": LearnOptions(metric="euclidean", **PLAIN),
    "velocities only (mse)": LearnOptions(objective="mse"),
    "likelihood (Eq. 6)": LearnOptions(objective="likelihood"),
}
HEAD = (
    "| learner | DTW mean / median / worst [mm] | bound, mean [mm] | arrive: starts / pushed / grid [%] "
    "| CPU median / max [s] |\n| --- | --- | --- | --- | --- |"
)


def row(name: str, scores: Sequence[Score]) -> str:
    """Return one line of the table."""
    distances = np.array([s.dtw for s in scores])
    cpu = np.array([s.cpu for s in scores])
    shares = [
        100 * np.mean([getattr(s, f"arrived{which}") for s in scores]) for which in ("", "_pushed", "_grid")
    ]
    return (
        f"| {name} | {distances.mean():.2f} / {np.median(distances):.2f} / {distances.max():.2f} "
        f"| {np.mean([s.bound for s in scores]):.2f} | {' / '.join(f'{share:.4g}' for share in shares)} "
        f"| {np.median(cpu):.2f} / {cpu.max():.2f} |"
    )


def split(
    motions: dict[str, DemonstrationSet], count: int
) -> Iterator[tuple[DemonstrationSet, DemonstrationSet]]:
    """Yield the first ``count`` demonstrations of each single-model motion, and the others."""
    for name, motion in motions.items():
        if not name.startswith("Multi_Models"):
            parts = motion.demonstrations[:count], motion.demonstrations[count:]
            training, test = (DemonstrationSet(part, motion.space) for part in parts)
            yield training, test


def published(motions: dict[str, DemonstrationSet], options: LearnOptions) -> str:
    """Return the figures of ds-opt's published test: learn demonstrations 1 to 4, test on 5 to 7.

    Means over the tested demonstrations of: the DTW distance, summed over the matched pairs, of every second
    sample [mm]; the velocity error ‖f − ẋ‖ / √d [mm/s]; and 1 − cos of the angle between both.
    """
    rows = []
    for training, test in split(motions, 4):
        skill = fit(training, options).skill
        for motion in test:
            x, v = motion.positions - motion.positions[-1] + skill.attractor, motion.velocities
            every = 2 * float(np.median(np.diff(motion.times)))
            moved = rollout(
                skill,
                x[:1],
                duration=lasa.HORIZON * motion.duration,
                period=every,
                arrival_distance=lasa.GOAL,
            )
            _, path = moved.trajectory(0)
            f = skill.velocity(x)
            error = np.linalg.norm(f - v, axis=1).mean() / np.sqrt(x.shape[1])
            speeds = np.linalg.norm(f, axis=1) * np.linalg.norm(v, axis=1)
            turned = 1 - (f * v).sum(axis=1)[speeds > 0] / speeds[speeds > 0]
            rows.append((1e3 * summed_dtw(path, x[::2]), 1e3 * error, np.abs(turned).mean()))
    distance, error, turned = np.mean(rows, axis=0)
    return f"DTWD {distance:.0f}, RMSE {error:.2f}, e-dot {turned:.3f}"


def summed_dtw(a: FloatArray, b: FloatArray) -> float:
    """Return the smallest sum of distances over monotone matchings of two paths."""
    costs = np.linalg.norm(a[:, None] - b[None], axis=2)
    best = np.full((len(a) + 1, len(b) + 1), np.inf)
    best[0, 0] = 0
    for diagonal in range(2, len(a) + len(b) + 1):
        i = np.arange(max(1, diagonal - len(b)), min(len(a), diagonal - 1) + 1)
        j = diagonal - i
        before = np.minimum(np.minimum(best[i - 1, j], best[i, j - 1]), best[i - 1, j - 1])
        best[i, j] = costs[i - 1, j - 1] + before
    return float(best[-1, -1])


def speed_beside(motions: dict[str, DemonstrationSet], options: LearnOptions) -> str:
    """Return how fast skills are beside the motion: 95th percentile in a box over the fastest one shown.

    The box is half as large again as that of the demonstrations; mean over the motions, and the largest.
    """
    ratios = []
    for motion in motions.values():
        skill = fit(motion, options).skill
        low, high = box(np.vstack([d.positions for d in motion]))
        middle, half = 0.5 * (low + high), 0.75 * (high - low)
        states = np.random.default_rng(0).uniform(middle - half, middle + half, (10_000, len(low)))
        speeds = np.linalg.norm(skill.velocity(states), axis=1)
        shown = max(float(np.linalg.norm(d.velocities, axis=1).max()) for d in motion)
        ratios.append(float(np.quantile(speeds, 0.95)) / shown)
    return f"{np.mean(ratios):.2f} (mean), {max(ratios):.2f} (largest)"


def under_one_proof(motions: dict[str, DemonstrationSet]) -> str:
    """Return the DTW of Sshape and Angle [mm], learned under one distance with and without coordinates."""
    sets = [motions["Sshape"], motions["Angle"]]
    found = {}
    for coordinates in get_args(Coordinates)[:2]:
        distance = learned_distance(sets, coordinates)
        found[coordinates] = [lasa.behaviour(fit(each, distance=distance), each)[0] for each in sets]
    return ", ".join(f"{name}: {a:.2f} / {b:.2f}" for name, (a, b) in found.items())


def speed() -> list[str]:
    """Return lines on the cost of one state, a batch, and the import."""
    phase = np.linspace(0, 1, 200)[:, None]
    arc = (1 - phase) * np.array([0.3, 0.1, 0.2]) + 0.1 * np.sin(np.pi * phase) * np.array([0.0, 1.0, 0.5])
    motion = DemonstrationSet((Demonstration.from_positions(2 * phase[:, 0], arc),), Euclidean.cartesian(3))
    skill = fit(motion, LearnOptions(preset="fast", n_components=7)).skill
    state = np.array([0.1, 0.05, 0.1])
    states = np.random.default_rng(0).uniform(-0.3, 0.3, (1_000_000, 3))
    batch = microseconds(lambda: skill.velocity(states), repeats=1, rounds=5) / len(states) * 1e3
    code = "import time; t = time.process_time(); import skillctl.model; print(time.process_time() - t)"
    imports = [
        float(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout)
        for _ in range(6)
    ][1:]
    bent = fit(motion, LearnOptions(preset="fast", n_components=7, coordinates="shears")).skill
    return [
        f"one state, K = 7, d = 3: {microseconds(lambda: skill.velocity(state)):.1f} us",
        f"the same with shears: {microseconds(lambda: bent.velocity(state)):.1f} us",
        f"a million states, K = 7, d = 3: {batch:.0f} ns a state",
        f"import skillctl and its model: {np.median(imports):.2f} s CPU",
    ]


def growth() -> list[str]:
    """Return lines on the cost of learning against demonstrations, points, components and dimensions."""
    generator = np.random.default_rng(0)

    def reaches(count: int, points: int, d: int) -> DemonstrationSet:
        phase = np.linspace(0, 1, points)[:, None]
        made = []
        for _ in range(count):
            start = np.eye(d)[0] + 0.1 * generator.standard_normal(d)
            bow = 0.3 * np.sin(np.pi * phase) * np.eye(d)[-1] if d > 1 else 0.0
            made.append(Demonstration.from_positions(3 * phase[:, 0], (1 - phase) ** 2 * start + bow))
        return DemonstrationSet(tuple(made), Euclidean.cartesian(d))

    lines = []
    for count, points, d, k in (
        (7, 1_000, 2, 7),
        (7, 100_000, 2, 7),
        (10, 100_000, 3, 7),
        (100, 10_000, 3, 7),
        (100, 1_000, 3, 7),
        (7, 1_000, 2, 3),
        (7, 1_000, 2, 10),
        (7, 1_000, 7, 7),
    ):
        s = lasa.cpu_of(
            lambda c=count, p=points, d=d, k=k: fit(reaches(c, p, d), LearnOptions(n_components=k))
        )
        lines.append(f"{count} demonstrations of {points} points, d = {d}, K = {k}: {s:.2f} s CPU")
    return lines


def main() -> None:
    """Print everything."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--motions", action="store_true", help="print DTW and bound of each motion")
    parser.add_argument("--only", help="only the rows whose name contains this")
    arguments = parser.parse_args()
    motions = lasa.motions()
    fit(motions["Line"], LearnOptions(preset="fast"))  # imports are not training
    print(HEAD)
    for name, options in ROWS.items():
        if arguments.only and arguments.only not in name:
            continue
        scores = {motion: score(data, options) for motion, data in motions.items()}
        print(row(name, list(scores.values())), flush=True)
        if arguments.motions:
            print("  " + ", ".join(f"{m} {s.dtw:.2f} ({s.bound:.2f})" for m, s in scores.items()))
    if not arguments.only:
        for name in ("default", "no shears"):
            rest = [score(training, ROWS[name], test) for training, test in split(motions, 5)]
            print(row(f"{name}, held out", rest), flush=True)
        for name in ("default", "no shears"):
            print(f"ds-opt's test, {name}: {published(motions, ROWS[name])}", flush=True)
            print(f"speed beside the motion, {name}: {speed_beside(motions, ROWS[name])}", flush=True)
        print(f"Sshape and Angle under one proof [mm]: {under_one_proof(motions)}", flush=True)
        print("\n" + "\n".join(speed() + growth()))


if __name__ == "__main__":
    main()
