"""Weights of a merged skill for one target among known things, chosen when both are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from skillctl.adapt.blends import Blends
from skillctl.adapt.clauses import Target
from skillctl.adapt.judge import ARRIVED, RESOLVED, Judge
from skillctl.adapt.keep_out import KeepOutBox
from skillctl.adapt.task_file import Start, Task
from skillctl.arrays import FloatArray
from skillctl.compose.merge import with_weights
from skillctl.errors import UsageError
from skillctl.model.coordinates.bodies import Box
from skillctl.model.gates import gate_parameters, merge_gate
from skillctl.model.merged import MergedSkill
from skillctl.model.retarget import retargeted
from skillctl.model.skill import Skill
from skillctl.simulation.arm import ArmBody
from skillctl.simulation.avoid import avoidance
from skillctl.simulation.ik import Kinematics
from skillctl.simulation.placement import placements
from skillctl.simulation.prepare import arm_of, start_of
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.scene import cup_middle

GRIDS = {2: 20, 3: 10, 4: 6}  # number of parts → into how many steps a weight is divided
FINER = (1 / 20, 1 / 40)  # weights that are moved from one part to another, round by round
STEP = 0.02  # [s], of motions that are followed
LONGEST = 30.0  # [s]
TOLERANCE = 0.005  # [m]


def adapted(skill: Skill, scenario: Scenario) -> Skill:
    """Return a merged skill with the weights that suit one episode: its target, its start and its scene.

    All weights on a grid over the simplex, and then ever finer ones around the best, are followed at once.
    The best keep farthest from what the hand must not touch, which is grown by the hand (see
    ``simulation.avoid``); of equal ones those that the skill has. What is proved of a merged skill holds for
    all weights, so nothing has to be proved again. Of the rest of the arm nothing is known.

    Args:
        skill: A merged skill in three dimensions.
        scenario: Of the episode, drawn.

    Raises:
        UsageError: A skill of another kind, or with more parts than weights can be tried for.
    """
    weighing = Weighing.of(skill, scenario)
    return with_weights(weighing.skill, weighing.chosen())


def require_merged(skill: Skill) -> None:
    """Raise UsageError unless it is a merged skill whose weights can be chosen."""
    if not isinstance(skill, MergedSkill):
        raise UsageError(
            f"adapt: chooses the weights of a merged skill; this is a {skill.kind} one.",
            hint="Merge the skills that it may be made of, as in `skillctl merge a b c --name all`.",
        )
    if len(skill.parts) not in GRIDS:
        raise UsageError(
            f"adapt: chooses weights of {min(GRIDS)} to {max(GRIDS)} parts, not of {len(skill.parts)}.",
            hint="Merge fewer skills.",
        )
    if skill.space.dimension != 3 or skill.space.unit != "m":
        raise UsageError(
            "adapt: chooses the weights of skills that move a hand's position in three dimensions."
        )
    if dict(skill.parameters) != gate_parameters(merge_gate(skill.gate), {}):
        raise UsageError(
            f"adapt: searches with the defaults of the {skill.gate} gate, which this skill does not have."
        )


@dataclass(frozen=True, eq=False)
class Weighing:
    """What the weights of a merged skill are judged by, for one episode.

    Attributes:
        skill: The merged skill.
        judge: Target, start and bodies.
        blends: Its parts, moved to the target.
    """

    skill: MergedSkill
    judge: Judge
    blends: Blends

    @classmethod
    def of(cls, skill: Skill, scenario: Scenario) -> Weighing:
        """Return how the weights of a merged skill are judged in a scenario, that of one episode."""
        require_merged(skill)
        assert isinstance(skill, MergedSkill)
        model, yaw = arm_of(scenario), scenario.base_yaw or 0.0
        placement = placements(skill, model, scenario)[0]
        target = skill.attractor if scenario.target is None else np.array(scenario.target)
        if scenario.target == "cup":
            target = placement.to_state(cup_middle(scenario))
        with ArmBody(model, yaw, shapes="none") as body:
            kinematics = Kinematics(body, scenario.hand or "horizontal", yaw)
            place = start_of(placement, kinematics, scenario)
            start = placement.to_state(kinematics.forward(kinematics.home) if place is None else place)
            avoid = avoidance(scenario.changed(avoid=True), placement, kinematics)
            bodies = [] if avoid is None else avoid.bodies(placement.to_workspace(target))
        boxes = [
            KeepOutBox(
                kind="box",
                name=f"{number} {body.name}",
                centre=tuple(np.subtract(body.centre, placement.origin).tolist()),
                size=body.size,
                turn=body.turn,
            )
            for number, body in enumerate(bodies)
            if isinstance(body, Box)
        ]
        task = Task(
            target=Target(position=tuple(target.tolist()), tolerance=TOLERANCE),
            start=Start(points=(tuple(start.tolist()),)),
            keep_out=[box for box in boxes if float(box.distances(target)) > 0],  # others cannot be helped
        )
        parts = [retargeted(part, target) for part in skill.parts]
        return cls(skill, Judge.of(task, skill, start[None]), Blends(parts))

    def chosen(self) -> FloatArray:
        """Return the weights that suit best, zero or more, summing to one. Shape (N,)."""
        best = self.best([self.skill.shares, *grid(len(self.skill.parts))])
        for finer in FINER:
            best = self.best([best, *_neighbours(best, finer)])
        return best

    def margins(self, tried: Sequence[FloatArray]) -> dict[str, FloatArray]:
        """Return the margin of every clause for weights (N,) each, by its name. Shape (number tried, 1)."""
        mixed = [self.blends.plain(weights) for weights in tried]
        step = min(STEP, RESOLVED * float(self.blends.periods.min()))
        near = ARRIVED * TOLERANCE
        moved = self.blends.follow(
            mixed, self.skill.gate, self.judge.starts, step, round(LONGEST / step), near
        )
        periods = np.array([self.blends.period(blend) for blend in mixed])
        return self.judge.margins(moved, np.full(moved.shape[:2], step), periods)

    def best(self, tried: Sequence[FloatArray]) -> FloatArray:
        """Return those weights whose motion keeps farthest from everything; the first of equals."""
        return tried[int(self.judge.scores(self.margins(tried)).argmax())]


def grid(count: int) -> list[FloatArray]:
    """Return weights of ``count`` parts on a grid over the simplex, equal ones first."""
    steps = GRIDS[count]
    splits = product(range(steps + 1), repeat=count)
    return [np.full(count, 1 / count), *(np.array(split) / steps for split in splits if sum(split) == steps)]


def _neighbours(weights: FloatArray, moved: float) -> list[FloatArray]:
    """Return weights with a little moved from one part to another."""
    found = []
    for giver, taker in product(range(len(weights)), repeat=2):
        if giver != taker and weights[giver] > 0:
            other = weights.copy()
            other[giver] = max(weights[giver] - moved, 0.0)
            other[taker] += weights[giver] - other[giver]
            found.append(other)
    return found
