"""Print the fixed weights that suit most scenes, to compare with weights that are chosen for each.

    python fixed.py all.h5 scenarios/clutter.toml

The scenes are drawn from another seed than the scenario's. A weighting suits a scene if the hand, on its
ideal motion, keeps out of everything that it must not touch. Nothing is simulated.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from skillctl.adapt.per_target import Weighing, grid
from skillctl.simulation.draws import drawn
from skillctl.simulation.scenario_file import read_scenario
from skillctl.store import read_skill

SEED, SCENES = 1, 200


def main(artifact: Path, scenario: Path) -> None:
    """Print the best weights and their share of scenes, and the share of weights chosen for each scene."""
    skill, batch = read_skill(artifact).skill, read_scenario(scenario).changed(seed=SEED)
    tried = grid(len(skill.parts))
    suits = np.zeros((SCENES, len(tried)), dtype=bool)
    for number in range(SCENES):
        scene = drawn(batch, number, np.zeros((0, 3)), skill.space)
        margins = Weighing.of(skill, scene).margins(tried)
        suits[number] = np.min([values.min(axis=1) for values in margins.values()], axis=0) >= 0
    best = int(suits.mean(axis=0).argmax())
    weights = ",".join(f"{weight:g}" for weight in tried[best])
    some = suits.any(axis=1).mean()
    print(f"{weights}: {suits[:, best].mean():.0%} of {SCENES} scenes; chosen for each: {some:.0%}")
    for part, weight in enumerate(np.eye(len(skill.parts)), start=1):
        alone = next(i for i, other in enumerate(tried) if (other == weight).all())
        print(f"part {part} alone: {suits[:, alone].mean():.0%}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
