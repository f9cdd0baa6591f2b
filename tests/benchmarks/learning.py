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
from collections.abc import Sequence

import lasa
import numpy as np
from lasa import Score, microseconds, score

from skillctl.learning.fit import fit
from skillctl.learning.options import LearnOptions
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.space import Euclidean

ROWS = {
    "learned P, default": LearnOptions(),
    "learned P, fast": LearnOptions(preset="fast"),
    "learned P, quality": LearnOptions(preset="quality"),
    "P = I (strict SEDS)": LearnOptions(metric="euclidean"),
    "P = I, quality": LearnOptions(metric="euclidean", preset="quality"),
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


def held_out(motions: dict[str, DemonstrationSet]) -> list[Score]:
    """Learn each single-model motion from its first five demonstrations; measure on the other two."""
    scores = []
    for name, motion in motions.items():
        if not name.startswith("Multi_Models"):
            parts = motion.demonstrations[:5], motion.demonstrations[5:]
            training, test = (DemonstrationSet(part, motion.space) for part in parts)
            scores.append(score(training, LearnOptions(), test))
    return scores


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
    return [
        f"one state, K = 7, d = 3: {microseconds(lambda: skill.velocity(state)):.1f} us",
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
        print(row("learned P, default, held out", held_out(motions)), flush=True)
        print("\n" + "\n".join(speed() + growth()))


if __name__ == "__main__":
    main()
