"""What many skills cost: verified, learned and simulated, with one worker and with several.

    python tests/benchmarks/scale.py                     # 1,000 skills, 100 learned, 1,000 episodes
    python tests/benchmarks/scale.py --workers 1,2,dask  # also a Dask cluster of two workers

CPU is that of this process and all it started; wall time says something only where nothing else runs. Whoever
does the work, the results are compared, to the byte, with those of the first row.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import resource
import shutil
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import numpy as np

from skillctl.demonstrations.reaching import reaching_demonstrations
from skillctl.learning.fit import fit
from skillctl.learning.options import LearnOptions
from skillctl.simulation.scenario import Scenario
from skillctl.usecases.files import save
from skillctl.usecases.learn_many import learn_many
from skillctl.usecases.simulate_many import simulate_many
from skillctl.usecases.verify_stability import verify_stability
from skillctl.workers import Workers

DEMONSTRATIONS = 3  # of each skill that is learned
PLACES = ("top-centre", "bottom-left", "bottom-right")


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--skills", type=int, default=1000, help="skills to verify")
    parser.add_argument("--learned", type=int, default=100, help="skills to learn, with the preset fast")
    parser.add_argument("--episodes", type=int, default=1000, help="episodes to simulate")
    parser.add_argument("--workers", default="1,2", help="numbers of processes, and dask")
    chosen = parser.parse_args()
    load = f"{os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    print(
        f"load before: {load}\n\n| what | workers | CPU [s] | wall [s] | per item, CPU [ms] | same results |"
    )
    print("| --- | --- | --- | --- | --- | --- |", flush=True)
    with tempfile.TemporaryDirectory() as scratch:
        os.chdir(scratch)
        _write_skills(chosen.skills)
        _write_demonstrations(chosen.learned)
        for what, count, task in (
            ("skills verified", chosen.skills, _verified),
            ("skills learned", chosen.learned, _learned),
            ("episodes simulated", chosen.episodes, partial(_simulated, chosen.episodes)),
        ):
            _rows(what, count, task, tuple(chosen.workers.split(",")) if count else ())


def _rows(what: str, count: int, task: Callable[[Workers], str], names: tuple[str, ...]) -> None:
    first = ""
    for name in names:
        with ExitStack() as stack:
            cpu, began = _cpu(), time.perf_counter()
            workers = Workers(scheduler=_cluster(stack)) if name == "dask" else Workers(int(name))
            digest = task(workers)
            wall = time.perf_counter() - began
        cpu, first = _cpu() - cpu, first or digest  # the time of children counts once they have ended
        same = "yes" if digest == first else "NO"
        print(
            f"| {count:,} {what} | {name} | {cpu:.1f} | {wall:.1f} | {1e3 * cpu / count:.1f} | {same} |",
            flush=True,
        )


def _cluster(stack: ExitStack) -> str:
    from distributed import LocalCluster

    cluster = LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0")
    return str(stack.enter_context(cluster).scheduler_address)


def _cpu() -> float:
    """Return the CPU time of this process and of its children that have ended, [s]."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def _write_skills(count: int) -> None:
    """Write skills that differ: one that was learned, moved elsewhere."""
    skill = fit(reaching_demonstrations("top-centre"), LearnOptions(preset="fast")).skill
    rng = np.random.default_rng(0)
    Path("verify").mkdir()
    for number in range(count):
        save(skill.translated(rng.uniform(-0.1, 0.1, 3)), f"verify/{number:04}.h5")
    save(skill, "reach.h5")


def _write_demonstrations(count: int) -> None:
    """Write a manifest and its data: reaches that differ from skill to skill."""
    lines = ["[options]", "preset = 'fast'"]
    for number in range(count):
        reaches = reaching_demonstrations(PLACES[number % len(PLACES)], DEMONSTRATIONS, seed=number)
        for index, each in enumerate(reaches):
            table = np.column_stack([each.times, each.positions])
            file = f"d{number:04}-{index}.csv"
            np.savetxt(file, table, delimiter=",", header="t,x,y,z", comments="", fmt="%.6f")
        lines += ["[[skills]]", f"name = 's{number:04}'", f"data = 'd{number:04}-*.csv'"]
    Path("many.toml").write_text("\n".join(lines) + "\n")


def _verified(workers: Workers) -> str:
    report = verify_stability(sorted(Path("verify").iterdir()), workers=workers)
    assert {verdict.outcome for verdict in report.skills} == {"proved"}
    return _digest(repr(report).encode())


def _learned(workers: Workers) -> str:
    shutil.rmtree("skills", ignore_errors=True)
    Path("skills").mkdir()
    report = learn_many("many.toml", workers=workers)
    assert report.failed == 0, [each.error for each in report.skills]
    return _digest(b"".join(path.read_bytes() for path in sorted(Path("skills").glob("*/*.h5"))))


def _simulated(episodes: int, workers: Workers) -> str:
    scenario = Scenario(episodes=episodes, seed=1)
    simulate_many("reach.h5", scenario, workers=workers, min_success=0, table=Path("rows.csv"))
    return _digest(Path("rows.csv").read_bytes())


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


if __name__ == "__main__":
    main()
