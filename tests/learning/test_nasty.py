"""Demonstrations that are hard to learn from end in a skill that is proved stable."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from skillctl.errors import FitError
from skillctl.learning import solve as solve_module
from skillctl.learning.fit import fit
from skillctl.learning.options import LearnOptions
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.space import Euclidean
from skillctl.stability.certificate import certify

PHASE = np.linspace(0, 1, 60)[:, None]
LEFT = 1 - (10 * PHASE**3 - 15 * PHASE**4 + 6 * PHASE**5)


def reach(start: object, bow: float = 0.0) -> np.ndarray:
    start = np.atleast_1d(np.asarray(start, dtype=float))
    return LEFT * start + bow * np.sin(np.pi * LEFT) * np.roll(start, 1)


WAITING = reach([1, 1], 0.2)
WAITING = np.insert(WAITING, 30, np.tile(WAITING[30], (90, 1)), axis=0)
LOOP = np.hstack([np.sin(2 * np.pi * PHASE), 1 - np.cos(2 * np.pi * PHASE)])


def from_all_sides() -> Iterator[np.ndarray]:
    starts = np.random.default_rng(0).standard_normal((45, 3))
    yield from (reach(start / np.linalg.norm(start), 0.2) for start in starts)


NASTY: dict[str, Callable[[], list[np.ndarray]]] = {
    "from all sides": lambda: list(from_all_sides()),
    "two of three points": lambda: [np.array([[1, y], [0.5, 0.2 + y], [0, 0]]) for y in (0, 0.1)],
    "one of two points": lambda: [np.array([[1.0, 0.0], [0.0, 0.0]])],
    "collinear": lambda: [reach(scale * np.array([1.0, 2.0, 3.0])) for scale in (1, 1.1, 1.2)],
    "collinear along an axis": lambda: [reach([1.0, 0.0])] * 2,
    "one far outlier": lambda: [reach([1, 0.1 * i], 0.1) for i in range(5)] + [reach([1e3, 1e3])],
    "duplicates": lambda: [reach([1, 0.5], 0.2)] * 6,
    "one coordinate": lambda: [reach(1.0 + 0.1 * i) for i in range(3)],
    "one coordinate, overshooting": lambda: [reach(1.0) - 0.5 * np.sin(np.pi * LEFT)],
    "from opposite sides": lambda: [reach([1, 0], 0.1), reach([-1, 0], 0.1)],
    "a pause on the way": lambda: [
        np.insert(reach([1, 1], 0.2), 30, np.tile(reach([1, 1], 0.2)[30], (90, 1)), 0)
    ],
    "a loop back to the start": lambda: [
        np.hstack([np.sin(2 * np.pi * PHASE), 1 - np.cos(2 * np.pi * PHASE)])
    ],
    "noise": lambda: list(np.random.default_rng(1).standard_normal((3, 50, 2))),
    "one jump": lambda: [np.repeat([[1.0, 0.0], [0.0, 0.0]], 50, axis=0)],
    "nanometres": lambda: [1e-9 * reach([1, 1 + 0.1 * i], 0.1) for i in range(3)],
    "millions of kilometres": lambda: [1e9 * reach([1, 1 + 0.1 * i], 0.1) for i in range(3)],
    "ten coordinates of one motion": lambda: [reach(np.arange(1.0, 11.0), 0.2)],
}


@pytest.mark.parametrize("objective", ["reproduction", "likelihood"])
@pytest.mark.parametrize("name", NASTY)
def test_a_nasty_set_ends_in_a_stable_skill(name: str, objective: str) -> None:
    paths = NASTY[name]()
    motions = tuple(Demonstration.from_positions(np.linspace(0, 2, len(path)), path) for path in paths)
    data = DemonstrationSet(motions, Euclidean.cartesian(paths[0].shape[1]))
    skill = fit(data, LearnOptions(preset="fast", objective=objective)).skill
    assert certify(skill).verdict == "stable"


def test_a_search_that_breaks_down_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def singular(*_: object) -> None:
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(solve_module, "initial_mixtures", singular)
    motion = Demonstration.from_positions(np.linspace(0, 2, 60), reach([1, 1]))
    with pytest.raises(FitError, match="a matrix became singular"):
        fit(DemonstrationSet((motion,), Euclidean.cartesian(2)))
