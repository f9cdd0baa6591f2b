"""Where runs begin and what episodes are drawn from, as far as the skill's file says it."""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.simulation.draws import drawn, with_defaults
from skillctl.simulation.scenario import Scenario
from skillctl.store.source import Source


def demonstration_starts(source: Source) -> FloatArray:
    """Return where the demonstrations that a skill carries start, in its own coordinates. Shape (n, d)."""
    starts = [motion.positions[0] for taught in source.artifact.demonstrations if taught for motion in taught]
    return np.array(starts).reshape(len(starts), source.skill.dimension)


def batch_of(source: Source, scenario: Scenario) -> tuple[Scenario, FloatArray]:
    """Return a scenario that says what is drawn, and the starts that it may draw from, (n, d)."""
    reaches = [
        float(np.linalg.norm(motion.positions[-1] - motion.positions[0]))
        for taught in source.artifact.demonstrations
        if taught
        for motion in taught
    ]
    starts = demonstration_starts(source)
    return with_defaults(scenario, starts, min(reaches, default=0.0)), starts


def chosen(source: Source, scenario: Scenario, *, demo: int | None, episode: int | None) -> Scenario:
    """Return the scenario of one run: begun where a demonstration was, or as an episode of a batch."""
    if demo is not None:
        scenario = scenario.changed(start=_start_of(demo, source, scenario))
    if episode is None:
        return scenario
    batch, starts = batch_of(source, scenario)
    return drawn(batch, episode, starts)


def _start_of(demo: int, source: Source, scenario: Scenario) -> tuple[float, ...]:
    """Return where an embedded demonstration starts, moved as the target is."""
    if scenario.start is not None:
        raise UsageError("start: given twice, by --start and by --demo.", hint="Leave one of them out.")
    starts = demonstration_starts(source)
    if not 0 <= demo < len(starts):
        raise UsageError(
            f"demonstration {demo} does not exist; {source.name} carries {len(starts)}, counted from 0.",
            hint="`skillctl inspect` lists them; --start gives a start in numbers.",
        )
    start = starts[demo]
    target = scenario.target
    if target is not None and target != "cup" and len(target) == len(start):
        start = start + (target - source.skill.attractors[0])
    return tuple(start.tolist())
