"""Skills of every dimension and kind, with demonstrations, and what figures are asked about."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from skillctl.model.combined import CombinedSkill
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.merged import MergedSkill
from skillctl.model.space import Euclidean
from skillctl.plotting.portrait import Portrait, portrait_of


def shown_to(skill: Any, count: int = 3, reach: float = 0.2) -> DemonstrationSet:
    """Return demonstrations of straight motions to the skill's first attractor, slower towards its end."""
    goal, d = skill.leaves[0].attractor, skill.dimension
    rng = np.random.default_rng(count)
    s = np.linspace(0, 1, 60)[:, None]
    eased = s * (2 - s)
    starts = goal + rng.uniform(0.5, 1, (count, d)) * reach * rng.choice([-1, 1], (count, d))
    members = [
        Demonstration.from_positions(2 * s[:, 0], x + (goal - x) * eased, f"demo-{i}.csv")
        for i, x in enumerate(starts)
    ]
    return DemonstrationSet(tuple(members), skill.space)


@pytest.fixture(scope="session")
def show_to() -> Callable[..., DemonstrationSet]:
    """Return a maker of demonstrations for a skill."""
    return shown_to


@pytest.fixture(scope="session", autouse=True)
def _coarse_grids() -> Iterator[None]:
    """Draw fewer points and streamlines than users get: the same artists in a third of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("skillctl.plotting.panels.REGION_GRID", 80)
        patch.setattr("skillctl.plotting.flow.DENSITY", 0.5)
        patch.setattr("skillctl.plotting.flow.DENSITY_OF_SMALL", 0.3)
        patch.setattr("skillctl.plotting.proof.FINENESS", {2: 61, 3: 21})
        yield


@pytest.fixture(scope="session")
def portrait(make_skill: Callable[..., Any]) -> Callable[..., Portrait]:
    """Return a maker of portraits: of one learned skill, or of a combined one of two."""

    @cache
    def make(
        dimension: int = 2,
        *,
        kind: str = "learned",
        gate: str = "latched",
        demonstrations: bool = True,
        unit: str = "m",
        reach: float = 0.2,
        name: str = "skill",
    ) -> Portrait:
        rng = np.random.default_rng(7)
        space = Euclidean(Euclidean.cartesian(dimension).names, unit=unit)
        goals = np.full(dimension, 0.02), np.full(dimension, 0.5 if kind == "combined" else 0.02)
        p = (
            np.eye(dimension)
            + 0.5 * np.diag(np.ones(dimension - 1), 1)
            + 0.5 * np.diag(np.ones(dimension - 1), -1)
        )
        one, other = (
            replace(make_skill(rng, dimension=dimension, lyapunov=p, attractor=g), space=space) for g in goals
        )
        halves = np.array([0.5, 0.5])
        skill = one
        if kind == "combined":
            skill = CombinedSkill((one, other), halves, gate=gate)
        elif kind == "merged":
            skill = MergedSkill((one, other), halves)
        taught = [shown_to(leaf, reach=reach) if demonstrations else None for leaf in skill.leaves]
        return portrait_of(name, skill, taught)

    return make


def texts_of(figure: Any) -> list[str]:
    """Return all that is written in a figure."""
    from matplotlib.text import Text

    return [text.get_text() for text in figure.findobj(Text) if text.get_text()]


@pytest.fixture(scope="session")
def texts() -> Callable[[Any], list[str]]:
    """Return a function that returns all that is written in a figure."""
    return texts_of


@pytest.fixture(scope="session")
def lines() -> Callable[[Any, str], list[Any]]:
    """Return a function that returns the lines of a figure's axes that have a colour and no markers."""

    def drawn(axes: Any, colour: str) -> list[Any]:
        return [
            line for line in axes.get_lines() if line.get_color() == colour and line.get_linestyle() != "None"
        ]

    return drawn
