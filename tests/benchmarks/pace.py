"""Do mergers move as fast as people do? Durations of merged motions on demonstrations that were left out.

    python tests/benchmarks/pace.py bottle=bottle2shelf.npy cube=3D-cube-pick.mat

A set is a file that ``learn`` reads, or an array (demonstrations, samples, columns) whose first three columns
are positions in centimetres at 60 Hz (RoboTasks). Of each set the first and the second third are learned as
two skills; of the last third, one demonstration is the new task, and the others are left out. Skills of one
set are merged, and the first skills of every two sets, fitted to the first of these and to sets that neither
part was taught. The table gives, on demonstrations left out, how long a motion takes to stay within 5 % of
its way to the target over the time that the person took; the proved controller period; and the mean DTW
distance.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from skillctl.adapt.options import TaskOptions
from skillctl.compose.options import MergeOptions
from skillctl.demonstrations.reader import read_demonstrations
from skillctl.demonstrations.writing import write_csv
from skillctl.metrics import dtw
from skillctl.model.demonstration import Demonstration
from skillctl.model.retarget import retargeted
from skillctl.model.rollout import rollout
from skillctl.model.skill import Skill
from skillctl.store import read_skill
from skillctl.usecases.learn import learn
from skillctl.usecases.merge import merge

HERTZ = 60
NEAR = 0.05
PERIOD = 0.005  # [s]
PATIENCE = 10  # durations


def demonstrations_of(path: Path) -> list[Demonstration]:
    """Return the demonstrations of a file, in metres and seconds, each moved to end at the mean end."""
    if path.suffix == ".npy":
        found = [
            Demonstration.from_positions(np.arange(len(x)) / HERTZ, x[:, :3] / 100) for x in np.load(path)
        ]
    else:
        found = list(read_demonstrations([path]).demonstrations)
    end = np.mean([motion.positions[-1] for motion in found], axis=0)
    return [motion.translated(end - motion.positions[-1]) for motion in found]


def ratio(skill: Skill, groups: Sequence[Sequence[Demonstration]]) -> float:
    """Return how long motions take from the starts of demonstrations over what the person took.

    Of each group the median duration counts, and of several groups the mean of their medians.
    """
    taken, shown = [], []
    for motions in groups:
        runs = [run(skill, motion) for motion in motions]
        ends = [motion.positions[-1] for motion in motions]
        taken.append(np.median([time_to_near(*each, end) for each, end in zip(runs, ends, strict=True)]))
        shown.append(
            np.median([time_to_near(m.times - m.times[0], m.positions, m.positions[-1]) for m in motions])
        )
    return float(np.mean(taken) / np.mean(shown))


def run(skill: Skill, motion: Demonstration) -> tuple[np.ndarray, np.ndarray]:
    """Return times and positions of a skill's motion from a demonstration's start to its end."""
    moved = retargeted(skill, motion.positions[-1])
    return rollout(
        moved, motion.positions[:1], duration=PATIENCE * motion.duration, period=PERIOD
    ).trajectory(0)


def time_to_near(times: np.ndarray, path: np.ndarray, goal: np.ndarray) -> float:
    """Return since when a path has stayed near its goal, [s]."""
    away = np.linalg.norm(path - goal, axis=1)
    outside = np.flatnonzero(away > NEAR * np.linalg.norm(path[0] - goal))
    return float(times[min(outside[-1] + 1, len(times) - 1)])


def miss(skill: Skill, groups: Sequence[Sequence[Demonstration]]) -> float:
    """Return the mean DTW distance of a skill's motions to demonstrations, [mm]."""
    found = [dtw(run(skill, motion)[1], motion.positions) for motions in groups for motion in motions]
    return 1e3 * float(np.mean(found))


class Bench:
    """Skills learned, and merged, in a folder of files."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def files(self, name: str, motions: Sequence[Demonstration]) -> list[Path]:
        """Write demonstrations, and return their files."""
        paths = [self.folder / f"{name}-{i}.csv" for i in range(len(motions))]
        for path, motion in zip(paths, motions, strict=True):
            write_csv(motion, path)
        return paths

    def learned(self, name: str, motions: Sequence[Demonstration]) -> Path:
        """Learn a skill, and return its file."""
        path = self.folder / f"{name}.h5"
        learn(self.files(name, motions), output=path)
        return path

    def row(
        self,
        name: str,
        parts: Sequence[Path],
        own: Sequence[Sequence[Demonstration]],
        task: Sequence[Demonstration],
    ) -> None:
        """Print how fast mergers move: plain ones on what is left of their sets, fitted ones on the task."""
        shown, path = tuple(self.files("task", task[:1])), self.folder / "merged.h5"
        cells = [name]
        for speed, fit, groups in (
            (1.0, None, own),
            (None, None, own),
            (None, TaskOptions(shown), [task[1:]]),
            (None, TaskOptions(shown, level="component"), [task[1:]]),
        ):
            report = merge(parts, output=path, options=MergeOptions(speed=speed), task=fit, force=True)
            skill = read_skill(path).skill
            cells.append(
                f"{ratio(skill, groups):.2f}; {report.certificate.period:.3f} s; {miss(skill, groups):.0f} mm"
            )
        print("|", " | ".join(cells), "|", flush=True)


def main(names: Sequence[str]) -> None:
    """Print the table."""
    sets = {name: demonstrations_of(Path(path)) for name, path in (each.split("=") for each in names)}
    headings = ("skills", "--speed 1", "plain", "--fit", "--fit, per component")
    print("|", " | ".join(headings), "|")
    print("|", " | ".join("---" for _ in headings), "|")
    with TemporaryDirectory() as folder:
        bench = Bench(Path(folder))
        firsts, rest = {}, {}
        for name, motions in sets.items():
            third = len(motions) // 3
            halves = [bench.learned(f"{name}-{i}", motions[i * third : (i + 1) * third]) for i in range(2)]
            firsts[name], rest[name] = halves[0], motions[2 * third :]
            bench.row(name, halves, [rest[name][1:]], rest[name])
        for task in sets:
            for parts in (pair for pair in combinations(sets, 2) if task not in pair or task == pair[0]):
                own = [rest[name][1:] for name in parts]
                bench.row(f"{'+'.join(parts)} to {task}", [firsts[name] for name in parts], own, rest[task])


if __name__ == "__main__":
    main(sys.argv[1:])
