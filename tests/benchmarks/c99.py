"""What a step in C takes, kind by kind: ``python tests/benchmarks/c99.py``; needs cc.

Motions from where demonstrations began, without a limit and with half their fastest speed as one. Since no
stored skill has shears, one of them is stepped in six random shears, too; its motions mean nothing.
"""

from __future__ import annotations

import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from skillctl.codegen.text import constant
from skillctl.model.coordinates.chain import Chain
from skillctl.model.coordinates.shears import Shears
from skillctl.model.seds import SedsSkill
from skillctl.store.source import open_skill
from skillctl.usecases.c99 import exported_c99

SKILLS = Path(__file__).parent.parent.parent / "skills"
NAMES = ("bottom-left", "top-left", "places", "bottom-left-turned", "top-left-turned", "shelf-turned")
PROGRAM = """
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "skill.h"
#include "starts.h"
int main(int count, char **arguments)
{
    const int starts_count = (int)(sizeof starts / sizeof starts[0]), steps = 2000;
    double state[SKILL_DIMENSION], command[SKILL_DIMENSION], best = HUGE_VAL;
    skill_controller c;
    clock_t begun;
    int repeat, start, step, i;
    for (repeat = 0; repeat < 7; ++repeat) {
        begun = clock();
        for (start = 0; start < starts_count; ++start) {
            skill_begin_unproved(&c, 0.001);
            c.max_speed = count > 1 ? atof(arguments[1]) : HUGE_VAL;
            for (i = 0; i < SKILL_DIMENSION; ++i) c.next[i] = starts[start][i];
            for (step = 0; step < steps; ++step) {
                for (i = 0; i < SKILL_DIMENSION; ++i) state[i] = c.next[i];
                skill_step(&c, state, command);
            }
        }
        best = fmin(best, (double)(clock() - begun));
    }
    printf("%.0f", 1e9 * best / CLOCKS_PER_SEC / starts_count / steps);
    return 0;
}
"""


def main() -> None:
    """Print the table of the page on C."""
    print("| skill | components | ns a step | with a limit |\n| --- | --- | --- | --- |")
    for name in NAMES:
        source = open_skill(SKILLS / name / "1.h5")
        taught = source.artifact.taught
        starts = np.stack([motion.positions[0] for motion in taught])
        limit = 0.5 * max(float(source.skill.space.magnitudes(each.velocities)[0].max()) for each in taught)
        kinds = {name: source.skill}
        if name == "bottom-left":
            kinds[f"{name}, in six shears"] = source.skill.with_leaves(in_shears)
        for kind, skill in kinds.items():
            columns = [kind, str(skill.n_components), *measured(exported_c99(skill, name), starts, limit)]
            print(f"| {' | '.join(columns)} |", flush=True)


def in_shears(leaf: SedsSkill) -> SedsSkill:
    """Return a skill in six random shears."""
    rng = np.random.default_rng(0)
    bumps = 0.01 * rng.standard_normal((6, 11, 3))
    shears = Shears(np.eye(3), rng.standard_normal((6, 3)), np.full(6, -0.5), np.full(6, 0.1), bumps)
    return replace(leaf, coordinates=Chain((shears,)))


def measured(header: str, starts: np.ndarray, limit: float) -> list[str]:
    """Return ns a step without and with a limit [m/s], the best of seven repeats."""
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        (place / "skill.h").write_text(header)
        (place / "starts.h").write_text(constant("double", "starts", starts))
        (place / "main.c").write_text(PROGRAM)
        subprocess.run(["cc", "-std=c99", "-O2", "main.c", "-o", "main", "-lm"], cwd=place, check=True)
        runs = [["./main"], ["./main", str(limit)]]
        return [subprocess.run(r, cwd=place, capture_output=True, text=True, check=True).stdout for r in runs]


if __name__ == "__main__":
    main()
