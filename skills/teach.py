"""Write the demonstrations of this directory again; they come from a seeded generator, not from a person."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from skillctl.demonstrations.reaching import TASKS, reaching_demonstrations
from skillctl.demonstrations.writing import DECIMALS, write_csv
from skillctl.geometry import arc_lengths
from skillctl.model.demonstration import Demonstration
from skillctl.model.pose import Pose

STARTS = ((0.385, 0.44), (-0.20, 0.20), (0.50, 0.58))  # x, y, z: low in front of the shelf, hand level [m]
COUNT = 10  # demonstrations of each task
HOME = ((0.39, 0.41), (-0.01, 0.01), (0.54, 0.56))  # where hands start that carry a cup [m]
EACH = 4  # demonstrations of these for each place on a board
LIFT, LIFTED, LEFT = (
    0.035,
    0.06,
    0.10,
)  # [m]: how high a cup is carried, from how far before its place, after home


def eased(t: np.ndarray) -> np.ndarray:
    """Return the position at a share of the time of a minimum-jerk motion from 0 to 1."""
    t = np.clip(t, 0.0, 1.0)
    return np.asarray(t * t * t * (10.0 + t * (6.0 * t - 15.0)))


def straight(demonstration: Demonstration) -> Demonstration:
    """Return a reach with the same start, end and duration, straight and with minimum jerk."""
    ends, times = demonstration.positions[[0, -1]], demonstration.times
    share = eased(times / times[-1])
    positions = np.round(ends[0] + share[:, None] * (ends[1] - ends[0]), DECIMALS)
    return Demonstration.from_positions(times, positions, demonstration.source)


def over(demonstration: Demonstration) -> Demonstration:
    """Return a reach that comes down upon its end, as a hand does that sets a cup down."""
    way = arc_lengths(demonstration.positions)
    positions = demonstration.positions.copy()
    positions[:, 2] += LIFT * eased((way[-1] - way) / LIFTED) * eased(way / LEFT)
    return Demonstration.from_positions(
        demonstration.times, np.round(positions, DECIMALS), demonstration.source
    )


def main() -> None:
    """Write one directory of demonstrations for each task."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("directory", type=Path)
    folder = parser.parse_args().directory
    reaches: dict[str, Iterable[Demonstration]] = {
        task: list(reaching_demonstrations(task, COUNT, starts=STARTS)) for task in TASKS
    }
    reaches["straight"] = [straight(reach) for reach in reaches["top-centre"]]
    for height in ("bottom", "top"):
        places = [f"{height}-{side}" for side in ("left", "centre", "right")]
        reaches[f"{height}-over"] = [
            over(reach) for place in places for reach in reaching_demonstrations(place, EACH, starts=HOME)
        ]
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
