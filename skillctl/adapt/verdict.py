"""What holds of a skill for a task: clauses measured on whole motions, and proved where that is possible."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from skillctl.adapt.clauses import Clause, PeriodLimit, StayIn, Target, TimeLimit
from skillctl.adapt.judge import Judge
from skillctl.adapt.keep_out import KeepOutClause
from skillctl.adapt.report import ClauseVerdict, TaskVerdict
from skillctl.adapt.task_file import Task
from skillctl.arrays import FloatArray
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.retarget import retargeted
from skillctl.model.skill import Skill
from skillctl.simulation.tally import wilson_interval
from skillctl.stability.reach import Reach, bound_reach
from skillctl.stability.report import Certificate
from skillctl.stability.sublevels import MOST_COORDINATES

FRESH = 200  # starts that a result is judged from, none of which the search has seen


def judge_task(
    task: Task,
    skill: Skill,
    certificate: Certificate,
    *,
    shown: Mapping[str, DemonstrationSet] | None = None,
    like: Mapping[str, Skill] | None = None,
    seed: int = 1,
) -> TaskVerdict:
    """Return whether a skill does a task, from ``FRESH`` drawn starts and the corners of the start box.

    What is proved is about undisturbed motions from anywhere in the box; what is measured is about the
    motions that were followed.

    Args:
        task: The clauses.
        skill: Judged as it is.
        certificate: What is proved of it.
        shown: Demonstrations of each clause that compares with some, by its name.
        like: Skill of each clause that compares with one, by its name.
        seed: Of the starts.

    Raises:
        UsageError: The task has another dimension than the skill.
    """
    drawn = task.start.drawn(FRESH, seed)
    corners = task.start.corners() if len(drawn) == FRESH else drawn[:0]
    judge = Judge.of(task, skill, np.concatenate([drawn, corners]), shown, like)
    margins = judge.trial(skill)
    reach = _reach(task, skill, certificate)
    held = np.ones(len(drawn), dtype=bool)
    verdicts = []
    for name, clause in task.clauses.items():
        values, rows = margins[name], judge.rows[name]
        if rows.start == 0:
            held &= values[: len(drawn)] >= 0
        worst = int(np.argmin(values))
        bound = proved_margin(clause, task, skill, certificate, reach)
        verdicts.append(
            ClauseVerdict(
                clause=name,
                unit=clause.unit,
                margin=float(values[worst]),
                worst_start=tuple(judge.starts[rows][worst].tolist()),
                proved=bound is not None and bound >= 0,
                bound=bound,
            )
        )
    count = int(held.sum())
    return TaskVerdict(tuple(verdicts), len(drawn), count, wilson_interval(count, len(drawn)))


def proved_margin(
    clause: Clause, task: Task, skill: Skill, certificate: Certificate, reach: Reach | None
) -> float | None:
    """Return the margin of a clause that is proved for every start in the box; None if nothing is proved.

    - ``target``: every motion converges to it, so it comes as near as the tolerance, and stays.
    - ``stay-in``: the box around {V ≤ c}, c the largest V in the start box, lies in the clause's box.
    - ``keep-out``: that box lies beside the box around the body; nothing is proved if it does not.
    - ``time``: √V falls by e^(−r t); the bound is far above what is measured.
    - ``period``: the certificate's.
    """
    at_target = bool((retargeted(skill, task.target.position).attractors == skill.attractors).all())
    if isinstance(clause, Target):
        return clause.tolerance if certificate.scope == "global" and at_target else None
    if isinstance(clause, PeriodLimit):
        return None if certificate.period is None else certificate.period - clause.most
    if reach is None:
        return None
    if isinstance(clause, StayIn):
        k = len(clause.low)
        low = min(a - b for a, b in zip(reach.low[:k], clause.low, strict=True))
        return min(low, *(b - a for a, b in zip(reach.high[:k], clause.high, strict=True)))
    if isinstance(clause, KeepOutClause):
        beside = _apart(reach, *clause.body("body").bounds) - clause.clearance - task.hand_radius
        return beside if beside >= 0 else None
    if isinstance(clause, TimeLimit) and at_target and reach.arrival is not None:
        return clause.most - reach.arrival if reach.arrival_distance <= task.target.tolerance else None
    return None


def _reach(task: Task, skill: Skill, certificate: Certificate) -> Reach | None:
    """Return where motions from the start box can go, if a clause asks for it and something is proved."""
    asked = any(isinstance(clause, StayIn | KeepOutClause | TimeLimit) for clause in task.clauses.values())
    low, high = task.start.box
    if not asked or len(low) > MOST_COORDINATES:
        return None
    k = skill.space.positions
    return bound_reach(skill, certificate, low[:k], high[:k])


def _apart(reach: Reach, low: FloatArray, high: FloatArray) -> float:
    """Return how far the box that motions stay in is from another one, (k,) each; negative if they meet."""
    k = len(low)
    return float(np.maximum(low - np.array(reach.high[:k]), np.array(reach.low[:k]) - high).max())
