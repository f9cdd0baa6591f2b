"""What a picture of a task shows: the clauses that are places, and motions with their margins."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from skillctl.adapt.clauses import StayIn, Via
from skillctl.adapt.judge import AMPLE, Judge, follow
from skillctl.adapt.keep_out import KeepOutClause
from skillctl.adapt.task_file import Task
from skillctl.errors import UsageError
from skillctl.model.demonstration import DemonstrationSet
from skillctl.model.skill import Skill
from skillctl.plotting.task import SIDES, TaskPicture

DRAWN = 40  # motions


def task_picture(
    task: Task,
    skill: Skill,
    *,
    shown: Mapping[str, DemonstrationSet] | None = None,
    like: Mapping[str, Skill] | None = None,
) -> TaskPicture:
    """Return what is drawn of a task and of a skill's motions from starts spread over the start box.

    Raises:
        UsageError: Positions that have neither two nor three coordinates.
    """
    space = skill.space
    k = space.positions
    if k not in SIDES:
        raise UsageError(f"plot: a task with {k} coordinates has no picture.", hint="Leave out --plot.")
    starts = task.start.spread(DRAWN)
    judge = Judge.of(task, skill, starts, shown, like)
    margins = judge.trial(skill)
    own = [margins[name] / judge.scales[name] for name in task.clauses if judge.rows[name].start == 0]
    worst = np.clip(np.min(own, axis=0), -AMPLE, AMPLE)
    states, _ = follow(skill, judge.starts[: len(starts)], task)
    low, high = task.start.box
    clauses = task.clauses.items()
    return TaskPicture(
        title=f"{len(starts)} motions, {int((worst >= 0).sum())} of which fulfil every clause",
        names=space.names[:k],
        unit=space.unit,
        low=low[:k],
        high=high[:k],
        target=judge.target[:k],
        tolerance=task.target.tolerance,
        bodies=[(name, c.outline()) for name, c in clauses if isinstance(c, KeepOutClause)],
        passed=[(np.array(c.point), c.within) for _, c in clauses if isinstance(c, Via)],
        kept=[(np.array(c.low), np.array(c.high)) for _, c in clauses if isinstance(c, StayIn)],
        motions=states[..., :k],
        margins=worst,
    )
