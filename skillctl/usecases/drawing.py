"""What the episodes of a batch are drawn from, as far as the skill's file says it."""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.simulation import Scenario
from skillctl.simulation.draws import drawn, with_defaults
from skillctl.usecases.files import Source


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


def episode_of(source: Source, scenario: Scenario, episode: int) -> Scenario:
    """Return what episode ``episode`` of a batch runs."""
    batch, starts = batch_of(source, scenario)
    return drawn(batch, episode, starts)
