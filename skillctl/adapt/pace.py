"""As fast as people: the speed of a merger, by how long demonstrated motions take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from skillctl.adapt.follow import SAFE
from skillctl.arrays import FloatArray
from skillctl.compose.parts import normalised
from skillctl.learning.options import LearnOptions
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.merged import MergedSkill
from skillctl.model.rollout import Rollouts, rollout
from skillctl.model.skill import Skill, contraction_period

PERIOD = LearnOptions().period  # [s] of a controller; the result keeps it if its parts do
PATIENCE = 5  # a motion is followed for this many durations of the longest demonstration
NEAR = 0.02  # of the way to its end: nearer than that a motion is as good as done
ROUNDS = 9  # at most, for motions that take much longer or shorter than was shown
STEPS = (200, 2000)  # per demonstration duration: at least as fine, and at most as fine, as this


@dataclass(frozen=True, eq=False, slots=True)
class Paced:
    """A merger with a speed that was chosen.

    Attributes:
        skill: The merger.
        late: How many times as long as demonstrated its motions take; 1 unless the period limits its speed.
    """

    skill: MergedSkill
    late: float


def paced(
    skill: MergedSkill,
    shown: Sequence[DemonstrationSet],
    shares: Sequence[float] | None = None,
    *,
    period: float = PERIOD,
) -> Paced:
    """Return a merger at the speed at which its motions near the target as soon as demonstrated ones do.

    Weights decide the way and ``speed`` the time: the path does not depend on it. Velocities that are
    averaged or that miss the demonstrated directions fit best when they are too small, and of two parts that
    move at different speeds the faster one decides how fast the mixture is; so neither says how long a motion
    takes. Here, the median time from the starts of a set, averaged over the sets, is as long as was shown.
    What it does not show: how long motions from other starts take, or from those of one set of several.

    Args:
        skill: A merger.
        shown: Sets of demonstrations, of one task or of each part; each counts relative to its own end.
        shares: How much each set counts, up to a common factor; equally by default.
        period: Of controllers, [s]: the merger contracts at it, or at that of its parts if that is less.
    """
    weights = normalised("shares", shares, len(shown))
    for _ in range(ROUNDS):
        ratio = _ratio(skill, shown, weights)
        skill = replace(skill, speed=skill.speed * max(ratio, 1 / PATIENCE))
        if 1 / PATIENCE < ratio < PATIENCE / 2:  # its motions were followed to their ends, in enough steps
            break
    return _within(skill, period)


def _ratio(skill: MergedSkill, shown: Sequence[DemonstrationSet], weights: FloatArray) -> float:
    """Return how many times as long as demonstrated motions take: medians over each set, averaged."""
    size, longest = skill.space.positions, max(motion.duration for motions in shown for motion in motions)
    goal = skill.attractor[:size]
    taken, wanted = [], []
    for motions in shown:
        states = paths_to(motions, skill.attractor)
        found = motions_from(skill, states, longest)
        paths = [path[:, :size] for path in states]
        nears = [NEAR * float(np.linalg.norm(path - goal, axis=1).max()) for path in paths]
        moved = [found.trajectory(i) for i in range(len(paths))]
        own = [time_to_near(t, x[:, :size], goal, near) for (t, x), near in zip(moved, nears, strict=True)]
        asked = [
            time_to_near(motion.times - motion.times[0], path, goal, near)
            for motion, path, near in zip(motions, paths, nears, strict=True)
        ]
        taken.append(float(np.median(own)))
        wanted.append(float(np.median(asked)))
    return float((weights @ taken) / (weights @ wanted))


def _within(merged: MergedSkill, period: float) -> Paced:
    """Return the merger, slowed down if it does not contract at the period at which its parts do."""
    own = float(min(contraction_period(part) for part in merged.parts))
    fastest = SAFE * own / min(period, own)
    return Paced(replace(merged, speed=min(merged.speed, fastest)), max(1.0, merged.speed / fastest))


def slowed(merged: MergedSkill, period: float = PERIOD) -> MergedSkill:
    """Return the merger, slowed down if it does not contract at a controller period at which its parts do."""
    return _within(merged, period).skill


def time_to_near(times: FloatArray, path: FloatArray, goal: FloatArray, near: float) -> float:
    """Return when a path (n, d) is nearer than ``near`` to the goal for good, or ends, [s]."""
    outside = np.flatnonzero(np.linalg.norm(path - goal, axis=1) > near)
    return float(times[min(outside[-1] + 1, len(times) - 1)]) if outside.size else 0.0


def paths_to(motions: DemonstrationSet, goal: FloatArray) -> list[FloatArray]:
    """Return the states (n, d) of each demonstration, moved so that it ends at the goal (d,)."""
    return [motions.space.carried(motion.positions, motion.positions[-1], goal) for motion in motions]


def motions_from(skill: Skill, paths: Sequence[FloatArray], longest: float) -> Rollouts:
    """Return the motions of a skill from where paths begin; a step longer than proved may diverge."""
    stable = 0.5 * contraction_period(skill)
    period = float(np.clip(stable, longest / STEPS[1], longest / STEPS[0]))
    with np.errstate(over="ignore", invalid="ignore"):
        return rollout(skill, np.stack([p[0] for p in paths]), duration=PATIENCE * longest, period=period)
