"""Write the demonstrations of this directory again; they come from a seeded generator, not from a person."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from skillctl.demonstrations.reaching import TASKS, reaching_demonstrations
from skillctl.demonstrations.writing import DECIMALS, write_csv
from skillctl.model.demonstration import Demonstration
from skillctl.model.pose import Pose

STARTS = ((0.385, 0.44), (-0.20, 0.20), (0.50, 0.58))  # x, y, z: low in front of the shelf, hand level [m]
COUNT = 10  # demonstrations of each task


def straight(demonstration: Demonstration) -> Demonstration:
    """Return a reach with the same start, end and duration, straight and with minimum jerk."""
    ends, times = demonstration.positions[[0, -1]], demonstration.times
    t = times / times[-1]
    share = t * t * t * (10.0 + t * (6.0 * t - 15.0))
    positions = np.round(ends[0] + share[:, None] * (ends[1] - ends[0]), DECIMALS)
    return Demonstration.from_positions(times, positions, demonstration.source)


def main() -> None:
    """Write one directory of demonstrations for each task."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("directory", type=Path)
    folder = parser.parse_args().directory
    reaches: dict[str, Iterable[Demonstration]] = {
        task: list(reaching_demonstrations(task, COUNT, starts=STARTS)) for task in TASKS
    }
    reaches["straight"] = [straight(reach) for reach in reaches["top-centre"]]
    poses = {
        f"{task}-turned": reaching_demonstrations(task, COUNT, starts=STARTS, turned=True) for task in TASKS
    }
    for task, demonstrations in {**reaches, **poses}.items():
        (folder / task).mkdir(parents=True, exist_ok=True)
        space = Pose() if task in poses else None
        for number, demonstration in enumerate(demonstrations, start=1):
            write_csv(demonstration, folder / task / f"{number}.csv", space)


if __name__ == "__main__":
    main()
