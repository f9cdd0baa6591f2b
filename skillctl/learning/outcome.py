"""How the iterations of learning end: converged or not, and how much the last steps still gained."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Result(Enum):
    """Why an iteration stopped; the value is the reason in words."""

    CONVERGED = "converged"
    OUT_OF_STEPS = "ran out of steps"
    NO_BETTER_STEP = "found no better step"


@dataclass(frozen=True, slots=True)
class StageResult:
    """How one stage of learning ended.

    Attributes:
        stage: ``metric`` (P), ``mixture`` (EM), ``polish`` (the optimiser) or ``refine`` (the optimiser
            again, with finer rollouts).
        result: Why it stopped.
        steps: How many steps it took.
        late_gain: By which share the last three steps together lowered the cost; None if not measured.
    """

    stage: str
    result: Result
    steps: int
    late_gain: float | None = None

    def __str__(self) -> str:
        return f"{self.stage}: {self.result.value} after {self.steps} steps"
