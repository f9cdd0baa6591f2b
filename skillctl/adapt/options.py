"""What a user may choose about fitting a merger to a task."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias

from skillctl.demonstrations.options import Reading
from skillctl.options import option

FitLevel: TypeAlias = Literal["part", "component"]

TASK = "Fitting to a task"


@dataclass(frozen=True)
class TaskOptions:
    """What a merger is fitted to.

    Attributes:
        demonstrations: Files with demonstrations of the new task.
        level: One weight per part, or ``component``: also one factor per component.
        from_store: Take the parts from all skills of the store that have the same state space.
        reading: How the files are read.
    """

    demonstrations: tuple[Path, ...] = option(
        (),
        name="fit",
        repeated=True,
        metavar="DEMO",
        group=TASK,
        help="Choose the weights so that the motion is near to the demonstrations in this file; give it "
        "again for more files.",
    )
    level: FitLevel = option(
        "part",
        name="fit-level",
        group=TASK,
        help="part: one weight a skill; component: also one factor a Gaussian component.",
    )
    from_store: bool = option(
        False, group=TASK, help="Merge the few skills of the store that help with the task."
    )
    reading: Reading = field(default_factory=Reading)
