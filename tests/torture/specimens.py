"""Real artifacts of every kind, made by learning, merging and combining short motions."""

from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from skillctl import store
from skillctl.compose.options import CombineOptions, MergeOptions
from skillctl.learning.options import LearnOptions
from skillctl.model.chained import ChainedSkill
from skillctl.usecases.combine import combine
from skillctl.usecases.files import save
from skillctl.usecases.learn import learn
from skillctl.usecases.merge import merge

FAST = LearnOptions(preset="fast", metric="euclidean", n_components=3)


def write_motion(
    path: Path, start: tuple[float, ...], bend: tuple[float, ...], end: tuple[float, ...]
) -> Path:
    """Write a motion of 31 points from start to end, bent aside in between."""
    rows = ["t," + ",".join("xyz"[: len(start)])]
    for i in range(31):
        s = i / 30
        eased = s**3 * (10 - 15 * s + 6 * s * s)
        aside = math.sin(math.pi * eased)
        point = (a + (c - a) * eased + b * aside for a, b, c in zip(start, bend, end, strict=True))
        rows.append(",".join(f"{value:.6f}" for value in (2 * s, *point)))
    path.write_text("\n".join(rows) + "\n", encoding="ascii")
    return path


def learned(
    folder: Path, name: str, start: tuple[float, ...], bend: tuple[float, ...], end: tuple[float, ...]
):
    files = [
        write_motion(folder / f"{name}-{i}.csv", (start[0] + i / 50, *start[1:]), bend, end) for i in range(2)
    ]
    path = folder / f"{name}.h5"
    learn(files, output=path, options=FAST)
    return path


def bare(path: Path) -> Path:
    """The same skill in a file that keeps no demonstrations."""
    whole = store.read_skill(path)
    none = replace(whole, demonstrations=(None,) * len(whole.skill.leaves), reports=())
    store.write_file(target := path.with_name(f"bare-{path.name}"), store.encode(none))
    return target


def make(folder: Path) -> dict[str, bytes]:
    """Return the bytes of every specimen by what it is; files are left in ``folder``."""
    a = learned(folder, "a", (0.2, 0.1), (0.0, 0.06), (0.0, 0.0))
    b = learned(folder, "b", (-0.1, -0.2), (0.08, 0.0), (0.1, 0.05))
    c = learned(folder, "c", (0.3, -0.2), (0.0, -0.05), (0.2, 0.1))
    space = learned(folder, "space", (0.4, 0.0, 0.5), (0.0, 0.05, 0.08), (0.6, 0.1, 0.5))
    made = {"seds 2-D": a, "seds 3-D": space, "seds bare": bare(a)}

    def merged(what: str, parts: list[Path], **options) -> Path:
        path = folder / f"{what.replace(' ', '-')}.h5"
        merge(parts, output=path, options=MergeOptions(**options))
        made[what] = path
        return path

    def combined(what: str, parts: list[Path], **options) -> None:
        path = folder / f"{what.replace(' ', '-')}.h5"
        combine(parts, output=path, options=CombineOptions(**options))
        made[what] = path

    both = merged("merged superposition", [a, b], part_weights=(0.3, 0.7), target=(0.05, 0.0))
    merged("merged density", [a, b, c], gate="density", speed=1.5)
    merged("merged experts", [a, c], gate="experts", parameters={"sharpness": 2.0})
    nested = merged("merged of merged", [both, bare(c)], gate="density")
    combined("combined latched", [a, b])
    combined("combined latched aligned", [a, b, c], align=True, target=(0.0, 0.1))
    combined("combined instantaneous", [a, b], gate="instantaneous")
    combined("combined instantaneous aligned", [a, b], gate="instantaneous", align=True)
    combined("combined of merged", [nested, b], part_priors=(0.25, 0.75))
    chain = ChainedSkill(
        tuple(
            store.read_skill(made[what]).skill for what in ("seds 2-D", "combined latched", "merged density")
        ),
        np.array([1e-5, 1e-4, 1e-3]),
        (("close", "wait 0.5"), (), ("open",)),
    )
    made["chain"] = save(chain, folder / "chain.h5")
    archive = Path(__file__).parents[1] / "archives" / "v1"
    made["format 1 combined"] = archive / "combined-by-command.h5"
    made["format 1 experts"] = archive / "merged.h5"
    return {what: path.read_bytes() for what, path in made.items()}


def make_anywhere() -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        return make(Path(folder))
