"""Other learners on the same motions in the same run, and what happens when the robot is held.

    pip install '.[bench]' && python tests/benchmarks/peers.py

A held robot stands still for half the motion's duration, half-way, and is then let go. A clock-driven
primitive goes on without it; a dynamical system has no clock.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one core, before NumPy starts its threads
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import time
import warnings
from collections.abc import Callable

import gmr
import lasa
import numpy as np
from movement_primitives.dmp import DMP
from sklearn.mixture import GaussianMixture

from skillctl.arrays import FloatArray
from skillctl.learning.fit import fit
from skillctl.learning.options import LearnOptions
from skillctl.learning.preprocess import align, training_data
from skillctl.metrics import dtw
from skillctl.model.controller import Controller
from skillctl.model.demonstration import Demonstration, DemonstrationSet

Run = Callable[[Demonstration, bool], FloatArray]  # demonstration, held → path relative to the target
K = 7


def skill_run(motion: DemonstrationSet) -> Run:
    """Learn a skill; run its controller at 200 Hz."""
    skill = fit(motion).skill

    def run(demonstration: Demonstration, held: bool) -> FloatArray:
        controller = Controller(skill, lasa.PERIOD)
        x = demonstration.positions[0] - demonstration.positions[-1] + skill.attractor
        path, steps = [x], int(lasa.HORIZON * demonstration.duration / lasa.PERIOD)
        hold = (
            range(*(int(f * demonstration.duration / lasa.PERIOD) for f in (0.5, 1.0))) if held else range(0)
        )
        for step in range(steps):
            velocity = controller.step(x)
            if step not in hold:  # while held, the hand stays where it is, whatever is commanded
                x = x + lasa.PERIOD * velocity
            path.append(x)
            if np.linalg.norm(x - skill.attractor) < lasa.GOAL:
                break
        return np.array(path) - skill.attractor

    return run


def dmp_run(motion: DemonstrationSet) -> Run:
    """Fit a dynamic movement primitive to the mean demonstration; it runs on a clock."""
    samples = 400
    duration = float(np.mean([d.duration for d in motion]))
    grid = np.linspace(0, 1, samples)
    mean = np.mean([_resampled(d, grid) for d in motion], axis=0)
    primitive = DMP(n_dims=2, execution_time=duration, dt=duration / samples, n_weights_per_dim=30)
    primitive.imitate(np.linspace(0, duration, samples), mean)

    def run(demonstration: Demonstration, held: bool) -> FloatArray:
        primitive.reset()
        start = demonstration.positions[0] - demonstration.positions[-1]
        primitive.configure(start_y=start, goal_y=np.zeros(2))
        if not held:
            return np.asarray(primitive.open_loop()[1])
        y, yd, path = start.copy(), np.zeros(2), [start.copy()]
        for step in range(2 * samples):
            moved, speed = primitive.step(y, yd)
            if not samples // 2 <= step < samples:
                y, yd = moved, speed
            path.append(y.copy())
        return np.array(path)

    return run


def gmr_run(motion: DemonstrationSet) -> Run:
    """Fit a Gaussian mixture to positions and velocities, regress: the same idea without the guarantee."""
    points = np.vstack([np.hstack([d.positions - d.positions[-1], d.velocities])[::10] for d in motion])
    scale = points.std(axis=0)
    mixture = gmr.GMM(n_components=6, random_state=0).from_samples(points / scale)

    def run(demonstration: Demonstration, held: bool) -> FloatArray:
        x = demonstration.positions[0] - demonstration.positions[-1]
        path = [x]
        for _ in range(int(1.5 * demonstration.duration / 0.01)):  # it need not arrive: bounded, 100 Hz
            velocity = mixture.predict(np.arange(2), (x / scale[:2])[None])[0] * scale[2:]
            x = x + 0.01 * velocity
            path.append(x)
            if np.linalg.norm(x) < lasa.GOAL or np.linalg.norm(x) > 1.0:
                break
        return np.array(path)

    return run


def log_likelihoods(motions: dict[str, DemonstrationSet]) -> tuple[float, float]:
    """Return mean log p(ξ, ξ̇) per point of constrained and of unconstrained EM, the same K and units."""
    ours, free = [], []
    for motion in motions.values():
        options = LearnOptions(objective="likelihood", n_components=K)
        ours.append(fit(motion, options).log_likelihood)
        points = np.hstack(training_data(*align(motion), options.effort.samples).points)
        mixture = GaussianMixture(
            K, reg_covar=1e-4, n_init=options.effort.starts, random_state=0, max_iter=200
        )
        free.append(mixture.fit(points).score(points))
    return float(np.mean(ours)), float(np.mean(free))


def _resampled(demonstration: Demonstration, grid: FloatArray) -> FloatArray:
    positions = demonstration.positions - demonstration.positions[-1]
    phase = (demonstration.times - demonstration.times[0]) / demonstration.duration
    return np.stack([np.interp(grid, phase, column) for column in positions.T], axis=1)


def main() -> None:
    """Print the table."""
    warnings.simplefilter("ignore", RuntimeWarning)  # peers overflow where they diverge
    motions = lasa.motions()
    fit(motions["Line"], LearnOptions(preset="fast"))
    print(
        "| learner | DTW mean / median [mm] | arrives [%] "
        "| held: DTW mean [mm] | held: arrives [%] | fit, CPU [s] |"
    )
    print("| --- | --- | --- | --- | --- | --- |")
    for name, learner in (
        ("skillctl", skill_run),
        ("movement_primitives DMP", dmp_run),
        ("gmr, K = 6", gmr_run),
    ):
        cpu, rows = [], []
        for motion in motions.values():
            started = time.process_time()
            run = learner(motion)
            cpu.append(time.process_time() - started)
            for demonstration in motion:
                shown = demonstration.positions - demonstration.positions[-1]
                paths = [run(demonstration, held) for held in (False, True)]
                rows.append(
                    [v for p in paths for v in (1e3 * dtw(p, shown), np.linalg.norm(p[-1]) <= lasa.GOAL)]
                )
        figures = np.array(rows, dtype=float)
        print(
            f"| {name} | {figures[:, 0].mean():.2f} / {np.median(figures[:, 0]):.2f} "
            f"| {100 * figures[:, 1].mean():.0f} "
            f"| {figures[:, 2].mean():.2f} | {100 * figures[:, 3].mean():.0f} | {np.median(cpu):.2f} |",
            flush=True,
        )
    ours, free = log_likelihoods(motions)
    print(
        f"\nlog-likelihood per point, K = {K}: {ours:.2f} with every A_k stable, "
        f"{free:.2f} unconstrained (scikit-learn)"
    )


if __name__ == "__main__":
    main()
