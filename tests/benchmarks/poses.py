"""Poses: skills and quaternion DMPs on the same kinesthetic demonstrations in the same run.

    pip install '.[bench]' && python tests/benchmarks/poses.py FOLDER_OF_ROBOTASKS

The folder holds .npy files (demonstrations, 1000, 7): position [cm], quaternion w, x, y, z, at 60 Hz. A held
robot stands still for half of the motion's duration, half-way, and is then let go. "Left out": learned from all
demonstrations but two, and measured on these two, for three choices of two.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one core, before NumPy starts its threads
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from movement_primitives.dmp import CartesianDMP

from skillctl import rotations
from skillctl.arrays import FloatArray
from skillctl.demonstrations.reader import read_demonstrations
from skillctl.learning.fit import fit
from skillctl.learning.options import LearnOptions
from skillctl.metrics import dtw, dtw_angle
from skillctl.model.controller import Controller
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.space import Space

PERIOD = 0.01  # [s], of the controller
SAMPLES = 1000  # of the clock-driven primitive
NEAR, TURNED = 2e-3, np.radians(2.0)  # a motion that ends within these has arrived
LEFT_OUT = ((0, 1), (3, 4), (7, 8))
Run = Callable[[Demonstration, bool], FloatArray]  # demonstration, held → states that end at its end
Learner = Callable[[DemonstrationSet], tuple[Run, Callable[[], object]]]  # and what one state costs


def learned(motions: DemonstrationSet) -> tuple[Run, Callable[[], object]]:
    """Learn a skill; run its controller."""
    skill = fit(motions).skill
    space = skill.space

    def run(demonstration: Demonstration, held: bool) -> FloatArray:
        controller = Controller(skill, PERIOD)
        states, duration = demonstration.positions, demonstration.duration
        x = space.carried(states[0], states[-1], skill.attractor)
        path = [x]
        for step in range(int(6 * duration / PERIOD)):
            controller.step(x)
            if not (held and 0.5 * duration <= step * PERIOD < duration):
                x = controller.next  # while held, the hand stays where it is, whatever is commanded
            path.append(x)
            if near(x, skill.attractor, space):
                break
        return space.carried(np.array(path), skill.attractor, states[-1])

    state = motions.demonstrations[0].positions[0]
    return run, lambda: skill.velocity_at(state)


def primitive(motions: DemonstrationSet) -> tuple[Run, Callable[[], object]]:
    """Fit a quaternion DMP to the mean demonstration, relative to its end; it runs on a clock."""
    space, target = motions.space, motions.demonstrations[0].positions[-1]
    duration = float(np.mean([d.duration for d in motions]))
    grid = np.linspace(0, 1, SAMPLES)
    mean = space.placed(np.mean([_offsets(d, space, grid) for d in motions], axis=0), target)
    movement = CartesianDMP(execution_time=duration, dt=duration / SAMPLES, n_weights_per_dim=30)
    movement.imitate(np.linspace(0, duration, SAMPLES), _with_quaternions(mean))

    def run(demonstration: Demonstration, held: bool) -> FloatArray:
        states = demonstration.positions
        start, goal = _with_quaternions(states[[0, -1]])
        movement.reset()
        movement.configure(start_y=start, goal_y=goal)
        y, velocity, path = start.copy(), np.zeros(6), [start.copy()]
        for step in range(2 * SAMPLES):
            moved, speed = movement.step(y, velocity)
            if not (held and SAMPLES // 2 <= step < SAMPLES):
                y, velocity = np.array(moved), np.array(speed)
            path.append(y.copy())
            if step >= SAMPLES and not held:
                break
        table = np.array(path)
        return np.hstack([table[:, :3], rotations.vectors(table[:, [4, 5, 6, 3]])])

    start = _with_quaternions(mean[:1])[0]
    return run, lambda: movement.step(start, np.zeros(6))


def near(state: FloatArray, target: FloatArray, space: Space) -> bool:
    """Return whether a state is a target, but for tolerances."""
    moved, turned = space.apart(state, target)
    return bool(moved <= NEAR and turned is not None and turned <= TURNED)


def _offsets(demonstration: Demonstration, space: Space, grid: FloatArray) -> FloatArray:
    states = demonstration.positions
    phase = (demonstration.times - demonstration.times[0]) / demonstration.duration
    return np.stack([np.interp(grid, phase, c) for c in space.offsets(states, states[-1]).T], axis=1)


def _with_quaternions(states: FloatArray) -> FloatArray:
    return np.hstack([states[:, :3], rotations.quaternions(states[:, 3:])[:, [3, 0, 1, 2]]])


def errors(run: Run, motions: Sequence[Demonstration], space: Space, held: bool) -> FloatArray:
    """Return DTW distances [mm] and [degrees], and whether it arrives [%], of each motion. Shape (n, 3)."""
    rows = []
    for demonstration in motions:
        path, shown = run(demonstration, held), demonstration.positions
        angle = np.degrees(dtw_angle(path[:, 3:], shown[:, 3:]))
        rows.append([1e3 * dtw(path[:, :3], shown[:, :3]), angle, 100.0 * near(path[-1], shown[-1], space)])
    return np.array(rows)


def microseconds(call: Callable[[], object], count: int = 2000) -> float:
    """Return what one call costs, CPU."""
    started = time.process_time()
    for _ in range(count):
        call()
    return 1e6 * (time.process_time() - started) / count


def main() -> None:
    """Print the table."""
    files = sorted(Path(sys.argv[1]).glob("*.npy"))
    sets = {
        file.stem: read_demonstrations([file], units="cm", orientation="wxyz", dt=1 / 60).demonstrations
        for file in files
    }
    fit(next(iter(sets.values())), LearnOptions(preset="fast"))
    head = "DTW [mm] | DTW [°] | arrives [%]"
    print(f"| set | learner | {head} | held: {head} | left out: {head} | fit, CPU [s] | µs a state |")
    print("| --- | --- " + "| --- " * 11 + "|")
    for name, motions in sets.items():
        for title, learner in (("skillctl", learned), ("movement_primitives CartesianDMP", primitive)):
            started = time.process_time()
            run, one_state = learner(motions)
            cpu = time.process_time() - started
            rows = [errors(run, motions.demonstrations, motions.space, held) for held in (False, True)]
            unseen = []
            for indices in LEFT_OUT:
                kept = tuple(d for i, d in enumerate(motions) if i not in indices)
                others = [motions.demonstrations[i] for i in indices]
                again, _ = learner(DemonstrationSet(kept, motions.space))
                unseen.append(errors(again, others, motions.space, held=False))
            means = [part.mean(axis=0) for part in (*rows, np.concatenate(unseen))]
            figures = " | ".join(f"{a:.1f} | {b:.2f} | {c:.0f}" for a, b, c in means)
            print(f"| {name} | {title} | {figures} | {cpu:.2f} | {microseconds(one_state):.1f} |", flush=True)


if __name__ == "__main__":
    main()
